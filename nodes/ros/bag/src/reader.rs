//! Reader of bags: a folder or a single file, in MCAP or sqlite3, compressed or not, finished or not.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

pub(crate) mod chunk;
mod contents;
mod far;
mod file;
pub(crate) mod folder;
pub(crate) mod index;
mod messages;
pub(crate) mod scan;
mod scratch;
mod sqlite;
mod usual;
mod zstd_data;

use crate::error::BagError;
use crate::format::metadata::joined;
pub use contents::{BagMessage, Topic, TopicCount};
use folder::files_of;
use index::IndexedFile;
pub use messages::Messages;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use usual::Usual;

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
    /// Range of the log times that are not far from the others.
    usual: Usual,
    far_notes: Vec<String>,
    custom_data: BTreeMap<String, String>,
}

/// Result of reading every message of a bag.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Verified {
    /// Number of readable messages.
    pub readable: u64,
    /// Number of damaged places.
    pub damaged: u64,
    /// One sentence for each of the first damaged places, at most [`Verified::LISTED`].
    pub damage: Vec<String>,
}

impl Verified {
    /// Greatest number of damaged places that are described.
    pub const LISTED: usize = 100;
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
        for file_path in paths {
            match file::open(&file_path) {
                Ok(file) => files.push(file),
                // One bad file of several costs its own messages alone.
                Err(error) if alone => return Err(error),
                Err(error @ BagError::Interrupted { .. }) => return Err(error),
                Err(error) => notes.push(error.to_string()),
            }
        }
        if files.is_empty() {
            return Err(BagError::NotABag { path: path.to_owned(), found: notes.join("; ") });
        }
        notes.extend(files.iter().flat_map(|f| f.notes.iter().cloned()));
        let topics = merged(files.iter().flat_map(IndexedFile::topics));
        let (usual, far_notes) = far::set_apart(path, &mut files);
        // An unreadable metadata.yaml was noted with the files.
        let layout = if path.is_dir() { folder::layout_of(path).ok().flatten() } else { None };
        let custom_data = layout.map(|layout| layout.added_data()).unwrap_or_default();
        Ok(Self { path: path.to_owned(), files, topics, notes, usual, far_notes, custom_data })
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

    /// First and last log time in ns, without those far from the rest; none without messages.
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

    /// Sentences about messages whose log times lie decades away from the rest, one for each topic: topic, number and
    /// times. They are no damage, and [`BagReader::messages`] has them.
    #[must_use]
    pub fn far_notes(&self) -> &[String] {
        &self.far_notes
    }

    /// Entries about the recording as a whole that users or programs added to a bag folder, by name.
    #[must_use]
    pub fn custom_data(&self) -> &BTreeMap<String, String> {
        &self.custom_data
    }

    /// True if a log time is not decades away from the rest of the bag.
    #[must_use]
    pub fn is_usual_time(&self, log_time_ns: i64) -> bool {
        self.usual.holds(log_time_ns)
    }

    /// Reads every message, which finds damage that the index of a file does not show.
    #[must_use]
    pub fn verify(&self) -> Verified {
        let mut found = Verified::default();
        for message in self.messages() {
            match message {
                Ok(_) => found.readable += 1,
                Err(error) => {
                    found.damaged += 1;
                    if found.damage.len() < Verified::LISTED {
                        found.damage.push(error.to_string());
                    }
                }
            }
        }
        found
    }

    /// Topics with types and counts, in one line.
    #[must_use]
    pub fn describe_topics(&self) -> String {
        let one = |t: &TopicCount| format!("{} [{}] {}", t.topic.name, t.topic.describe_type(), t.messages);
        let all: Vec<String> = self.topics.iter().map(one).collect();
        if all.is_empty() { "no topics".to_owned() } else { all.join(", ") }
    }

    /// All messages in order of log time.
    #[must_use]
    pub fn messages(&self) -> Messages<'_> {
        Messages::new(&self.path, &self.files, self.usual, None)
    }

    /// Messages of the given topics in order of log time.
    #[must_use]
    pub fn messages_of<S: AsRef<str>>(&self, topics: &[S]) -> Messages<'_> {
        let wanted = topics.iter().map(|t| t.as_ref().to_owned()).collect();
        Messages::new(&self.path, &self.files, self.usual, Some(wanted))
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
