//! Endpoints of services: two topics, as rmw_fastrtps maps them. An answer names its request in the inline QoS (DDS-RPC 1.0,
//! section 7.2.4, enhanced service mapping).

use super::datagram::{Answer, MOST};
use super::endpoint::{Reader, Writer};
use super::graph::Graph;
use super::matches::Matches;
use super::session::{Created, Session};
use catenary_msgs::to_cdr;
use futures::{Stream, StreamExt};
use ros2_client::{MessageInfo, RmwRequestId};
use rustdds::mio1::event::Source;
use rustdds::{QosPolicies, SequenceNumber};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::pin::pin;
use std::sync::atomic::{AtomicI64, Ordering};

/// Name, type and profiles of a service.
pub(crate) struct ServiceSpec<'a> {
    /// Absolute name.
    pub(crate) name: &'a str,
    /// DDS name of the type, without `_Request_` and `_Response_`.
    pub(crate) dds_type: &'a str,
    /// Profile of requests.
    pub(crate) requests: &'a QosPolicies,
    /// Profile of answers.
    pub(crate) answers: &'a QosPolicies,
}

impl ServiceSpec<'_> {
    fn request_topic(&self) -> (String, String) {
        (format!("rq{}Request", self.name), format!("{}_Request_", self.dds_type))
    }

    fn answer_topic(&self) -> (String, String) {
        (format!("rr{}Reply", self.name), format!("{}_Response_", self.dds_type))
    }
}

/// Endpoints of a server.
pub(crate) struct ServerEndpoints<Req: 'static + DeserializeOwned, Resp: Serialize> {
    requests: Reader<Req>,
    answers: Writer<Resp>,
    answer_topic: String,
    /// Sequence number of the next answer.
    next: AtomicI64,
}

impl<Req: 'static + DeserializeOwned, Resp: Serialize> ServerEndpoints<Req, Resp> {
    pub(crate) fn new(session: &Session, of: &ServiceSpec<'_>) -> Created<Self> {
        let ((requests, request), (answers, answer)) = (of.request_topic(), of.answer_topic());
        let requests = Reader::new(session, &requests, &request, of.requests)?;
        let writer = Writer::new(session, &answers, &answer, of.answers)?;
        Ok(Self { requests, answers: writer, answer_topic: answers, next: AtomicI64::new(1) })
    }

    /// Returns the endless stream of requests.
    pub(crate) fn requests(&self) -> impl Stream<Item = Result<(RmwRequestId, Req), String>> + '_ {
        self.requests.stream().map(|read| read.map(|(request, info)| (identity(&info), request)))
    }

    /// Takes the next request, if there is one.
    pub(crate) fn try_take(&self) -> Result<Option<(RmwRequestId, Req)>, String> {
        Ok(self.requests.try_take()?.map(|(request, info)| (identity(&info), request)))
    }

    /// Answers a request. Only one thread of a server may call it: the sequence number of the next answer must be known.
    ///
    /// An answer of more than one datagram would not arrive. Then `refusal` makes the answer from the reason, and the log says it.
    pub(crate) fn answer(
        &self,
        graph: &Graph,
        to: RmwRequestId,
        answer: Resp,
        refusal: impl FnOnce(String) -> Option<Resp>,
    ) -> Result<(), String> {
        let mut answer = answer;
        let mut cdr = to_cdr(&answer).unwrap_or_default();
        if cdr.len() > MOST {
            let reason = self.too_large(graph, to, cdr.len());
            if let Some(refused) = refusal(reason) {
                answer = refused;
                cdr = to_cdr(&answer).unwrap_or_default();
            }
        }
        self.answer_in_one_datagram(graph, to, &cdr);
        // Sent in any case: the client ignores the second copy, and it may be the only one that arrives.
        let sequence = self.answers.write_answer(to, answer)?;
        self.next.store(sequence + 1, Ordering::Relaxed);
        Ok(())
    }

    /// Logs and counts an answer that is too large. Returns the reason for the caller.
    fn too_large(&self, graph: &Graph, to: RmwRequestId, bytes: usize) -> String {
        graph.count_too_large();
        let service = self.answer_topic.trim_start_matches("rr").trim_end_matches("Reply");
        let reason = format!(
            "the answer has {bytes} bytes, and one of more than {MOST} does not reach this program: ask for less at once, or use a \
             program of catenary, which gets answers of any size"
        );
        tracing::warn!("{service}: asked by {}: {reason}", graph.peer_of(to.writer_gid.to_bytes16()));
        reason
    }

    /// Sends a large answer as one datagram: see [`super::datagram`].
    fn answer_in_one_datagram(&self, graph: &Graph, to: RmwRequestId, cdr: &[u8]) {
        let sequence = self.next.load(Ordering::Relaxed);
        let answer = Answer { writer: self.answers.guid(), sequence, to, cdr };
        if !answer.is_due() {
            return;
        }
        if let Err(error) = answer.send(&graph.addresses_of(&self.answer_topic, to.writer_gid)) {
            tracing::debug!("{}: a large answer was not sent ahead: {error}", self.answer_topic);
        }
    }

    /// Returns the event source that signals new requests to a poll.
    pub(crate) fn source(&mut self) -> &mut dyn Source {
        self.requests.source()
    }
}

/// Returns the identity of a request, which its answer must name.
fn identity(info: &MessageInfo) -> RmwRequestId {
    let own = RmwRequestId { writer_gid: info.publisher_gid(), sequence_number: info.sequence_number() };
    match info.related_request_id() {
        // Clients on RustDDS: the message itself is the identity.
        None => own,
        // Clients on Fast DDS name their reader, and leave the number to the message.
        Some(named) if named.sequence_number == i64::from(SequenceNumber::UNKNOWN) => {
            RmwRequestId { sequence_number: own.sequence_number, ..named }
        }
        Some(named) => named,
    }
}

/// Endpoints of a client.
pub(crate) struct ClientEndpoints<Req: Serialize, Resp: 'static + DeserializeOwned> {
    requests: Writer<Req>,
    answers: Reader<Resp>,
}

impl<Req: Serialize, Resp: 'static + DeserializeOwned> ClientEndpoints<Req, Resp> {
    pub(crate) fn new(session: &Session, of: &ServiceSpec<'_>) -> Created<Self> {
        let ((requests, request), (answers, answer)) = (of.request_topic(), of.answer_topic());
        let requests = Writer::new(session, &requests, &request, of.requests)?;
        let answers = Reader::new(session, &answers, &answer, of.answers)?;
        Ok(Self { requests, answers })
    }

    /// Returns true if a server reads the requests and writes answers.
    pub(crate) fn is_matched(&self, matches: &Matches) -> bool {
        matches.has_reader(self.requests.guid()) && matches.has_writer(self.answers.guid())
    }

    /// Sends a request. Waits while the window is full.
    pub(crate) async fn ask(&self, request: Req) -> Result<RmwRequestId, String> {
        self.requests.write_request(request).await.map_err(|error| format!("Write error: {error}"))
    }

    /// Sends a request without waiting for the window.
    pub(crate) fn ask_now(&self, request: Req) -> Result<RmwRequestId, String> {
        self.requests.write_request_now(request).map_err(|error| format!("Write error: {error}"))
    }

    /// Waits for the answer to a request. Answers to other requests are ignored.
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
    fn a_request_is_identified_by_its_inline_qos_or_else_by_the_message() {
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
