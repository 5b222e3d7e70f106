//! Setup of a demo: sizes, seeds, hidden parameters, and the start of its graph.

use super::config;
use crate::graph::own::{Cell, Conditions, OwnDomain, OwnGraph};
use crate::options::{Preset, TrainingPreset, arm};
use anyhow::Result;
use catenary_core::{Judge, Model, seed};
use catenary_shell::Node;
use rand::RngExt;
use std::ops::Range;
use std::path::PathBuf;

/// Random streams derived from the demo's seed.
pub mod stream {
    /// Hidden parameters.
    pub const TRUTH: u64 = 1;
    /// Trainings.
    pub const TRAINING: u64 = 2;
    /// Inference.
    pub const INFERENCE: u64 = 3;
    /// Episodes on the cell.
    pub const EPISODE: u64 = 4;
    /// Noise of the cell.
    pub const CELL: u64 = 5;
    /// Simulated episodes of the score.
    pub const SCORE: u64 = 6;
}

/// Sizes of a demo.
pub struct Sizes {
    /// Preset of the inference, which names the demo.
    pub preset: Preset,
    /// Preset of the trainings.
    pub training_preset: TrainingPreset,
    /// Environment steps of each training.
    pub training_steps: u64,
}

/// Minutes on two cores.
pub const DEFAULT: Sizes =
    Sizes { preset: Preset::Default, training_preset: TrainingPreset::Default, training_steps: 122_880 };
/// Sizes of the paper.
pub const PAPER: Sizes = Sizes { preset: Preset::Paper, training_preset: TrainingPreset::Sb3, training_steps: 120_000 };

/// State that stays constant during a demo.
pub struct Demo {
    /// Model that is inferred, trained and simulated.
    pub model: Model,
    /// Text of that model.
    pub model_yaml: String,
    /// Judge of the task.
    pub judge: Judge,
    /// Folder of the results.
    pub folder: PathBuf,
    /// Robot cell.
    pub cell: Cell,
    /// Seed of every random draw.
    pub seed: u64,
    /// Sizes of the demo.
    pub sizes: Sizes,
    /// Hidden parameters of the cell.
    pub truth: Vec<f64>,
    /// DDS domain of the demo.
    pub domain: OwnDomain,
}

/// Range of the hidden values in unit coordinates, away from the prior's edges.
const HIDDEN: Range<f64> = 0.1..0.9;
/// Range of the hidden modulus in unit coordinates: about 6 to 34 kPa. Softer bars, which the prior contains too,
/// stretch down to the table, so that no motion brings their end to the target.
const HIDDEN_MODULUS: Range<f64> = 0.45..0.9;

/// Model of a demo in this cell, and its text. On the emulated arm the model has the law of the bridge that drives it.
///
/// # Errors
/// Shipped files that cannot be read.
pub fn model(cell: Cell) -> Result<(Model, String)> {
    let mut model = Model::from_yaml(config::MODEL)?;
    if cell == Cell::Emulated {
        model.arm.law = arm::shipped(cell.name())?;
    }
    let text = model.rewrite(config::MODEL)?;
    Ok((model, text))
}

/// The cell's parameters.
pub fn hidden_truth(model: &Model, demo_seed: u64) -> Vec<f64> {
    let mut rng = seed::rng(demo_seed, stream::TRUTH);
    let mut unit = |name: &str| rng.random_range(if name == "youngs_modulus_pa" { HIDDEN_MODULUS } else { HIDDEN });
    let u: Vec<f64> = model.theta.parameters().iter().map(|p| unit(&p.name)).collect();
    model.theta.from_unit(&u)
}

impl Demo {
    /// Starts the graph.
    pub fn launch<'a>(&self, node: &'a Node) -> Result<OwnGraph<'a>> {
        let conditions = Conditions {
            cell: self.cell,
            model: config::MODEL_NAME,
            model_yaml: &self.model_yaml,
            truth: &self.truth,
            seed: seed::derive(self.seed, stream::CELL),
            learning: true,
        };
        OwnGraph::start(node, &self.domain, &self.folder, &conditions)
    }
}
