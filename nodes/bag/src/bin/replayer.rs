//! The executable of the node `replayer`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    catenary_bag::node::replayer(std::env::args().skip(1).collect())
}
