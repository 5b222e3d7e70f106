//! Errors of tracking.

use convnet::{Stopped, WeightsError};
use thiserror::Error;

/// Reason for which a mask gave no keypoints. A mask without the object is no error: its scores are 0.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum Error {
    /// A parameter, or a field of an image message, is out of range.
    #[error("{field}: expected {expected}, got {got}")]
    Parameter {
        /// Name of the parameter or field.
        field: &'static str,
        /// Values that it may take.
        expected: &'static str,
        /// Value that was given.
        got: String,
    },
    /// The number of bytes is not width times height, or is zero.
    #[error("a mask of {width} x {height} pixels needs as many bytes, at least one, got {got}")]
    Size {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Number of bytes given.
        got: usize,
    },
    /// The mask holds a value that is no label.
    #[error("expected 0 (background), 1 (object) or 2 (target) in the mask, got {label} in column {u}, row {v}")]
    UnknownLabel {
        /// Value that is no label.
        label: u8,
        /// Its column.
        u: usize,
        /// Its row.
        v: usize,
    },
    /// Weights of another network.
    #[error("weights of the tracker `{network}`, as `catenary train-tracker` of this version writes them: {fault}")]
    Weights {
        /// Name of the tracker.
        network: &'static str,
        /// What is wrong with them.
        fault: WeightsError,
    },
    /// A training that ended early.
    #[error(transparent)]
    Training(#[from] Stopped),
}

impl Error {
    /// Field or property at fault. The node counts dropped masks by it.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Parameter { field, .. } => field,
            Self::Size { .. } => "size",
            Self::UnknownLabel { .. } => "label",
            Self::Weights { .. } => "weights",
            Self::Training(_) => "training",
        }
    }
}
