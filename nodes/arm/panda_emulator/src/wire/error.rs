//! Sizes of messages, and bytes that are none.

/// Size of a header, bytes: command, identifier, size with the header.
pub const HEADER_BYTES: usize = 12;
/// Largest size of a request that the server reads, bytes. Chosen: ten times the largest of both versions (428).
pub const REQUEST_BYTES_MAX: u32 = 4096;

/// Bytes of a client that are no message of its version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Wrong length.
    #[error("{what}: expected {expected} bytes, got {got}")]
    Length {
        /// Structure.
        what: &'static str,
        /// Bytes by the layout.
        expected: usize,
        /// Bytes that came.
        got: usize,
    },
    /// Size field of a header out of range.
    #[error("header of command {command}: expected a size of {HEADER_BYTES} to {REQUEST_BYTES_MAX} bytes, got {size}")]
    Size {
        /// Command of the header.
        command: u32,
        /// Size of the header.
        size: u32,
    },
    /// Command that the version does not have.
    #[error("expected a command of FCI {version}, got {command}")]
    UnknownCommand {
        /// Version of the server.
        version: u16,
        /// Command that came.
        command: u32,
    },
    /// Value that the layout cannot have. The server answers "invalid argument".
    #[error("{what}: {expected}")]
    Value {
        /// Field.
        what: &'static str,
        /// Expected values.
        expected: &'static str,
    },
}
