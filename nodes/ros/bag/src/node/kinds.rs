//! Message types that the nodes record and replay. Types of the contract's topics are decoded on the way, so only valid
//! messages get into a bag or onto a topic. All other types pass through as bytes.

use crate::error::BagError;
use crate::node::definitions::{self, Definition};
use crate::reader::{BagMessage, Topic};
use crate::writer::TopicType;
use catenary_msgs::{
    InterfaceInfo, diagnostic_msgs, geometry_msgs, msg, rcl_interfaces, sensor_msgs, std_msgs, tf2_msgs,
};
use catenary_shell::{Msg, Node, Publisher, Qos, RawMessage, ShellError, Subscription, Time};
use std::time::Duration;

/// Received message, in CDR.
pub(crate) struct Arrival {
    pub(crate) cdr: Vec<u8>,
    pub(crate) received: Time,
    pub(crate) sent: Option<Time>,
}

/// Callback for messages of a topic. It runs on the thread of the subscription.
pub(crate) type Inbox = Box<dyn FnMut(Arrival) + Send>;

/// Publisher of the messages of a bag's topic.
pub(crate) trait Outlet {
    fn publish(&self, message: &BagMessage) -> Result<(), BagError>;
    fn has_subscriber(&self) -> bool;
    fn wait_for_subscriber(&self, timeout: Duration) -> bool;
    /// Absolute topic name after remapping.
    fn topic(&self) -> &str;
}

/// Constructor of an outlet.
type NewOutlet = fn(&Node, &str, Qos) -> Result<Box<dyn Outlet>, ShellError>;

/// Functions that record and replay one message type.
pub(crate) struct Kind {
    pub(crate) info: InterfaceInfo,
    /// True if messages are so large that subscriptions keep few of them.
    pub(crate) is_large: bool,
    subscribe: fn(&Node, &str, Qos, Inbox) -> Result<Subscription, ShellError>,
    outlet: NewOutlet,
    check: fn(&Topic) -> Result<(), BagError>,
}

impl Kind {
    const fn of<T: Msg>() -> Self {
        Self {
            info: InterfaceInfo::of::<T>(),
            is_large: false,
            subscribe: subscribe::<T>,
            outlet: |node, topic, qos| Ok(Box::new(node.publisher::<T>(topic, qos)?)),
            check: Topic::check::<T>,
        }
    }

    const fn large<T: Msg>() -> Self {
        Self { is_large: true, ..Self::of::<T>() }
    }

    pub(crate) fn outlet(&self, node: &Node, topic: &str, qos: Qos) -> Result<Box<dyn Outlet>, ShellError> {
        (self.outlet)(node, topic, qos)
    }

    pub(crate) fn check(&self, topic: &Topic) -> Result<(), BagError> {
        (self.check)(topic)
    }
}

// The types of the contract's topics; a test compares both lists.
static KINDS: [Kind; 18] = [
    Kind::large::<sensor_msgs::msg::Image>(),
    Kind::of::<sensor_msgs::msg::CameraInfo>(),
    Kind::of::<sensor_msgs::msg::JointState>(),
    Kind::of::<geometry_msgs::msg::PoseStamped>(),
    Kind::of::<geometry_msgs::msg::TwistStamped>(),
    Kind::of::<geometry_msgs::msg::WrenchStamped>(),
    Kind::of::<msg::Keypoints>(),
    Kind::of::<msg::ArmState>(),
    Kind::of::<std_msgs::msg::String>(),
    Kind::of::<msg::AcceptedTarget>(),
    Kind::of::<msg::EefDelta>(),
    Kind::of::<msg::Observation>(),
    Kind::of::<msg::EpisodeEvent>(),
    Kind::of::<msg::Mixture>(),
    Kind::of::<tf2_msgs::msg::TFMessage>(),
    Kind::of::<diagnostic_msgs::msg::DiagnosticArray>(),
    Kind::of::<rcl_interfaces::msg::Log>(),
    Kind::of::<catenary_msgs::rosgraph_msgs::msg::Clock>(),
];

/// Kind of the type called `type_name`; none if the type is not built in.
pub(crate) fn find(type_name: &str) -> Option<&'static Kind> {
    KINDS.iter().find(|k| k.info.type_name == type_name)
}

fn subscribe<T: Msg>(node: &Node, topic: &str, qos: Qos, mut inbox: Inbox) -> Result<Subscription, ShellError> {
    let name = topic.to_owned();
    node.subscription::<T>(topic, qos, move |got| match catenary_msgs::to_cdr(&*got.message) {
        Ok(cdr) => inbox(Arrival { cdr, received: got.received, sent: got.sent }),
        Err(error) => tracing::error!("{name}: a message is lost: {error}"),
    })
}

impl<T: Msg> Outlet for Publisher<T> {
    fn publish(&self, message: &BagMessage) -> Result<(), BagError> {
        Publisher::publish(self, message.decode::<T>()?).map_err(|e| BagError::Message {
            topic: e.topic,
            log_time_ns: message.log_time_ns,
            reason: e.reason,
        })
    }

    fn has_subscriber(&self) -> bool {
        Publisher::has_subscriber(self)
    }

    fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        Publisher::wait_for_subscriber(self, timeout)
    }

    fn topic(&self) -> &str {
        Publisher::topic(self)
    }
}

/// Type that can be recorded: decoded, or passed through with a known definition.
pub(crate) enum Source {
    Decoded(&'static Kind),
    Raw(Definition),
}

impl Source {
    /// Type called `type_name`; none if it is neither built in nor installed.
    pub(crate) fn find(type_name: &str) -> Option<Self> {
        find(type_name).map(Self::Decoded).or_else(|| definitions::find(type_name).map(Self::Raw))
    }

    pub(crate) fn topic_type(&self) -> TopicType<'_> {
        match self {
            Self::Decoded(kind) => TopicType::from(&kind.info),
            Self::Raw(definition) => definition.topic_type(),
        }
    }

    /// True if messages are so large that subscriptions keep few of them.
    pub(crate) fn is_large(&self) -> bool {
        matches!(self, Self::Decoded(kind) if kind.is_large)
    }

    pub(crate) fn subscribe(
        &self,
        node: &Node,
        topic: &str,
        qos: Qos,
        mut inbox: Inbox,
    ) -> Result<Subscription, ShellError> {
        match self {
            Self::Decoded(kind) => (kind.subscribe)(node, topic, qos, inbox),
            Self::Raw(definition) => node.raw_subscription(topic, &definition.name, qos, move |got| {
                inbox(Arrival { cdr: got.message.to_cdr(), received: got.received, sent: got.sent });
            }),
        }
    }
}

/// Outlet of a topic whose messages pass through as bytes.
pub(crate) fn raw_outlet(node: &Node, topic: &str, type_name: &str, qos: Qos) -> Result<Box<dyn Outlet>, ShellError> {
    Ok(Box::new(RawOutlet(node.raw_publisher(topic, type_name, qos)?)))
}

struct RawOutlet(Publisher<RawMessage>);

impl Outlet for RawOutlet {
    fn publish(&self, message: &BagMessage) -> Result<(), BagError> {
        let wrong =
            |topic: String, reason: String| BagError::Message { topic, log_time_ns: message.log_time_ns, reason };
        let raw = RawMessage::from_cdr(&message.data).ok_or_else(|| {
            wrong(message.topic.name.clone(), "expected little-endian CDR, got another encapsulation".to_owned())
        })?;
        self.0.publish(raw).map_err(|e| wrong(e.topic, e.reason))
    }

    fn has_subscriber(&self) -> bool {
        self.0.has_subscriber()
    }

    fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        self.0.wait_for_subscriber(timeout)
    }

    fn topic(&self) -> &str {
        self.0.topic()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_shell::contract;

    #[test]
    fn every_topic_of_the_contract_can_be_recorded() {
        for topic in contract::TOPICS {
            assert!(find(topic.type_name).is_some(), "{}", topic.type_name);
        }
        assert!(find("std_msgs/msg/Nothing").is_none());
    }
}
