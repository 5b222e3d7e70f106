//! Option `--preset`.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// Preset sizes of inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Well calibrated in minutes
    Default,
    /// Sizes of the paper
    Paper,
}

impl Preset {
    /// Name of the preset in goals and settings.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Default => "default",
            Preset::Paper => "paper",
        }
    }

    /// Settings of the inference with these sizes.
    pub fn inference(self) -> bayes_sim::Settings {
        match self {
            Preset::Default => bayes_sim::Settings::default(),
            Preset::Paper => bayes_sim::Settings::paper(),
        }
    }
}

/// Preset hyperparameters of training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TrainingPreset {
    /// Many small updates, within a minute
    Default,
    /// Hyperparameters of Stable-Baselines3, as in the paper
    Sb3,
}

impl TrainingPreset {
    /// Name of the preset in goals and settings.
    pub fn name(self) -> &'static str {
        match self {
            TrainingPreset::Default => "default",
            TrainingPreset::Sb3 => "sb3",
        }
    }

    /// Settings of the training with these hyperparameters.
    pub fn settings(self) -> ppo_trainer::Settings {
        match self {
            TrainingPreset::Default => ppo_trainer::Settings::tuned(),
            TrainingPreset::Sb3 => ppo_trainer::Settings::sb3(),
        }
    }
}
