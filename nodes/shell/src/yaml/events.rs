//! Events of a YAML text, as libyaml gives them to rcl.

use super::Yaml;
use libyaml_safer::{EventData, Parser, STR_TAG, ScalarStyle};
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// An event that has a meaning for parameters.
pub(crate) enum Event {
    /// A key, a value or an item.
    Scalar(Scalar),
    /// The begin of a list.
    ListStart,
    /// Its end.
    ListEnd,
    /// The begin of a map.
    MapStart,
    /// Its end.
    MapEnd,
    /// `*name`.
    Alias,
    /// The end of a document.
    DocumentEnd,
}

/// A scalar before its type is known.
pub(crate) struct Scalar {
    /// The text, without quotes.
    pub(crate) text: String,
    is_quoted: bool,
    is_tagged_string: bool,
}

impl Scalar {
    /// The value as rcl types it.
    pub(crate) fn value(self) -> Result<Yaml, String> {
        if self.text.is_empty() && !self.is_quoted {
            return Err("expected a value, got nothing; an empty text is ''".to_owned());
        }
        // rcl knows one tag, !!str.
        if self.is_quoted || self.is_tagged_string {
            Ok(Yaml::String(self.text))
        } else {
            Ok(Yaml::of_plain(&self.text))
        }
    }
}

/// Events with their lines, counted from 1. The first error ends them.
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

/// Events of a YAML text in libyaml's own form, to the end of the stream or to the first error.
pub struct YamlEvents<'a> {
    parser: Parser<Input<'a>>,
    /// Characters of the text, where its last line has no end of its own.
    cut_at: Option<u64>,
    is_over: bool,
}

type Input<'a> = std::io::Chain<&'a [u8], &'static [u8]>;

impl<'a> YamlEvents<'a> {
    /// The events of `text`.
    #[must_use]
    pub fn new(text: &'a str) -> Self {
        // The parser panics where a block scalar ends without the end of its line.
        let cut_at = (!text.ends_with('\n')).then(|| text.chars().count() as u64);
        let end: &[u8] = if cut_at.is_some() { b"\n" } else { b"" };
        let mut parser = Parser::new();
        parser.set_input(text.as_bytes().chain(end));
        Self { parser, cut_at, is_over: false }
    }
}

impl Iterator for YamlEvents<'_> {
    /// An event, or the reason for which the text is not YAML, with line and column.
    type Item = Result<libyaml_safer::Event, String>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        // The parser panics at a tag with a comma behind it, `[!a,b]`, which neither rcl nor Python take for YAML.
        let parse = AssertUnwindSafe(|| self.parser.parse().map_err(|error| error.to_string()));
        let mut event = catch_unwind(parse).unwrap_or_else(|_| Err("a tag without a value".to_owned()));
        self.is_over = !matches!(&event, Ok(event) if event.data != EventData::StreamEnd);
        if let Ok(event) = &mut event {
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
