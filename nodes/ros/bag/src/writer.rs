//! Writer of bags: a folder with MCAP files and `metadata.yaml`, in the form of `ros2 bag record`.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

mod mcap_file;
mod options;
mod tail;

use crate::error::BagError;
use crate::format::metadata::{self, FileFacts, Origin, TopicFacts};
use crate::format::profile::Profile;
use crate::format::reserve::{self, Reserve};
use catenary_msgs::{Interface, InterfaceInfo};
use catenary_shell::Qos;
use mcap_file::McapFile;
pub use options::{Compression, Split, WriterOptions};
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Type of a topic, as stored in a bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicType<'a> {
    /// `package/msg/Type`.
    pub name: &'a str,
    /// RIHS01 hash; empty if unknown.
    pub hash: &'a str,
    /// Definition: the ros2msg text with all nested definitions.
    pub definition: &'a str,
}

impl From<&InterfaceInfo> for TopicType<'static> {
    fn from(info: &InterfaceInfo) -> Self {
        Self { name: info.type_name, hash: info.type_hash, definition: info.definition }
    }
}

/// Handle of a topic of the bag that is being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(usize);

/// Contents of a finished bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagSummary {
    /// Folder of the bag.
    pub path: PathBuf,
    /// Number of all messages.
    pub messages: u64,
    /// Topics with the number of their messages.
    pub topics: Vec<(String, u64)>,
    /// First and last log time in ns; none without messages.
    pub span_ns: Option<(i64, i64)>,
    /// Names of the files in the folder, in order.
    pub files: Vec<String>,
}

/// Bag that is being written. Dropping it finishes the bag, too, but errors are only logged.
///
/// The files can be read up to the last complete chunk at any time. After a failed write, every later write fails.
pub struct BagWriter {
    folder: PathBuf,
    options: WriterOptions,
    /// Topics in the order of their ids, with the numbers of their messages in finished files.
    topics: Vec<TopicFacts>,
    /// Definitions of the topics' types, in the order of their ids.
    definitions: Vec<String>,
    /// Finished files.
    ended: Vec<FileFacts>,
    /// Open file; none after the end of the bag.
    file: Option<McapFile<File>>,
    reserve: Reserve,
    /// Entries about the recording as a whole.
    origin: Origin,
    /// True if an error was returned to the caller, so dropping the bag does not log it again.
    failed: bool,
}

/// Name of the file with this number, counted from 0.
fn file_name(folder: &Path, number: usize) -> String {
    let name = folder.file_name().map_or_else(|| "bag".to_owned(), |n| n.to_string_lossy().into_owned());
    format!("{name}_{number}.mcap")
}

impl BagWriter {
    /// Creates the folder with an empty bag: `FOLDER/NAME_0.mcap` and `FOLDER/metadata.yaml`.
    ///
    /// # Errors
    /// [`BagError::Exists`], [`BagError::Io`], [`BagError::Write`].
    pub fn create(folder: &Path, options: &WriterOptions) -> Result<Self, BagError> {
        if folder.exists() {
            return Err(BagError::Exists { path: folder.to_owned() });
        }
        // Existing folders are refused above: a bag is never overwritten.
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
            origin: Origin::default(),
            failed: false,
        };
        // A killed recorder must leave a folder that other tools recognise as a bag.
        writer.write_metadata()?;
        Ok(writer)
    }

    /// Adds an entry about the recording to the `custom_data` of the bag, which readers show. It is written with the next
    /// topic, and at the end.
    pub fn describe(&mut self, key: &str, text: &str) {
        self.origin.custom_data.insert(key.to_owned(), text.to_owned());
    }

    /// Folder of the bag.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Adds a topic with the profiles that its publishers offer. A known topic of the same type gives its id again.
    ///
    /// # Errors
    /// [`BagError::Type`] if the topic already has another type, [`BagError::Write`].
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

    /// Adds a topic of messages of type `T` with [`BagWriter::add_topic`].
    ///
    /// # Errors
    /// As [`BagWriter::add_topic`].
    pub fn add_topic_of<T: Interface>(&mut self, name: &str, qos: Qos) -> Result<TopicId, BagError> {
        self.add_topic(name, &TopicType::from(&InterfaceInfo::of::<T>()), &[qos])
    }

    /// Writes a message. Times are in ns since the epoch, of the recorder's clock and of the sender's clock. Times
    /// before the epoch count as the epoch.
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

    /// Writes a message that is already in CDR, with its encapsulation header.
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

    /// Ends the open chunk. All messages written before survive the end of the process.
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
    /// [`BagError::Write`], [`BagError::Io`]. The file can then be read up to its last complete chunk.
    pub fn finish(mut self) -> Result<BagSummary, BagError> {
        self.end()
    }

    fn file(&mut self) -> Result<&mut McapFile<File>, BagError> {
        let path = self.folder.join(file_name(&self.folder, self.ended.len()));
        let safe = self.ended.iter().map(|f| f.messages).sum();
        self.file.as_mut().ok_or(BagError::Write { path, reason: "it was ended".to_owned(), safe })
    }

    /// Topics and files of the bag, including the open file.
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
        metadata::write(&self.folder, &topics, &files, &self.origin)
    }

    /// Reserves disk space for the end of the bag.
    fn keep_room(&mut self) -> Result<(), BagError> {
        // The end repeats each topic's definition and, in two places, its profiles (2 KiB for each topic). It adds a
        // chunk index for each chunk, with 10 bytes for each channel. 16 KiB cover statistics, footer and
        // metadata.yaml.
        let topics: usize = self.definitions.iter().map(|text| text.len() + 2048).sum();
        let chunks = self.file.as_ref().map_or(0, McapFile::chunks);
        let needed = 16 * 1024 + topics + chunks * (128 + 10 * self.definitions.len());
        let safe = self.file.as_ref().map_or(0, McapFile::safe);
        let path = &self.folder;
        self.reserve.grow(needed).map_err(|e| BagError::Write { path: path.clone(), reason: e.to_string(), safe })
    }

    /// Continues in a new file.
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
        // The space is needed from here on.
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

/// Creates the file with this number. The files before it hold `before` messages.
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
