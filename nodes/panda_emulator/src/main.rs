//! Executable of the node `panda_emulator`.

fn main() {}
