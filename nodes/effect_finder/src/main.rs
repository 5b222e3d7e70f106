//! The executable of the node `effect_finder`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    effect_finder::node::main(std::env::args().skip(1).collect())
}
