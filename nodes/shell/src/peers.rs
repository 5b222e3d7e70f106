//! Other nodes as discovery tells of them: who serves, publishes or listens under a name, and who sent a request.
//!
//! RTPS endpoints carry identifiers only. The names of their nodes come on the topic `ros_discovery_info`, on which every
//! ROS 2 participant lists its nodes and their endpoints.

use crate::error::ShellError;
use crate::graph::Graph;
use crate::middleware::Reader;
use crate::node::Node;
use crate::participant::data_ports_here;
use crate::process_of::{are_local, is_local, process_at};
use crate::qos::Qos;
use futures::StreamExt;
use ros2_client::builtin_topics::ros_discovery;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest time until a participant of this machine is found. Fast DDS listens to no multicast where discovery is kept to
/// this machine, and is found by its announcement, every 3 s.
const SLOWEST: Duration = Duration::from_secs(4);
/// Between two looks at what discovery knows.
const LOOK: Duration = Duration::from_millis(20);
/// Participants whose nodes are remembered before those that have left are dropped.
const REMEMBERED: usize = 256;
/// Bytes of an identifier that all endpoints of a participant share.
const PREFIX: usize = 12;

/// Identifier of an endpoint or a participant.
type Gid = [u8; 16];
type Prefix = [u8; PREFIX];

/// `rmw_dds_common/msg/NodeEntitiesInfo`.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct NodeEntities {
    namespace: String,
    name: String,
    readers: Vec<Gid>,
    writers: Vec<Gid>,
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ParticipantEntities {
    participant: Gid,
    nodes: Vec<NodeEntities>,
}

/// Nodes of each participant.
#[derive(Debug, Default)]
pub(crate) struct Directory {
    nodes: Mutex<BTreeMap<Prefix, Vec<NodeEntities>>>,
}

fn prefix(gid: &Gid) -> Prefix {
    let mut prefix = [0; PREFIX];
    prefix.copy_from_slice(&gid[..PREFIX]);
    prefix
}

fn path(node: &NodeEntities) -> String {
    crate::names::node_path(&node.namespace, &node.name)
}

impl Directory {
    fn nodes(&self) -> MutexGuard<'_, BTreeMap<Prefix, Vec<NodeEntities>>> {
        self.nodes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a participant's list, the last of which counts. `present` tells which participants are still there.
    fn update(&self, told: ParticipantEntities, present: impl Fn() -> BTreeSet<Prefix>) {
        let mut nodes = self.nodes();
        let prefix = prefix(&told.participant);
        if told.nodes.is_empty() {
            nodes.remove(&prefix);
            return;
        }
        if nodes.len() >= REMEMBERED {
            let present = present();
            nodes.retain(|prefix, _| present.contains(prefix));
        }
        nodes.insert(prefix, told.nodes);
    }

    /// Name of the node that has an endpoint. An endpoint in no list is one of its participant's nodes.
    fn name(&self, gid: &Gid) -> Option<String> {
        let nodes = self.nodes();
        let of_participant = nodes.get(&prefix(gid))?;
        let owner = of_participant.iter().find(|n| n.readers.contains(gid) || n.writers.contains(gid));
        match (owner, &of_participant[..]) {
            (Some(node), _) => Some(path(node)),
            (None, []) => None,
            (None, all) => Some(all.iter().map(path).collect::<Vec<_>>().join(" or ")),
        }
    }
}

/// Reader of `ros_discovery_info`.
pub(crate) fn reader(graph: &Graph) -> Result<Reader<ParticipantEntities>, ShellError> {
    let policies = Qos::ReliableTransientLocal { depth: 100 }.policies();
    graph.make(
        "rmw_dds_common/msg/ParticipantEntitiesInfo",
        || "subscription of ros_discovery_info".to_owned(),
        |session| Reader::new(session, ros_discovery::TOPIC_NAME, ros_discovery::TYPE_NAME, &policies),
    )
}

/// Keeps the directory of the graph up to date, for ever.
pub(crate) async fn follow(graph: Arc<Graph>, reader: Reader<ParticipantEntities>) {
    let mut lists = pin!(reader.stream());
    while let Some(list) = lists.next().await {
        match list {
            Ok((list, _)) => {
                graph.directory().update(list, || graph.others().into_iter().map(|e| prefix(&e.gid)).collect())
            }
            Err(error) => tracing::debug!("ros_discovery_info: {error}"),
        }
    }
}

/// An endpoint of a participant.
#[derive(Clone)]
pub(crate) struct Endpoint {
    pub(crate) gid: Gid,
    /// Name of the topic in the middleware.
    pub(crate) topic: String,
    pub(crate) is_writer: bool,
    pub(crate) addresses: Vec<SocketAddr>,
}

impl Graph {
    /// Endpoints of other participants that live, as far as they promised signs of life.
    fn others(&self) -> Vec<Endpoint> {
        let own = self.own_prefix();
        let all = self.living_endpoints();
        all.into_iter().filter(|endpoint| prefix(&endpoint.gid) != own).collect()
    }

    fn own_prefix(&self) -> Prefix {
        prefix(&self.guid().to_bytes())
    }

    fn peer(&self, gid: Gid, addresses: Vec<SocketAddr>) -> Peer {
        Peer { node: self.directory().name(&gid), gid, addresses }
    }

    /// The node that has an endpoint, which discovery need not know: addresses are those of its participant.
    fn peer_of(&self, gid: Gid) -> Peer {
        let of_participant = |e: &Endpoint| prefix(&e.gid) == prefix(&gid) && !e.addresses.is_empty();
        let addresses = self.living_endpoints().into_iter().find(of_participant).map(|e| e.addresses);
        self.peer(gid, addresses.unwrap_or_default())
    }

    /// The owners of the chosen endpoints, each node once.
    fn owners(&self, chosen: impl Fn(&Endpoint) -> bool) -> Vec<Peer> {
        let mut owners: Vec<Peer> = Vec::new();
        for endpoint in self.others().into_iter().filter(chosen) {
            let peer = self.peer(endpoint.gid, endpoint.addresses);
            if !owners.iter().any(|known| known.is_same_node(&peer)) {
                owners.push(peer);
            }
        }
        owners.sort_by(|a, b| a.node.cmp(&b.node));
        owners
    }

    /// Other nodes that serve a service or an action with one of these absolute names.
    pub(crate) fn servers(&self, names: &[String]) -> Vec<Peer> {
        let replies = |name: &String| [format!("rr{name}Reply"), format!("rr{name}/_action/send_goalReply")];
        let replies: Vec<String> = names.iter().flat_map(replies).collect();
        self.owners(|endpoint| endpoint.is_writer && replies.contains(&endpoint.topic))
    }
}

/// Another node, by its name or by what is known without it. Displays as `/camera (process 4711)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Peer {
    node: Option<String>,
    gid: Gid,
    addresses: Vec<SocketAddr>,
}

impl Peer {
    /// Fully qualified name, unless it is not known yet.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        self.node.as_deref()
    }

    /// Process number, where the node runs on this machine and /proc shows it.
    #[must_use]
    pub fn process(&self) -> Option<u32> {
        process_at(&self.addresses)
    }

    /// Whether both live in one DDS participant, which is one process.
    #[must_use]
    pub fn shares_participant(&self, other: &Self) -> bool {
        prefix(&self.gid) == prefix(&other.gid)
    }

    fn is_same_node(&self, other: &Self) -> bool {
        self.shares_participant(other) && self.node == other.node
    }
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.node {
            Some(name) => f.write_str(name)?,
            None => {
                f.write_str("a node without a name, GUID ")?;
                self.gid.iter().try_for_each(|byte| write!(f, "{byte:02x}"))?;
            }
        }
        let remote = self.addresses.iter().map(SocketAddr::ip).find(|ip| !ip.is_unspecified() && !is_local(*ip));
        match (self.process(), remote) {
            (Some(pid), _) => write!(f, " (process {pid})"),
            (None, Some(ip)) => write!(f, " (on {ip})"),
            (None, None) => Ok(()),
        }
    }
}

/// Sender of a request. Displays as its [`Peer`], which is looked up only then.
#[derive(Clone)]
pub struct Requester {
    gid: Gid,
    graph: Arc<Graph>,
}

impl Requester {
    pub(crate) fn new(graph: &Arc<Graph>, request: &ros2_client::RmwRequestId) -> Self {
        Self { gid: request.writer_gid.to_bytes16(), graph: Arc::clone(graph) }
    }

    /// The node that sent the request.
    #[must_use]
    pub fn peer(&self) -> Peer {
        self.graph.peer_of(self.gid)
    }
}

impl fmt::Display for Requester {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.peer().fmt(f)
    }
}

/// Names in a sentence: `/a (process 1) and /b (process 2)`.
#[must_use]
pub fn list_peers(peers: &[Peer]) -> String {
    let words: Vec<String> = peers.iter().map(Peer::to_string).collect();
    match &words[..] {
        [] => "nobody".to_owned(),
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        all => all.concat(),
    }
}

impl Node {
    /// Other nodes that serve a service or an action with one of these names. One that was killed counts until its lease
    /// ends: 10 s for our services.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn servers(&self, names: &[&str]) -> Result<Vec<Peer>, ShellError> {
        let names = names.iter().map(|name| self.resolve(name)).collect::<Result<Vec<_>, _>>()?;
        Ok(self.graph().servers(&names))
    }

    /// The node that has the endpoint with this identifier, such as [`Received::publisher`](crate::Received::publisher).
    #[must_use]
    pub fn peer(&self, endpoint: [u8; 16]) -> Peer {
        self.graph().peer_of(endpoint)
    }

    /// Publishers that other nodes have on a topic. A node comes as often as it has one.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publishers(&self, topic: &str) -> Result<Vec<Peer>, ShellError> {
        let (topic, graph) = (format!("rt{}", self.resolve(topic)?), self.graph());
        let publishers = graph.others().into_iter().filter(|endpoint| endpoint.is_writer && endpoint.topic == topic);
        Ok(publishers.map(|publisher| graph.peer(publisher.gid, publisher.addresses)).collect())
    }

    /// Other nodes that publish on one of these topics, each once.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publishing(&self, topics: &[&str]) -> Result<Vec<Peer>, ShellError> {
        let names = topics.iter().map(|topic| Ok(format!("rt{}", self.resolve(topic)?)));
        let names = names.collect::<Result<Vec<_>, ShellError>>()?;
        Ok(self.graph().owners(|endpoint| endpoint.is_writer && names.contains(&endpoint.topic)))
    }

    /// Other nodes that subscribe to a topic.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn subscribers(&self, topic: &str) -> Result<Vec<Peer>, ShellError> {
        let topic = format!("rt{}", self.resolve(topic)?);
        Ok(self.graph().owners(|endpoint| !endpoint.is_writer && endpoint.topic == topic))
    }

    /// Every other node of the domain, as far as discovery has told. A participant that has not listed its nodes counts as one
    /// node without a name.
    #[must_use]
    pub fn peers(&self) -> Vec<Peer> {
        let mut participants: BTreeMap<Prefix, Endpoint> = BTreeMap::new();
        for endpoint in self.graph().others() {
            let known = participants.entry(prefix(&endpoint.gid)).or_insert_with(|| endpoint.clone());
            if known.addresses.is_empty() {
                known.addresses = endpoint.addresses;
            }
        }
        let nodes = self.graph().directory().nodes();
        let peers = participants.into_iter().flat_map(|(prefix, Endpoint { gid, addresses, .. })| {
            let names: Vec<Option<String>> = match nodes.get(&prefix) {
                Some(listed) => listed.iter().map(|node| Some(path(node))).collect(),
                None => vec![None],
            };
            names.into_iter().map(move |node| Peer { node, gid, addresses: addresses.clone() })
        });
        peers.collect()
    }

    /// Looks around for `time` at least, and returns the other nodes of the domain. Waits longer, 4 s at most, for the
    /// participants of this machine that are known by their ports alone, and for names.
    #[must_use]
    pub fn look_around(&self, time: Duration) -> Vec<Peer> {
        let start = Instant::now();
        loop {
            let is_over = self.shutdown().wait_timeout(LOOK);
            let peers = self.peers();
            let is_complete = self.has_met_all_here(&peers) && peers.iter().all(|peer| peer.node.is_some());
            if is_over || start.elapsed() >= if is_complete { time } else { time.max(SLOWEST) } {
                return peers;
            }
        }
    }

    /// Whether the participants of this machine that have ports of this domain are known.
    fn has_met_all_here(&self, peers: &[Peer]) -> bool {
        let Some((domain, number)) = self.graph().domain_and_number() else { return true };
        let own = 7400 + 250 * u32::from(domain) + 11 + 2 * u32::from(number);
        // A participant of another machine may have the same port.
        let is_at = |peer: &Peer, port| peer.addresses.iter().any(|address| address.port() == port);
        let has = |port: u16| peers.iter().any(|peer| is_at(peer, port) && are_local(&peer.addresses));
        data_ports_here(domain).into_iter().all(|port| u32::from(port) == own || has(port))
    }
}

/// Addresses at which an endpoint receives.
pub(crate) fn addresses<L: Copy>(locators: &[L]) -> Vec<SocketAddr>
where
    SocketAddr: From<L>,
{
    locators.iter().map(|locator| SocketAddr::from(*locator)).filter(|a| !a.ip().is_unspecified()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid_of(participant: u8, entity: u8) -> Gid {
        let mut gid = [participant; 16];
        gid[PREFIX..].fill(entity);
        gid
    }

    fn node(namespace: &str, name: &str, readers: &[Gid], writers: &[Gid]) -> NodeEntities {
        let (namespace, name) = (namespace.to_owned(), name.to_owned());
        NodeEntities { namespace, name, readers: readers.to_vec(), writers: writers.to_vec() }
    }

    #[test]
    fn an_endpoint_is_its_nodes_and_an_unlisted_one_is_one_of_its_participants() {
        let directory = Directory::default();
        let nodes = vec![node("/", "a", &[gid_of(1, 7)], &[]), node("/lab", "b", &[], &[gid_of(1, 9)])];
        directory.update(ParticipantEntities { participant: gid_of(1, 1), nodes }, BTreeSet::new);
        assert_eq!(directory.name(&gid_of(1, 7)).as_deref(), Some("/a"));
        assert_eq!(directory.name(&gid_of(1, 9)).as_deref(), Some("/lab/b"));
        assert_eq!(directory.name(&gid_of(1, 5)).as_deref(), Some("/a or /lab/b"));
        assert_eq!(directory.name(&gid_of(2, 7)), None);
        directory.update(ParticipantEntities { participant: gid_of(1, 1), nodes: Vec::new() }, BTreeSet::new);
        assert_eq!(directory.name(&gid_of(1, 7)), None);
    }

    #[test]
    fn participants_that_left_are_forgotten_and_those_that_stay_are_not() {
        let directory = Directory::default();
        for number in 0..=REMEMBERED {
            let mut participant = [0; 16];
            participant[..2].copy_from_slice(&u16::try_from(number).unwrap().to_be_bytes());
            let nodes = vec![node("/", "a", &[], &[])];
            let present = || BTreeSet::from([[0; PREFIX]]);
            directory.update(ParticipantEntities { participant, nodes }, present);
        }
        assert_eq!(directory.nodes().len(), 2);
        assert!(directory.nodes().contains_key(&[0; PREFIX]));
    }

    #[test]
    fn a_peer_without_a_name_tells_its_guid() {
        let peer = Peer { node: None, gid: [0xab; 16], addresses: Vec::new() };
        assert!(peer.to_string().ends_with(&"ab".repeat(16)), "{peer}");
        let named = Peer { node: Some("/a".to_owned()), ..peer };
        assert_eq!(list_peers(&[named.clone(), named.clone(), named]), "/a, /a and /a");
    }
}
