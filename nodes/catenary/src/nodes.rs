//! The nodes that this program carries: `catenary node NAME` is the node's own executable under another name.

use std::process::ExitCode;

/// Entry point of a node: its arguments without the program's name.
type Main = fn(Vec<String>) -> ExitCode;

/// Every node: its name, what it does, its entry point.
pub const NODES: &[(&str, &str, Main)] = &[];

/// Whether `name` is one of our nodes.
pub fn is_node(name: &str) -> bool {
    NODES.iter().any(|(n, _, _)| *n == name)
}
