//! Other nodes of the graph: servers, publishers and subscribers under a name, and senders of requests.

use super::directory::{Endpoint, Gid, ParticipantEntities, Prefix, prefix};
use super::endpoint::Reader;
use super::graph::Graph;
use super::participant::{data_port, data_ports_here};
use super::qos::Qos;
use super::socket_owner::{are_local, is_bound, is_local, process_at, socket_at};
use crate::error::ShellError;
use crate::process::threads::Threads;
use futures::StreamExt;
use ros2_client::builtin_topics::ros_discovery;
use std::collections::BTreeMap;
use std::fmt;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Timeout for the node list of a new participant. Chosen: most lists come within 0.1 s. A DDS program without ROS sends none.
const NODE_LIST_TIMEOUT: Duration = Duration::from_secs(1);

/// Creates the reader of `ros_discovery_info`.
pub(crate) fn reader(graph: &Graph) -> Result<Reader<ParticipantEntities>, ShellError> {
    let policies = Qos::ReliableTransientLocal { depth: 100 }.policies();
    graph.make(
        "rmw_dds_common/msg/ParticipantEntitiesInfo",
        || "subscription of ros_discovery_info".to_owned(),
        |session| Reader::new(session, ros_discovery::TOPIC_NAME, ros_discovery::TYPE_NAME, &policies),
    )
}

/// Updates the directory of the graph with every message of `ros_discovery_info`. The future ends with the reader's stream.
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

impl Graph {
    /// Returns the living endpoints of other participants.
    pub(crate) fn others(&self) -> Vec<Endpoint> {
        let own = self.own_prefix();
        let all = self.living_writers().into_iter().chain(self.living_readers());
        all.filter(|endpoint| prefix(&endpoint.gid) != own).collect()
    }

    /// Returns the living writers of other participants.
    pub(crate) fn other_writers(&self) -> Vec<Endpoint> {
        let own = self.own_prefix();
        self.living_writers().into_iter().filter(|writer| prefix(&writer.gid) != own).collect()
    }

    /// Returns the living readers of other participants.
    pub(crate) fn other_readers(&self) -> Vec<Endpoint> {
        let own = self.own_prefix();
        self.living_readers().into_iter().filter(|reader| prefix(&reader.gid) != own).collect()
    }

    fn own_prefix(&self) -> Prefix {
        prefix(&self.guid().to_bytes())
    }

    /// Returns the node of a known endpoint.
    pub(crate) fn peer(&self, endpoint: &Endpoint) -> Peer {
        let Endpoint { gid, addresses, .. } = endpoint;
        Peer { node: self.directory().name(gid), gid: *gid, addresses: addresses.clone() }
    }

    /// Returns the node of an endpoint, even if discovery does not know the endpoint: the addresses are those of its participant.
    pub(crate) fn peer_of(&self, gid: Gid) -> Peer {
        Peer { node: self.directory().name(&gid), gid, addresses: self.addresses_of_participant(gid) }
    }

    /// Passes the node of an endpoint to `tell`: at once if its name is known, else from a thread of `threads`, within a second. A message may come
    /// before the list of its participant's nodes, and what stops an arm must not wait for a name.
    pub(crate) fn identify(self: &Arc<Self>, gid: Gid, threads: &Threads, tell: impl FnOnce(&Peer) + Send + 'static) {
        let peer = self.peer_of(gid);
        if peer.node.is_some() {
            return tell(&peer);
        }
        let graph = Arc::clone(self);
        let started = threads.spawn("name of a node", move || {
            graph.directory().wait_listed(&gid, NODE_LIST_TIMEOUT);
            tell(&graph.peer_of(gid));
        });
        if let Err(error) = started {
            tracing::error!("a request or target of {peer} is not logged: {error}");
        }
    }

    /// Returns the addresses of an endpoint's participant; empty if discovery does not know it.
    fn addresses_of_participant(&self, gid: Gid) -> Vec<SocketAddr> {
        let of_participant = |e: &Endpoint| prefix(&e.gid) == prefix(&gid) && !e.addresses.is_empty();
        let mut known = self.living_writers().into_iter().chain(self.living_readers());
        known.find(of_participant).map(|e| e.addresses).unwrap_or_default()
    }

    /// Returns the nodes of endpoints, each node once.
    pub(crate) fn owners<'a>(&self, endpoints: impl Iterator<Item = &'a Endpoint>) -> Vec<Peer> {
        let mut owners: Vec<Peer> = Vec::new();
        for peer in endpoints.map(|endpoint| self.peer(endpoint)) {
            if !owners.iter().any(|known| known.is_same_node(&peer)) {
                owners.push(peer);
            }
        }
        owners.sort_by(|a, b| a.node.cmp(&b.node));
        owners
    }

    /// Returns other nodes that serve a service or an action with one of these absolute names.
    pub(crate) fn servers(&self, names: &[String]) -> Vec<Peer> {
        self.servers_among(&self.other_writers(), names)
    }

    /// Returns the owners of `writers` that serve a service or an action with one of these absolute names.
    pub(crate) fn servers_among(&self, writers: &[Endpoint], names: &[String]) -> Vec<Peer> {
        let replies = |name: &String| [format!("rr{name}Reply"), format!("rr{name}/_action/send_goalReply")];
        let replies: Vec<String> = names.iter().flat_map(replies).collect();
        self.owners(writers.iter().filter(|writer| replies.contains(&writer.topic)))
    }

    /// Returns every discovered node of the domain except the nodes of this participant. A participant that has not listed its
    /// nodes counts as one node without a name.
    pub(crate) fn peers(&self) -> Vec<Peer> {
        let mut participants: BTreeMap<Prefix, Endpoint> = BTreeMap::new();
        for endpoint in self.others() {
            // Not every endpoint announces addresses, so the first ones that come are taken.
            let known = participants.entry(prefix(&endpoint.gid)).or_insert_with(|| endpoint.clone());
            if known.addresses.is_empty() {
                known.addresses = endpoint.addresses;
            }
        }
        let peers = participants.into_iter().flat_map(|(prefix, Endpoint { gid, addresses, .. })| {
            let names = self
                .directory()
                .names(&prefix)
                .map_or_else(|| vec![None], |names| names.into_iter().map(Some).collect());
            names.into_iter().map(move |node| Peer { node, gid, addresses: addresses.clone() })
        });
        peers.collect()
    }

    /// Returns true if every participant of this machine with ports of this domain is among `peers`.
    pub(crate) fn has_met_all_here(&self, peers: &[Peer]) -> bool {
        let Some((domain, number)) = self.domain_and_number() else { return true };
        let own = data_port(domain, number);
        // A participant of another machine may have the same port.
        let is_at = |peer: &Peer, port| peer.addresses.iter().any(|address| address.port() == port);
        let has = |port: u16| peers.iter().any(|peer| is_at(peer, port) && are_local(&peer.addresses));
        data_ports_here(domain).into_iter().all(|port| u32::from(port) == own || has(port))
    }
}

/// Another node, by name or, without a name, by identifier. Displays as `/camera (process 4711)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Peer {
    node: Option<String>,
    gid: Gid,
    addresses: Vec<SocketAddr>,
}

impl Peer {
    /// Returns the fully qualified name; `None` if it is not known yet.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        self.node.as_deref()
    }

    /// Returns the process number of a node on this machine, if /proc shows it.
    #[must_use]
    pub fn process(&self) -> Option<u32> {
        process_at(&self.addresses)
    }

    /// Returns the identifier of the endpoint by which the node was found, as [`Received::publisher`](crate::Received::publisher).
    #[must_use]
    pub fn endpoint(&self) -> [u8; 16] {
        self.gid
    }

    /// Returns true if both nodes are in one DDS participant, and therefore in one process.
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

/// Sender of a request.
#[derive(Clone)]
pub struct Requester {
    gid: Gid,
    graph: Arc<Graph>,
}

impl Requester {
    pub(crate) fn new(graph: &Arc<Graph>, request: &ros2_client::RmwRequestId) -> Self {
        Self { gid: request.writer_gid.to_bytes16(), graph: Arc::clone(graph) }
    }

    /// Returns the identifier of the endpoint that sent the request, for [`Node::identify`](crate::Node::identify).
    #[must_use]
    pub fn endpoint(&self) -> [u8; 16] {
        self.gid
    }

    fn addresses(&self) -> Vec<SocketAddr> {
        self.graph.addresses_of_participant(self.gid)
    }

    /// Begins to watch whether the sender still takes part in the graph.
    #[must_use]
    pub fn attendance(&self) -> Attendance {
        let addresses = self.addresses();
        Attendance {
            sender: self.clone(),
            was_known: !addresses.is_empty(),
            socket: socket_at(&addresses),
            missing_since: None,
            last: None,
        }
    }
}

/// State of a sender that was in the graph when its request came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// It takes part, or it never was in discovery.
    Here,
    /// It was not found in the last look: look again.
    Missing,
    /// It was not found for a second.
    Gone,
}

/// Watch over the sender of a request. A process of this machine that is killed is missing at once; a node of another machine or container is
/// missing when its lease has ended, up to 50 s later.
pub struct Attendance {
    sender: Requester,
    was_known: bool,
    /// Inode of its socket, if it receives on this machine.
    socket: Option<u64>,
    missing_since: Option<Instant>,
    /// Time and outcome of the last look.
    last: Option<(Instant, Presence)>,
}

impl Attendance {
    /// Time without the sender after which it is gone. Discovery may lose a busy node for a moment, and the kernel's table of sockets can leave out
    /// a row.
    const MOMENT: Duration = Duration::from_secs(1);
    /// Least time between two looks: each reads the kernel's table or the whole of discovery.
    const PERIOD: Duration = Duration::from_millis(100);

    /// Looks for the sender. May be called as often as wanted.
    pub fn look(&mut self) -> Presence {
        let now = Instant::now();
        if let Some((at, presence)) = self.last
            && now.duration_since(at) < Self::PERIOD
        {
            return presence;
        }
        let is_here = match self.socket {
            Some(inode) => is_bound(inode),
            None => !self.was_known || !self.sender.addresses().is_empty(),
        };
        let presence = judge(is_here, now, &mut self.missing_since);
        self.last = Some((now, presence));
        presence
    }
}

/// Presence after a look at `now`. `missing_since` is kept from look to look.
fn judge(is_here: bool, now: Instant, missing_since: &mut Option<Instant>) -> Presence {
    if is_here {
        *missing_since = None;
        return Presence::Here;
    }
    let since = *missing_since.get_or_insert(now);
    if now.duration_since(since) < Attendance::MOMENT { Presence::Missing } else { Presence::Gone }
}

/// Joins peers in words: `/a (process 1) and /b (process 2)`.
#[must_use]
pub fn list_peers(peers: &[Peer]) -> String {
    let words: Vec<String> = peers.iter().map(Peer::to_string).collect();
    match &words[..] {
        [] => "nobody".to_owned(),
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        all => all.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peer_without_a_name_displays_its_guid() {
        let peer = Peer { node: None, gid: [0xab; 16], addresses: Vec::new() };
        assert!(peer.to_string().ends_with(&"ab".repeat(16)), "{peer}");
        let named = Peer { node: Some("/a".to_owned()), ..peer };
        assert_eq!(list_peers(&[named.clone(), named.clone(), named]), "/a, /a and /a");
    }

    #[test]
    fn a_sender_is_gone_when_it_was_missing_for_a_second() {
        let (start, mut since) = (Instant::now(), None);
        let looks = [
            (0, true, Presence::Here),
            (100, false, Presence::Missing),
            (900, false, Presence::Missing),
            // Found again: the second begins anew.
            (1000, true, Presence::Here),
            (1200, false, Presence::Missing),
            (2100, false, Presence::Missing),
            (2200, false, Presence::Gone),
        ];
        for (ms, is_here, presence) in looks {
            assert_eq!(judge(is_here, start + Duration::from_millis(ms), &mut since), presence, "{ms} ms");
        }
    }
}
