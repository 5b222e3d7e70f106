//! What can go wrong with a bag.

use catenary_core::episode::EpisodeError;
use catenary_shell::ShellError;
use catenary_shell::convert::ConvertError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a bag cannot be written, read, imported, recorded or replayed.
#[derive(Debug, Error)]
pub enum BagError {
    /// There is no bag at the path.
    #[error("{}: expected a bag folder or an .mcap or .db3 file, found {found}", path.display())]
    NotABag {
        /// The path that was given.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// A bag, but of a kind that is not read here.
    #[error("{}: {found} not supported yet; {remedy}", path.display())]
    Unsupported {
        /// The bag or the file.
        path: PathBuf,
        /// What it is, with its verb.
        found: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The folder of a new bag exists already.
    #[error("{}: expected a folder that does not exist yet, because a bag is never written over", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The file system refuses.
    #[error("{}: cannot {action}: {reason}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// With which file.
        path: PathBuf,
        /// Why not.
        reason: std::io::Error,
    },
    /// A bag cannot be written any further; the file ends with its last complete chunk.
    #[error("{}: cannot write on: {reason}; the {safe} messages up to the last complete chunk are safe", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
        /// Messages that can be read back.
        safe: u64,
    },
    /// One chunk or message of a file is damaged; the others can be read.
    #[error("{}: damaged at byte {offset}: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the damaged record begins.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A database of sqlite3 is damaged, or cannot be opened.
    #[error("{}: {reason}", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// What sqlite says.
        reason: String,
    },
    /// A topic has another type, or another version of its type, than was asked for.
    #[error("topic {topic}: expected {expected}, found {found}")]
    Type {
        /// Name of the topic.
        topic: String,
        /// The type that was asked for.
        expected: String,
        /// The type that was recorded.
        found: String,
    },
    /// The bytes of a message are no message of the topic's type.
    #[error("topic {topic}: the message logged at {log_time_ns} ns: {reason}")]
    Message {
        /// Name of the topic.
        topic: String,
        /// When it was logged, ns.
        log_time_ns: i64,
        /// What is wrong with it.
        reason: String,
    },
    /// The bag has none of the topics that are needed.
    #[error("{}: needs {needed}; found {found}", path.display())]
    NoTopic {
        /// The bag.
        path: PathBuf,
        /// Topics of which at least one is needed.
        needed: String,
        /// Topics that it has.
        found: String,
    },
    /// An episode that is not there, or lacks what is needed of it.
    #[error("{}: {reason}", path.display())]
    Episode {
        /// The bag.
        path: PathBuf,
        /// What is missing.
        reason: EpisodeError,
    },
    /// A value of a CSV track.
    #[error("{file}: line {line}, column {column}: expected {expected}, got {got}")]
    Csv {
        /// Name of the file.
        file: String,
        /// Line in the file, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// What was expected.
        expected: String,
        /// What is there.
        got: String,
    },
    /// A track of which the model's camera would have seen nothing.
    #[error(
        "{file}: expected points in metres within the image of the model's camera, got all {points} outside of it, the first of line {line} at ({}, {}) m: is the track in m, and the model the track's?",
        first_m[0], first_m[1]
    )]
    OutOfView {
        /// Name of the file.
        file: String,
        /// Line of the first row.
        line: u64,
        /// Points of the track.
        points: usize,
        /// (x, z) in m of the first one.
        first_m: [f64; 2],
    },
    /// A setting makes no sense.
    #[error("{name}: expected {expected}, got {got}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// What was expected.
        expected: String,
        /// What came.
        got: String,
    },
    /// A file of profiles by topic that makes no sense.
    #[error("QoS overrides {}: {reason}", path.display())]
    Overrides {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
    },
    /// Replaying was refused, or stopped, because a real arm may listen.
    #[error("not replayed: {0}")]
    Refused(String),
    /// A message without meaning.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// The graph.
    #[error(transparent)]
    Shell(#[from] ShellError),
}

impl BagError {
    /// An [`BagError::Io`], for `map_err`.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |reason| Self::Io { action, path, reason }
    }
}
