//! Errors of model files, with line and field.

use super::outline::{Content, Node};
use crate::spelling::did_you_mean;
use serde_saphyr::{Error as YamlError, MessageFormatter, UserMessageFormatter};
use std::fmt;
use thiserror::Error;

/// Place of an error in a model file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Place {
    /// Line in the text, from 1; none if the model was not read from a text.
    pub line: Option<usize>,
    /// Path of the field, such as `theta.length_m.prior`; empty for the whole model.
    pub field: String,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.line, self.field.as_str()) {
            (Some(line), "") => write!(f, "line {line}"),
            (Some(line), field) => write!(f, "line {line}, `{field}`"),
            (None, "") => write!(f, "model"),
            (None, field) => write!(f, "model, `{field}`"),
        }
    }
}

/// Reason for which a model is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ModelError {
    /// Value of a field that makes no sense.
    #[error("{place}: expected {expected}, got {got}")]
    Value {
        /// Place of the error.
        place: Place,
        /// Expected value.
        expected: String,
        /// Given value.
        got: String,
    },
    /// Text that is no model.
    #[error("{place}: {what}")]
    Text {
        /// Place of the error.
        place: Place,
        /// Description of the error.
        what: String,
    },
}

/// Maximum number of characters of a value that a message quotes. Chosen: a line of a message.
const QUOTED: usize = 60;

impl ModelError {
    /// Error about the value of a field.
    pub fn value(field: impl Into<String>, expected: impl Into<String>, got: impl fmt::Display) -> Self {
        let place = Place { line: None, field: field.into() };
        Self::Value { place, expected: expected.into(), got: got.to_string() }
    }

    /// Error about a field, in free words.
    pub fn text(field: impl Into<String>, what: impl fmt::Display) -> Self {
        Self::Text { place: Place { line: None, field: field.into() }, what: what.to_string() }
    }

    /// Rejects a value outside `[low, high]`. NaN counts as outside.
    pub(crate) fn within(field: &str, [low, high]: [f64; 2], unit: &str, v: f64) -> Result<(), Self> {
        if (low..=high).contains(&v) {
            return Ok(());
        }
        // Rounded for the message: 2 pi has too many digits.
        let [from, to] = [low, high].map(|limit| (limit * 1e5).round() / 1e5);
        Err(Self::value(field, format!("{from} to {to} {unit}"), v))
    }

    /// Changes the path of the field.
    #[must_use]
    pub(super) fn with_field(mut self, change: impl FnOnce(&str) -> String) -> Self {
        let (Self::Value { place, .. } | Self::Text { place, .. }) = &mut self;
        place.field = change(&place.field);
        self
    }

    /// Adds the line of the field in the text of the model file, if the error has none.
    #[must_use]
    pub fn in_text(mut self, text: &str) -> Self {
        let (Self::Value { place, .. } | Self::Text { place, .. }) = &mut self;
        if place.line.is_none() {
            place.line = Node::of(text).map(|outline| outline.line_of(&place.field));
        }
        self
    }

    /// Converts an error of the YAML reader, with its place in the text.
    pub(super) fn from_yaml(error: &YamlError, text: &str, outline: Option<&Node>) -> Self {
        let error = error.without_snippet();
        let location = error.location();
        let at = location.and_then(|l| l.span().byte_offset());
        let found = at.zip(outline).map(|(at, outline)| outline.at(at as usize));
        let (mut field, value) = found.map_or((String::new(), None), |(path, node)| (path, Some(node)));
        let line = location.map(|l| l.line() as usize);
        // The reader reports a tab as an unexpected token, which does not help: YAML indents by spaces alone.
        let begins_with_tab = |l: &str| l.trim_start_matches(' ').starts_with('\t');
        if line.and_then(|l| text.lines().nth(l - 1)).is_some_and(begins_with_tab) {
            let place = Place { line, field };
            return Self::Value { place, expected: "spaces before the field".into(), got: "a tab".into() };
        }
        let expected = match error {
            YamlError::InvalidScalar { ty, .. } => match *ty {
                "floating point" => "a number",
                ty if ty.starts_with('u') => "a whole number of at least 0",
                ty => ty,
            },
            YamlError::Unexpected { expected: "mapping start", .. } => "fields of its own",
            YamlError::Unexpected { expected: "sequence start", .. } => "a list",
            YamlError::Unexpected { expected, .. } => expected,
            YamlError::SerdeMissingField { .. } => {
                // The reader points at the last field that exists; the missing one belongs to the map around it.
                field.truncate(field.rfind('.').unwrap_or_default());
                ""
            }
            _ => "",
        };
        let place = Place { line, field };
        if expected.is_empty() {
            let mut what = UserMessageFormatter.format_message(error).replace('\n', " ");
            if let YamlError::SerdeUnknownField { field, expected, .. } = error {
                what += &did_you_mean(field, expected.iter().map(AsRef::as_ref));
            }
            return Self::Text { place, what };
        }
        let got = match value.map(|v| &v.content) {
            Some(Content::Scalar(text)) => match text.char_indices().nth(QUOTED) {
                None => format!("`{text}`"),
                // A file of another kind may be one long text to the reader.
                Some((end, _)) => format!("`{} ...`", &text[..end]),
            },
            Some(Content::Map { .. }) => "fields".to_owned(),
            Some(Content::List { .. }) => "a list".to_owned(),
            None => "something else".to_owned(),
        };
        Self::Value { place, expected: expected.to_owned(), got }
    }
}
