//! Finishing of a truncated file: adds the missing end, so every reader of MCAP can read it.
#![allow(clippy::disallowed_methods, reason = "bags are files")]

use crate::error::BagError;
use crate::format::records::{list, record};
use crate::reader::chunk::{RECORD_HEADER, visit_records};
use crate::reader::index::read_body;
use crate::reader::scan::message_key;
use mcap::MAGIC;
use mcap::records::{ChunkHeader, Record, op};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Chunk of the file.
struct Chunk {
    header: ChunkHeader,
    start: u64,
    len: u64,
    /// Byte offset of the message index of each channel.
    index: BTreeMap<u16, u64>,
    /// Length in bytes of all its message indexes.
    index_len: u64,
    /// First and last log time of its messages; none without messages. The times in its header are not used, because they have
    /// no checksum.
    span: Option<(u64, u64)>,
}

/// Contents of a file, read from the front.
#[derive(Default)]
struct Contents {
    chunks: Vec<Chunk>,
    /// Log time and byte offset of the messages of each channel in the last chunk.
    last: BTreeMap<u16, Vec<(u64, u64)>>,
    /// Bodies of schemas and channels.
    schemas: BTreeMap<u16, Vec<u8>>,
    channels: BTreeMap<u16, Vec<u8>>,
    counts: BTreeMap<u16, u64>,
    /// Bodies of the index entries of attachments and of metadata.
    attachments: Vec<Vec<u8>>,
    metadata: Vec<Vec<u8>>,
    /// End of the last complete chunk, definition, attachment or metadata.
    end: u64,
    has_loose_messages: bool,
}

/// Writes message indexes, summary and footer behind the last complete chunk, definition, attachment or metadata.
///
/// An incomplete record behind it is cut off. A file whose messages stand outside of chunks is left unchanged.
///
/// # Errors
/// [`BagError::Io`]. The file then ends with its last complete chunk.
pub(super) fn finish(path: &Path) -> Result<(), BagError> {
    let mut file = File::options().read(true).write(true).open(path).map_err(BagError::io("open for writing", path))?;
    let mut found = read_contents(&file).map_err(BagError::io("read", path))?;
    if found.has_loose_messages {
        return Ok(());
    }
    let end = found.ending();
    let written = file.set_len(found.end).and_then(|()| {
        file.seek(SeekFrom::Start(found.end))?;
        file.write_all(&end)?;
        file.sync_all()
    });
    written.map_err(|reason| {
        let _ends_within_a_record = file.set_len(found.end);
        BagError::io("write the index of", path)(reason)
    })
}

fn read_contents(file: &File) -> io::Result<Contents> {
    let len = file.metadata()?.len();
    let mut input = BufReader::new(file);
    let mut found = Contents { end: MAGIC.len() as u64, ..Contents::default() };
    let mut offset = found.end;
    while len - offset >= RECORD_HEADER {
        input.seek(SeekFrom::Start(offset))?;
        let mut head = [0; RECORD_HEADER as usize];
        input.read_exact(&mut head)?;
        let body_len = u64::from_le_bytes(head[1..].try_into().unwrap_or_default());
        let left = len - offset - RECORD_HEADER;
        // An end that was begun is cut off and written again.
        if head[0] == 0 || head[0] == op::DATA_END || body_len > left {
            break;
        }
        let record_len = RECORD_HEADER + body_len;
        match head[0] {
            op::HEADER => found.end = offset + record_len,
            op::SCHEMA | op::CHANNEL => {
                found.define(head[0], &read_body(&mut input, offset, body_len)?);
                found.end = offset + record_len;
            }
            op::ATTACHMENT | op::METADATA => {
                found.take_attachment_or_metadata(head[0], &read_body(&mut input, offset, body_len)?, offset);
                found.end = offset + record_len;
            }
            op::CHUNK => found.take_chunk(&read_body(&mut input, offset, body_len)?, offset),
            op::MESSAGE_INDEX => found.take_index(&read_body(&mut input, offset, body_len)?, offset),
            op::MESSAGE => found.has_loose_messages = true,
            _ => {}
        }
        offset += record_len;
    }
    Ok(found)
}

/// Id at the beginning of schemas, channels and message indexes.
fn number(body: &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes(body.get(..2)?.try_into().ok()?))
}

impl Contents {
    fn define(&mut self, opcode: u8, body: &[u8]) {
        let known = if opcode == op::SCHEMA { &mut self.schemas } else { &mut self.channels };
        if let Some(id) = number(body) {
            known.entry(id).or_insert_with(|| body.to_vec());
        }
    }

    /// Adds a chunk; a damaged chunk is skipped.
    fn take_chunk(&mut self, body: &[u8], start: u64) {
        let mut messages = BTreeMap::<u16, Vec<(u64, u64)>>::new();
        let mut place = 0;
        let visited = visit_records(body, |opcode, record| {
            match opcode {
                op::SCHEMA | op::CHANNEL => self.define(opcode, record),
                op::MESSAGE => {
                    let (channel, time) = message_key(record)?;
                    messages.entry(channel).or_default().push((time, place));
                }
                _ => {}
            }
            place += RECORD_HEADER + record.len() as u64;
            Ok(())
        });
        if let Ok(header) = visited {
            let len = RECORD_HEADER + body.len() as u64;
            self.end = start + len;
            // Readers refuse an index of an undefined channel.
            messages.retain(|channel, _| self.channels.contains_key(channel));
            for (channel, of_channel) in &messages {
                *self.counts.entry(*channel).or_default() += of_channel.len() as u64;
            }
            let times = || messages.values().flatten().map(|(time, _)| *time);
            let span = times().min().zip(times().max());
            self.chunks.push(Chunk { header, start, len, index: BTreeMap::new(), index_len: 0, span });
            self.last = messages;
        }
    }

    /// Adds a message index to the chunk before it.
    fn take_index(&mut self, body: &[u8], start: u64) {
        let before = self.chunks.last_mut().filter(|chunk| chunk.start + chunk.len + chunk.index_len == start);
        if let (Some(chunk), Some(channel)) = (before, number(body)) {
            chunk.index.insert(channel, start);
            chunk.index_len += RECORD_HEADER + body.len() as u64;
        }
    }

    /// Adds an attachment or a metadata record.
    fn take_attachment_or_metadata(&mut self, opcode: u8, body: &[u8], start: u64) {
        let place = [start.to_le_bytes(), (RECORD_HEADER + body.len() as u64).to_le_bytes()].concat();
        match mcap::parse_record(opcode, body) {
            Ok(Record::Attachment { header, data, .. }) => {
                let numbers = [header.log_time, header.create_time, data.len() as u64].map(u64::to_le_bytes).concat();
                self.attachments.push([place, numbers, list(&header.name), list(&header.media_type)].concat());
            }
            Ok(Record::Metadata(metadata)) => self.metadata.push([place, list(&metadata.name)].concat()),
            _ => {}
        }
    }

    /// Bytes of the missing end: message indexes of the last chunk, summary and footer.
    fn ending(&mut self) -> Vec<u8> {
        let mut out = Vec::new();
        let start = self.end;
        // Only the last chunk can lack its message indexes: the writer puts them right behind each chunk.
        if let Some(chunk) = self.chunks.last_mut().filter(|chunk| chunk.start + chunk.len == start) {
            chunk.index.clear();
            for (channel, messages) in &mut self.last {
                messages.sort_unstable();
                chunk.index.insert(*channel, start + out.len() as u64);
                let entries = messages.iter().flat_map(|(time, place)| [time.to_le_bytes(), place.to_le_bytes()]);
                record(
                    &mut out,
                    op::MESSAGE_INDEX,
                    &[&channel.to_le_bytes(), &list(entries.collect::<Vec<_>>().concat())],
                );
            }
            chunk.index_len = out.len() as u64;
        }
        // A checksum of 0 means that none was computed, here and in the footer.
        record(&mut out, op::DATA_END, &[&[0; 4]]);
        let summary_start = start + out.len() as u64;
        let mut groups = Vec::new();
        let mut group = |out: &mut Vec<u8>, opcode: u8, bodies: Vec<Vec<u8>>| {
            let begin = start + out.len() as u64;
            bodies.iter().for_each(|body| record(out, opcode, &[body]));
            let len = start + out.len() as u64 - begin;
            if len > 0 {
                groups.push([&[opcode][..], &begin.to_le_bytes(), &len.to_le_bytes()].concat());
            }
        };
        group(&mut out, op::SCHEMA, self.schemas.values().cloned().collect());
        group(&mut out, op::CHANNEL, self.channels.values().cloned().collect());
        group(&mut out, op::STATISTICS, vec![self.statistics()]);
        group(&mut out, op::CHUNK_INDEX, self.chunks.iter().map(Chunk::index).collect());
        group(&mut out, op::ATTACHMENT_INDEX, self.attachments.clone());
        group(&mut out, op::METADATA_INDEX, self.metadata.clone());
        let offsets_start = start + out.len() as u64;
        groups.iter().for_each(|body| record(&mut out, op::SUMMARY_OFFSET, &[body]));
        record(&mut out, op::FOOTER, &[&summary_start.to_le_bytes(), &offsets_start.to_le_bytes(), &[0; 4]]);
        out.extend_from_slice(MAGIC);
        out
    }

    fn statistics(&self) -> Vec<u8> {
        let messages: u64 = self.counts.values().sum();
        let spans = || self.chunks.iter().filter_map(|chunk| chunk.span);
        let first = spans().map(|(first, _)| first).min().unwrap_or(0);
        let last = spans().map(|(_, last)| last).max().unwrap_or(0);
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes();
        let schemas = u16::try_from(self.schemas.len()).unwrap_or(u16::MAX);
        let counts = self.counts.iter().flat_map(|(id, n)| [&id.to_le_bytes()[..], &n.to_le_bytes()].concat());
        [
            &messages.to_le_bytes()[..],
            &schemas.to_le_bytes(),
            &count(self.channels.len()),
            &count(self.attachments.len()),
            &count(self.metadata.len()),
            &count(self.chunks.len()),
            &first.to_le_bytes(),
            &last.to_le_bytes(),
            &list(counts.collect::<Vec<_>>()),
        ]
        .concat()
    }
}

impl Chunk {
    /// Body of its chunk index in the summary.
    fn index(&self) -> Vec<u8> {
        let offsets = self.index.iter().flat_map(|(id, at)| [&id.to_le_bytes()[..], &at.to_le_bytes()].concat());
        let (first, last) = self.span.unwrap_or_default();
        [
            &first.to_le_bytes()[..],
            &last.to_le_bytes(),
            &self.start.to_le_bytes(),
            &self.len.to_le_bytes(),
            &list(offsets.collect::<Vec<_>>()),
            &self.index_len.to_le_bytes(),
            &list(&self.header.compression),
            &self.header.compressed_size.to_le_bytes(),
            &self.header.uncompressed_size.to_le_bytes(),
        ]
        .concat()
    }
}
