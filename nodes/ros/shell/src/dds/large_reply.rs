//! Large replies between nodes of catenary, on a topic beside the service.
//!
//! RustDDS 0.15.1 writes a stray byte before the inline QoS of every fragment. A service reply names its request in the inline
//! QoS, so a reply of several fragments is corrupted. Topic messages have no inline QoS. Therefore a large reply goes out as a
//! `catenary_msgs/msg/Reply`, which names its request itself, if the client listens on that topic. Small replies and other
//! clients use the service as usual. Results of actions are service replies too.

use super::endpoint::{Reader, Writer};
use super::first_contact::FirstContact;
use super::graph::Graph;
use super::qos::Qos;
use crate::error::ShellError;
use catenary_msgs::msg::Reply;
use catenary_msgs::{Interface, from_cdr, to_cdr};
use futures::StreamExt;
use ros2_client::{Message, RmwRequestId};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

/// Types of services with large replies.
const TYPES: [&str; 3] = ["catenary_msgs/srv/Simulate", "catenary_msgs/srv/OpenEnvs", "catenary_msgs/srv/StepEnvs"];

/// Maximum size of a small reply, bytes: with its headers it fits into one datagram of every network (IPv6 guarantees 1280).
const SMALL: usize = 1024;

/// Vendor id of RustDDS, the first bytes of its identifiers.
const RUSTDDS: [u8; 2] = [0x01, 0x12];

/// Profile of the reply topic: reliable, so lost replies are repeated.
const QOS: Qos = Qos::DEFAULT;

/// Timeout for the discovery of a client's reader on the reply topic. Without the reader a large reply would be corrupted. Every
/// client of catenary has one, but on a busy network it is discovered late.
const PATIENCE: Duration = Duration::from_secs(5);

/// Returns true if services of this type have a topic for large replies.
pub(crate) fn is_for(type_name: &str) -> bool {
    TYPES.contains(&type_name)
}

/// Returns the reply topic of a service. The underscore hides it in `ros2 topic list`, as the topics of actions.
fn topic(service: &str) -> String {
    format!("{service}/_reply")
}

/// Writer of large replies of a server.
pub(crate) struct ReplyWriter {
    writer: Writer<Reply>,
    topic: String,
}

impl ReplyWriter {
    pub(crate) fn new(graph: &Graph, service: &str) -> Result<Self, ShellError> {
        let topic = topic(service);
        let writer = graph.writer(&topic, Reply::TYPE_NAME, &QOS.of_writer().policies())?;
        Ok(Self { writer, topic })
    }

    /// Creates the known clients of the reply topic.
    pub(crate) fn contact(&self, graph: &Arc<Graph>) -> FirstContact {
        FirstContact::new(graph, format!("rt{}", self.topic), PATIENCE)
    }

    /// Sends a large reply to a client that listens on the reply topic. Returns false for a small reply or another client.
    pub(crate) fn send<R: Message>(&self, id: &RmwRequestId, response: &R, clients: &mut FirstContact) -> bool {
        // The service itself reports a reply that cannot be encoded.
        let Ok(cdr) = to_cdr(response) else { return false };
        // Other programs never listen on this topic, so they are not awaited.
        if cdr.len() <= SMALL || !is_rustdds(id) || !clients.wait(id) {
            return false;
        }
        let mut client = [0; 16];
        client.copy_from_slice(id.writer_gid.as_bytes());
        let reply = Reply { client, sequence: id.sequence_number, response: cdr };
        if let Err(error) = self.writer.write(reply) {
            tracing::warn!("{}: answer not sent: {error}", self.topic);
        }
        true
    }
}

fn is_rustdds(id: &RmwRequestId) -> bool {
    id.writer_gid.as_bytes()[..2] == RUSTDDS
}

/// Reader of large replies of a client.
pub(crate) struct ReplyReader {
    reader: Reader<Reply>,
}

impl ReplyReader {
    pub(crate) fn new(graph: &Graph, service: &str) -> Result<Self, ShellError> {
        let topic = topic(service);
        let reader = graph.reader(&topic, Reply::TYPE_NAME, &QOS.policies())?;
        Ok(Self { reader })
    }

    /// Waits for the reply to a request. Replies to other requests are ignored.
    pub(crate) async fn receive<R: Message>(&self, id: RmwRequestId) -> Result<R, String> {
        let mut replies = pin!(self.reader.stream());
        loop {
            let Some(reply) = replies.next().await else { return Err("the stream of answers ended".to_owned()) };
            let (reply, _) = reply?;
            if reply.client == id.writer_gid.as_bytes()[..] && reply.sequence == id.sequence_number {
                return from_cdr(&reply.response).map_err(|error| error.to_string());
            }
        }
    }
}
