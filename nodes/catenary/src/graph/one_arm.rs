//! Check before a command to the running graph's arm: there is exactly one arm, and only the graph commands it.

use super::DISCOVERY_TIME;
use crate::exit::Interrupted;
use anyhow::{Error, Result, ensure};
use catenary_shell::{CallError, Node, Peer, Shutdown, contract, list_peers};
use std::time::{Duration, Instant};

/// Time between two checks.
const PAUSE: Duration = Duration::from_millis(100);

/// Remedy for two graphs.
pub const REMEDY: &str = "end one graph, or give each a ROS_DOMAIN_ID or a namespace of its own; nothing was sent";

/// Waits for the servers of `needed`, then checks the other nodes of the domain. Returns an error if two nodes serve a
/// name of an arm or of `needed`, if a node without episodes publishes targets, or if a node without an arm's services
/// publishes its state.
pub fn ensure_one_arm(node: &Node, needed: &[&str], wait: Duration, interrupted: &Shutdown) -> Result<()> {
    let start = Instant::now();
    for name in needed {
        while node.servers(&[name])?.is_empty() {
            let name = node.resolve(name)?;
            if interrupted.wait_timeout(PAUSE) {
                return Err(Error::from(Interrupted(String::new())).context(name));
            }
            if start.elapsed() >= wait {
                return Err(CallError::NoServer { name, waited: wait }.into());
            }
        }
    }
    // A second arm may be discovered later than the first server.
    let _everybody = node.look_around(DISCOVERY_TIME);
    for name in contract::ARM.iter().chain(needed) {
        let servers = node.servers(&[name])?;
        let name = node.resolve(name)?;
        ensure!(servers.len() < 2, "{name}: {} serve it, and all of them would act: {REMEDY}", list_peers(&servers));
    }
    let runners = node.servers(&[contract::RUN_EPISODE.name])?;
    let is_runner = |peer: &Peer| runners.iter().any(|runner| runner.shares_participant(peer));
    let topic = contract::TARGET_POSE.name;
    let strangers: Vec<Peer> = node.publishers(topic)?.into_iter().filter(|peer| !is_runner(peer)).collect();
    ensure!(
        strangers.is_empty(),
        "{}: {} may also command the arm: end it first; nothing was sent",
        node.resolve(topic)?,
        list_peers(&strangers)
    );
    // An arm that follows targets may offer no services.
    let servers = node.servers(&contract::ARM)?;
    let is_server = |peer: &Peer| servers.iter().any(|server| server.shares_participant(peer));
    let arms: Vec<Peer> = node.publishing(&contract::ARM_TOPICS)?.into_iter().filter(|peer| !is_server(peer)).collect();
    ensure!(
        arms.is_empty(),
        "{} publishes the pose or the state of an arm without its services, and may follow the targets: {REMEDY}",
        list_peers(&arms)
    );
    Ok(())
}
