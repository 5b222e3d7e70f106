//! The executable of the node `camera`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    camera::node::main(std::env::args().skip(1).collect())
}
