//! Reader of bags: a folder or a single file, in MCAP or sqlite3, compressed or not, finished or not.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

pub(crate) mod chunk;
mod contents;
mod file;
pub(crate) mod folder;
pub(crate) mod index;
mod messages;
pub(crate) mod scan;
mod sqlite;
mod zstd_data;

use crate::error::BagError;
use crate::format::metadata::joined;
pub use contents::{BagMessage, Topic, TopicCount};
use folder::files_of;
use index::IndexedFile;
pub use messages::Messages;
use std::path::{Path, PathBuf};

/// Open bag.
///
/// A file that was not finished, because its recorder was killed or still runs, is read up to its last complete chunk.
/// [`BagReader::notes`] reports it.
#[derive(Debug)]
pub struct BagReader {
    path: PathBuf,
    files: Vec<IndexedFile>,
    topics: Vec<TopicCount>,
    notes: Vec<String>,
}

impl BagReader {
    /// Opens a bag folder, or a single file of a bag, and reads its index.
    ///
    /// # Errors
    /// [`BagError::NotABag`], [`BagError::Unsupported`], [`BagError::Io`]. Damage is no error; it is noted.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        Self::open_files(path, false)
    }

    /// Opens a bag. With `all`, files of its folder that metadata.yaml does not list are opened, too.
    pub(crate) fn open_files(path: &Path, all: bool) -> Result<Self, BagError> {
        let mut notes = Vec::new();
        let paths = if path.is_dir() {
            files_of(path, all, &mut notes)?
        } else if path.exists() {
            vec![path.to_owned()]
        } else {
            let found = format!("nothing{}", catenary_shell::files::hint(path));
            return Err(BagError::NotABag { path: path.to_owned(), found });
        };
        let alone = paths.len() == 1;
        let mut files = Vec::new();
        for path in paths {
            match file::open(&path) {
                Ok(file) => files.push(file),
                // One bad file of several costs its own messages alone.
                Err(error) if alone => return Err(error),
                Err(error) => notes.push(error.to_string()),
            }
        }
        if files.is_empty() {
            return Err(BagError::NotABag { path: path.to_owned(), found: notes.join("; ") });
        }
        notes.extend(files.iter().flat_map(|f| f.notes.iter().cloned()));
        let topics = merged(files.iter().flat_map(IndexedFile::topics));
        Ok(Self { path: path.to_owned(), files, topics, notes })
    }

    /// Path that was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Topics, sorted by name.
    #[must_use]
    pub fn topics(&self) -> &[TopicCount] {
        &self.topics
    }

    /// Topic called `name`.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&TopicCount> {
        self.topics.iter().find(|t| t.topic.name == name)
    }

    /// Number of all messages.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|t| t.messages).sum()
    }

    /// First and last log time in ns; none without messages.
    #[must_use]
    pub fn span_ns(&self) -> Option<(i64, i64)> {
        joined(self.files.iter().map(IndexedFile::span_ns))
    }

    /// Indexes of the files, in order.
    pub(crate) fn indexed(&self) -> &[IndexedFile] {
        &self.files
    }

    /// Files of the bag, in order.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|f| &*f.path)
    }

    /// Sentences about missing or damaged parts; empty for an intact bag.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Reads every message, which finds damage that the index of a file does not show. Returns the number of readable
    /// messages and one sentence for each defect.
    #[must_use]
    pub fn verify(&self) -> (u64, Vec<String>) {
        let (mut readable, mut damage) = (0, Vec::new());
        for message in self.messages() {
            match message {
                Ok(_) => readable += 1,
                Err(error) => damage.push(error.to_string()),
            }
        }
        (readable, damage)
    }

    /// Topics with types and counts, in one line.
    #[must_use]
    pub fn describe_topics(&self) -> String {
        let one = |t: &TopicCount| format!("{} [{}] {}", t.topic.name, t.topic.type_name, t.messages);
        let all: Vec<String> = self.topics.iter().map(one).collect();
        if all.is_empty() { "no topics".to_owned() } else { all.join(", ") }
    }

    /// All messages in order of log time.
    #[must_use]
    pub fn messages(&self) -> Messages<'_> {
        Messages::new(&self.files, None)
    }

    /// Messages of the given topics in order of log time.
    #[must_use]
    pub fn messages_of<S: AsRef<str>>(&self, topics: &[S]) -> Messages<'_> {
        Messages::new(&self.files, Some(topics.iter().map(|t| t.as_ref().to_owned()).collect()))
    }
}

/// Merges the topics of several files: one entry for each name and type, sorted by name.
fn merged(all: impl Iterator<Item = TopicCount>) -> Vec<TopicCount> {
    let mut topics: Vec<TopicCount> = Vec::new();
    for t in all {
        let same =
            |known: &&mut TopicCount| known.topic.name == t.topic.name && known.topic.type_name == t.topic.type_name;
        match topics.iter_mut().find(same) {
            Some(known) => known.messages += t.messages,
            None => topics.push(t),
        }
    }
    topics.sort_by(|a, b| a.topic.name.cmp(&b.topic.name));
    topics
}
