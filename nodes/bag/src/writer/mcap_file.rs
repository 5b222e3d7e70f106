//! One MCAP file of a bag: topics, chunks, and when a chunk ends.

use super::tail::{Tail, Target};
use super::{Compression, TopicId, WriterOptions};
use crate::error::BagError;
use crate::metadata::TopicFacts;
use crate::profile::Profile;
use catenary_msgs::InterfaceInfo;
use catenary_shell::Qos;
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions};
use std::collections::BTreeMap;
use std::path::PathBuf;

struct Topic {
    facts: TopicFacts,
    channel: u16,
    sequence: u32,
}

/// Writes one file. After its first error it writes no more.
pub(super) struct McapFile<F: Target> {
    path: PathBuf,
    mcap: mcap::Writer<Tail<F>>,
    topics: Vec<Topic>,
    chunk_bytes: usize,
    chunk_period_ns: i64,
    /// Message bytes and first log time of the open chunk.
    open: Option<(usize, i64)>,
    span_ns: Option<(i64, i64)>,
    messages: u64,
    safe: u64,
}

impl<F: Target> McapFile<F> {
    pub(super) fn new(path: PathBuf, target: F, options: &WriterOptions) -> Result<Self, BagError> {
        let compression = match options.compression {
            Compression::None => None,
            Compression::Zstd => Some(mcap::Compression::Zstd),
        };
        // Chunks end where this file says so, and are put together in memory. Threads for compressing 256 KiB cost more
        // than they bring.
        let made = WriteOptions::new()
            .profile("ros2")
            .library(concat!("catenary ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true)
            .create(Tail::new(target))
            .and_then(|mut mcap| mcap.flush().map(|()| mcap));
        let mcap = made.map_err(|e| write_error(&path, 0, &e))?;
        Ok(Self {
            path,
            mcap,
            topics: Vec::new(),
            chunk_bytes: options.chunk_bytes,
            chunk_period_ns: i64::try_from(options.chunk_period.as_nanos()).unwrap_or(i64::MAX),
            open: None,
            span_ns: None,
            messages: 0,
            safe: 0,
        })
    }

    pub(super) fn messages(&self) -> u64 {
        self.messages
    }

    pub(super) fn span_ns(&self) -> Option<(i64, i64)> {
        self.span_ns
    }

    pub(super) fn topics(&self) -> Vec<TopicFacts> {
        self.topics.iter().map(|t| t.facts.clone()).collect()
    }

    pub(super) fn add_topic(&mut self, name: &str, interface: &InterfaceInfo, qos: Qos) -> Result<TopicId, BagError> {
        if let Some(known) = self.topics.iter().position(|t| t.facts.name == name) {
            let found = &self.topics[known].facts.type_name;
            return if found == interface.type_name {
                Ok(TopicId(known))
            } else {
                Err(BagError::Type {
                    topic: name.to_owned(),
                    expected: interface.type_name.to_owned(),
                    found: found.clone(),
                })
            };
        }
        let profiles = serde_saphyr::to_string(&[Profile::from(qos)]).unwrap_or_default();
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), profiles),
            ("topic_type_hash".to_owned(), interface.type_hash.to_owned()),
        ]);
        let channel = self
            .mcap
            .add_schema(interface.type_name, "ros2msg", interface.definition.as_bytes())
            .and_then(|schema| self.mcap.add_channel(schema, name, "cdr", &metadata))
            .map_err(|e| self.error(&e))?;
        let facts = TopicFacts {
            name: name.to_owned(),
            type_name: interface.type_name.to_owned(),
            type_hash: interface.type_hash.to_owned(),
            qos: vec![qos],
            messages: 0,
        };
        self.topics.push(Topic { facts, channel, sequence: 0 });
        Ok(TopicId(self.topics.len() - 1))
    }

    pub(super) fn write(&mut self, id: TopicId, log_ns: i64, publish_ns: i64, cdr: &[u8]) -> Result<(), BagError> {
        let Some(topic) = self.topics.get_mut(id.0) else {
            let reason = "a topic of another bag was given".to_owned();
            return Err(BagError::Write { path: self.path.clone(), reason, safe: self.safe });
        };
        // MCAP's times are unsigned.
        let time = |ns: i64| u64::try_from(ns).unwrap_or(0);
        let header = MessageHeader {
            channel_id: topic.channel,
            sequence: topic.sequence,
            log_time: time(log_ns),
            publish_time: time(publish_ns),
        };
        topic.sequence = topic.sequence.wrapping_add(1);
        if let Err(e) = self.mcap.write_to_known_channel(&header, cdr) {
            return Err(self.error(&e));
        }
        topic.facts.messages += 1;
        self.messages += 1;
        let (first, last) = self.span_ns.unwrap_or((log_ns, log_ns));
        self.span_ns = Some((first.min(log_ns), last.max(log_ns)));
        let (bytes, since_ns) = self.open.unwrap_or((0, log_ns));
        self.open = Some((bytes + cdr.len(), since_ns));
        let full = bytes + cdr.len() >= self.chunk_bytes || log_ns.saturating_sub(since_ns) >= self.chunk_period_ns;
        if full { self.flush() } else { Ok(()) }
    }

    /// Ends the open chunk and writes it to the file.
    pub(super) fn flush(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(|e| self.error(&e))?;
        self.open = None;
        self.safe = self.messages;
        Ok(())
    }

    /// Ends the file with rosbag2's metadata and the summary.
    pub(super) fn finish(&mut self, embedded: String) -> Result<(), BagError> {
        self.flush()?;
        let metadata = BTreeMap::from([("serialized_metadata".to_owned(), embedded)]);
        self.mcap
            .write_metadata(&Metadata { name: "rosbag2".to_owned(), metadata })
            .and_then(|()| self.mcap.finish().map(|_summary| ()))
            .map_err(|e| self.error(&e))
    }

    /// Brings a finished file to the disk.
    pub(super) fn close(self) -> Result<(), BagError> {
        let (path, safe) = (self.path, self.safe);
        let mut tail = self.mcap.into_inner();
        std::io::Write::flush(&mut tail)
            .and_then(|()| tail.sync())
            .map_err(|e| write_error(&path, safe, &McapError::Io(e)))
    }

    fn error(&self, error: &McapError) -> BagError {
        write_error(&self.path, self.safe, error)
    }
}

fn write_error(path: &std::path::Path, safe: u64, error: &McapError) -> BagError {
    let reason = match error {
        McapError::Io(e) => e.to_string(),
        McapError::AttemptedWriteAfterFailure => "an earlier write failed".to_owned(),
        other => other.to_string(),
    };
    BagError::Write { path: path.to_owned(), reason, safe }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reader::BagReader;
    use catenary_msgs::geometry_msgs::msg::PoseStamped;
    use std::io::{self, Write};
    use std::sync::{Arc, Mutex};

    /// A disk that is full after `capacity` bytes.
    #[derive(Clone)]
    struct Disk {
        bytes: Arc<Mutex<Vec<u8>>>,
        capacity: usize,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let mut disk = self.bytes.lock().unwrap();
            let room = self.capacity - disk.len();
            if room == 0 {
                return Err(io::Error::new(io::ErrorKind::StorageFull, "no space left on device"));
            }
            let taken = room.min(bytes.len());
            disk.extend_from_slice(&bytes[..taken]);
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Target for Disk {
        fn cut(&mut self, len: u64) -> io::Result<()> {
            self.bytes.lock().unwrap().truncate(len as usize);
            Ok(())
        }

        fn sync(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// Writes poses until the disk is full or `count` are written; the outcome and what the disk holds.
    fn fill(capacity: usize, count: i64) -> (Result<(), BagError>, Vec<u8>) {
        let disk = Disk { bytes: Arc::default(), capacity };
        let options = WriterOptions { compression: Compression::None, chunk_bytes: 1000, ..WriterOptions::default() };
        let outcome = McapFile::new("full_0.mcap".into(), disk.clone(), &options).and_then(|mut file| {
            let pose = InterfaceInfo::of::<PoseStamped>();
            let topic = file.add_topic("/pose", &pose, Qos::DEFAULT)?;
            let cdr = catenary_msgs::to_cdr(&PoseStamped::default()).unwrap();
            (1..=count).try_for_each(|i| file.write(topic, i, i, &cdr))?;
            file.finish(String::new())?;
            file.close()
        });
        let bytes = disk.bytes.lock().unwrap().clone();
        (outcome, bytes)
    }

    #[test]
    fn a_full_disk_ends_with_an_error_and_a_file_of_whole_chunks() {
        let (whole, all) = fill(usize::MAX, 100);
        whole.unwrap();
        let folder = tempfile::tempdir().unwrap();
        for capacity in [300, 5_000, 9_000, all.len() - 3000, all.len() - 1] {
            let (outcome, bytes) = fill(capacity, 100);
            let error = outcome.unwrap_err();
            let BagError::Write { safe, reason, .. } = &error else { panic!("{error}") };
            assert!(reason.contains("no space left") || reason.contains("earlier write"), "{error}");
            let path = folder.path().join("full.mcap");
            std::fs::write(&path, &bytes).unwrap();
            let bag = BagReader::open(&path).unwrap();
            let read = bag.messages().collect::<Result<Vec<_>, _>>().unwrap();
            assert_eq!(read.len() as u64, *safe, "capacity {capacity}");
            assert_eq!(bag.notes().len(), 1, "{:?}", bag.notes());
            assert!(bag.notes()[0].contains("no summary"), "{:?}", bag.notes());
        }
    }
}
