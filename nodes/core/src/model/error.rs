//! What is wrong with a model file, and where.

use super::outline::{Content, Node};
use crate::spelling::did_you_mean;
use serde_saphyr::{Error as YamlError, MessageFormatter, UserMessageFormatter};
use std::fmt;
use thiserror::Error;

/// Where in a model file something is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Place {
    /// Line in the text, from 1; none where the model was not read from a text.
    pub line: Option<usize>,
    /// Path of the field, such as `theta.length_m.prior`; empty for the whole.
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

/// Why a model was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ModelError {
    /// A field's value makes no sense.
    #[error("{place}: expected {expected}, got {got}")]
    Value {
        /// Where.
        place: Place,
        /// What was expected.
        expected: String,
        /// What came.
        got: String,
    },
    /// The text is no model.
    #[error("{place}: {what}")]
    Text {
        /// Where.
        place: Place,
        /// What is wrong.
        what: String,
    },
}

impl ModelError {
    /// A value that makes no sense, in the field at a path.
    pub fn value(field: impl Into<String>, expected: impl Into<String>, got: impl fmt::Display) -> Self {
        let place = Place { line: None, field: field.into() };
        Self::Value { place, expected: expected.into(), got: got.to_string() }
    }

    /// Something else that is wrong with the field at a path.
    pub fn text(field: impl Into<String>, what: impl fmt::Display) -> Self {
        Self::Text { place: Place { line: None, field: field.into() }, what: what.to_string() }
    }

    /// The same, with the line at which its field stands in the model file's text.
    #[must_use]
    pub fn in_text(mut self, text: &str) -> Self {
        let (Self::Value { place, .. } | Self::Text { place, .. }) = &mut self;
        if place.line.is_none() {
            place.line = Node::of(text).map(|outline| outline.line_of(&place.field));
        }
        self
    }

    /// What the YAML reader has to say, at the place in the text where it says so.
    pub(super) fn from_yaml(error: &YamlError, text: &str, outline: Option<&Node>) -> Self {
        let error = error.without_snippet();
        let location = error.location();
        let at = location.and_then(|l| l.span().byte_offset());
        let found = at.zip(outline).map(|(at, outline)| outline.at(at as usize));
        let (mut field, value) = found.map_or((String::new(), None), |(path, node)| (path, Some(node)));
        let line = location.map(|l| l.line() as usize);
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
                // The reader names the last field that is there.
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
            Some(Content::Scalar(text)) => format!("`{text}`"),
            Some(Content::Map { .. }) => "fields".to_owned(),
            Some(Content::List { .. }) => "a list".to_owned(),
            None => "something else".to_owned(),
        };
        Self::Value { place, expected: expected.to_owned(), got }
    }
}
