//! The nodes that this program carries: `catenary node NAME` is the node's own executable under another name.

use anyhow::Result;
use std::io::Write;
use std::process::ExitCode;

/// Entry point of a node: its arguments without the program's name.
type Main = fn(Vec<String>) -> ExitCode;

/// Every node: its name, what it does, its entry point.
pub const NODES: &[(&str, &str, Main)] = &[
    ("simulated_cell", "robot, object and camera, simulated", simulator_pool::node::cell::main),
    ("camera", "image to label mask", camera::node::main),
    ("keypoint_tracker", "mask to keypoints", keypoint_tracker::node::main),
    ("panda_bridge", "safety gate and relay to the arm's controller", panda_bridge::node::main),
    ("policy_runner", "one episode of a policy", policy_runner::node::main),
    ("simulator_pool", "batches of simulated episodes, and environments", simulator_pool::node::pool::main),
    ("bayes_sim", "posterior over the model's parameters", bayes_sim::node::main),
    ("effect_finder", "where model and recordings disagree, and why", effect_finder::node::main),
    ("ppo_trainer", "training of policies", ppo_trainer::node::main),
    ("recorder", "the contract's topics to a bag", catenary_bag::node::recorder),
    ("replayer", "a bag's messages in time", catenary_bag::node::replayer),
];

/// Whether `name` is one of our nodes.
pub fn is_node(name: &str) -> bool {
    NODES.iter().any(|(n, _, _)| *n == name)
}

/// Runs the node called `name`.
pub fn run(name: &str, arguments: Vec<String>) -> ExitCode {
    match NODES.iter().find(|(n, _, _)| *n == name) {
        Some((_, _, main)) => main(arguments),
        None => {
            let known: Vec<&str> = NODES.iter().map(|(n, _, _)| *n).collect();
            let _closed = writeln!(std::io::stderr(), "catenary: no node `{name}`; there are {}", known.join(", "));
            ExitCode::from(2)
        }
    }
}

/// Lists the nodes on stdout.
pub fn list() -> Result<()> {
    let mut out = std::io::stdout().lock();
    for (name, what, _) in NODES {
        writeln!(out, "{name:<18} {what}")?;
    }
    Ok(())
}
