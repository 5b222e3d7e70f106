//! Messages of types that are known only by name, as bytes on the wire.

use super::publisher::Publisher;
use super::subscription::{Received, Subscription};
use crate::dds::qos::Qos;
use crate::error::ShellError;
use crate::process::node::Node;
use serde::de::{SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::sync::Arc;

/// Encapsulation header of little-endian CDR.
const CDR_LE: [u8; 4] = [0, 1, 0, 0];

/// Message in little-endian CDR, of any type.
///
/// Every machine that ROS 2 is built for uses this byte order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RawMessage {
    /// Message without its encapsulation header, which the middleware adds and removes.
    body: Vec<u8>,
}

impl ros2_client::Message for RawMessage {}

impl RawMessage {
    /// Reads a message after its encapsulation header. Returns `None` if it is not little-endian CDR.
    #[must_use]
    pub fn from_cdr(cdr: &[u8]) -> Option<Self> {
        let (header, body) = cdr.split_at_checked(CDR_LE.len())?;
        (header[..2] == CDR_LE[..2]).then(|| Self { body: body.to_vec() })
    }

    /// Returns the message with its encapsulation header.
    #[must_use]
    pub fn to_cdr(&self) -> Vec<u8> {
        [&CDR_LE[..], &self.body].concat()
    }
}

impl Serialize for RawMessage {
    /// Serialises a tuple of bytes: CDR writes neither a length nor padding for it.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(self.body.len())?;
        self.body.iter().try_for_each(|byte| tuple.serialize_element(byte))?;
        tuple.end()
    }
}

impl<'de> Deserialize<'de> for RawMessage {
    /// Deserialises a tuple of unlimited length: it ends with the input.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // The number of bytes is not known before the end of the input.
        deserializer.deserialize_tuple(usize::MAX, Bytes)
    }
}

struct Bytes;

impl<'de> Visitor<'de> for Bytes {
    type Value = RawMessage;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("the bytes of a message")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<RawMessage, A::Error> {
        let mut body = Vec::new();
        // CDR reports the end of its input as an error.
        while let Ok(Some(byte)) = bytes.next_element::<u8>() {
            body.push(byte);
        }
        Ok(RawMessage { body })
    }
}

/// Topic of another participant's publisher.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublishedTopic {
    /// Absolute name.
    pub name: String,
    /// `package/msg/Type`.
    pub type_name: String,
    /// Profile that each publisher offers, with the depth of [`Qos::DEFAULT`]: depths are not announced.
    pub offered: Vec<Qos>,
}

impl Node {
    /// Returns the ROS topics that other participants publish, sorted by name and type.
    #[must_use]
    pub fn published_topics(&self) -> Vec<PublishedTopic> {
        let mut found: Vec<PublishedTopic> = Vec::new();
        for (name, type_name, qos) in self.graph().other_publishers() {
            match found.iter_mut().find(|t| t.name == name && t.type_name == type_name) {
                Some(known) => known.offered.push(qos),
                None => found.push(PublishedTopic { name, type_name, offered: vec![qos] }),
            }
        }
        found.sort_by(|a, b| (&a.name, &a.type_name).cmp(&(&b.name, &b.type_name)));
        found
    }

    /// Creates a publisher of encoded messages of the type called `type_name` (`package/msg/Type`).
    ///
    /// # Errors
    /// [`ShellError`]: the names, the middleware.
    pub fn raw_publisher(&self, topic: &str, type_name: &str, qos: Qos) -> Result<Publisher<RawMessage>, ShellError> {
        let name = self.resolve(topic)?;
        let writer = self.graph().writer(&name, type_name, &qos.policies())?;
        Ok(Publisher::new(writer, name, Arc::clone(self.graph()), self.shutdown().clone()))
    }

    /// Calls `callback` with every message of a topic of the type called `type_name`, as [`Node::subscription`].
    ///
    /// # Errors
    /// As [`Node::raw_publisher`].
    pub fn raw_subscription(
        &self,
        topic: &str,
        type_name: &str,
        qos: Qos,
        callback: impl FnMut(Received<RawMessage>) + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let name = self.resolve(topic)?;
        let reader = self.graph().reader(&name, type_name, &qos.policies())?;
        Subscription::start(self, name, qos, reader, None, callback)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_msgs::geometry_msgs::msg::PoseStamped;

    #[test]
    fn a_message_keeps_its_bytes() {
        let mut pose = PoseStamped::default();
        pose.header.frame_id = "base".into();
        pose.pose.position.x = 0.25;
        let cdr = catenary_msgs::to_cdr(&pose).unwrap();
        let raw: RawMessage = catenary_msgs::from_cdr(&cdr).unwrap();
        assert_eq!(raw.to_cdr(), cdr);
        assert_eq!(catenary_msgs::to_cdr(&raw).unwrap(), cdr);
        assert_eq!(RawMessage::from_cdr(&cdr), Some(raw));
        assert_eq!(RawMessage::from_cdr(&[0, 0, 0, 0, 1]), None);
        assert_eq!(RawMessage::from_cdr(&[0, 1]), None);
    }
}
