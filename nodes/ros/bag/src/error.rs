//! Errors of bags.

use catenary_core::episode::EpisodeError;
use catenary_shell::ShellError;
use catenary_shell::convert::ConvertError;
use std::path::PathBuf;
use thiserror::Error;

/// Reason for which a bag cannot be written, read, imported, recorded or replayed.
#[derive(Debug, Error)]
pub enum BagError {
    /// Path without a bag.
    #[error("{}: expected a bag folder or an .mcap or .db3 file, found {found}", path.display())]
    NotABag {
        /// Given path.
        path: PathBuf,
        /// Description of the thing at the path.
        found: String,
    },
    /// Bag of a kind that is not supported.
    #[error("{}: {found} not supported yet; {remedy}", path.display())]
    Unsupported {
        /// Bag or file.
        path: PathBuf,
        /// Description of the kind, with its verb.
        found: String,
        /// Advice to the user.
        remedy: &'static str,
    },
    /// Folder of a new bag that already exists.
    #[error("{}: expected a folder that does not exist yet, because a bag is never overwritten", path.display())]
    Exists {
        /// Folder.
        path: PathBuf,
    },
    /// Refusal by the file system.
    #[error("{}: cannot {action}: {reason}", path.display())]
    Io {
        /// Attempted action.
        action: &'static str,
        /// File of the action.
        path: PathBuf,
        /// Reason of the file system.
        reason: std::io::Error,
    },
    /// Failed write. The file ends with its last complete chunk.
    #[error("{}: cannot write any further: {reason}; the {safe} messages up to the last complete chunk are safe", path.display())]
    Write {
        /// File.
        path: PathBuf,
        /// Reason of the failure.
        reason: String,
        /// Number of messages that can be read back.
        safe: u64,
    },
    /// Damaged chunk or message of a file. The others can be read.
    #[error("{}: damaged at byte {offset}: {reason}", path.display())]
    Damaged {
        /// File.
        path: PathBuf,
        /// Byte offset of the damaged record.
        offset: u64,
        /// Description of the damage.
        reason: String,
    },
    /// Message that cannot be decompressed. The others can be read.
    #[error("{}: topic {topic}: the message logged at {log_time_ns} ns: {reason}", path.display())]
    Unpack {
        /// File.
        path: PathBuf,
        /// Name of the topic.
        topic: String,
        /// Log time in ns.
        log_time_ns: i64,
        /// Damage, or size and limit.
        reason: String,
    },
    /// File whose decompressed size is above the limit of a scratch file.
    #[error("{}: expected at most {limit} bytes after decompression ({reason}), got {got}; where there is space, `zstd -d` makes a file that is read without a copy", path.display())]
    Scratch {
        /// Compressed file.
        path: PathBuf,
        /// Limit in bytes.
        limit: u64,
        /// Source of the limit.
        reason: String,
        /// Size in bytes, or `more` if the file does not state it.
        got: String,
        /// True if the free space sets the limit: with more of it, the same file can be read.
        is_of_disk: bool,
    },
    /// End of a long reading by Ctrl-C.
    #[error("{}: interrupted while it was read", path.display())]
    Interrupted {
        /// Bag or file.
        path: PathBuf,
    },
    /// Chunks that overlap in log time, and hold more messages together than memory may.
    #[error("{}: expected chunks that overlap in log time to hold at most {limit} bytes together, got more: later messages are not in order of their log times", path.display())]
    Overlap {
        /// Bag.
        path: PathBuf,
        /// Limit in bytes.
        limit: usize,
    },
    /// Database of sqlite3 that is damaged or cannot be opened.
    #[error("{}: {reason}", path.display())]
    Database {
        /// File.
        path: PathBuf,
        /// Message of sqlite.
        reason: String,
    },
    /// Topic with another type, or another version of its type, than expected.
    #[error("topic {topic}: expected {expected}, found {found}")]
    Type {
        /// Name of the topic.
        topic: String,
        /// Expected type.
        expected: String,
        /// Recorded type.
        found: String,
    },
    /// Message whose bytes cannot be decoded as the topic's type.
    #[error("topic {topic}: the message logged at {log_time_ns} ns: {reason}")]
    Message {
        /// Name of the topic.
        topic: String,
        /// Log time in ns.
        log_time_ns: i64,
        /// Description of the defect.
        reason: String,
    },
    /// Bag without any of the needed topics.
    #[error("{}: needs {needed}; found {found}", path.display())]
    NoTopic {
        /// Bag.
        path: PathBuf,
        /// Needed topics; one of them is enough.
        needed: String,
        /// Topics of the bag.
        found: String,
    },
    /// Episode that is absent or incomplete.
    #[error("{}: {reason}", path.display())]
    Episode {
        /// Bag.
        path: PathBuf,
        /// Missing episode or records.
        reason: EpisodeError,
    },
    /// Invalid value in a CSV track.
    #[error("{file}: line {line}, column {column}: expected {expected}, got {got}")]
    Csv {
        /// Name of the file.
        file: String,
        /// Line in the file, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// Expected value.
        expected: String,
        /// Given value.
        got: String,
    },
    /// Column of a CSV track in another unit.
    #[error("{file}: lines {} to {}, column {column}: {doubt}", lines[0], lines[1])]
    Unit {
        /// Name of the file.
        file: String,
        /// Lines of the first and the last row.
        lines: [u64; 2],
        /// Name of the column.
        column: &'static str,
        /// Expected and received values.
        doubt: String,
    },
    /// Track without any point in the image of the model's camera.
    #[error(
        "{file}: expected points in metres within the image of the model's camera, got all {points} outside of it, the first of line {line} at ({}, {}) m: check that the track is in m and belongs to this model; a {view}",
        first_m[0], first_m[1]
    )]
    OutOfView {
        /// Name of the file.
        file: String,
        /// Line of the first row.
        line: u64,
        /// Number of points of the track.
        points: usize,
        /// (x, z) in m of the first point.
        first_m: [f64; 2],
        /// Fields of the camera that would show all points.
        view: String,
    },
    /// Setting that makes no sense.
    #[error("{name}: expected {expected}, got {got}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Expected value.
        expected: String,
        /// Given value.
        got: String,
    },
    /// Invalid file of QoS overrides.
    #[error("QoS overrides {}: {reason}", path.display())]
    Overrides {
        /// File.
        path: PathBuf,
        /// Defect and its place.
        reason: String,
    },
    /// Replay that was refused or stopped, because a real arm may listen.
    #[error("not replayed: {0}")]
    Refused(String),
    /// Message with a field that makes no sense.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// Failure of the ROS 2 graph.
    #[error(transparent)]
    Shell(#[from] ShellError),
}

impl BagError {
    /// Constructor of [`BagError::Io`] for `map_err`.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |reason| Self::Io { action, path, reason }
    }
}
