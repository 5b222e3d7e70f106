//! A DDS domain of the demo's own, so that neither its commands nor its names reach anybody else.

use crate::launch::Supervisor;
use anyhow::{Result, ensure};
use catenary_shell::{Discovery, DomainClaim, Node, NodeBuilder, Peer, RosArgs, ShellError, contract, list_peers};
use std::time::Duration;

/// Time in which whoever is in a domain answers a newcomer.
const LOOK: Duration = Duration::from_millis(700);

/// A domain in which nobody else was, and the claim to it.
#[derive(Debug)]
pub struct OwnDomain(DomainClaim);

impl OwnDomain {
    /// Claims a domain of this machine that is not the environment's, is claimed by no other demo, and has nobody in it.
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

    /// `ROS_DOMAIN_ID`.
    pub fn id(&self) -> u16 {
        self.0.id()
    }

    /// Environment of the demo's processes: this domain, and discovery on this machine only.
    pub fn environment(&self) -> [(String, Option<String>); 2] {
        [
            ("ROS_DOMAIN_ID".to_owned(), Some(self.id().to_string())),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE".to_owned(), Some("LOCALHOST".to_owned())),
        ]
    }

    /// Where the demo lives, and how its topics are looked at.
    pub fn words(&self) -> String {
        format!(
            "in DDS domain {id}, its own, on this machine only; to look in:\n  \
             ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID={id} ros2 topic list",
            id = self.id()
        )
    }
}

/// The nodes of a domain, as far as they are on this machine.
fn look(id: u16) -> Result<Vec<Peer>, ShellError> {
    let node = NodeBuilder::new("demo_look", &RosArgs::default())?.domain(id, Discovery::Localhost).build()?;
    let others = node.look_around(LOOK);
    node.stop();
    Ok(others)
}

/// Fails unless the arm that the demo is about to move is its own: one server of each name, started by `supervisor`, and no
/// publisher of targets, or of the pose or the state of an arm, that it did not start.
pub fn ensure_own_arm(node: &Node, supervisor: &Supervisor) -> Result<()> {
    let own: Vec<u32> = supervisor.rows().iter().filter_map(|row| row.pid).collect();
    let episode = contract::RUN_EPISODE.name;
    for name in contract::ARM.into_iter().chain([episode]) {
        let servers = node.servers(&[name])?;
        ensure!(servers.len() == 1, "{name}: expected one server, the demo's own, found {}", list_peers(&servers));
        ensure_started(name, &servers, &own)?;
    }
    for topic in contract::ARM_TOPICS.into_iter().chain([contract::TARGET_POSE.name]) {
        ensure_started(topic, &node.publishers(topic)?, &own)?;
    }
    Ok(())
}

/// Fails where one of the nodes is in a process of this machine that is not one of `own`. Where /proc hides the process,
/// the look before the start has to do.
fn ensure_started(name: &str, peers: &[Peer], own: &[u32]) -> Result<()> {
    let strangers = peers.iter().filter(|peer| peer.process().is_some_and(|pid| !own.contains(&pid)));
    let strangers: Vec<Peer> = strangers.cloned().collect();
    ensure!(
        strangers.is_empty(),
        "{name}: {} came into the demo's domain and is none of its nodes; nothing is moved",
        list_peers(&strangers)
    );
    Ok(())
}
