//! Messages in order of their log times.

use super::chunk::visit_records;
use super::file::{IndexedFile, Piece, read_body};
use super::{BagReader, Topic};
use crate::error::BagError;
use catenary_msgs::Interface;
use mcap::records::{Record, op};
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::File;
use std::sync::Arc;

/// A message of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct BagMessage {
    /// Its topic.
    pub topic: Arc<Topic>,
    /// When it was received, ns in the recorder's clock.
    pub log_time_ns: i64,
    /// When it was sent, ns in the sender's clock.
    pub publish_time_ns: i64,
    /// CDR with its encapsulation header.
    pub data: Vec<u8>,
}

impl BagMessage {
    /// The message as a `T`.
    ///
    /// # Errors
    /// [`BagError::Type`] where the topic has another type or another version of it, [`BagError::Message`] where the
    /// bytes are none.
    pub fn decode<T: Interface + DeserializeOwned>(&self) -> Result<T, BagError> {
        self.topic.check::<T>()?;
        catenary_msgs::from_cdr(&self.data).map_err(|e| BagError::Message {
            topic: self.topic.name.clone(),
            log_time_ns: self.log_time_ns,
            reason: e.to_string(),
        })
    }
}

/// Messages of a bag in order of their log times; those of equal time in the order in which they were written.
///
/// Reads a chunk when its time has come, so that memory holds only the chunks that overlap. A damaged chunk gives one
/// error, and the messages of the others follow.
pub struct Messages<'a> {
    bag: &'a BagReader,
    wanted: Option<BTreeSet<String>>,
    /// File and piece, by start.
    order: Vec<(usize, Piece)>,
    next: usize,
    open: Vec<Option<File>>,
    /// By log time, file, offset of the piece and place in it.
    ready: BTreeMap<(u64, usize, u64, usize), BagMessage>,
    errors: VecDeque<BagError>,
}

impl<'a> Messages<'a> {
    pub(super) fn new(bag: &'a BagReader, wanted: Option<BTreeSet<String>>) -> Self {
        let pieces = |(i, file): (usize, &IndexedFile)| file.pieces.iter().map(move |p| (i, *p)).collect::<Vec<_>>();
        let mut order: Vec<(usize, Piece)> = bag.files.iter().enumerate().flat_map(pieces).collect();
        order.sort_by_key(|(file, piece)| (piece.span.0, *file, piece.offset));
        let open = bag.files.iter().map(|_| None).collect();
        Self { bag, wanted, order, next: 0, open, ready: BTreeMap::new(), errors: VecDeque::new() }
    }

    fn load(&mut self, index: usize, piece: Piece) -> Result<(), BagError> {
        let indexed = &self.bag.files[index];
        let file = match &mut self.open[index] {
            Some(file) => file,
            slot => slot.insert(File::open(&indexed.path).map_err(BagError::io("open", &indexed.path))?),
        };
        let damaged = |reason: String| BagError::Damaged { path: indexed.path.clone(), offset: piece.offset, reason };
        let body = read_body(file, piece.offset, piece.len).map_err(|e| damaged(e.to_string()))?;
        let (ready, wanted) = (&mut self.ready, self.wanted.as_ref());
        let mut place = 0;
        let mut take = |opcode: u8, body: &[u8]| {
            if opcode == op::MESSAGE {
                let (time, message) = message(indexed, body)?;
                if wanted.is_none_or(|names| names.contains(&message.topic.name)) {
                    ready.insert((time, index, piece.offset, place), message);
                }
                place += 1;
            }
            Ok(())
        };
        if piece.is_chunk {
            visit_records(&body, take).map(|_header| ()).map_err(damaged)
        } else {
            take(op::MESSAGE, &body).map_err(damaged)
        }
    }
}

fn message(file: &IndexedFile, body: &[u8]) -> Result<(u64, BagMessage), String> {
    let Ok(Record::Message { header, data }) = mcap::parse_record(op::MESSAGE, body) else {
        return Err("a message's header is not readable".to_owned());
    };
    let id = header.channel_id;
    let topic = file.channels.get(&id).ok_or_else(|| format!("a message on channel {id}, which is not defined"))?;
    let ns = |time: u64| i64::try_from(time).unwrap_or(i64::MAX);
    let message = BagMessage {
        topic: Arc::clone(topic),
        log_time_ns: ns(header.log_time),
        publish_time_ns: ns(header.publish_time),
        data: data.into_owned(),
    };
    Ok((header.log_time, message))
}

impl Iterator for Messages<'_> {
    type Item = Result<BagMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        while let Some((file, piece)) = self.order.get(self.next).copied() {
            let early = self.ready.first_key_value().is_some_and(|(key, _)| key.0 < piece.span.0);
            if early {
                break;
            }
            self.next += 1;
            if let Err(error) = self.load(file, piece) {
                self.errors.push_back(error);
            }
        }
        match self.errors.pop_front() {
            Some(error) => Some(Err(error)),
            None => self.ready.pop_first().map(|(_, message)| Ok(message)),
        }
    }
}
