#![doc = include_str!("../README.md")]
#![allow(
    clippy::disallowed_methods,
    reason = "the program at the edge: files, clocks, processes and the environment are its trade"
)]

mod all_cores;
mod bags;
mod bench;
mod cli;
mod demo;
mod deploy;
mod doctor;
mod effects;
mod evaluate;
mod exit;
mod find_effects;
mod graph;
mod import_track;
mod infer;
mod inputs;
mod install;
mod kept;
mod launch;
mod mask;
mod node;
mod options;
mod plan;
mod program;
mod propose;
mod report;
mod segmenter;
mod simulate;
mod study;
mod terminal;
mod train;
mod train_tracker;

pub use cli::check_command_line;
pub use program::main;
