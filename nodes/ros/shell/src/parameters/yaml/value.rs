//! Value of a parameter, and the type that rcl gives a plain scalar.

use super::number::{c_double, c_integer};

/// Value of a parameter. The items of a list are scalars of one type.
#[derive(Clone, Debug, PartialEq)]
pub enum Yaml {
    /// `true` or `false`, also written `yes`, `on`, `y` or `no`, `off`, `n`.
    Bool(bool),
    /// An integer as C reads it: decimal, `0x1f`, octal `017`.
    Integer(i64),
    /// A number as C reads it, `.inf` or `.nan`.
    Float(f64),
    /// A quoted text, or a plain one that is no other scalar.
    String(String),
    /// A list, possibly empty.
    List(Vec<Yaml>),
}

impl Yaml {
    /// Parses a plain scalar, without quotes and tag.
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

    /// Returns type and value in words, for messages: `the integer 3`.
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
