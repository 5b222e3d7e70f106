//! Options `--preset`.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// Preset sizes.
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
}

/// Preset of an inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InferencePreset {
    /// Networks, refined with the simulator as the likelihood
    Default,
    /// Networks of the default without the refinement
    Networks,
    /// Sizes of the paper: one network, without a refinement
    Paper,
}

impl InferencePreset {
    /// Name of the preset in goals and settings.
    pub fn name(self) -> &'static str {
        match self {
            InferencePreset::Default => "default",
            InferencePreset::Networks => "networks",
            InferencePreset::Paper => "paper",
        }
    }

    /// Settings of the inference with these sizes.
    pub fn settings(self) -> bayes_sim::Settings {
        match self {
            InferencePreset::Default => bayes_sim::Settings::default(),
            InferencePreset::Networks => bayes_sim::Settings::networks(),
            InferencePreset::Paper => bayes_sim::Settings::paper(),
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
