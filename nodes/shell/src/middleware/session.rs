//! The participant of a node, owned in one place: dropping it is how the node leaves the graph.

use futures::StreamExt;
use ros2_client::builtin_topics::ros_discovery;
use ros2_client::entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo};
use ros2_client::{DEFAULT_PUBLISHER_QOS, DEFAULT_SUBSCRIPTION_QOS, Gid, NodeName};
use rustdds::no_key::DataWriterCdr;
use rustdds::{
    DomainParticipant, DomainParticipantStatusEvent, DomainParticipantStatusListener, Publisher, QosPolicies,
    RTPSEntity, StatusEvented, Subscriber, Timestamp, Topic, TopicKind,
};
use std::collections::BTreeSet;
use std::error::Error;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};

/// Result of making an endpoint.
pub(crate) type Made<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Identifiers of the endpoints that a node has.
#[derive(Default)]
struct Entities {
    readers: BTreeSet<Gid>,
    writers: BTreeSet<Gid>,
}

type Shared = Arc<Mutex<Entities>>;

fn edit<T>(entities: &Shared, edit: impl FnOnce(&mut Entities) -> T) -> T {
    edit(&mut entities.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Entry of an endpoint in the node's announcement; dropping it takes the endpoint out of the next one.
pub(crate) struct Entry {
    gid: Gid,
    entities: Shared,
}

impl Drop for Entry {
    fn drop(&mut self) {
        edit(&self.entities, |entities| entities.readers.remove(&self.gid) | entities.writers.remove(&self.gid));
    }
}

/// DDS participant of a node.
pub(crate) struct Session {
    node: NodeName,
    entities: Shared,
    announcements: DataWriterCdr<ParticipantEntitiesInfo>,
    publisher: Publisher,
    subscriber: Subscriber,
    events: DomainParticipantStatusListener,
    // Last: the others go while the participant can still tell of it.
    participant: DomainParticipant,
}

impl Drop for Session {
    /// Tells ROS that the node is gone. The end of the participant, which follows, tells DDS.
    fn drop(&mut self) {
        self.announce(Vec::new());
    }
}

impl Session {
    /// The session of this node, which nobody has heard of before its first endpoint.
    pub(crate) fn new(participant: DomainParticipant, node: NodeName) -> Made<Self> {
        let publisher = participant.create_publisher(&QosPolicies::from(DEFAULT_PUBLISHER_QOS))?;
        let subscriber = participant.create_subscriber(&QosPolicies::from(DEFAULT_SUBSCRIPTION_QOS))?;
        let (name, kind) = (ros_discovery::TOPIC_NAME.to_owned(), ros_discovery::TYPE_NAME.to_owned());
        let topic = participant.create_topic(name, kind, &ros_discovery::QOS_PUB, TopicKind::NoKey)?;
        let announcements = publisher.create_datawriter_no_key(&topic, None)?;
        let events = participant.status_listener();
        Ok(Self { node, entities: Shared::default(), announcements, publisher, subscriber, events, participant })
    }

    pub(crate) fn participant(&self) -> &DomainParticipant {
        &self.participant
    }

    pub(super) fn publisher(&self) -> &Publisher {
        &self.publisher
    }

    pub(super) fn subscriber(&self) -> &Subscriber {
        &self.subscriber
    }

    /// A topic by the names that DDS has for it and for its type.
    pub(super) fn topic(&self, name: &str, dds_type: &str, qos: &QosPolicies) -> Made<Topic> {
        Ok(self.participant.create_topic(name.to_owned(), dds_type.to_owned(), qos, TopicKind::NoKey)?)
    }

    /// Announces a new reader as the node's.
    pub(super) fn enter_reader(&self, reader: &impl RTPSEntity) -> Entry {
        let gid = Gid::from(reader.guid());
        edit(&self.entities, |entities| entities.readers.insert(gid));
        self.enter(gid)
    }

    /// Announces a new writer as the node's.
    pub(super) fn enter_writer(&self, writer: &impl RTPSEntity) -> Entry {
        let gid = Gid::from(writer.guid());
        edit(&self.entities, |entities| entities.writers.insert(gid));
        self.enter(gid)
    }

    fn enter(&self, gid: Gid) -> Entry {
        let mut node = NodeEntitiesInfo::new(self.node.clone());
        node.add_writer(Gid::from(self.announcements.guid()));
        edit(&self.entities, |entities| {
            entities.readers.iter().for_each(|gid| node.add_reader(*gid));
            entities.writers.iter().for_each(|gid| node.add_writer(*gid));
        });
        self.announce(vec![node]);
        Entry { gid, entities: Arc::clone(&self.entities) }
    }

    fn announce(&self, nodes: Vec<NodeEntitiesInfo>) {
        let info = ParticipantEntitiesInfo::new(Gid::from(self.participant.guid()), nodes);
        if let Err(error) = self.announcements.write(info, Some(Timestamp::now())) {
            tracing::error!("the node's endpoints could not be announced: {error}");
        }
    }

    /// The next change that discovery tells of.
    pub(crate) fn poll_event(&self, context: &mut Context<'_>) -> Poll<Option<DomainParticipantStatusEvent>> {
        self.events.as_async_status_stream().poll_next_unpin(context)
    }
}
