//! Large answers from node to node of catenary: on a topic beside the service.
//!
//! RustDDS 0.15.1 puts a stray byte before the inline QoS of every fragment that it sends, and a service's reply names its
//! request in the inline QoS: a reply that does not fit into one datagram comes out garbled. A message on a topic has no
//! inline QoS. So a large answer goes out as a `catenary_msgs/msg/Reply`, which names its request itself, where the client
//! listens there. Other clients, and small answers, go by the service as ever. Actions tell their results by a service, too.

use crate::error::ShellError;
use crate::first_contact::FirstContact;
use crate::graph::Graph;
use crate::middleware::{Reader, Writer};
use crate::qos::Qos;
use catenary_msgs::msg::Reply;
use catenary_msgs::{Interface, from_cdr, to_cdr};
use futures::StreamExt;
use ros2_client::{Message, RmwRequestId};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

/// Services with answers that may be large, by type.
const TYPES: [&str; 3] = ["catenary_msgs/srv/Simulate", "catenary_msgs/srv/OpenEnvs", "catenary_msgs/srv/StepEnvs"];

/// Bytes of an answer that fit into one datagram of every network, with all that goes before them.
const SMALL: usize = 1024;

/// The vendor's id of RustDDS, by which its identifiers begin.
const RUSTDDS: [u8; 2] = [0x01, 0x12];

/// How many answers the middleware repeats where they were lost.
const QOS: Qos = Qos::DEFAULT;

/// How long the first large answer waits for the client's reader, without which it would be garbled. Clients of catenary have one,
/// which a busy network tells late.
const PATIENCE: Duration = Duration::from_secs(5);

/// Whether a service of this type has a topic for large answers.
pub(crate) fn is_for(type_name: &str) -> bool {
    TYPES.contains(&type_name)
}

/// The topic of a service, hidden as those of actions are.
fn topic(service: &str) -> String {
    format!("{service}/_reply")
}

/// The server's end.
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

    /// The clients that listen.
    pub(crate) fn contact(&self, graph: &Arc<Graph>) -> FirstContact {
        FirstContact::new(graph, format!("rt{}", self.topic), PATIENCE)
    }

    /// Sends an answer that is large to a client that listens; false: it is small, or the client does not.
    pub(crate) fn send<R: Message>(&self, id: &RmwRequestId, response: &R, clients: &mut FirstContact) -> bool {
        let Ok(cdr) = to_cdr(response) else { return false };
        // Other programs never listen here: they are not waited for.
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

/// The client's end.
pub(crate) struct ReplyReader {
    reader: Reader<Reply>,
}

impl ReplyReader {
    pub(crate) fn new(graph: &Graph, service: &str) -> Result<Self, ShellError> {
        let topic = topic(service);
        let reader = graph.reader(&topic, Reply::TYPE_NAME, &QOS.policies())?;
        Ok(Self { reader })
    }

    /// The answer to one request, for which it waits; those to others are passed over.
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
