//! Other nodes as seen by a node: servers, publishers and subscribers under a name, and the wait for their discovery.

use crate::dds::directory::Endpoint;
use crate::dds::peers::Peer;
use crate::error::ShellError;
use crate::process::node::Node;
use std::time::{Duration, Instant};

/// Maximum time of discovery on this machine. With discovery limited to this machine, Fast DDS does not listen to multicast, and
/// is found only by its own announcement every 3 s.
const SLOWEST: Duration = Duration::from_secs(4);
/// Polling period of discovery.
const POLL: Duration = Duration::from_millis(20);
/// Writers of other nodes at one moment. It answers several questions with one copy of the discovered writers.
pub struct GraphSnapshot<'n> {
    node: &'n Node,
    writers: Vec<Endpoint>,
}

impl GraphSnapshot<'_> {
    /// Returns other nodes that serve a service or an action with one of these names. A killed server counts until its lease
    /// ends, 10 s for servers of this crate.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn servers(&self, names: &[&str]) -> Result<Vec<Peer>, ShellError> {
        let names = names.iter().map(|name| self.node.resolve(name)).collect::<Result<Vec<_>, _>>()?;
        Ok(self.node.graph().servers_among(&self.writers, &names))
    }

    /// Returns the publishers of other nodes on a topic. A node with several publishers occurs several times.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publishers(&self, topic: &str) -> Result<Vec<Peer>, ShellError> {
        let topic = format!("rt{}", self.node.resolve(topic)?);
        let publishers = self.writers.iter().filter(|writer| writer.topic == topic);
        Ok(publishers.map(|publisher| self.node.graph().peer(publisher)).collect())
    }

    /// Returns other nodes that publish on one of these topics, each once.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publishing(&self, topics: &[&str]) -> Result<Vec<Peer>, ShellError> {
        let names = topics.iter().map(|topic| Ok(format!("rt{}", self.node.resolve(topic)?)));
        let names = names.collect::<Result<Vec<_>, ShellError>>()?;
        Ok(self.node.graph().owners(self.writers.iter().filter(|writer| names.contains(&writer.topic))))
    }
}

impl Node {
    /// Takes a snapshot of the writers of other nodes.
    #[must_use]
    pub fn graph_snapshot(&self) -> GraphSnapshot<'_> {
        GraphSnapshot { node: self, writers: self.graph().other_writers() }
    }

    /// Returns other nodes that serve a service or an action with one of these names, as [`GraphSnapshot::servers`].
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn servers(&self, names: &[&str]) -> Result<Vec<Peer>, ShellError> {
        self.graph_snapshot().servers(names)
    }

    /// Returns the node of the endpoint with this identifier, for example [`Received::publisher`](crate::Received::publisher).
    #[must_use]
    pub fn peer(&self, endpoint: [u8; 16]) -> Peer {
        self.graph().peer_of(endpoint)
    }

    /// Passes the node of an endpoint to `tell`, for a log: at once if its name is known. The first request or message of a node may come before
    /// its name does; `tell` is then called from another thread, within a second.
    pub fn identify(&self, endpoint: [u8; 16], tell: impl FnOnce(&Peer) + Send + 'static) {
        self.graph().identify(endpoint, self.threads(), tell);
    }

    /// Returns the publishers of other nodes on a topic, as [`GraphSnapshot::publishers`].
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publishers(&self, topic: &str) -> Result<Vec<Peer>, ShellError> {
        self.graph_snapshot().publishers(topic)
    }

    /// Returns other nodes that publish on one of these topics, each once, as [`GraphSnapshot::publishing`].
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publishing(&self, topics: &[&str]) -> Result<Vec<Peer>, ShellError> {
        self.graph_snapshot().publishing(topics)
    }

    /// Returns other nodes that subscribe to a topic.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn subscribers(&self, topic: &str) -> Result<Vec<Peer>, ShellError> {
        let (topic, readers) = (format!("rt{}", self.resolve(topic)?), self.graph().other_readers());
        Ok(self.graph().owners(readers.iter().filter(|reader| reader.topic == topic)))
    }

    /// Returns every discovered node of the domain except this one. A participant that has not listed its nodes counts as one node
    /// without a name.
    #[must_use]
    pub fn peers(&self) -> Vec<Peer> {
        self.graph().peers()
    }

    /// Waits for discovery, at least `time`, and returns the other nodes of the domain. Waits up to 4 s for participants of this
    /// machine that are known only by their ports, and for missing names.
    #[must_use]
    pub fn look_around(&self, time: Duration) -> Vec<Peer> {
        let start = Instant::now();
        loop {
            let is_over = self.shutdown().wait_timeout(POLL);
            let peers = self.peers();
            let is_complete = self.graph().has_met_all_here(&peers) && peers.iter().all(|peer| peer.name().is_some());
            if is_over || start.elapsed() >= if is_complete { time } else { time.max(SLOWEST) } {
                return peers;
            }
        }
    }
}
