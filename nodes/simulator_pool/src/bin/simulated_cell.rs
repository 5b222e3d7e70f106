//! The executable of the node `simulated_cell`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    simulator_pool::node::cell::main(std::env::args().skip(1).collect())
}
