//! Nodes in this program: `catenary node NAME` starts one, and so does the program under a node's name.

pub mod args;

use crate::exit::WrongInput;
use crate::terminal::output;
use anyhow::Result;
use catenary_core::spelling::did_you_mean;
use std::io::Write;
use std::process::ExitCode;

/// Entry point of a node. It takes the arguments without the program's name.
type Main = fn(Vec<String>) -> ExitCode;

/// All nodes: name, description, entry point.
pub const NODES: &[(&str, &str, Main)] = &[
    ("simulated_cell", "robot, object and camera, simulated", simulated_cell::node::main),
    ("camera", "image to label mask", camera::node::main),
    ("keypoint_tracker", "mask to keypoints", keypoint_tracker::node::main),
    ("panda_bridge", "safety gate, and control of the arm by FCI or a relay", panda_bridge::node::main),
    ("panda_emulator", "emulated arm behind FCI", panda_emulator::node::main),
    ("policy_runner", "one episode of a policy", policy_runner::node::main),
    ("simulator_pool", "batches of simulated episodes, and environments", simulator_pool::node::main),
    ("bayes_sim", "posterior over the model's parameters", bayes_sim::node::main),
    ("effect_finder", "where model and recordings disagree, and why", effect_finder::node::main),
    ("ppo_trainer", "training of policies", ppo_trainer::node::main),
    ("recorder", "the contract's topics to a bag", catenary_bag::node::recorder),
    ("replayer", "a bag's messages in time", catenary_bag::node::replayer),
];

/// True if `name` is one of our nodes.
pub fn is_node(name: &str) -> bool {
    NODES.iter().any(|(n, _, _)| *n == name)
}

/// Runs the node called `name`.
pub fn run(name: &str, arguments: Vec<String>) -> ExitCode {
    match NODES.iter().find(|(n, _, _)| *n == name) {
        Some((_, _, main)) => main(arguments),
        None => {
            let known: Vec<&str> = NODES.iter().map(|(n, _, _)| *n).collect();
            let (hint, known) = (did_you_mean(name, known.iter().copied()), known.join(", "));
            let _closed = writeln!(std::io::stderr(), "catenary: no node `{name}`; there are {known}{hint}");
            ExitCode::from(WrongInput::EXIT_CODE)
        }
    }
}

/// Lists the nodes on stdout.
pub fn list() -> Result<()> {
    let rows: Vec<String> = NODES.iter().map(|(name, what, _)| format!("{name:<18} {what}")).collect();
    output::print(&rows.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_node_of_a_checkout_has_a_stand_in_for_other_launchers() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch_configs/bin");
        for (name, _, _) in NODES {
            let target = std::fs::read_link(folder.join(name)).unwrap_or_default();
            // A symbolic link, so that the script knows the name that it was called by.
            assert_eq!(target.to_str(), Some("checkout_node"), "{name}");
        }
    }
}
