//! `catenary bench`: what this machine does in a second, how near the simulator comes to theory and posteriors to hidden
//! truths.

mod calibration;
mod corruption;
mod fidelity;
mod networks;
mod pool;
mod sensitivities;

use crate::cli::{BenchArgs, BenchWhat, Output};
use crate::infer::{self, Inferred};
use crate::{model_file, output, train};
use anyhow::{Context, Result};
use bayes_sim::Settings as InferenceSettings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripTrajectory, Model, SimulationRequest, Simulator, seed};
use catenary_shell::Shutdown;
use ppo_trainer::{Domains, Settings};
use rand::RngExt;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use simulator_pool::BeamSimulator;
use simulator_pool::verification::random_hand_path;
use std::time::{Duration, Instant};

/// Runs a measurement.
pub fn run(arguments: &BenchArgs) -> Result<()> {
    match &arguments.what {
        BenchWhat::Pool { model, output } => pool::run(model.as_deref(), output),
        BenchWhat::Training { steps, output } => training(*steps, output),
        BenchWhat::Sensitivities { model, episodes, output } => sensitivities::run(model.as_deref(), *episodes, output),
        BenchWhat::Fidelity(arguments) => fidelity::run(arguments),
        BenchWhat::Calibration(arguments) => calibration::run(arguments),
        BenchWhat::Networks(arguments) => networks::run(arguments),
        BenchWhat::Inference { seeds, output } => inference(*seeds, output),
    }
}

/// Episodes of 16 steps and 8 s over the table, thetas and effects from the model's own distributions.
fn batch(model: &Model, fidelity: Fidelity, count: usize) -> Result<SimulationRequest> {
    let mut rng = seed::rng(1, 0);
    let path = motion(model, 1)?;
    let o = model.observation;
    Ok(SimulationRequest {
        thetas: (0..count).map(|_| model.theta.sample_prior(&mut rng)).collect(),
        effects: Vec::new(),
        drive: Drive::Grip(path),
        start: StartShape::HangingAtRest,
        frame_times_s: (0..o.frames).map(|i| i as f64 * o.frame_period_s).collect(),
        target_m: None,
        fidelity,
        seed: 1,
        first_episode: 0,
        noise: true,
    })
}

fn motion(model: &Model, motion_seed: u64) -> Result<GripTrajectory> {
    random_hand_path(model, motion_seed).with_context(|| format!("model `{}` has no task", model.name))
}

#[derive(Debug, Serialize)]
struct TrainingRow {
    steps: u64,
    steps_per_second: f64,
    mean_return: f64,
    success_rate: f64,
}

fn training(steps: u64, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(None)?;
    let settings = Settings { total_steps: steps, ..Settings::tuned() };
    let domains = Domains::Prior(model.theta.clone());
    let (trained, seconds) = train::train(&model, &domains, &settings, 1, &Shutdown::new())?;
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

/// Posteriors of episodes that were simulated at reference fidelity with noise, from hidden values of theta.
fn inference(seeds: u64, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(None)?;
    let mut rows = Vec::new();
    for s in 1..=seeds {
        let mut rng = seed::rng(s, 0);
        let u: Vec<f64> = (0..model.theta.dimension()).map(|_| rng.random_range(0.1..0.9)).collect();
        let truth = model.theta.from_unit(&u);
        let measured = hidden_episode(&model, &truth, s, Fidelity::Reference)?;
        let settings = InferenceSettings { seed: s, ..InferenceSettings::default() };
        let started = Instant::now();
        let Inferred { result, simulation_s } =
            infer::infer(&model, &[measured], None, &settings, None, &Shutdown::new())?;
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
    output::result(out, &rows, |rows| inference_words(&model, rows))
}

/// An episode of `truth` with a random motion and all noise, as if it had been measured.
fn hidden_episode(model: &Model, truth: &[f64], episode_seed: u64, fidelity: Fidelity) -> Result<MeasuredTrack> {
    let path = motion(model, episode_seed)?;
    let mut request = batch(model, fidelity, 1)?;
    request.thetas = vec![truth.to_vec()];
    request.seed = seed::derive(episode_seed, 1);
    request.drive = Drive::Grip(path.clone());
    let track = BeamSimulator::new(model, 1)?.simulate(&request)?.remove(0);
    let target_m = track.frames.first().and_then(|f| model.camera.view.plane_from_scaled(f.target));
    Ok(MeasuredTrack {
        track,
        grip: path,
        actions: Vec::new(),
        start: StartShape::HangingAtRest,
        target_m,
        warnings: Vec::new(),
    })
}

fn inference_words(model: &Model, rows: &[InferenceRow]) -> String {
    let n = rows.len() as f64;
    let mut lines: Vec<String> = rows
        .iter()
        .map(|r| {
            let InferenceRow { seed, truth, mean, sd, .. } = r;
            let time = infer::time_words(r.simulations, r.wall_s, r.simulation_s);
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

/// CPU time of this program so far, all threads together.
fn cpu_time() -> Duration {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), u32::try_from(now.tv_nsec).unwrap_or_default())
}
