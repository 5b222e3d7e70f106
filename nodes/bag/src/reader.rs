//! Reads bags: a folder, or a bare file; in MCAP or sqlite3, compressed or not, finished or not.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

mod chunk;
mod file;
mod finish;
mod messages;
mod scan;
mod sqlite;

use crate::error::BagError;
use crate::metadata::{self, FileFacts, Origin, TopicFacts, joined};
use crate::profile::Profile;
use crate::reserve;
use catenary_msgs::Interface;
use catenary_shell::Qos;
use file::IndexedFile;
pub use messages::{BagMessage, Messages};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Absolute name.
    pub name: String,
    /// `package/msg/Type`.
    pub type_name: String,
    /// How its messages are serialised; `cdr` in all ROS 2 bags.
    pub encoding: String,
    /// RIHS01 hash of the type, where the recorder knew it.
    pub type_hash: Option<String>,
    /// Profiles that its publishers offered.
    pub qos: Vec<Qos>,
    /// The same with what is not kept to here.
    profiles: Vec<Profile>,
}

impl Topic {
    /// Whether its messages can be read as `T`.
    ///
    /// # Errors
    /// [`BagError::Type`] naming what differs.
    pub fn check<T: Interface>(&self) -> Result<(), BagError> {
        let wrong = |expected: String, found: String| Err(BagError::Type { topic: self.name.clone(), expected, found });
        if self.type_name != T::TYPE_NAME {
            return wrong(T::TYPE_NAME.to_owned(), self.type_name.clone());
        }
        if self.encoding != "cdr" {
            return wrong("messages in cdr".to_owned(), format!("messages in {}", self.encoding));
        }
        match &self.type_hash {
            Some(hash) if hash != T::TYPE_HASH => {
                wrong(format!("{} with the hash {}", T::TYPE_NAME, T::TYPE_HASH), format!("the hash {hash}"))
            }
            _ => Ok(()),
        }
    }
}

/// A topic with the number of its messages.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicCount {
    /// The topic.
    pub topic: Arc<Topic>,
    /// Its messages that can be read.
    pub messages: u64,
}

/// A bag that can be read.
///
/// A file that was not finished, because the recorder was killed or still runs, is read up to its last complete chunk;
/// [`BagReader::notes`] says so.
#[derive(Debug)]
pub struct BagReader {
    path: PathBuf,
    files: Vec<IndexedFile>,
    topics: Vec<TopicCount>,
    notes: Vec<String>,
}

impl BagReader {
    /// Opens a bag folder or a file of one, and finds out what is in it.
    ///
    /// # Errors
    /// [`BagError::NotABag`], [`BagError::Unsupported`], [`BagError::Io`]. Damage is none: it is noted.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        Self::open_files(path, false)
    }

    /// Opens a bag; `all`: with the files of its folder that metadata.yaml does not list.
    fn open_files(path: &Path, all: bool) -> Result<Self, BagError> {
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
            match IndexedFile::open(&path) {
                Ok(file) => files.push(file),
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

    /// The path that was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The topics, by name.
    #[must_use]
    pub fn topics(&self) -> &[TopicCount] {
        &self.topics
    }

    /// The topic called `name`.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&TopicCount> {
        self.topics.iter().find(|t| t.topic.name == name)
    }

    /// Messages in all.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|t| t.messages).sum()
    }

    /// First and last log time in ns; none without messages.
    #[must_use]
    pub fn span_ns(&self) -> Option<(i64, i64)> {
        joined(self.files.iter().map(IndexedFile::span_ns))
    }

    /// The files that it consists of.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|f| &*f.path)
    }

    /// What is missing or damaged, in words; empty for a bag in order.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Reads every message, which finds damage that the index of a file does not show: how many there are, and what is wrong
    /// with the others.
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

    /// The topics with types and counts, in one line.
    #[must_use]
    pub fn describe_topics(&self) -> String {
        let one = |t: &TopicCount| format!("{} [{}] {}", t.topic.name, t.topic.type_name, t.messages);
        let all: Vec<String> = self.topics.iter().map(one).collect();
        if all.is_empty() { "no topics".to_owned() } else { all.join(", ") }
    }

    /// Every message, in order of log time.
    #[must_use]
    pub fn messages(&self) -> Messages<'_> {
        Messages::new(self, None)
    }

    /// The messages of some topics, in order of log time.
    #[must_use]
    pub fn messages_of<S: AsRef<str>>(&self, topics: &[S]) -> Messages<'_> {
        Messages::new(self, Some(topics.iter().map(|t| t.as_ref().to_owned()).collect()))
    }
}

/// Finishes the files of a bag whose recorder was killed, so that every reader of MCAP can read them, and writes the
/// folder's `metadata.yaml` anew, of all bag files in the folder. Given a file: finishes that. Nothing that can be read is lost;
/// returns what was missing. A bag that misses nothing stays as it is.
///
/// # Errors
/// As [`BagReader::open`], and [`BagError::Io`]; [`BagError::Unsupported`] for other files than MCAP, and for those whose
/// messages were compressed one by one.
pub fn reindex(path: &Path) -> Result<Vec<String>, BagError> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    reserve::check(folder).map_err(BagError::io("finish", path))?;
    if path.is_dir() {
        reserve::free(path);
    }
    let before = BagReader::open_files(path, true)?;
    if before.notes.is_empty() && before.files.iter().all(|f| f.is_finished) {
        return Ok(Vec::new());
    }
    let layout = layout_of(path).ok().flatten();
    let mode = layout.as_ref().map(|layout| layout.compression_mode.to_lowercase());
    if let Some(mode) = mode.filter(|mode| !["", "none"].contains(&mode.as_str())) {
        return Err(BagError::Unsupported {
            path: path.to_owned(),
            found: format!("finishing a bag of compression mode {mode} is"),
            remedy: "`ros2 bag reindex` does it",
        });
    }
    if let Some(file) = before.files.iter().find(|f| f.source.extension().is_none_or(|e| e != "mcap")) {
        return Err(BagError::Unsupported {
            path: file.path.clone(),
            found: "writing indexes of other files than .mcap is".to_owned(),
            remedy: "`ros2 bag reindex` does it",
        });
    }
    for file in before.files.iter().filter(|f| !f.is_finished) {
        finish::finish(&file.path)?;
    }
    if path.is_dir() {
        write_metadata(path, layout.as_ref())?;
    }
    Ok(before.notes)
}

/// Writes the `metadata.yaml` of a folder anew; what only the one before says is kept.
fn write_metadata(folder: &Path, before: Option<&metadata::Layout>) -> Result<(), BagError> {
    let bag = BagReader::open_files(folder, true)?;
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let file = |f: &IndexedFile| FileFacts { name: name(&f.path), span_ns: f.span_ns(), messages: f.messages() };
    let topic = |t: &TopicCount| {
        let hash = t.topic.type_hash.as_deref();
        let hash = hash.or_else(|| before?.type_hash(&t.topic.name, &t.topic.type_name));
        TopicFacts {
            name: t.topic.name.clone(),
            type_name: t.topic.type_name.clone(),
            encoding: t.topic.encoding.clone(),
            type_hash: hash.unwrap_or_default().to_owned(),
            profiles: t.topic.profiles.clone(),
            messages: t.messages,
        }
    };
    let files: Vec<FileFacts> = bag.files.iter().map(file).collect();
    let topics: Vec<TopicFacts> = bag.topics.iter().map(topic).collect();
    let origin = before.map_or_else(Origin::default, |before| {
        let listed = before.relative_file_paths.iter().map(|p| name(Path::new(p)));
        let missing: Vec<String> = listed.filter(|n| !folder.join(n).exists()).collect();
        before.origin(&missing, &files.iter().map(|f| f.name.clone()).collect::<Vec<_>>())
    });
    metadata::write(folder, &topics, &files, &origin)
}

/// One entry for each name and type, by name.
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

/// Whether a file is one of a bag by its name.
fn is_bag_file(name: &str) -> bool {
    let name = name.strip_suffix(".zstd").unwrap_or(name);
    name.ends_with(".mcap") || name.ends_with(".db3")
}

/// The files of a bag folder, in order.
fn files_of(folder: &Path, all: bool, notes: &mut Vec<String>) -> Result<Vec<PathBuf>, BagError> {
    let present = listing(folder)?;
    let bag_files: Vec<PathBuf> = present.iter().filter(|n| is_bag_file(n)).map(|n| folder.join(n)).collect();
    let layout = layout_of(folder).and_then(|layout| layout.ok_or_else(|| "metadata.yaml is missing".to_owned()));
    let listed: Vec<PathBuf> = match layout {
        Ok(layout) => {
            for (name, known) in layout.missing_before().filter(|(name, _)| !folder.join(name).exists()) {
                let path = folder.join(name).display().to_string();
                notes.push(format!("{path}: missing since the bag was reindexed without it ({known})"));
            }
            let name = |p: &String| Path::new(p).file_name().map(|n| folder.join(n));
            layout.relative_file_paths.iter().filter_map(name).collect()
        }
        Err(note) => {
            notes.push(format!("{}: {note}", folder.display()));
            bag_files.clone()
        }
    };
    let (mut found, missing): (Vec<PathBuf>, Vec<PathBuf>) = listed.into_iter().partition(|p| p.exists());
    for path in missing {
        notes.push(format!("{}: listed in metadata.yaml, and missing", path.display()));
    }
    for path in bag_files.iter().filter(|path| !found.contains(path)) {
        notes.push(format!("{}: not listed in metadata.yaml", path.display()));
    }
    if all {
        found.clone_from(&bag_files);
    }
    if found.is_empty() {
        found = bag_files;
    }
    if found.is_empty() {
        let found = match &present[..] {
            [] => "an empty folder".to_owned(),
            [a, b, c, d, _, ..] => {
                format!("a folder without .mcap or .db3 files that holds {a}, {b}, {c}, {d} and more")
            }
            few => format!("a folder without .mcap or .db3 files that holds {}", few.join(", ")),
        };
        return Err(BagError::NotABag { path: folder.to_owned(), found });
    }
    Ok(found)
}

/// What a folder's metadata.yaml says; none: there is none.
#[allow(clippy::disallowed_methods, reason = "bags are files")]
fn layout_of(folder: &Path) -> Result<Option<metadata::Layout>, String> {
    let unreadable = |e: &dyn std::fmt::Display| format!("metadata.yaml is not readable ({e})");
    match std::fs::read_to_string(folder.join(metadata::FILE_NAME)) {
        Ok(text) => metadata::parse(&text).map(Some).map_err(|e| unreadable(&e)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(unreadable(&e)),
    }
}

/// Names in a folder, those of split files in the order of their numbers.
fn listing(folder: &Path) -> Result<Vec<String>, BagError> {
    let entries = std::fs::read_dir(folder).map_err(BagError::io("list", folder))?;
    let mut names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let number = |name: &str| {
        let stem = name.split('.').next().unwrap_or_default();
        stem.rsplit('_').next().and_then(|n| n.parse::<u64>().ok()).unwrap_or(u64::MAX)
    };
    names.sort_by(|a, b| number(a).cmp(&number(b)).then_with(|| a.cmp(b)));
    Ok(names)
}
