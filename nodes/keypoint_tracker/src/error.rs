//! Errors.

use thiserror::Error;

/// Why there are no keypoints. That the object is not in the mask is no error: its scores are then 0.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum Error {
    /// A parameter is out of range.
    #[error("{field}: expected {expected}, got {got}")]
    Parameter {
        /// The parameter's name.
        field: &'static str,
        /// What values it may take.
        expected: &'static str,
        /// The value given.
        got: String,
    },
    /// The mask's bytes do not fill it.
    #[error("a mask of {width} x {height} pixels needs as many bytes, at least one, got {got}")]
    Size {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Bytes given.
        got: usize,
    },
    /// The mask holds a value that is no label.
    #[error("expected 0 (background), 1 (object) or 2 (target) in the mask, got {label} in column {u}, row {v}")]
    UnknownLabel {
        /// The value.
        label: u8,
        /// Its column.
        u: usize,
        /// Its row.
        v: usize,
    },
}

impl Error {
    /// Field or property at fault, by which dropped masks are counted.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Parameter { field, .. } => field,
            Self::Size { .. } => "size",
            Self::UnknownLabel { .. } => "label",
        }
    }
}
