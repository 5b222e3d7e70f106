//! `catenary propose`: the two motions of the hand to record next, and the intervals that their recordings promise.

pub mod args;
mod check;
mod planner;

use crate::exit::{Interrupted, WrongInput};
use crate::inputs::{model_file, posterior_file};
use crate::report::quantity::Quantity;
use crate::terminal::{output, progress};
use anyhow::Result;
use args::ProposeArgs;
use catenary_core::{Fidelity, GripTrajectory, Model};
use catenary_shell::{Shutdown, files};
use catenary_simulator::{BeamSimulator, workers};
use planner::Planner;
use serde::Serialize;
use std::path::Path;
use track_fit::FitError;
use track_fit::design::{DETERMINED, Information, Motion, Proposal, motions, promised, propose};
use track_fit::fitting::Problem;

/// Distance in m from the start within which a model without a task lets the hand move.
const REACH_M: f64 = 0.25;

/// Motion of the proposal.
#[derive(Debug, Serialize)]
struct Row {
    motion: String,
    duration_s: f64,
}

/// Promise of the recordings for a parameter.
#[derive(Debug, Serialize)]
struct Promise {
    name: String,
    /// Width of the 90 % interval as a share of the prior's: the median over the tried values.
    share_of_prior: f64,
    is_determined: bool,
    /// Tried value with the ends of the interval promised there, one a tried value.
    tried: Vec<[f64; 3]>,
}

/// Result in the form of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    model: String,
    motions: Vec<Row>,
    parameters: Vec<Promise>,
    check: check::Check,
}

/// Compares motions, and checks the best two in simulation.
pub fn run(arguments: &ProposeArgs) -> Result<()> {
    let model = model_file::read(&arguments.model)?;
    if model.camera.keypoint_noise_px <= 0.0 {
        let got = model.camera.keypoint_noise_px;
        let name = arguments.model.display();
        return Err(WrongInput::error(format!("{name}: camera.keypoint_noise_px: expected more than 0, got {got}")));
    }
    let domains = posterior_file::domains(arguments.posterior.as_deref(), &model)?;
    let mut thetas = domains.rows(arguments.values.into(), arguments.seed)?;
    // The prior gives more rows than asked for.
    thetas.truncate(arguments.values.into());
    if let Some(out) = &arguments.out {
        output::prepare(&out.join(file_of(0)))?;
    }
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let simulator = BeamSimulator::new(&model, workers::available())?;
    let settings =
        track_fit::Settings { fidelity: Fidelity::Fast, seed: arguments.seed, ..track_fit::Settings::default() };
    let planner = Planner { model: &model, simulator: &simulator, settings, shutdown: &shutdown };
    let all = motions(model.arm.start, limits_m(&model));
    let found = compared(&planner, &all, &thetas)?;
    let durations: Vec<f64> = all.iter().map(Motion::duration_s).collect();
    let Some(proposal) = propose(&found, &durations) else {
        let name = arguments.model.display();
        return Err(WrongInput::error(format!(
            "{name}: expected a model that can be simulated in motion, got none of {} motions",
            all.len()
        )));
    };
    let chosen: Vec<&Motion> = proposal.motions.iter().map(|i| &all[*i]).collect();
    if let Some(out) = &arguments.out {
        for (i, motion) in chosen.iter().enumerate() {
            write(&out.join(file_of(i)), &motion.path)?;
        }
    }
    let bar = progress::bar("check", 0.0)?;
    let check = check::run(&planner, &chosen, &thetas, &mut |share| progress::advance(&bar, share));
    bar.finish_and_clear();
    let report = Report {
        model: model.name.clone(),
        motions: chosen.iter().map(|m| Row { motion: m.words.clone(), duration_s: m.duration_s() }).collect(),
        parameters: promises(&model, &proposal, &found, &thetas),
        check: check.map_err(interrupted)?,
    };
    output::result(&arguments.output, &report, words)
}

/// Limits of x and z in m for the hand: the task's workspace, or some distance about the start.
fn limits_m(model: &Model) -> [[f64; 2]; 2] {
    let start = model.arm.start;
    let about = |v: f64| [v - REACH_M, v + REACH_M];
    model.task.map_or([about(start.x_m), about(start.z_m)], |task| [task.workspace.x_m, task.workspace.z_m])
}

/// Informations of all motions at all values.
fn compared(planner: &Planner<'_>, all: &[Motion], thetas: &[Vec<f64>]) -> Result<Vec<Vec<Option<Information>>>> {
    let bar = progress::bar("motions", 0.0)?;
    let mut found = Vec::new();
    for (i, motion) in all.iter().enumerate() {
        let episodes = planner.episodes(&[&motion.path]);
        let problem = Problem::of(planner.model, &episodes, planner.simulator, 1);
        let one =
            |theta: &Vec<f64>| Information::at(&problem, &problem.unknowns.point_at(theta), &mut || planner.go_on());
        found.push(thetas.iter().map(one).collect::<Result<Vec<_>, _>>().map_err(interrupted)?);
        progress::advance(&bar, (i + 1) as f64 / all.len() as f64);
    }
    bar.finish_and_clear();
    Ok(found)
}

fn interrupted(error: FitError) -> anyhow::Error {
    match error {
        FitError::Cancelled => Interrupted::lost("the comparison of motions").into(),
        other => other.into(),
    }
}

/// Promises of the proposal for each parameter.
fn promises(
    model: &Model,
    proposal: &Proposal,
    found: &[Vec<Option<Information>>],
    thetas: &[Vec<f64>],
) -> Vec<Promise> {
    // Once for all parameters: each inverts the information of the pair.
    let halves: Vec<Option<Vec<f64>>> = (0..thetas.len())
        .map(|at| {
            let all: Option<Vec<&Information>> = proposal.motions.iter().map(|m| found[*m][at].as_ref()).collect();
            promised(&all?)
        })
        .collect();
    let promise = |(i, parameter): (usize, &catenary_core::Parameter)| {
        let tried = thetas.iter().zip(&halves).filter_map(|(theta, half)| {
            let (half, u) = (half.as_ref()?[i], parameter.prior.to_unit(theta[i]));
            let end = |u: f64| parameter.prior.from_unit(u.clamp(0.0, 1.0));
            Some([theta[i], end(u - half), end(u + half)])
        });
        Promise {
            name: parameter.name.clone(),
            share_of_prior: proposal.shares[i],
            is_determined: proposal.shares[i] <= DETERMINED,
            tried: tried.collect(),
        }
    };
    model.theta.parameters().iter().enumerate().map(promise).collect()
}

/// Name of the file of a motion of the proposal.
fn file_of(motion: usize) -> String {
    format!("motion_{}.csv", motion + 1)
}

/// Writes a path of the hand.
fn write(path: &Path, motion: &GripTrajectory) -> Result<()> {
    let rows = motion.times_s().iter().zip(motion.poses());
    let row =
        |(t, p): (&f64, &catenary_core::GripPose)| format!("{t:.4},{:.6},{:.6},{:.6}\n", p.x_m, p.z_m, p.pitch_rad);
    files::write(path, format!("t_s,x_m,z_m,pitch_rad\n{}", rows.map(row).collect::<String>()))
}

fn words(report: &Report) -> String {
    let determined = report.parameters.iter().filter(|p| p.is_determined).count();
    let mut lines = vec![format!(
        "two recordings determine {determined} of {} parameters: their 90 % interval is at most a quarter of the prior's",
        report.parameters.len()
    )];
    for (i, row) in report.motions.iter().enumerate() {
        lines.push(format!("{}. {:.1} s: {}", i + 1, row.duration_s, row.motion));
    }
    let width = report.parameters.iter().map(|p| p.name.len()).max().unwrap_or(0);
    for p in &report.parameters {
        let quantity = Quantity::of(&p.name);
        let tried: Vec<String> = p.tried.iter().map(|[v, low, high]| quantity.estimate(*v, *low, *high)).collect();
        let not = if p.is_determined { "" } else { "not determined; " };
        lines.push(format!(
            "{:<width$}  {:>3.0} % of the prior; {not}at {}",
            p.name,
            100.0 * p.share_of_prior,
            tried.join(", ")
        ));
    }
    lines.push(report.check.words());
    lines.join("\n")
}
