//! Parameter values as rcl reads them from parameter files and from `-p name:=value`.
//!
//! rcl reads the events of libyaml and has its own rules for scalars: those of C's `strtoll` and `strtod`, not those
//! of YAML. `0o17` and `null` are strings, `010` is 8, `08` is 8.0, and `nan` is a number.

mod events;
mod number;
mod slot;

pub use events::YamlEvents;
pub(crate) use events::{Event, Events};
pub(crate) use slot::Slot;

use number::{c_double, c_integer};

/// A value that a parameter can have. The items of a list are scalars of one type.
#[derive(Clone, Debug, PartialEq)]
pub enum Yaml {
    /// `true` or `false`, also written `yes`, `on`, `y` or `no`, `off`, `n`.
    Bool(bool),
    /// An integer as C reads it: decimal, `0x1f`, octal `017`.
    Integer(i64),
    /// A number as C reads it, `.inf` or `.nan`.
    Float(f64),
    /// A quoted text, or a plain one that is none of the others.
    String(String),
    /// A list, perhaps empty.
    List(Vec<Yaml>),
}

impl Yaml {
    /// Reads the value after `:=` of `-p`. Of several documents the last counts.
    ///
    /// # Errors
    /// The reason in words, with line and column where the text is not YAML.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (mut slot, mut list) = (Slot::default(), None);
        for event in Events::new(text) {
            match event?.0 {
                Event::Scalar(scalar) => match &mut list {
                    None => slot.set(scalar.value()?, ""),
                    Some(kind) => slot.push(scalar.value()?, kind, "")?,
                },
                Event::ListStart => list = Some(None),
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

    /// Reads a plain scalar, one without quotes or a tag.
    #[must_use]
    pub fn of_plain(text: &str) -> Self {
        match text {
            "Y" | "y" | "yes" | "Yes" | "YES" | "true" | "True" | "TRUE" | "on" | "On" | "ON" => Self::Bool(true),
            "N" | "n" | "no" | "No" | "NO" | "false" | "False" | "FALSE" | "off" | "Off" | "OFF" => Self::Bool(false),
            _ => c_integer(text)
                .map(Self::Integer)
                .or_else(|| c_double(text).map(Self::Float))
                .unwrap_or_else(|| Self::String(text.to_owned())),
        }
    }

    /// The kind and the value in words, for messages: `the integer 3`.
    #[must_use]
    pub fn describe(&self) -> String {
        match self {
            Self::Bool(value) => format!("the boolean {value}"),
            Self::Integer(value) => format!("the integer {value}"),
            Self::Float(value) => format!("the number {value:?}"),
            Self::String(value) => format!("the string {value:?}"),
            Self::List(items) => format!("a list of {}", items.len()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_yaml_is_refused_with_its_place() {
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
