//! Looks an MCAP file through record by record: one that was not finished, or whose summary does not say where all
//! messages are.

use super::chunk::{RECORD_HEADER, visit_records};
use super::file::{Definitions, Piece, Place, nanoseconds, read_body};
use mcap::MAGIC;
use mcap::records::{Record, op};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

/// Reads a file from the front, for what can be had of it.
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
        if head[0] == 0 || body_len > left.saturating_sub(RECORD_HEADER) {
            definitions.notes.push(format!("it ends within a record: the last {left} bytes are lost"));
            break;
        }
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

/// Counts no messages on channels that the file does not define, as where the chunk that did is damaged.
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

/// Says what was found in the file, and whether its end is there.
fn conclude(definitions: &mut Definitions, ended: bool, has_footer: bool) {
    let messages: u64 = definitions.counts.values().sum();
    let chunks = definitions.pieces.iter().filter(|p| p.place == Place::Chunk).count();
    let has_loose = definitions.pieces.len() > chunks;
    // Without chunks there is nothing that a summary could say where it is.
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
    let remedy =
        if has_loose { "; such a file is not reindexed, `mcap recover` makes one with chunks of it" } else { "" };
    definitions.notes.insert(0, format!("{state}: {messages} messages were found {places}{remedy}"));
}

/// Takes what one record defines.
fn take_record(
    definitions: &mut Definitions,
    input: &mut BufReader<&File>,
    opcode: u8,
    offset: u64,
    len: u64,
) -> Result<(), String> {
    let body = read_body(input, offset, len).map_err(|e| e.to_string())?;
    let piece = |span, place| Piece { span, offset, len, place };
    match opcode {
        op::CHUNK => {
            let mut found = Vec::new();
            let read = visit_records(&body, |opcode, body| match opcode {
                op::SCHEMA | op::CHANNEL => {
                    definitions.define(mcap::parse_record(opcode, body).map_err(|e| e.to_string())?);
                    Ok(())
                }
                op::MESSAGE => {
                    let (channel, time) = message_key(body)?;
                    found.push((channel, nanoseconds(time)));
                    Ok(())
                }
                _ => Ok(()),
            });
            if let Ok(Record::Chunk { header, .. }) = mcap::parse_record(op::CHUNK, &body) {
                definitions.check_compression(&header.compression);
            }
            read?;
            let times = found.iter().map(|(_, time)| Some((*time, *time)));
            let span = times.flatten().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
            for (channel, _) in &found {
                *definitions.counts.entry(*channel).or_default() += 1;
            }
            definitions.pieces.extend(span.map(|s| piece(s, Place::Chunk)));
        }
        op::MESSAGE => {
            let (channel, time) = message_key(&body)?;
            *definitions.counts.entry(channel).or_default() += 1;
            let time = nanoseconds(time);
            definitions.pieces.push(piece((time, time), Place::Message));
        }
        _ => definitions.define(mcap::parse_record(opcode, &body).map_err(|e| e.to_string())?),
    }
    Ok(())
}

/// Channel and log time of a message.
pub(super) fn message_key(body: &[u8]) -> Result<(u16, u64), String> {
    match mcap::parse_record(op::MESSAGE, body) {
        Ok(Record::Message { header, .. }) => Ok((header.channel_id, header.log_time)),
        _ => Err("a message's header is not readable".to_owned()),
    }
}
