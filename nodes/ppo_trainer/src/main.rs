//! The executable of the node `ppo_trainer`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    ppo_trainer::node::main(std::env::args().skip(1).collect())
}
