//! MCAP file of a bag: its topics and chunks, and the end of a chunk.

use super::options::{Compression, Split, WriterOptions};
use super::tail::{Tail, Target, TrailingRecords};
use crate::error::BagError;
use crate::format::metadata::TopicFacts;
use crate::format::records::{list, map, record};
use mcap::records::{MessageHeader, Metadata, op};
use mcap::{McapError, WriteOptions};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError};

/// A chunk may grow to 1/16 of the file: a long recording then has few chunks in its index.
const CHUNK_SHARE: u64 = 16;
/// Limit of that growth in message bytes. A larger option `chunk_bytes` replaces it. A chunk ends with the message that
/// reaches its size.
const LARGEST_CHUNK: u64 = 4 << 20;

struct Topic {
    channel: u16,
    messages: u64,
}

/// File that is being written. After its first error it writes no more.
pub(super) struct McapFile<F: Target> {
    path: PathBuf,
    mcap: mcap::Writer<Tail<F>>,
    topics: Vec<Topic>,
    chunk_bytes: u64,
    largest_chunk_bytes: u64,
    chunk_period_ns: i64,
    /// Message bytes and first log time of the open chunk.
    open: Option<(u64, i64)>,
    span_ns: Option<(i64, i64)>,
    messages: u64,
    bytes: u64,
    chunks: usize,
    /// Number of messages that can be read back, including `before` messages in earlier files.
    safe: u64,
    before: u64,
    /// Number of bytes of complete chunks.
    written: Arc<AtomicU64>,
    /// Second copy of the definitions, outside of chunks.
    trailing: TrailingRecords,
}

impl<F: Target> McapFile<F> {
    pub(super) fn new(path: PathBuf, target: F, options: &WriterOptions, before: u64) -> Result<Self, BagError> {
        let compression = match options.compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        };
        let tail = Tail::new(target);
        let (written, trailing) = (tail.written(), tail.trailing());
        // Chunk size is None, because `write` decides when a chunk ends. Seeking is disabled, so that the library
        // assembles each chunk in memory. Compression threads are 0: chunks of 256 KiB are too small to gain from threads.
        let made = WriteOptions::new()
            .profile("ros2")
            .library(concat!("catenary ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true)
            // Trailing records bypass `mcap::Writer`, so that its checksum of the data section would be wrong. Every
            // chunk has its own checksum.
            .calculate_data_section_crc(false)
            .create(tail)
            .and_then(|mut mcap| mcap.flush().map(|()| mcap));
        let mcap = made.map_err(|e| write_error(&path, before, &e))?;
        // The size is checked between chunks: with chunks of a quarter of the limit, a file exceeds it by a quarter at
        // most.
        let quarter = options.split.bytes.map_or(u64::MAX, |b| b / 4);
        Ok(Self {
            path,
            mcap,
            topics: Vec::new(),
            chunk_bytes: (options.chunk_bytes as u64).min(quarter),
            largest_chunk_bytes: LARGEST_CHUNK.min(quarter),
            chunk_period_ns: i64::try_from(options.chunk_period.as_nanos()).unwrap_or(i64::MAX),
            open: None,
            span_ns: None,
            messages: 0,
            bytes: 0,
            chunks: 0,
            safe: before,
            before,
            written,
            trailing,
        })
    }

    pub(super) fn messages(&self) -> u64 {
        self.messages
    }

    /// Number of complete chunks.
    pub(super) fn chunks(&self) -> usize {
        self.chunks
    }

    /// Number of messages that can be read back, including those in earlier files.
    pub(super) fn safe(&self) -> u64 {
        self.safe
    }

    pub(super) fn span_ns(&self) -> Option<(i64, i64)> {
        self.span_ns
    }

    /// Number of messages of each topic.
    pub(super) fn counts(&self) -> impl Iterator<Item = u64> {
        self.topics.iter().map(|t| t.messages)
    }

    /// True if a message of this log time belongs into the next file.
    pub(super) fn is_full(&self, split: &Split, log_ns: i64) -> bool {
        let is_long = |(first, _)| {
            let age = u64::try_from(log_ns.saturating_sub(first)).unwrap_or(0);
            split.duration.is_some_and(|limit| u128::from(age) > limit.as_nanos())
        };
        let is_large = split.bytes.is_some_and(|limit| self.written.load(Ordering::Relaxed) >= limit);
        self.messages > 0 && (is_large || self.span_ns.is_some_and(is_long))
    }

    /// Adds the next topic. Its definition goes into the open chunk and, a second time, behind it outside of any chunk.
    /// Damage to a chunk then loses only the messages of that chunk. Messages in later chunks keep their channel
    /// definitions.
    pub(super) fn add_topic(&mut self, facts: &TopicFacts, definition: &str) -> Result<(), BagError> {
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), serde_saphyr::to_string(&facts.profiles).unwrap_or_default()),
            ("topic_type_hash".to_owned(), facts.type_hash.clone()),
        ]);
        let added = self.mcap.add_schema(&facts.type_name, "ros2msg", definition.as_bytes()).and_then(|schema| {
            let channel = self.mcap.add_channel(schema, &facts.name, "cdr", &metadata)?;
            Ok((schema.to_le_bytes(), channel))
        });
        let (schema, channel) = added.map_err(|e| self.error(&e))?;
        let mut trailing = self.trailing.lock().unwrap_or_else(PoisonError::into_inner);
        record(&mut trailing, op::SCHEMA, &[&schema, &list(&facts.type_name), &list("ros2msg"), &list(definition)]);
        let parts = [&channel.to_le_bytes()[..], &schema, &list(&facts.name), &list("cdr"), &map(&metadata)];
        record(&mut trailing, op::CHANNEL, &parts);
        drop(trailing);
        self.topics.push(Topic { channel, messages: 0 });
        Ok(())
    }

    pub(super) fn write(&mut self, topic: usize, log_ns: i64, publish_ns: i64, cdr: &[u8]) -> Result<(), BagError> {
        let Some(topic) = self.topics.get_mut(topic) else {
            let reason = "a topic of another bag was given".to_owned();
            return Err(BagError::Write { path: self.path.clone(), reason, safe: self.safe });
        };
        // Times of MCAP are unsigned.
        let time = |ns: i64| u64::try_from(ns).unwrap_or(0);
        let header = MessageHeader {
            channel_id: topic.channel,
            // Sequence numbers have 32 bits and wrap around.
            sequence: topic.messages as u32,
            log_time: time(log_ns),
            publish_time: time(publish_ns),
        };
        if let Err(e) = self.mcap.write_to_known_channel(&header, cdr) {
            return Err(self.error(&e));
        }
        topic.messages += 1;
        self.messages += 1;
        let (first, last) = self.span_ns.unwrap_or((log_ns, log_ns));
        self.span_ns = Some((first.min(log_ns), last.max(log_ns)));
        let (bytes, since_ns) = self.open.unwrap_or((0, log_ns));
        let bytes = bytes + cdr.len() as u64;
        self.bytes += cdr.len() as u64;
        self.open = Some((bytes, since_ns));
        let enough = self.chunk_bytes.max(self.largest_chunk_bytes.min(self.bytes / CHUNK_SHARE));
        let full = bytes >= enough || log_ns.saturating_sub(since_ns) >= self.chunk_period_ns;
        if full { self.flush() } else { Ok(()) }
    }

    /// Ends the open chunk and writes it to the file.
    pub(super) fn flush(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(|e| self.error(&e))?;
        self.chunks += usize::from(self.open.is_some());
        self.open = None;
        self.safe = self.before + self.messages;
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

    /// Syncs a finished file to the disk.
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
    use catenary_msgs::Interface;
    use catenary_msgs::geometry_msgs::msg::PoseStamped;
    use catenary_shell::Qos;
    use std::io::{self, Write};
    use std::sync::Mutex;

    /// Disk that is full after `capacity` bytes.
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

    fn facts() -> TopicFacts {
        TopicFacts {
            name: "/pose".into(),
            type_name: PoseStamped::TYPE_NAME.into(),
            type_hash: PoseStamped::TYPE_HASH.into(),
            encoding: "cdr".into(),
            profiles: vec![Qos::DEFAULT.into()],
            messages: 0,
        }
    }

    /// Writes poses until the disk is full or `count` are written. Returns the outcome and the bytes on the disk.
    fn fill(capacity: usize, count: i64) -> (Result<(), BagError>, Vec<u8>) {
        let disk = Disk { bytes: Arc::default(), capacity };
        let options = WriterOptions { compression: Compression::None, chunk_bytes: 1000, ..WriterOptions::default() };
        let outcome = McapFile::new("full_0.mcap".into(), disk.clone(), &options, 0).and_then(|mut file| {
            file.add_topic(&facts(), PoseStamped::DEFINITION)?;
            let cdr = catenary_msgs::to_cdr(&PoseStamped::default()).unwrap();
            (1..=count).try_for_each(|i| file.write(0, i, i, &cdr))?;
            file.finish(String::new())?;
            file.close()
        });
        let bytes = disk.bytes.lock().unwrap().clone();
        (outcome, bytes)
    }

    #[test]
    fn chunks_grow_with_the_file_so_that_a_long_one_has_few() {
        let disk = Disk { bytes: Arc::default(), capacity: usize::MAX };
        let options = WriterOptions { compression: Compression::Lz4, ..WriterOptions::default() };
        let mut file = McapFile::new("long_0.mcap".into(), disk, &options, 0).unwrap();
        file.add_topic(&facts(), PoseStamped::DEFINITION).unwrap();
        // Masks of 256 x 256 at 60 Hz.
        let mut at_60_hz = |from: i64, to: i64| {
            let before = file.chunks();
            (60 * from..60 * to).for_each(|i| file.write(0, i * 16_666_667, 0, &[0; 65_536]).unwrap());
            file.chunks() - before
        };
        let (first_s, _, later_s) = (at_60_hz(0, 1), at_60_hz(1, 30), at_60_hz(30, 60));
        assert!(first_s > 10, "{first_s} chunks in the first second");
        assert!(later_s <= 40, "{later_s} chunks in 30 s");
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
