//! Scan of an MCAP file record by record, for files that were not finished or whose summary is not complete.

use super::chunk::{RECORD_HEADER, visit_records};
use super::index::{Definitions, Piece, PieceKind, nanoseconds, read_body};
use mcap::MAGIC;
use mcap::records::{Record, op};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

/// Reads a file of `len` bytes from the front and collects every readable definition, chunk and message outside of
/// chunks.
pub(super) fn scan(file: &File, len: u64) -> std::io::Result<Definitions> {
    let mut input = BufReader::new(file);
    let mut definitions = Definitions::default();
    let mut offset = MAGIC.len() as u64;
    let mut ended = false;
    while offset < len && !ended {
        let mut head = [0; RECORD_HEADER as usize];
        let left = len - offset;
        let body_len = if left >= RECORD_HEADER {
            input.seek(SeekFrom::Start(offset))?;
            input.read_exact(&mut head)?;
            u64::from_le_bytes(head[1..].try_into().unwrap_or_default())
        } else {
            u64::MAX
        };
        // Opcode 0 is invalid: a machine that lost power leaves zeros at the end of its files.
        if head[0] == 0 || body_len > left.saturating_sub(RECORD_HEADER) {
            definitions.notes.push(format!("it ends within a record: the last {left} bytes are lost"));
            break;
        }
        // The records behind DATA_END repeat earlier ones.
        ended = head[0] == op::DATA_END;
        let interesting = matches!(head[0], op::SCHEMA | op::CHANNEL | op::CHUNK | op::MESSAGE);
        if interesting && let Err(reason) = take_record(&mut definitions, &mut input, head[0], offset, body_len) {
            definitions.notes.push(format!("damaged at byte {offset}: {reason}"));
        }
        offset += RECORD_HEADER + body_len;
    }
    leave_out_undefined(&mut definitions);
    let mut end = [0; MAGIC.len()];
    input.seek(SeekFrom::Start(len.saturating_sub(MAGIC.len() as u64)))?;
    input.read_exact(&mut end)?;
    conclude(&mut definitions, ended, end == MAGIC);
    Ok(definitions)
}

/// Removes messages on undefined channels from the counts, and notes them. The chunk that defined a channel may be
/// damaged.
fn leave_out_undefined(definitions: &mut Definitions) {
    let (counts, channels) = (&mut definitions.counts, &definitions.channels);
    let all: u64 = counts.values().sum();
    counts.retain(|id, _| channels.contains_key(id));
    let left_out = all - counts.values().sum::<u64>();
    if left_out > 0 {
        let note = format!("{left_out} messages are left out, because no readable record defines their channels");
        definitions.notes.push(note);
    }
}

/// Decides if the file is finished, and notes the state of a file that is not. A file is finished if it has DATA_END, the
/// magic bytes at its end, messages outside of chunks, and no chunk.
fn conclude(definitions: &mut Definitions, ended: bool, has_footer: bool) {
    let messages: u64 = definitions.counts.values().sum();
    let chunks = definitions.pieces.iter().filter(|p| p.kind == PieceKind::Chunk).count();
    let has_loose = definitions.pieces.len() > chunks;
    // A summary of a file without chunks indexes nothing, so the file counts as finished without one.
    definitions.is_finished = ended && has_footer && has_loose && chunks == 0;
    if definitions.is_finished {
        return;
    }
    let state = match ended {
        true => "its summary is missing or not complete",
        false => "it was not finished and has no summary",
    };
    let places = match (has_loose, chunks) {
        (false, _) => format!("in {chunks} complete chunks"),
        (true, 0) => "outside of chunks".to_owned(),
        (true, _) => format!("in {chunks} complete chunks and outside of them"),
    };
    let remedy = match has_loose {
        true => "; reindex cannot finish a file with messages outside of chunks: convert it with `mcap recover`",
        false => "",
    };
    definitions.notes.insert(0, format!("{state}: {messages} messages were found {places}{remedy}"));
}

/// Length in bytes from which on a run of messages outside of chunks ends: as many as a chunk has.
const RUN: u64 = 1 << 20;

/// Adds a message outside of chunks to the run before it, or begins another run.
fn take_loose(definitions: &mut Definitions, channel: u16, time: i64, offset: u64, len: u64) {
    let end = |run: &Piece| run.offset + run.len;
    match definitions.pieces.last_mut().filter(|p| p.kind == PieceKind::Run && end(p) == offset && p.len + len <= RUN) {
        Some(run) => {
            run.len += len;
            run.span = (run.span.0.min(time), run.span.1.max(time));
        }
        None => {
            let piece = Piece { span: (time, time), offset, len, kind: PieceKind::Run, channels: None };
            definitions.pieces.push(piece);
        }
    }
    *definitions.counts.entry(channel).or_default() += 1;
}

/// Adds the definitions of one record, or its chunk or message as a piece.
fn take_record(
    definitions: &mut Definitions,
    input: &mut BufReader<&File>,
    opcode: u8,
    offset: u64,
    len: u64,
) -> Result<(), String> {
    let body = read_body(input, offset, len).map_err(|e| e.to_string())?;
    match opcode {
        op::CHUNK => {
            let (mut found, mut span) = (BTreeMap::<u16, u64>::new(), None::<(i64, i64)>);
            let read = visit_records(&body, |opcode, body| match opcode {
                op::SCHEMA | op::CHANNEL => {
                    definitions.define(mcap::parse_record(opcode, body).map_err(|e| e.to_string())?);
                    Ok(())
                }
                op::MESSAGE => {
                    let (channel, time) = message_key(body)?;
                    let time = nanoseconds(time);
                    *found.entry(channel).or_default() += 1;
                    span = Some(span.map_or((time, time), |(first, last)| (first.min(time), last.max(time))));
                    Ok(())
                }
                _ => Ok(()),
            });
            // Compression is checked before an error of the read is returned: a chunk of an unknown compression cannot
            // be read, and would be reported only as damaged.
            if let Ok(Record::Chunk { header, .. }) = mcap::parse_record(op::CHUNK, &body) {
                definitions.check_compression(&header.compression);
            }
            read?;
            for (channel, count) in &found {
                *definitions.counts.entry(*channel).or_default() += count;
            }
            let channels = Some(found.keys().copied().collect());
            definitions.pieces.extend(span.map(|span| Piece { span, offset, len, kind: PieceKind::Chunk, channels }));
        }
        op::MESSAGE => {
            let (channel, time) = message_key(&body)?;
            take_loose(definitions, channel, nanoseconds(time), offset, RECORD_HEADER + len);
        }
        _ => definitions.define(mcap::parse_record(opcode, &body).map_err(|e| e.to_string())?),
    }
    Ok(())
}

/// Channel and log time of a message record.
pub(crate) fn message_key(body: &[u8]) -> Result<(u16, u64), String> {
    match mcap::parse_record(op::MESSAGE, body) {
        Ok(Record::Message { header, .. }) => Ok((header.channel_id, header.log_time)),
        _ => Err("a message's header is not readable".to_owned()),
    }
}
