//! Participant of a node, owned in one place. Dropping it makes the node leave the graph.

use super::participant::discovery_port;
use super::socket_owner;
use futures::StreamExt;
use ros2_client::builtin_topics::ros_discovery;
use ros2_client::entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo};
use ros2_client::{DEFAULT_PUBLISHER_QOS, DEFAULT_SUBSCRIPTION_QOS, Gid, NodeName};
use rustdds::no_key::DataWriterCdr;
use rustdds::{
    DomainParticipant, DomainParticipantStatusEvent, DomainParticipantStatusListener, Publisher as DdsPublisher,
    QosPolicies, RTPSEntity, StatusEvented, Subscriber, Timestamp, Topic, TopicKind,
};
use std::collections::BTreeSet;
use std::error::Error;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};

/// Result of creating an endpoint.
pub(crate) type Created<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Identifiers of the endpoints of a node.
#[derive(Default)]
struct Entities {
    readers: BTreeSet<Gid>,
    writers: BTreeSet<Gid>,
}

type Shared = Arc<Mutex<Entities>>;

fn edit<T>(entities: &Shared, edit: impl FnOnce(&mut Entities) -> T) -> T {
    edit(&mut entities.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Entry of an endpoint in the node's announcement. Dropping it removes the endpoint from the next announcement.
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
    publisher: DdsPublisher,
    subscriber: Subscriber,
    events: DomainParticipantStatusListener,
    /// Inode of the socket at which the participant receives discovery; `None` without /proc.
    socket: Option<u64>,
    // Last: fields drop in this order, and the others must go while the participant can still announce it.
    participant: DomainParticipant,
}

impl Drop for Session {
    /// Announces to ROS that the node is gone. The end of the participant, which follows, announces it to DDS.
    fn drop(&mut self) {
        self.announce(Vec::new());
    }
}

impl Session {
    /// Creates the session of a node. Other nodes learn of it with its first endpoint.
    pub(crate) fn new(participant: DomainParticipant, node: NodeName) -> Created<Self> {
        let publisher = participant.create_publisher(&QosPolicies::from(DEFAULT_PUBLISHER_QOS))?;
        let subscriber = participant.create_subscriber(&QosPolicies::from(DEFAULT_SUBSCRIPTION_QOS))?;
        let (name, kind) = (ros_discovery::TOPIC_NAME.to_owned(), ros_discovery::TYPE_NAME.to_owned());
        let topic = participant.create_topic(name, kind, &ros_discovery::QOS_PUB, TopicKind::NoKey)?;
        let announcements = publisher.create_datawriter_no_key(&topic, None)?;
        let events = participant.status_listener();
        let port = discovery_port(participant.domain_id(), participant.participant_id());
        let socket = u16::try_from(port).ok().and_then(socket_owner::inode_at);
        Ok(Self {
            node,
            entities: Shared::default(),
            announcements,
            publisher,
            subscriber,
            events,
            socket,
            participant,
        })
    }

    pub(crate) fn participant(&self) -> &DomainParticipant {
        &self.participant
    }

    pub(super) fn publisher(&self) -> &DdsPublisher {
        &self.publisher
    }

    pub(super) fn subscriber(&self) -> &Subscriber {
        &self.subscriber
    }

    /// Creates a topic, by the DDS names of topic and type.
    pub(super) fn topic(&self, name: &str, dds_type: &str, qos: &QosPolicies) -> Created<Topic> {
        Ok(self.participant.create_topic(name.to_owned(), dds_type.to_owned(), qos, TopicKind::NoKey)?)
    }

    /// Announces a new reader of the node.
    pub(super) fn enter_reader(&self, reader: &impl RTPSEntity) -> Entry {
        let gid = Gid::from(reader.guid());
        edit(&self.entities, |entities| entities.readers.insert(gid));
        self.enter(gid)
    }

    /// Announces a new writer of the node.
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

    /// Polls the next event of discovery.
    pub(crate) fn poll_event(&self, context: &mut Context<'_>) -> Poll<Option<DomainParticipantStatusEvent>> {
        self.events.as_async_status_stream().poll_next_unpin(context)
    }

    /// Returns true if a thread of RustDDS has ended by itself, so that the participant no longer hears the graph.
    ///
    /// RustDDS 0.15.1 runs two threads for a participant, and ends each of them with a log line when its wait fails. No event
    /// tells of it: the status channel has a further sender in the discovery database, so it stays open. The ends of both threads
    /// have other traces. The event loop owns the UDP sockets, which are closed with it. The discovery thread owns the receiver of
    /// commands, so that a command fails after its end. An assertion of manual liveliness is such a command, and has no effect on
    /// writers with automatic liveliness.
    pub(crate) fn has_lost_network(&self) -> bool {
        self.participant.assert_liveliness().is_err() || self.socket.is_some_and(|inode| !socket_owner::is_bound(inode))
    }
}
