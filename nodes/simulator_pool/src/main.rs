//! The executable of the node `simulator_pool`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    simulator_pool::node::pool::main(std::env::args().skip(1).collect())
}
