//! The executable of the node `recorder`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    catenary_bag::node::recorder(std::env::args().skip(1).collect())
}
