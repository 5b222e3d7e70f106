//! Parameter values as rcl reads them from parameter files and from `-p name:=value`.
//!
//! rcl reads the events of libyaml and has its own rules for scalars: the rules of C's `strtoll` and `strtod` instead of YAML's.
//! `0o17` and `null` are strings, `010` is 8, `08` is 8.0, and `nan` is a number. Hand-written: these rules are rcl's own.

mod events;
mod number;
mod slot;
mod value;

pub use events::YamlEvents;
pub(crate) use events::{Event, Events};
pub(crate) use slot::Slot;
pub use value::Yaml;

impl Yaml {
    /// Parses the value after `:=` of `-p`. Of several documents the last one takes effect.
    ///
    /// # Errors
    /// Reason in words, with line and column for a text that is not YAML.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (mut slot, mut list) = (Slot::default(), None);
        for event in Events::new(text) {
            match event?.0 {
                Event::Scalar(scalar) => match &mut list {
                    None => slot.set(scalar.value()?, ""),
                    Some(kind) => slot.push(scalar.value()?, kind, "")?,
                },
                Event::ListStart => list = Some(None),
                // The typed items are in the slot already; only an empty list is set here.
                Event::ListEnd => {
                    slot.end_list(list.take().flatten(), "");
                }
                Event::MapStart | Event::MapEnd => return Err("expected a value or a list, got a map".to_owned()),
                Event::Alias => {
                    return Err("expected a value, got an alias; quote a text that starts with *".to_owned());
                }
                Event::DocumentEnd => {}
            }
        }
        slot.value().map(|(value, _)| value.clone()).ok_or_else(|| "expected a value, got nothing".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_yaml_is_refused_with_its_position() {
        for (text, reason) in [
            ("[1", "line 1 column"),
            ("''*''", "line 1 column"),
            ("*a", "alias"),
            ("{a: 1}", "got a map"),
            ("", "got nothing"),
            ("# a", "got nothing"),
            ("!!str", "got nothing"),
            ("- ", "got nothing"),
            ("[1, 2.5]", "all of one type, got the number 2.5 after the integer 1"),
        ] {
            let error = Yaml::parse(text).unwrap_err();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }
}
