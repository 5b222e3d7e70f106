//! The executable of the node `bayes_sim`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    bayes_sim::node::main(std::env::args().skip(1).collect())
}
