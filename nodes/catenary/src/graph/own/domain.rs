//! A DDS domain for the graph of one command alone, so that its commands reach no other arm and its names clash with no other node.

use crate::graph::DISCOVERY_TIME;
use crate::launch::Supervisor;
use anyhow::{Result, ensure};
use catenary_shell::{Discovery, DomainClaim, Node, NodeBuilder, Peer, RosArgs, ShellError, contract, list_peers};

/// Claim to a domain without other participants.
#[derive(Debug)]
pub struct OwnDomain(DomainClaim);

impl OwnDomain {
    /// Claims a domain of this machine that differs from the environment's, is claimed by no other command and has no
    /// participants.
    pub fn claim() -> Result<Self> {
        let claim = DomainClaim::any(|id| {
            let others = look(id)?;
            if !others.is_empty() {
                tracing::info!("DDS domain {id} is taken by {}", list_peers(&others));
            }
            Ok(others.is_empty())
        })?;
        Ok(Self(claim))
    }

    /// Domain number, as in `ROS_DOMAIN_ID`.
    pub fn id(&self) -> u16 {
        self.0.id()
    }

    /// Environment of the graph's processes: this domain, and discovery on this machine only.
    pub fn environment(&self) -> [(String, Option<String>); 2] {
        [
            ("ROS_DOMAIN_ID".to_owned(), Some(self.id().to_string())),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE".to_owned(), Some("LOCALHOST".to_owned())),
        ]
    }

    /// Sentence for the user: the domain's number, and a command that lists its topics.
    pub fn words(&self) -> String {
        format!(
            "runs in its own DDS domain {id} on this machine; to list its topics:\n  \
             ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID={id} ros2 topic list",
            id = self.id()
        )
    }
}

/// Participants of a domain, as far as they run on this machine.
fn look(id: u16) -> Result<Vec<Peer>, ShellError> {
    let node = NodeBuilder::new("look", &RosArgs::default())?.domain(id, Discovery::Localhost).build()?;
    let others = node.look_around(DISCOVERY_TIME);
    // The temporary participant must not stay visible to the graph's own nodes.
    node.stop();
    Ok(others)
}

/// Returns an error unless the arm that the command is about to move is its own. Every server and publisher of the arm's
/// names must be a process that `supervisor` started, with one server for each name.
pub fn ensure_own_arm(node: &Node, supervisor: &Supervisor) -> Result<()> {
    let own: Vec<u32> = supervisor.rows().iter().filter_map(|row| row.pid).collect();
    let episode = contract::RUN_EPISODE.name;
    for name in contract::ARM.into_iter().chain([episode]) {
        let servers = node.servers(&[name])?;
        // Two servers of one name would both answer, and two arms could move.
        ensure!(servers.len() == 1, "{name}: expected one server, the command's own, found {}", list_peers(&servers));
        ensure_started(name, &servers, &own)?;
    }
    for topic in contract::ARM_TOPICS.into_iter().chain([contract::TARGET_POSE.name]) {
        ensure_started(topic, &node.publishers(topic)?, &own)?;
    }
    Ok(())
}

/// Returns an error if one of the peers is a process of this machine outside `own`. A peer whose process /proc hides is
/// accepted: the check before the start has to suffice.
fn ensure_started(name: &str, peers: &[Peer], own: &[u32]) -> Result<()> {
    let strangers = peers.iter().filter(|peer| peer.process().is_some_and(|pid| !own.contains(&pid)));
    let strangers: Vec<Peer> = strangers.cloned().collect();
    ensure!(
        strangers.is_empty(),
        "{name}: {} joined the command's domain and is none of its nodes; the arm is not moved",
        list_peers(&strangers)
    );
    Ok(())
}
