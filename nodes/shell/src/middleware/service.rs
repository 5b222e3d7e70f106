//! Services over two topics, as rmw_fastrtps maps them: an answer names its request in the inline QoS (DDS-RPC 1.0, section
//! 7.2.4, enhanced service mapping).

use super::datagram::Answer;
use super::endpoint::{Reader, Writer};
use super::matches::Matches;
use super::session::{Made, Session};
use crate::graph::Graph;
use catenary_msgs::to_cdr;
use futures::{Stream, StreamExt};
use ros2_client::{MessageInfo, RmwRequestId};
use rustdds::mio1::event::Source;
use rustdds::{QosPolicies, SequenceNumber};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::pin::pin;
use std::sync::atomic::{AtomicI64, Ordering};

/// Names and profiles of a service.
pub(crate) struct Served<'a> {
    /// The absolute name.
    pub(crate) name: &'a str,
    /// The DDS name of its type, up to `_Request_` and `_Response_`.
    pub(crate) dds_type: &'a str,
    /// The profile of requests.
    pub(crate) requests: &'a QosPolicies,
    /// The profile of answers.
    pub(crate) answers: &'a QosPolicies,
}

impl Served<'_> {
    fn request_topic(&self) -> (String, String) {
        (format!("rq{}Request", self.name), format!("{}_Request_", self.dds_type))
    }

    fn answer_topic(&self) -> (String, String) {
        (format!("rr{}Reply", self.name), format!("{}_Response_", self.dds_type))
    }
}

/// The server's ends.
pub(crate) struct ServerEnds<Req: 'static + DeserializeOwned, Resp: Serialize> {
    requests: Reader<Req>,
    answers: Writer<Resp>,
    answer_topic: String,
    /// Number of the next answer.
    next: AtomicI64,
}

impl<Req: 'static + DeserializeOwned, Resp: Serialize> ServerEnds<Req, Resp> {
    pub(crate) fn new(session: &Session, of: &Served<'_>) -> Made<Self> {
        let ((requests, request), (answers, answer)) = (of.request_topic(), of.answer_topic());
        let requests = Reader::new(session, &requests, &request, of.requests)?;
        let writer = Writer::new(session, &answers, &answer, of.answers)?;
        Ok(Self { requests, answers: writer, answer_topic: answers, next: AtomicI64::new(1) })
    }

    /// The requests as they come, without end.
    pub(crate) fn requests(&self) -> impl Stream<Item = Result<(RmwRequestId, Req), String>> + '_ {
        self.requests.stream().map(|read| read.map(|(request, info)| (identity(&info), request)))
    }

    /// The next request, where one has come.
    pub(crate) fn try_take(&self) -> Result<Option<(RmwRequestId, Req)>, String> {
        Ok(self.requests.try_take()?.map(|(request, info)| (identity(&info), request)))
    }

    /// Answers a request. One thread of a server answers.
    pub(crate) fn answer(&self, graph: &Graph, to: RmwRequestId, answer: Resp) -> Result<(), String> {
        self.answer_in_one_datagram(graph, to, &answer);
        let sequence = self.answers.write_answer(to, answer)?;
        self.next.store(sequence + 1, Ordering::Relaxed);
        Ok(())
    }

    /// Sends a large answer ahead: see [`super::datagram`].
    fn answer_in_one_datagram(&self, graph: &Graph, to: RmwRequestId, answer: &Resp) {
        let Ok(cdr) = to_cdr(answer) else { return };
        let sequence = self.next.load(Ordering::Relaxed);
        let answer = Answer { writer: self.answers.guid(), sequence, to, cdr: &cdr };
        if !answer.is_due() {
            return;
        }
        if let Err(error) = answer.send(&graph.addresses_of(&self.answer_topic, to.writer_gid)) {
            tracing::debug!("{}: a large answer was not sent ahead: {error}", self.answer_topic);
        }
    }

    /// By which a poll learns that a request has come.
    pub(crate) fn source(&mut self) -> &mut dyn Source {
        self.requests.source()
    }
}

/// Identity of a request, to which the answer refers.
fn identity(info: &MessageInfo) -> RmwRequestId {
    let own = RmwRequestId { writer_gid: info.publisher_gid(), sequence_number: info.sequence_number() };
    match info.related_request_id() {
        // Clients on RustDDS name themselves by the message alone.
        None => own,
        // Fast DDS leaves the number to the message.
        Some(named) if named.sequence_number == i64::from(SequenceNumber::UNKNOWN) => {
            RmwRequestId { sequence_number: own.sequence_number, ..named }
        }
        Some(named) => named,
    }
}

/// The client's ends.
pub(crate) struct ClientEnds<Req: Serialize, Resp: 'static + DeserializeOwned> {
    requests: Writer<Req>,
    answers: Reader<Resp>,
}

impl<Req: Serialize, Resp: 'static + DeserializeOwned> ClientEnds<Req, Resp> {
    pub(crate) fn new(session: &Session, of: &Served<'_>) -> Made<Self> {
        let ((requests, request), (answers, answer)) = (of.request_topic(), of.answer_topic());
        let requests = Writer::new(session, &requests, &request, of.requests)?;
        let answers = Reader::new(session, &answers, &answer, of.answers)?;
        Ok(Self { requests, answers })
    }

    /// Whether somebody reads the requests and somebody writes answers.
    pub(crate) fn is_matched(&self, matches: &Matches) -> bool {
        matches.has_reader(self.requests.guid()) && matches.has_writer(self.answers.guid())
    }

    /// Sends a request; waits while the window is full.
    pub(crate) async fn ask(&self, request: Req) -> Result<RmwRequestId, String> {
        self.requests.write_request(request).await.map_err(|error| format!("Write error: {error}"))
    }

    /// Sends a request without waiting.
    pub(crate) fn ask_now(&self, request: Req) -> Result<RmwRequestId, String> {
        self.requests.write_request_now(request).map_err(|error| format!("Write error: {error}"))
    }

    /// The answer to a request; those to others are passed over.
    pub(crate) async fn answer(&self, to: RmwRequestId) -> Result<Resp, String> {
        let mut answers = pin!(self.answers.stream());
        loop {
            let Some(answer) = answers.next().await else {
                return Err("Read error: the stream of answers ended".into());
            };
            let (answer, info) = answer.map_err(|error| format!("Read error: {error}"))?;
            if info.related_request_id() == Some(to) {
                return Ok(answer);
            }
        }
    }

    /// Sends a request and waits for its answer.
    pub(crate) async fn call(&self, request: Req) -> Result<Resp, String> {
        let id = self.ask(request).await?;
        self.answer(id).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::Gid;

    #[test]
    fn a_request_is_known_by_what_it_names_as_far_as_it_names_something() {
        let (writer, client) = (Gid::from([1; 16]), Gid::from([2; 16]));
        let of = |named: Option<i64>| {
            let named = named.map(|sequence_number| RmwRequestId { writer_gid: client, sequence_number });
            let id = identity(&MessageInfo::new(None, None, 7, writer, named));
            (id.writer_gid, id.sequence_number)
        };
        assert_eq!(of(None), (writer, 7));
        assert_eq!(of(Some(3)), (client, 3));
        assert_eq!(of(Some(i64::from(SequenceNumber::UNKNOWN))), (client, 7));
    }
}
