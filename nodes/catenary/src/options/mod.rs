//! Command-line options that several commands share.

mod bags;
mod fidelity;
mod on_graph;
mod output;
mod parameter_value;
mod preset;

pub use bags::Bags;
pub use fidelity::FidelityName;
pub use on_graph::OnGraph;
pub use output::Output;
pub use parameter_value::parameter_value;
pub use preset::{Preset, TrainingPreset};
