//! Errors of the command line and of parameter files.

use crate::parameters::files;
use crate::parameters::names::NameError;
use std::path::PathBuf;
use thiserror::Error;

/// Error in the command line, or in a file that it names.
#[derive(Debug, Error)]
pub enum ArgError {
    /// Option without its value.
    #[error("{option}: expected {expected} after it, got the end of the arguments")]
    MissingValue {
        /// The option.
        option: String,
        /// Expected value.
        expected: &'static str,
    },
    /// Value of the wrong form.
    #[error("{option} {value:?}: expected {expected}")]
    BadValue {
        /// The option.
        option: String,
        /// The value.
        value: String,
        /// Expected form.
        expected: String,
    },
    /// Unknown option between `--ros-args` and `--`.
    #[error("--ros-args: unknown option {0:?}; expected -r, -p, --params-file, --log-level, --enable-* or --disable-*")]
    UnknownOption(String),
    /// Parameter file that cannot be read.
    #[error("{}: cannot read the parameter file: {reason}{}", path.display(), files::hint(path))]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the file system.
        reason: std::io::Error,
    },
    /// Parameter file that is not YAML.
    #[error("{}: not YAML: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Message of the parser.
        reason: String,
    },
    /// Parameter file of the wrong structure.
    #[error("{}:{line}: {field}: expected {expected}, got {got}", path.display())]
    Structure {
        /// The file.
        path: PathBuf,
        /// Line in the file, from 1.
        line: u64,
        /// Path of keys in the file.
        field: String,
        /// Expected structure.
        expected: &'static str,
        /// Content of the file.
        got: String,
    },
    /// Remap to an invalid node name or namespace.
    #[error("--remap {rule}: {reason}")]
    Name {
        /// The rule.
        rule: String,
        /// Error of the name.
        reason: NameError,
    },
}
