//! The policy runner's executable.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    policy_runner::node::main(std::env::args().skip(1).collect())
}
