//! `catenary bench inference`: posteriors against hidden truths.

use super::episodes::hidden_episode;
use crate::infer::local::{Inferred, infer};
use crate::infer::words::time_words;
use crate::inputs::model_file;
use crate::options::Output;
use crate::terminal::output;
use anyhow::Result;
use bayes_sim::Settings;
use catenary_core::{Fidelity, Model, seed};
use catenary_shell::Shutdown;
use rand::RngExt;
use serde::Serialize;
use std::time::Instant;

#[derive(Debug, Serialize)]
struct InferenceRow {
    seed: u64,
    truth: Vec<f64>,
    mean: Vec<f64>,
    sd: Vec<f64>,
    inside_90: Vec<bool>,
    rmse_mm: Option<f64>,
    coverage: Option<f64>,
    simulations: usize,
    wall_s: f64,
    simulation_s: f64,
}

/// Infers episodes that were simulated at reference fidelity with noise from hidden values of theta, one per seed.
pub fn run(seeds: u64, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(None)?;
    let mut rows = Vec::new();
    for s in 1..=seeds {
        let mut rng = seed::rng(s, 0);
        // The outer 10 % of the prior are left out on both sides, where the edge of the prior decides and not the data.
        let u: Vec<f64> = (0..model.theta.dimension()).map(|_| rng.random_range(0.1..0.9)).collect();
        let truth = model.theta.from_unit(&u);
        let measured = hidden_episode(&model, &truth, s, Fidelity::Reference)?;
        let settings = Settings { seed: s, ..Settings::default() };
        let started = Instant::now();
        let Inferred { result, simulation_s } = infer(&model, &[measured], None, &settings, None, &Shutdown::new())?;
        let inside = result.marginals.iter().zip(&truth).map(|(m, t)| (m.q05..=m.q95).contains(t)).collect();
        rows.push(InferenceRow {
            seed: s,
            mean: result.marginals.iter().map(|m| m.mean).collect(),
            sd: result.marginals.iter().map(|m| m.sd).collect(),
            inside_90: inside,
            rmse_mm: result.predictive.as_ref().map(|p| p.rmse_mm),
            coverage: result.predictive.as_ref().map(|p| p.coverage),
            wall_s: started.elapsed().as_secs_f64(),
            simulation_s,
            simulations: result.simulations(),
            truth,
        });
        tracing::info!("{:?}", rows.last());
    }
    output::result(out, &rows, |rows| words(&model, rows))
}

fn words(model: &Model, rows: &[InferenceRow]) -> String {
    let n = rows.len() as f64;
    let mut lines: Vec<String> = rows
        .iter()
        .map(|r| {
            let InferenceRow { seed, truth, mean, sd, .. } = r;
            let time = time_words(r.simulations, r.wall_s, r.simulation_s);
            format!("seed {seed}: truth {truth:?}, mean {mean:?}, sd {sd:?}, {time}")
        })
        .collect();
    for (i, p) in model.theta.parameters().iter().enumerate() {
        let error = rows.iter().map(|r| (r.mean[i] - r.truth[i]).abs()).sum::<f64>() / n;
        let decades = rows.iter().map(|r| (r.mean[i] / r.truth[i]).abs().log10().abs()).sum::<f64>() / n;
        let inside = rows.iter().filter(|r| r.inside_90[i]).count();
        lines.push(format!(
            "{}: mean absolute error {error:.4}, {decades:.4} in log10; truth in the 90 % interval {inside} of {}",
            p.name,
            rows.len()
        ));
    }
    lines.join("\n")
}
