//! Check before a launch: no running graph may use the same names.

use super::logs;
use crate::graph::DISCOVERY_TIME;
use crate::launch::description::{LaunchDescription, Process};
use anyhow::{Result, bail};
use catenary_shell::{
    Discovery, Node, NodeBuilder, Peer, RosArgs, Shutdown, contract, domain_and_range, is_domain_used_here, list_peers,
};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::{Duration, Instant};

/// Time for a graph that is just ending to disappear.
const LEAVING: Duration = Duration::from_secs(3);

/// Names that processes of the launch take in a domain.
#[derive(Debug, Default, PartialEq)]
struct Names {
    /// Fully qualified names of nodes.
    nodes: BTreeSet<String>,
    /// Absolute names of services and actions.
    served: BTreeSet<String>,
    /// Absolute names of the topics on which an arm publishes its state.
    told: BTreeSet<String>,
}

/// Services and actions of one of our nodes, by default names.
fn served_by(node: &str) -> Vec<&'static str> {
    match node {
        "simulated_cell" | "panda_bridge" => contract::ARM.to_vec(),
        _ => {
            let all = contract::SERVICES.iter().chain(contract::ACTIONS).map(|endpoint| endpoint.name);
            all.filter(|name| name.split('/').next() == Some(node)).collect()
        }
    }
}

/// Topics on which one of our nodes publishes the state of an arm, by default names.
fn told_by(node: &str) -> Vec<&'static str> {
    match node {
        "simulated_cell" | "panda_bridge" => contract::ARM_TOPICS.to_vec(),
        _ => Vec::new(),
    }
}

/// Names that a process takes if it is one of our nodes; `None` for any other program, whose names are unknown.
fn names(process: &Process) -> Option<Names> {
    // The node's name is not the first word behind a prefix such as `gdb --args`, or behind `catenary node`.
    let words = process.command.iter().take_while(|word| *word != "--ros-args");
    let base_names = words.map(|word| Path::new(word).file_name().and_then(|name| name.to_str()).unwrap_or_default());
    let (at, node) = base_names.enumerate().find(|(_, name)| crate::node::is_node(name))?;
    // Parameters contain no names, and their files may not be written yet.
    let nothing = |_: &Path| Ok("{}".to_owned());
    let (arguments, _) = RosArgs::parse_with(process.command[at + 1..].to_vec(), &nothing).ok()?;
    let (name, namespace) = arguments.node_identity(node, "/").ok()?;
    let resolved = |names: Vec<&str>| {
        let names = names.into_iter().filter_map(|of_node| arguments.resolve(of_node, &namespace, &name).ok());
        names.collect::<BTreeSet<String>>()
    };
    Some(Names {
        nodes: BTreeSet::from([catenary_shell::names::node_path(&namespace, &name)]),
        served: resolved(served_by(node)),
        told: resolved(told_by(node)),
    })
}

/// Names that the launch takes, by domain and range of discovery.
fn by_domain(description: &LaunchDescription) -> Result<BTreeMap<(u16, bool), Names>> {
    let mut found: BTreeMap<(u16, bool), Names> = BTreeMap::new();
    for process in &description.processes {
        let Some(new) = names(process) else { continue };
        let variable = |name: &str| match process.environment.get(name) {
            Some(set) => set.clone(),
            None => std::env::var(name).ok(),
        };
        let (domain, discovery) = domain_and_range(&variable)?;
        let names = found.entry((domain, discovery == Discovery::Localhost)).or_default();
        names.nodes.extend(new.nodes);
        names.served.extend(new.served);
        names.told.extend(new.told);
    }
    Ok(found)
}

/// Returns an error if a running node has one of the launch's node names, or serves or publishes one of its names of an
/// arm.
pub fn refuse_second_graph(description: &LaunchDescription, shutdown: &Shutdown) -> Result<()> {
    for ((domain, is_localhost), names) in by_domain(description)? {
        // Participants on this machine are visible by their ports, without a wait for discovery.
        if is_localhost && !is_domain_used_here(domain) {
            continue;
        }
        let range = if is_localhost { Discovery::Localhost } else { Discovery::Subnet };
        let node = NodeBuilder::new("launch_look", &RosArgs::default())?.domain(domain, range).build()?;
        let taken = look(&node, &names, shutdown)?;
        if !taken.is_empty() {
            let namespaced = description.arguments.iter().any(|argument| argument.name == "namespace");
            bail!("{}", words(domain, &taken, namespaced));
        }
    }
    Ok(())
}

/// Nodes that have one of the names. Nodes that are about to end get time to do so.
fn look(node: &Node, names: &Names, shutdown: &Shutdown) -> Result<Vec<Peer>> {
    let start = Instant::now();
    let mut peers = node.look_around(DISCOVERY_TIME);
    loop {
        let [served, told] = [&names.served, &names.told].map(|set| set.iter().map(String::as_str).collect::<Vec<_>>());
        let mut taken: Vec<Peer> =
            peers.into_iter().filter(|peer| peer.name().is_some_and(|name| names.nodes.contains(name))).collect();
        for other in node.servers(&served)?.into_iter().chain(node.publishing(&told)?) {
            if taken.iter().all(|known| known.name() != other.name()) {
                taken.push(other);
            }
        }
        // A restarted launch often meets its own predecessor on its way out.
        if taken.is_empty() || start.elapsed() >= LEAVING || shutdown.wait_timeout(Duration::from_millis(100)) {
            return Ok(taken);
        }
        peers = node.peers();
    }
}

fn words(domain: u16, taken: &[Peer], namespaced: bool) -> String {
    let launch = taken.iter().find_map(Peer::process).and_then(logs::launch_of);
    let launch = launch.map_or(String::new(), |table| {
        format!(" (launch of {}, process {}, logs in {})", table.file.display(), table.pid, table.log.display())
    });
    let namespace = if namespaced { ", or in another namespace: namespace:=/NAME" } else { "" };
    format!(
        "a graph with the same names already runs in ROS_DOMAIN_ID {domain}{launch}: {}; two would answer each other's \
         requests. End it, or start this one in another domain: ROS_DOMAIN_ID=NUMBER{namespace}. Nothing was started",
        list_peers(taken)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn process(words: &[&str]) -> Process {
        Process::new(words[0].to_owned(), words.iter().map(|w| (*w).to_owned()).collect())
    }

    #[test]
    fn names_follow_remaps_and_namespaces() {
        let Names { nodes, served, told } = names(&process(&[
            "/opt/catenary/bin/simulated_cell",
            "--ros-args",
            "--params-file",
            "/absent.yaml",
            "-r",
            "__ns:=/lab",
            "-r",
            "panda/hold:=/stop",
        ]))
        .unwrap();
        assert_eq!(nodes, BTreeSet::from(["/lab/simulated_cell".to_owned()]));
        assert!(told.contains("/lab/panda/current_pose") && told.contains("/lab/panda/arm_state"), "{told:?}");
        assert!(served.contains("/lab/panda/enable") && served.contains("/stop"), "{served:?}");
        for (words, node) in [
            (&["simulator_pool", "--ros-args", "-r", "__node:=pool_2"][..], "/pool_2"),
            (&["gdb", "--args", "catenary", "node", "camera", "--ros-args"], "/camera"),
        ] {
            let Names { nodes, told, .. } = names(&process(words)).unwrap();
            assert_eq!((nodes, told), (BTreeSet::from([node.to_owned()]), BTreeSet::new()));
        }
        assert!(names(&process(&["rviz2"])).is_none());
    }

    #[test]
    fn every_service_and_action_of_the_contract_belongs_to_a_node() {
        let nodes = crate::node::NODES.iter().flat_map(|(name, ..)| served_by(name));
        let served: BTreeSet<&str> = nodes.collect();
        for endpoint in contract::SERVICES.iter().chain(contract::ACTIONS) {
            assert!(served.contains(endpoint.name), "{}", endpoint.name);
        }
    }
}
