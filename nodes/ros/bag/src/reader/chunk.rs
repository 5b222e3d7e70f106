//! Records in a chunk.

use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Number of bytes of opcode and length before each record's body.
pub(crate) const RECORD_HEADER: u64 = 9;

/// Limit in bytes of a record and of a decompressed chunk: 256 MiB. A greater length is taken for damage, so a wrong
/// length does not exhaust the memory.
pub(super) const LARGEST: u64 = 1 << 28;

/// Calls `visit` with opcode and body of every record in a chunk, after its checksum was verified. `body` is the body
/// of the chunk record. After an error, `visit` may have seen none, some or all of the records.
pub(crate) fn visit_records(
    body: &[u8],
    mut visit: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<ChunkHeader, String> {
    let Ok(Record::Chunk { header, data }) = mcap::parse_record(op::CHUNK, body) else {
        return Err("the chunk's header is not readable".to_owned());
    };
    if header.uncompressed_size > LARGEST {
        return Err(format!("expected a chunk of at most {LARGEST} bytes, got one of {}", header.uncompressed_size));
    }
    // The reader of the crate `mcap` reads whole files: it must see this record and nothing behind it.
    let head = body.get(..data_offset(&header)).unwrap_or(body);
    let length = (head.len() + data.len()) as u64;
    let record = [&[op::CHUNK], &length.to_le_bytes()[..], head, &data].concat();
    let mut input = &record[..];
    let limit = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX).max(record.len());
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(limit);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(|e| e.to_string())? {
            LinearReadEvent::ReadRequest(wanted) => {
                let given = wanted.min(input.len());
                let (now, later) = input.split_at(given);
                reader.insert(given).copy_from_slice(now);
                reader.notify_read(given);
                input = later;
            }
            LinearReadEvent::Record { opcode, data } => visit(opcode, data)?,
        }
    }
    Ok(header)
}

/// Number of bytes of a chunk's body before its records.
fn data_offset(header: &ChunkHeader) -> usize {
    3 * 8 + 4 + 4 + header.compression.len() + 8
}
