//! Writes a bag: a folder with MCAP files and `metadata.yaml`, as `ros2 bag record` makes it.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

mod mcap_file;
mod tail;

use crate::error::BagError;
use crate::metadata::{self, FileFacts, Origin, TopicFacts};
use crate::profile::Profile;
use crate::reserve::{self, Reserve};
use catenary_msgs::{Interface, InterfaceInfo};
use catenary_shell::Qos;
use mcap_file::McapFile;
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How the chunks of a file are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Not at all.
    None,
    /// By lz4, chunk by chunk: faster, and larger.
    Lz4,
    /// By zstd, chunk by chunk.
    #[default]
    Zstd,
}

impl Compression {
    /// The name in settings.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        }
    }

    /// All of them.
    pub const ALL: [Self; 3] = [Self::None, Self::Lz4, Self::Zstd];

    /// The compression that is called `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }
}

/// When a bag goes on in a new file, as rosbag2 splits: before the first message after a limit was reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Split {
    /// Bytes of complete chunks; none: no limit.
    pub bytes: Option<u64>,
    /// Log time since the first message of the file; none: no limit.
    pub duration: Option<Duration>,
}

/// How a bag is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriterOptions {
    /// Compression of the chunks.
    pub compression: Compression,
    /// Bytes of messages after which a chunk ends, default 256 KiB. Larger compresses better and loses more where the
    /// process is killed or the disk is full. Where a sixteenth of the file is more, that counts, up to 4 MiB: what a file
    /// says of each of its chunks at its end is kept in memory until then.
    pub chunk_bytes: usize,
    /// Log time after which a chunk ends that is not full, default 1 s.
    pub chunk_period: Duration,
    /// When a file ends, default never.
    pub split: Split,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            compression: Compression::default(),
            chunk_bytes: 256 * 1024,
            chunk_period: Duration::from_secs(1),
            split: Split::default(),
        }
    }
}

/// The type of a topic, as a bag states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicType<'a> {
    /// `package/msg/Type`.
    pub name: &'a str,
    /// RIHS01 hash; empty where nobody knows it.
    pub hash: &'a str,
    /// ros2msg text with all nested definitions.
    pub definition: &'a str,
}

impl From<&InterfaceInfo> for TopicType<'static> {
    fn from(info: &InterfaceInfo) -> Self {
        Self { name: info.type_name, hash: info.type_hash, definition: info.definition }
    }
}

/// A topic of the bag that is being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagSummary {
    /// Folder of the bag.
    pub path: PathBuf,
    /// Messages in all.
    pub messages: u64,
    /// Topics with the number of their messages.
    pub topics: Vec<(String, u64)>,
    /// First and last log time in ns; none without messages.
    pub span_ns: Option<(i64, i64)>,
    /// Names of the files in the folder, in order.
    pub files: Vec<String>,
}

/// A bag that is being written. Dropping it ends the file in order, too, but nobody hears of errors.
///
/// At any moment the files can be read up to the last complete chunk. A failed write is final: every later one fails too.
pub struct BagWriter {
    folder: PathBuf,
    options: WriterOptions,
    /// Every topic with the messages in the files that have ended, in the order of their numbers.
    topics: Vec<TopicFacts>,
    /// Definitions of the topics' types.
    definitions: Vec<String>,
    /// Files that have ended.
    ended: Vec<FileFacts>,
    /// None after its end.
    file: Option<McapFile<File>>,
    reserve: Reserve,
    /// Whether a caller has heard of an error.
    failed: bool,
}

/// Name of the file with this number, from 0.
fn file_name(folder: &Path, number: usize) -> String {
    let name = folder.file_name().map_or_else(|| "bag".to_owned(), |n| n.to_string_lossy().into_owned());
    format!("{name}_{number}.mcap")
}

impl BagWriter {
    /// Makes the folder with an empty bag in it, `FOLDER/NAME_0.mcap` and `FOLDER/metadata.yaml`.
    ///
    /// # Errors
    /// [`BagError::Exists`], [`BagError::Io`], [`BagError::Write`].
    pub fn create(folder: &Path, options: &WriterOptions) -> Result<Self, BagError> {
        if folder.exists() {
            return Err(BagError::Exists { path: folder.to_owned() });
        }
        std::fs::create_dir_all(folder).map_err(BagError::io("make the folder", folder))?;
        let file = Some(new_file(folder, 0, options, 0)?);
        let reserve = Reserve::new(folder).map_err(BagError::io("make files in the folder", folder))?;
        let writer = Self {
            folder: folder.to_owned(),
            options: *options,
            topics: Vec::new(),
            definitions: Vec::new(),
            ended: Vec::new(),
            file,
            reserve,
            failed: false,
        };
        writer.write_metadata()?;
        Ok(writer)
    }

    /// The bag's folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Adds a topic with the profiles that its publishers offer; again with the same type: the same topic.
    ///
    /// # Errors
    /// [`BagError::Type`] where the topic has another type already, [`BagError::Write`].
    pub fn add_topic(&mut self, name: &str, kind: &TopicType<'_>, qos: &[Qos]) -> Result<TopicId, BagError> {
        if let Some(known) = self.topics.iter().position(|t| t.name == name) {
            let found = &self.topics[known].type_name;
            return if found == kind.name {
                Ok(TopicId(known))
            } else {
                let (topic, expected) = (name.to_owned(), kind.name.to_owned());
                Err(BagError::Type { topic, expected, found: found.clone() })
            };
        }
        let facts = TopicFacts {
            name: name.to_owned(),
            type_name: kind.name.to_owned(),
            type_hash: kind.hash.to_owned(),
            encoding: "cdr".to_owned(),
            profiles: qos.iter().copied().map(Profile::from).collect(),
            messages: 0,
        };
        self.file()?.add_topic(&facts, kind.definition)?;
        self.topics.push(facts);
        self.definitions.push(kind.definition.to_owned());
        Ok(TopicId(self.topics.len() - 1))
    }

    /// Adds a topic of messages of type `T`: see [`BagWriter::add_topic`].
    ///
    /// # Errors
    /// As [`BagWriter::add_topic`].
    pub fn add_topic_of<T: Interface>(&mut self, name: &str, qos: Qos) -> Result<TopicId, BagError> {
        self.add_topic(name, &TopicType::from(&InterfaceInfo::of::<T>()), &[qos])
    }

    /// Writes a message. Times are ns since the epoch of the recorder's clock and of the sender's; times before it
    /// count as the epoch.
    ///
    /// # Errors
    /// [`BagError::Write`].
    pub fn write<T: Serialize>(
        &mut self,
        topic: TopicId,
        log_time_ns: i64,
        publish_time_ns: i64,
        message: &T,
    ) -> Result<(), BagError> {
        let cdr = catenary_msgs::to_cdr(message).map_err(|e| BagError::Message {
            topic: self.topics.get(topic.0).map(|t| t.name.clone()).unwrap_or_default(),
            log_time_ns,
            reason: e.to_string(),
        })?;
        self.write_cdr(topic, log_time_ns, publish_time_ns, &cdr)
    }

    /// Writes a message that is CDR already, with its encapsulation header.
    ///
    /// # Errors
    /// [`BagError::Write`].
    pub fn write_cdr(
        &mut self,
        topic: TopicId,
        log_time_ns: i64,
        publish_time_ns: i64,
        cdr: &[u8],
    ) -> Result<(), BagError> {
        let split = self.options.split;
        let full = self.file()?.is_full(&split, log_time_ns);
        let written = if full { self.split() } else { Ok(()) }
            .and_then(|()| self.keep_room())
            .and_then(|()| self.file()?.write(topic.0, log_time_ns, publish_time_ns, cdr));
        self.failed |= written.is_err();
        written
    }

    /// Ends the open chunk: what was written up to now survives the end of the process.
    ///
    /// # Errors
    /// [`BagError::Write`].
    pub fn flush(&mut self) -> Result<(), BagError> {
        let flushed = self.file()?.flush();
        self.failed |= flushed.is_err();
        flushed
    }

    /// Ends the file and writes the final `metadata.yaml`.
    ///
    /// # Errors
    /// [`BagError::Write`], [`BagError::Io`]; the file can be read up to its last complete chunk all the same.
    pub fn finish(mut self) -> Result<BagSummary, BagError> {
        self.end()
    }

    fn file(&mut self) -> Result<&mut McapFile<File>, BagError> {
        let path = self.folder.join(file_name(&self.folder, self.ended.len()));
        let safe = self.ended.iter().map(|f| f.messages).sum();
        self.file.as_mut().ok_or(BagError::Write { path, reason: "it was ended".to_owned(), safe })
    }

    /// What there is, the open file included.
    fn facts(&self) -> (Vec<TopicFacts>, Vec<FileFacts>) {
        let (mut topics, mut files) = (self.topics.clone(), self.ended.clone());
        if let Some(open) = &self.file {
            topics.iter_mut().zip(open.counts()).for_each(|(topic, messages)| topic.messages += messages);
            let name = file_name(&self.folder, self.ended.len());
            files.push(FileFacts { name, span_ns: open.span_ns(), messages: open.messages() });
        }
        (topics, files)
    }

    fn write_metadata(&self) -> Result<(), BagError> {
        let (topics, files) = self.facts();
        metadata::write(&self.folder, &topics, &files, &Origin::default())
    }

    /// Keeps room on the disk for what the end of the bag adds to it: definitions and profiles, twice, and the index.
    fn keep_room(&mut self) -> Result<(), BagError> {
        let topics: usize = self.definitions.iter().map(|text| text.len() + 2048).sum();
        let chunks = self.file.as_ref().map_or(0, McapFile::chunks);
        let needed = 16 * 1024 + topics + chunks * (128 + 10 * self.definitions.len());
        let safe = self.file.as_ref().map_or(0, McapFile::safe);
        let path = &self.folder;
        self.reserve.grow(needed).map_err(|e| BagError::Write { path: path.clone(), reason: e.to_string(), safe })
    }

    /// Goes on in a new file.
    fn split(&mut self) -> Result<(), BagError> {
        self.end_file()?;
        let before = self.ended.iter().map(|f| f.messages).sum();
        let mut file = new_file(&self.folder, self.ended.len(), &self.options, before)?;
        for (facts, definition) in self.topics.iter().zip(&self.definitions) {
            file.add_topic(facts, definition)?;
        }
        self.file = Some(file);
        self.reserve = Reserve::new(&self.folder).map_err(BagError::io("make files in the folder", &self.folder))?;
        self.write_metadata()
    }

    fn end_file(&mut self) -> Result<(), BagError> {
        let (topics, files) = self.facts();
        let embedded = metadata::embedded_text(&topics, &files).unwrap_or_default();
        reserve::free(&self.folder);
        let finished = self.file()?.finish(embedded);
        let closed = self.file.take().map_or(Ok(()), McapFile::close);
        finished.and(closed)?;
        (self.topics, self.ended) = (topics, files);
        Ok(())
    }

    fn end(&mut self) -> Result<BagSummary, BagError> {
        self.end_file()?;
        self.write_metadata()?;
        Ok(BagSummary {
            path: self.folder.clone(),
            messages: self.ended.iter().map(|f| f.messages).sum(),
            topics: self.topics.iter().map(|t| (t.name.clone(), t.messages)).collect(),
            span_ns: metadata::joined(self.ended.iter().map(|f| f.span_ns)),
            files: self.ended.iter().map(|f| f.name.clone()).collect(),
        })
    }
}

/// The file with this number, behind files that hold `before` messages.
fn new_file(folder: &Path, number: usize, options: &WriterOptions, before: u64) -> Result<McapFile<File>, BagError> {
    let path = folder.join(file_name(folder, number));
    let target = File::create_new(&path).map_err(BagError::io("make the file", &path))?;
    McapFile::new(path, target, options, before)
}

impl Drop for BagWriter {
    fn drop(&mut self) {
        if self.file.is_some()
            && let Err(error) = self.end()
            && !self.failed
        {
            tracing::error!("{error}");
        }
    }
}
