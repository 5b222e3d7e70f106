//! Executable of the node `panda_emulator`.

use std::process::ExitCode;

#[allow(clippy::disallowed_methods, reason = "a main reads the command line")]
fn main() -> ExitCode {
    let words: Vec<_> = std::env::args_os().skip(1).collect();
    catenary_shell::in_unicode(&words).map_or_else(|code| code, panda_emulator::node::main)
}
