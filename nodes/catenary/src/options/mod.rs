//! Command-line options that several commands share.

pub mod arm;
mod bags;
mod fidelity;
mod inference_sizes;
mod observes;
mod on_graph;
mod output;
mod parameter_value;
mod part;
mod preset;
mod prior_support;
mod report_page;
mod start_moving;
mod task;

pub use arm::{ArmOption, SimulatedArm};
pub use bags::Bags;
pub use fidelity::FidelityName;
pub use inference_sizes::InferenceSizes;
pub use observes::ObservesOptions;
pub use on_graph::OnGraph;
pub use output::Output;
pub use parameter_value::parameter_value;
pub use part::Part;
pub use preset::{InferencePreset, Preset, TrainingPreset};
pub use prior_support::PriorSupportName;
pub use report_page::ReportPage;
pub use start_moving::StartMovingOption;
pub use task::TaskOption;
