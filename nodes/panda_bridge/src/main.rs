//! The executable of the node `panda_bridge`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    panda_bridge::node::main(std::env::args().skip(1).collect())
}
