//! `catenary evaluate`: policies on simulated episodes of a model.

use crate::cli::EvaluateArgs;
use crate::interrupted::Interrupted;
use crate::wrong_input::Given;
use crate::{model_file, output, policy_file, progress, theta, train};
use anyhow::{Context, Result, ensure};
use catenary_core::simulator::StartShape;
use catenary_core::track::End;
use catenary_core::{Drive, Model, Policy, SimulationRequest, Simulator, Task, Track, seed};
use catenary_shell::Shutdown;
use policy_runner::Runner;
use serde::Serialize;
use simulator_pool::{BeamSimulator, Registry, workers};
use std::path::{Path, PathBuf};

/// A reward that no position has: success ends no episode, so that returns are sums over as many steps. Leaving the workspace
/// does end one.
const OUT_OF_REACH: f64 = 2.0;
/// Episodes between two moves of the bar.
const BATCH: usize = 16;
/// Random stream of the parameters: that of trainings is another, so that no policy meets the very ones it learnt on.
const STREAM: u64 = 2301;
/// Standard normal quantile of a two-sided interval of 95 %.
const Z: f64 = 1.959_964;

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    model: String,
    fidelity: &'static str,
    seed: u64,
    episodes: usize,
    policies: Vec<Evaluated>,
}

/// How one policy fared.
#[derive(Debug, Serialize)]
struct Evaluated {
    policy: PathBuf,
    /// Sum of the rewards of all steps, by episode.
    returns: Vec<f64>,
    mean_return: Estimate,
    /// Mean over episodes of the best reward of a step.
    mean_best_reward: Estimate,
    /// Share of the episodes in which a step's reward reached the task's goal.
    success_rate: Estimate,
    /// Share of the episodes that left the workspace, and ended there.
    left_workspace: f64,
    /// How much greater the return is than the first policy's in the same episode; of the first none.
    mean_return_gained: Option<Estimate>,
}

/// A mean or share with its interval of 95 %.
#[derive(Debug, Clone, Copy, Serialize)]
struct Estimate {
    value: f64,
    low: f64,
    high: f64,
}

impl Estimate {
    /// Mean of at least two values; the interval is that of many.
    fn mean(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let value = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / (n - 1.0);
        let half = Z * (variance / n).sqrt();
        Self { value, low: value - half, high: value + half }
    }

    /// A share with Wilson's interval (1927).
    fn share(hits: usize, of: usize) -> Self {
        let (n, value) = (of as f64, hits as f64 / of as f64);
        let (middle, square) = (value + Z * Z / (2.0 * n), Z * Z / n);
        let half = Z * (value * (1.0 - value) / n + Z * Z / (4.0 * n * n)).sqrt();
        Self {
            value,
            low: ((middle - half) / (1.0 + square)).max(0.0),
            high: ((middle + half) / (1.0 + square)).min(1.0),
        }
    }
}

/// Runs every policy on the same episodes; Ctrl-C ends it.
pub fn run(arguments: &EvaluateArgs) -> Result<()> {
    let model = model_file::read(&arguments.model)?;
    let task = model.task.with_context(|| format!("model `{}` has no task: no policy runs on it", model.name));
    let mut task = task.given()?;
    let goal = task.success_reward;
    let policies = arguments.policy.iter().map(|path| read(path, task)).collect::<Result<Vec<Policy>>>().given()?;
    let requested = request(arguments, &model).given()?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    task.success_reward = OUT_OF_REACH;
    let simulator = BeamSimulator::new(&Model { task: Some(task), ..model.clone() }, workers::available())?;
    let n = requested.thetas.len();
    let all = policies.len() * n;
    let bar = progress::bar("episodes", 0.0)?;
    let mut evaluated: Vec<Evaluated> = Vec::new();
    for (path, policy) in arguments.policy.iter().zip(policies) {
        bar.set_message(path.display().to_string());
        let asked = SimulationRequest { drive: Drive::Policy(Box::new(policy)), ..requested.clone() };
        let mut tracks = Vec::new();
        while tracks.len() < n {
            if shutdown.is_triggered() {
                let done = evaluated.len() * n + tracks.len();
                return Err(Interrupted(format!(" after {done} of {all} episodes")).into());
            }
            tracks.extend(simulator.simulate(&asked.part(tracks.len()..tracks.len() + BATCH))?);
            progress::advance(&bar, progress::share((evaluated.len() * n + tracks.len()) as f64, all as f64));
        }
        evaluated.push(of(path, &tracks, goal, evaluated.first()));
    }
    bar.finish_and_clear();
    let report = Report {
        model: model.name.clone(),
        fidelity: requested.fidelity.name(),
        seed: arguments.seed,
        episodes: n,
        policies: evaluated,
    };
    output::result(&arguments.output, &report, words)
}

/// The policy of a file, which must have been trained for the task.
fn read(path: &Path, task: Task) -> Result<Policy> {
    let (policy, _) = policy_file::read(path)?;
    let (steps, most) = (policy.steps, task.steps);
    Runner::new(policy.clone(), task, policy_runner::Settings::default())
        .with_context(|| path.display().to_string())?;
    ensure!(
        steps == most,
        "{}: policy `{}`: `steps` is {steps}, the task has {most}: returns are held against one another over as many steps",
        path.display(),
        policy.name
    );
    Ok(policy)
}

/// The episodes, with nothing yet that drives them.
fn request(arguments: &EvaluateArgs, model: &Model) -> Result<SimulationRequest> {
    let n = arguments.episodes as usize;
    let mut thetas =
        train::domains(arguments.posterior.as_deref(), model)?.rows(n, seed::derive(arguments.seed, STREAM))?;
    thetas.truncate(n);
    for (name, value) in &arguments.theta {
        let place = theta::place_of(name, *value, model)?;
        thetas.iter_mut().for_each(|theta| theta[place] = *value);
    }
    for (name, value) in &arguments.effect {
        theta::check_effect(name, *value, model, Registry::shipped())?;
    }
    ensure!(thetas.len() == n, "--episodes: expected {n} draws of the parameters, got {}", thetas.len());
    Ok(SimulationRequest {
        thetas,
        effects: arguments.effect.iter().map(|(name, value)| (name.clone(), vec![*value; n])).collect(),
        drive: Drive::Actions(Vec::new()),
        start: StartShape::HangingAtRest,
        frame_times_s: Vec::new(),
        target_m: None,
        fidelity: arguments.fidelity.0,
        seed: arguments.seed,
        first_episode: 0,
        noise: true,
    })
}

/// What the policy of `path` came to in `tracks`.
fn of(path: &Path, tracks: &[Track], goal: f64, first: Option<&Evaluated>) -> Evaluated {
    let rewards: Vec<Vec<f64>> = tracks.iter().map(Track::rewards).collect();
    let returns: Vec<f64> = rewards.iter().map(|r| r.iter().sum()).collect();
    let best: Vec<f64> = rewards.iter().map(|r| r.iter().copied().fold(f64::NEG_INFINITY, f64::max)).collect();
    let left = tracks.iter().filter(|t| t.end == End::LeftWorkspace).count();
    let gained = |first: &Evaluated| -> Estimate {
        Estimate::mean(&returns.iter().zip(&first.returns).map(|(own, other)| own - other).collect::<Vec<_>>())
    };
    Evaluated {
        policy: path.to_owned(),
        mean_return: Estimate::mean(&returns),
        mean_best_reward: Estimate::mean(&best),
        success_rate: Estimate::share(best.iter().filter(|b| **b >= goal).count(), tracks.len()),
        left_workspace: left as f64 / tracks.len() as f64,
        mean_return_gained: first.map(gained),
        returns,
    }
}

fn words(report: &Report) -> String {
    let line = |e: &Evaluated| {
        let with = |e: &Estimate, scale: f64, digits: usize| {
            format!("{:.digits$} ({:.digits$} to {:.digits$})", scale * e.value, scale * e.low, scale * e.high)
        };
        let gained = e
            .mean_return_gained
            .as_ref()
            .map_or(String::new(), |g| format!(", {} more than the first", with(g, 1.0, 2)));
        format!(
            "{}: return {}{gained}, success {} %, best reward {}, {:.0} % left the workspace",
            e.policy.display(),
            with(&e.mean_return, 1.0, 2),
            with(&e.success_rate, 100.0, 0),
            with(&e.mean_best_reward, 1.0, 3),
            100.0 * e.left_workspace
        )
    };
    let mut lines: Vec<String> = report.policies.iter().map(line).collect();
    lines.push(format!(
        "{} episodes of model `{}` each, {} fidelity; intervals of 95 %",
        report.episodes, report.model, report.fidelity
    ));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Frame;

    #[test]
    fn intervals_are_those_of_the_textbooks() {
        let e = Estimate::mean(&[1.0, 2.0, 3.0, 4.0]);
        assert!(
            (e.value - 2.5).abs() < 1e-12 && (e.high - e.low - 2.0 * Z * (5.0f64 / 12.0).sqrt()).abs() < 1e-9,
            "{e:?}"
        );
        let share = Estimate::share(5, 100);
        assert!((share.low - 0.0215).abs() < 5e-4 && (share.high - 0.1118).abs() < 5e-4, "{share:?}");
        let none = Estimate::share(0, 10);
        assert!(none.low == 0.0 && (none.high - 0.278).abs() < 1e-3, "{none:?}");
    }

    #[test]
    fn policies_are_held_against_the_first_episode_by_episode() {
        let frame = |x| Frame { time_s: 0.0, dlo: [[x, 0.0]; 4], target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };
        let track = |x, end| Track { frames: vec![frame(1.0), frame(x), frame(0.75)], end };
        let first = of(Path::new("a"), &[track(0.75, End::StepLimit), track(0.15, End::StepLimit)], 0.75, None);
        assert!(first.mean_return_gained.is_none() && first.returns == [0.0, 0.8], "{first:?}");
        assert_eq!((first.success_rate.value, first.left_workspace), (0.5, 0.0));
        let other = [track(0.15, End::StepLimit), track(0.15, End::LeftWorkspace)];
        let second = of(Path::new("b"), &other, 0.75, Some(&first));
        let gained = second.mean_return_gained.unwrap();
        assert!((gained.value - (-0.1)).abs() < 1e-12, "{gained:?}");
        assert_eq!((second.success_rate.value, second.left_workspace), (1.0, 0.5));
    }
}
