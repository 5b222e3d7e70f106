//! The executable of the node `keypoint_tracker`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    keypoint_tracker::node::main(std::env::args().skip(1).collect())
}
