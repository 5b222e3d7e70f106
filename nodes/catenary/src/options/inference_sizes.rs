//! Options `--preset`, `--iterations` and `--simulations` of an inference.

use super::InferencePreset;
use bayes_sim::Settings;
use clap::Args;

/// Sizes of an inference.
#[derive(Debug, Args)]
pub struct InferenceSizes {
    /// Sizes of the network and the schedule, and whether the simulator refines the result
    #[arg(long, value_enum, default_value = "default")]
    pub preset: InferencePreset,
    /// Rounds of simulation and training; default: the preset's
    #[arg(long)]
    pub iterations: Option<usize>,
    /// Simulations in each round; default: the preset's
    #[arg(long)]
    pub simulations: Option<usize>,
}

impl InferenceSizes {
    /// Settings with these sizes.
    pub fn settings(&self) -> Settings {
        let preset = self.preset.settings();
        Settings {
            iterations: self.iterations.unwrap_or(preset.iterations),
            simulations: self.simulations.unwrap_or(preset.simulations),
            ..preset
        }
    }
}
