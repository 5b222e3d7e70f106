//! Events of a YAML text, as libyaml passes them to rcl.

use super::value::Yaml;
use libyaml_safer::{EventData, Parser, STR_TAG, ScalarStyle};
use std::cell::Cell;
use std::io::Read;
use std::panic::{AssertUnwindSafe, UnwindSafe, catch_unwind};
use std::sync::Once;

thread_local! {
    /// True while this thread runs code whose panics are caught and must not be printed.
    static IS_SILENT: Cell<bool> = const { Cell::new(false) };
}

/// Runs `body`, and returns `None` if it panics. A panic of `body` is not printed. Panics of other code are printed as
/// before.
fn catch_silently<T>(body: impl FnOnce() -> T + UnwindSafe) -> Option<T> {
    static HOOK: Once = Once::new();
    // The hook of the process is wrapped once. It stays in force for every other panic of every thread.
    HOOK.call_once(|| {
        let print = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !IS_SILENT.get() {
                print(panic);
            }
        }));
    });
    IS_SILENT.set(true);
    let outcome = catch_unwind(body);
    IS_SILENT.set(false);
    outcome.ok()
}

/// Event with a meaning for parameters.
pub(crate) enum Event {
    /// Key, value or item.
    Scalar(Scalar),
    /// Start of a list.
    ListStart,
    /// End of a list.
    ListEnd,
    /// Start of a map.
    MapStart,
    /// End of a map.
    MapEnd,
    /// Alias, `*name`.
    Alias,
    /// End of a document.
    DocumentEnd,
}

/// Scalar before its type is determined.
pub(crate) struct Scalar {
    /// Text without quotes.
    pub(crate) text: String,
    is_quoted: bool,
    is_tagged_string: bool,
}

impl Scalar {
    /// Returns the value, with the type that rcl gives it.
    pub(crate) fn value(self) -> Result<Yaml, String> {
        if self.text.is_empty() && !self.is_quoted {
            return Err("expected a value, got nothing; write '' for an empty string".to_owned());
        }
        // rcl knows a single tag, !!str.
        if self.is_quoted || self.is_tagged_string {
            Ok(Yaml::String(self.text))
        } else {
            Ok(Yaml::of_plain(&self.text))
        }
    }
}

/// Iterator over events with their lines, counted from 1. It ends after the first error.
pub(crate) struct Events<'a>(YamlEvents<'a>);

impl<'a> Events<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        Self(YamlEvents::new(text))
    }
}

impl Iterator for Events<'_> {
    type Item = Result<(Event, u64), String>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let event = match self.0.next()? {
                Ok(event) => event,
                Err(reason) => return Some(Err(reason)),
            };
            let line = event.start_mark.line + 1;
            let event = match event.data {
                EventData::StreamStart { .. } | EventData::StreamEnd | EventData::DocumentStart { .. } => continue,
                EventData::DocumentEnd { .. } => Event::DocumentEnd,
                EventData::Alias { .. } => Event::Alias,
                EventData::SequenceStart { .. } => Event::ListStart,
                EventData::SequenceEnd => Event::ListEnd,
                EventData::MappingStart { .. } => Event::MapStart,
                EventData::MappingEnd => Event::MapEnd,
                EventData::Scalar { value, tag, style, .. } => Event::Scalar(Scalar {
                    text: value,
                    is_quoted: matches!(style, ScalarStyle::SingleQuoted | ScalarStyle::DoubleQuoted),
                    is_tagged_string: tag.as_deref() == Some(STR_TAG),
                }),
            };
            return Some(Ok((event, line)));
        }
    }
}

/// Iterator over the events of a YAML text, as libyaml reports them. It ends with the stream or after the first error.
pub struct YamlEvents<'a> {
    parser: Parser<Input<'a>>,
    /// Number of characters of a text without a final line end.
    cut_at: Option<u64>,
    is_over: bool,
}

type Input<'a> = std::io::Chain<&'a [u8], &'static [u8]>;

impl<'a> YamlEvents<'a> {
    /// Creates the iterator over the events of `text`.
    #[must_use]
    pub fn new(text: &'a str) -> Self {
        // The parser panics at a block scalar in a text without a final line end.
        let cut_at = (!text.ends_with('\n')).then(|| text.chars().count() as u64);
        let end: &[u8] = if cut_at.is_some() { b"\n" } else { b"" };
        let mut parser = Parser::new();
        parser.set_input(text.as_bytes().chain(end));
        Self { parser, cut_at, is_over: false }
    }
}

impl Iterator for YamlEvents<'_> {
    /// Event, or the reason why the text is not YAML, with line and column.
    type Item = Result<libyaml_safer::Event, String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        // libyaml-safer 0.3.0 panics at some texts, such as a tag before a comma, `[!a,b]`. Neither rcl nor Python take them for YAML.
        let parse = AssertUnwindSafe(|| self.parser.parse().map_err(|error| error.to_string()));
        let mut event = catch_silently(parse).unwrap_or_else(|| Err("a tag without a value".to_owned()));
        self.is_over = !matches!(&event, Ok(event) if event.data != EventData::StreamEnd);
        if let Ok(event) = &mut event {
            // The added line end must not become part of the last block scalar.
            let is_last = self.cut_at.is_some_and(|end| event.end_mark.index > end);
            if let EventData::Scalar { value, style: ScalarStyle::Literal | ScalarStyle::Folded, .. } = &mut event.data
                && is_last
                && value.ends_with('\n')
            {
                value.pop();
            }
        }
        Some(event)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_at_which_the_parser_panics_is_an_error_and_later_panics_are_printed() {
        let last = |text| YamlEvents::new(text).last().unwrap();
        assert_eq!(last("[!a,b]").err().as_deref(), Some("a tag without a value"));
        assert!(!IS_SILENT.get());
        assert!(last("[a, b]").is_ok());
    }
}
