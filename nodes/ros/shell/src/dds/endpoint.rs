//! Writers and readers of topics.

use super::session::{Created, Entry, Session};
use futures::{Stream, StreamExt};
use ros2_client::{MessageInfo, RmwRequestId, WriteError};
use rustdds::mio1::event::Source;
use rustdds::no_key::{DataWriterCdr, SimpleDataReaderCdr};
use rustdds::{CDRDeserializerAdapter, GUID, QosPolicies, RTPSEntity, SampleIdentity, Timestamp, WriteOptionsBuilder};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Display;

/// Writer on a topic.
pub(crate) struct Writer<M: Serialize> {
    writer: DataWriterCdr<M>,
    _entry: Entry,
}

impl<M: Serialize> Writer<M> {
    /// Creates a writer on a topic, by the DDS names of topic and type.
    pub(crate) fn new(session: &Session, topic: &str, dds_type: &str, qos: &QosPolicies) -> Created<Self> {
        let topic = session.topic(topic, dds_type, qos)?;
        let writer = session.publisher().create_datawriter_no_key(&topic, None)?;
        let entry = session.enter_writer(&writer);
        Ok(Self { writer, _entry: entry })
    }

    pub(crate) fn guid(&self) -> GUID {
        self.writer.guid()
    }

    /// Writes a message. The error is the reason of its loss.
    pub(crate) fn write(&self, message: M) -> Result<(), String> {
        self.writer.write(message, Some(Timestamp::now())).map_err(|error| reason(WriteError::from(error)))
    }

    /// Waits until every matched reliable reader has acknowledged all messages so far. Returns false on timeout.
    pub(crate) fn wait_acknowledged(&self, timeout: std::time::Duration) -> bool {
        self.writer.wait_for_acknowledgments(timeout).unwrap_or(false)
    }

    /// Writes a request, and returns the identity that its answer will name. Waits while the window is full.
    pub(super) async fn write_request(&self, request: M) -> Result<RmwRequestId, String> {
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).build();
        let sent = self.writer.async_write_with_options(request, options).await;
        sent.map(RmwRequestId::from).map_err(|error| reason(WriteError::from(error)))
    }

    /// Writes a request without waiting for the window.
    pub(super) fn write_request_now(&self, request: M) -> Result<RmwRequestId, String> {
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).build();
        let sent = self.writer.write_with_options(request, options);
        sent.map(RmwRequestId::from).map_err(|error| reason(WriteError::from(error)))
    }

    /// Writes the answer to a request, and returns its sequence number.
    pub(super) fn write_answer(&self, to: RmwRequestId, answer: M) -> Result<i64, String> {
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now());
        let options = options.related_sample_identity(SampleIdentity::from(to)).build();
        let sent = self.writer.write_with_options(answer, options);
        sent.map(|sent| i64::from(sent.sequence_number)).map_err(|error| reason(WriteError::from(error)))
    }
}

fn reason<M>(error: WriteError<M>) -> String
where
    WriteError<M>: Display,
{
    match error {
        WriteError::WouldBlock { .. } => "a subscriber does not keep up".to_owned(),
        other => other.to_string(),
    }
}

/// Reader on a topic.
pub(crate) struct Reader<M: 'static + DeserializeOwned> {
    reader: SimpleDataReaderCdr<M>,
    _entry: Entry,
}

/// Message with its metadata, or the reason why it cannot be decoded.
type Read<M> = Result<(M, MessageInfo), String>;

impl<M: 'static + DeserializeOwned> Reader<M> {
    /// Creates a reader on a topic, by the DDS names of topic and type.
    pub(crate) fn new(session: &Session, topic: &str, dds_type: &str, qos: &QosPolicies) -> Created<Self> {
        let topic = session.topic(topic, dds_type, qos)?;
        let reader =
            session.subscriber().create_simple_datareader_no_key::<M, CDRDeserializerAdapter<M>>(&topic, None)?;
        let entry = session.enter_reader(&reader);
        Ok(Self { reader, _entry: entry })
    }

    pub(crate) fn guid(&self) -> GUID {
        self.reader.guid()
    }

    /// Returns the endless stream of messages.
    pub(crate) fn stream(&self) -> impl Stream<Item = Read<M>> + '_ {
        self.reader.as_async_stream().map(|sample| {
            let sample = sample.map_err(|error| error.to_string())?;
            let info = MessageInfo::from(&sample);
            Ok((sample.into_value(), info))
        })
    }

    /// Takes the next message, if there is one.
    pub(crate) fn try_take(&self) -> Result<Option<(M, MessageInfo)>, String> {
        // Without this a poll is not signalled again.
        self.reader.drain_read_notifications();
        let sample = self.reader.try_take_one().map_err(|error| error.to_string())?;
        Ok(sample.map(|sample| {
            let info = MessageInfo::from(&sample);
            (sample.into_value(), info)
        }))
    }

    /// Returns the event source that signals new messages to a poll.
    pub(super) fn source(&mut self) -> &mut dyn Source {
        &mut self.reader
    }
}
