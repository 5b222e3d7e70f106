//! Cell that parameters describe.

use crate::Cell;
use anyhow::{Context, Result};
use catenary_core::{Fidelity, GripPose, Model};

/// Cell that the parameters describe.
pub struct Setup {
    /// Path of the model file.
    pub path: String,
    /// Model.
    pub model: Model,
    /// Values of the inferred parameters.
    pub theta: Vec<f64>,
    /// Fidelity of the simulation.
    pub fidelity: Fidelity,
    /// Seed of effects, jitter and noise.
    pub seed: u64,
}

impl Setup {
    /// Makes the cell, with its object in a hand elsewhere at `hand` if there is one.
    pub fn cell(&self, hand: Option<GripPose>) -> Result<Cell> {
        let Self { path, model, theta, fidelity, seed } = self;
        match hand {
            None => Cell::new(model, theta, *fidelity, *seed),
            Some(start) => Cell::elsewhere(model, theta, *fidelity, *seed, start),
        }
        .with_context(|| format!("model_file {path}"))
    }
}
