//! `catenary bench training`: environment steps per second.

use crate::inputs::model_file;
use crate::options::Output;
use crate::terminal::output;
use crate::train::local;
use anyhow::Result;
use catenary_shell::Shutdown;
use ppo_trainer::{Domains, Settings};
use serde::Serialize;

#[derive(Debug, Serialize)]
struct TrainingRow {
    steps: u64,
    steps_per_second: f64,
    mean_return: f64,
    success_rate: f64,
}

/// Trains on the soft bar for `steps` steps.
pub fn run(steps: u64, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(None)?;
    // Every step, so that the time is that of a known work.
    let settings = Settings { total_steps: steps, ends_when_flat: false, ..Settings::tuned() };
    let domains = Domains::Prior(model.theta.clone());
    let (trained, seconds) = local::train(&model, &domains, &settings, 1, &Shutdown::new())?;
    let last = trained.curve.last();
    let row = TrainingRow {
        steps: trained.steps,
        steps_per_second: trained.steps as f64 / seconds,
        mean_return: last.map_or(f64::NAN, |p| p.mean_return),
        success_rate: last.map_or(0.0, |p| p.success_rate),
    };
    output::result(out, &row, |r| {
        format!(
            "{} steps, simulation included: {:.0} steps/s; mean return {:.2}, success {:.0} %",
            r.steps,
            r.steps_per_second,
            r.mean_return,
            100.0 * r.success_rate
        )
    })
}
