//! Writes a bag: a folder with one MCAP file and `metadata.yaml`, as `ros2 bag record` makes it.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

mod mcap_file;
mod tail;

use crate::error::BagError;
use crate::metadata::{self, FileFacts};
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
            Self::Zstd => "zstd",
        }
    }

    /// The compression that is called `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::None, Self::Zstd].into_iter().find(|c| c.name() == name)
    }
}

/// How a bag is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriterOptions {
    /// Compression of the chunks.
    pub compression: Compression,
    /// Bytes of messages after which a chunk ends, default 256 KiB. Larger compresses better and loses more where the
    /// process is killed.
    pub chunk_bytes: usize,
    /// Log time after which a chunk ends that is not full, default 1 s.
    pub chunk_period: Duration,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self { compression: Compression::default(), chunk_bytes: 256 * 1024, chunk_period: Duration::from_secs(1) }
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
}

/// A bag that is being written. Dropping it ends the file in order, too, but nobody hears of errors.
///
/// At any moment the file can be read up to its last complete chunk. A failed write is final: every later one fails too.
pub struct BagWriter {
    folder: PathBuf,
    file_name: String,
    /// None after its end.
    file: Option<McapFile<File>>,
    /// Whether a caller has heard of an error.
    failed: bool,
}

impl BagWriter {
    /// Makes the folder with an empty bag in it, `FOLDER/NAME_0.mcap` and `FOLDER/metadata.yaml`.
    ///
    /// # Errors
    /// [`BagError::Exists`], [`BagError::Io`], [`BagError::Write`].
    pub fn create(folder: &Path, options: &WriterOptions) -> Result<Self, BagError> {
        let name = folder.file_name().map_or_else(|| "bag".to_owned(), |n| n.to_string_lossy().into_owned());
        if folder.exists() {
            return Err(BagError::Exists { path: folder.to_owned() });
        }
        std::fs::create_dir_all(folder).map_err(BagError::io("make the folder", folder))?;
        let file_name = format!("{name}_0.mcap");
        let path = folder.join(&file_name);
        let target = File::create_new(&path).map_err(BagError::io("make the file", &path))?;
        let file = Some(McapFile::new(path, target, options)?);
        let writer = Self { folder: folder.to_owned(), file_name, file, failed: false };
        writer.write_metadata()?;
        Ok(writer)
    }

    /// The bag's folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Adds a topic with the profile that its publishers offer; again with the same type: the same topic.
    ///
    /// # Errors
    /// [`BagError::Type`] where the topic has another type already, [`BagError::Write`].
    pub fn add_topic(&mut self, name: &str, interface: &InterfaceInfo, qos: Qos) -> Result<TopicId, BagError> {
        self.file()?.add_topic(name, interface, qos)
    }

    /// Adds a topic of messages of type `T`: see [`BagWriter::add_topic`].
    ///
    /// # Errors
    /// As [`BagWriter::add_topic`].
    pub fn add_topic_of<T: Interface>(&mut self, name: &str, qos: Qos) -> Result<TopicId, BagError> {
        self.add_topic(name, &InterfaceInfo::of::<T>(), qos)
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
            topic: self.file.as_ref().and_then(|f| Some(f.topics().get(topic.0)?.name.clone())).unwrap_or_default(),
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
        let written = self.file()?.write(topic, log_time_ns, publish_time_ns, cdr);
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
        let path = self.folder.join(&self.file_name);
        self.file.as_mut().ok_or(BagError::Write { path, reason: "it was ended".to_owned(), safe: 0 })
    }

    fn facts(&self) -> FileFacts {
        let file = self.file.as_ref();
        FileFacts {
            name: self.file_name.clone(),
            span_ns: file.and_then(McapFile::span_ns),
            messages: file.map_or(0, McapFile::messages),
        }
    }

    fn write_metadata(&self) -> Result<(), BagError> {
        let topics = self.file.as_ref().map(McapFile::topics).unwrap_or_default();
        metadata::write(&self.folder, &topics, &[self.facts()])
    }

    fn end(&mut self) -> Result<BagSummary, BagError> {
        let facts = self.facts();
        let topics = self.file()?.topics();
        let embedded = metadata::embedded_text(&topics, std::slice::from_ref(&facts)).unwrap_or_default();
        let finished = self.file()?.finish(embedded);
        let closed = self.file.take().map_or(Ok(()), McapFile::close);
        finished.and(closed)?;
        metadata::write(&self.folder, &topics, std::slice::from_ref(&facts))?;
        Ok(BagSummary {
            path: self.folder.clone(),
            messages: facts.messages,
            topics: topics.into_iter().map(|t| (t.name, t.messages)).collect(),
            span_ns: facts.span_ns,
        })
    }
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
