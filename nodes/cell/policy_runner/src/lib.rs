#![doc = include_str!("../README.md")]

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;
pub mod numbering;
pub mod runner;
pub mod writers;

pub use runner::{
    Fault, Inputs, Objection, Runner, RunnerError, Settings, Step, StillProgress, StillTurn, StillWait, Turn,
};
pub use writers::{Source, Stranger, Writer, Writers};
