//! `catenary evaluate`: scores of policies on simulated episodes of a model.

pub mod args;
pub mod episodes;
mod page;
pub mod score;

use crate::exit::{Given, Interrupted};
use crate::inputs::model_file::no_task;
use crate::inputs::{model_file, parameter_values, policy_file, posterior_file};
use crate::kept::Kept;
use crate::options::SimulatedArm;
use crate::plan;
use crate::report::Estimate;
use crate::terminal::{output, progress};
use anyhow::{Context, Result, ensure};
use args::EvaluateArgs;
use catenary_core::{Judge, Model, Policy, SimulationRequest, identity, seed};
use catenary_shell::Shutdown;
use catenary_simulator::Registry;
use episodes::episodes;
use policy_runner::Runner;
use score::{Evaluated, Finished, score_from};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Random stream of the parameter draws. Training uses another stream, so that no policy is evaluated on its own
/// training draws.
const STREAM: u64 = 2301;

/// Result in the form of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    model: String,
    arm: SimulatedArm,
    fidelity: &'static str,
    seed: u64,
    episodes: usize,
    policies: Vec<Evaluated>,
    /// Best plan that a search finds for these objects: what can be reached without feedback.
    #[serde(skip_serializing_if = "Option::is_none")]
    best_plan: Option<Evaluated>,
}

/// Runs every policy on the same episodes. Ctrl-C ends the run and keeps the finished episodes, from which the same command goes on.
pub fn run(arguments: &EvaluateArgs) -> Result<()> {
    let model = arguments.task.applied_to(model_file::read(&arguments.model)?)?;
    let judge = Judge::of(&model).with_context(|| no_task(&arguments.model)).given()?;
    let own_law = model.arm.law;
    let model = arguments.start.applied_to(arguments.arm.applied_to(model)?)?;
    let read = |path: &PathBuf| Ok((path.clone(), read(path, &judge)?));
    let mut policies = arguments.policy.iter().map(read).collect::<Result<Vec<_>>>().given()?;
    let requested = request(arguments, &model).given()?;
    for (path, policy) in &policies {
        if let Some(other) = policy.other_arm(&model.arm.law) {
            output::warn(&format!("{}: {other}; --arm chooses the arm of the episodes", path.display()));
        }
    }
    let files =
        arguments.policy.iter().chain([&arguments.model]).chain(&arguments.posterior).chain(&arguments.task.task);
    arguments.page.prepare(files.map(PathBuf::as_path))?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let own = policies.len();
    if !arguments.no_plan {
        let rows = |n, draws| thetas(arguments, &model, n, draws);
        let plan = plan::best_shown(&of_effects(&model, &arguments.effect), &rows, arguments.seed, &shutdown)?;
        policies.extend(plan.map(|plan| (PathBuf::from(plan::NAME), plan)));
    }
    let n = requested.thetas.len();
    let all = policies.len() * n;
    let bar = progress::bar("episodes", 0.0)?;
    let kept = Kept::of_command("evaluate", fingerprint(&model, &policies, &requested)?);
    let mut finished: Finished = match &kept {
        Some(kept) => kept.read()?.unwrap_or_default(),
        None => Finished::default(),
    };
    let known: usize = finished.iter().map(Vec::len).sum();
    if let (Some(kept), true) = (&kept, known > 0) {
        output::tell(&format!("resumes after {known} of {all} episodes, from {}", kept.path().display()));
    }
    let mut stopped_after = None;
    let scored = score_from(&mut finished, &model, &judge, policies, &requested, &mut |path, done| {
        bar.set_message(path.display().to_string());
        progress::advance(&bar, progress::share(done as f64, all as f64));
        if shutdown.is_triggered() && done < all {
            stopped_after = Some(done);
            return Err(Interrupted(String::new()).into());
        }
        Ok(())
    });
    bar.finish_and_clear();
    if let Some(done) = stopped_after {
        return Err(interrupted(kept.as_ref(), &finished, &format!("{done} of {all} episodes")).into());
    }
    let mut evaluated = scored?;
    let best_plan = evaluated.split_off(own).pop();
    let report = Report {
        model: model.name.clone(),
        arm: SimulatedArm::new(model.arm.law, own_law),
        fidelity: requested.fidelity.name(),
        seed: arguments.seed,
        episodes: n,
        policies: evaluated,
        best_plan,
    };
    arguments.page.write(|| {
        let rows: Vec<&Evaluated> = report.policies.iter().chain(&report.best_plan).collect();
        Ok(page::page(&words(&report).lines().map(str::to_owned).collect::<Vec<String>>(), &rows))
    })?;
    output::result(&arguments.output, &report, words)?;
    // Last: what could not be written is not simulated again.
    kept.iter().for_each(Kept::remove);
    Ok(())
}

/// Keeps the finished episodes, and returns the error that says where.
fn interrupted(kept: Option<&Kept>, finished: &Finished, done: &str) -> Interrupted {
    if finished.iter().all(Vec::is_empty) {
        return Interrupted::lost(done);
    }
    let Some(kept) = kept else { return Interrupted::lost(done) };
    match kept.write(finished) {
        Ok(()) => Interrupted::kept(done, kept.path().display(), ""),
        Err(error) => {
            output::warn(&format!("the finished episodes cannot be kept: {error:#}"));
            Interrupted::lost(done)
        }
    }
}

/// Fingerprint of everything that the scores depend on.
fn fingerprint(model: &Model, policies: &[(PathBuf, Policy)], requested: &SimulationRequest) -> Result<u64> {
    let policies: Vec<Vec<u8>> = policies.iter().map(|(_, policy)| policy.to_bytes()).collect();
    let program = (env!("CARGO_PKG_VERSION"), catenary_simulator::fingerprint(model));
    Ok(identity::fingerprint(&(program, model.to_yaml()?, policies, requested)))
}

/// Reads a policy, and returns an error unless it was trained for this task.
fn read(path: &Path, judge: &Judge) -> Result<Policy> {
    let (policy, _) = policy_file::read(path)?;
    let (steps, most) = (policy.steps, judge.task().steps);
    Runner::new(policy.clone(), *judge, policy_runner::Settings::default())
        .with_context(|| path.display().to_string())?;
    ensure!(
        steps == most,
        "{}: policy `{}`: `steps` is {steps}, the task has {most}: returns are comparable only over the same number of steps",
        path.display(),
        policy.name
    );
    Ok(policy)
}

/// Says how the policies stand to the best plan: by the paired difference of the returns, whose sign tells whether feedback pays.
pub fn beside_the_plan(policies: &[Evaluated], plan: &Evaluated) -> String {
    let words = |policy: &Evaluated| {
        let minus = policy.returns.iter().zip(&plan.returns).map(|(own, plan)| own - plan).collect::<Vec<f64>>();
        let gained = Estimate::mean(&minus);
        let verdict = match () {
            () if gained.low > 0.0 => "better than the best plan: feedback pays",
            () if gained.high < 0.0 => "worse than the best plan, which sees the target once and nothing else",
            () => "no difference from the best plan was found",
        };
        format!("{}: {verdict} (difference of the returns {})", policy.policy.display(), gained.words(1.0, 3))
    };
    policies.iter().map(words).collect::<Vec<String>>().join("\n")
}

/// Draws of `n` objects: from the posterior or the prior, with the values of `--theta`.
fn thetas(arguments: &EvaluateArgs, model: &Model, n: usize, draws: u64) -> Result<Vec<Vec<f64>>> {
    let mut thetas = posterior_file::domains(arguments.posterior.as_deref(), model)?.rows(n, draws)?;
    // The prior gives more rows than asked for.
    thetas.truncate(n);
    for (name, value) in &arguments.theta {
        let place = parameter_values::place_of(name, *value, model)?;
        thetas.iter_mut().for_each(|theta| theta[place] = *value);
    }
    Ok(thetas)
}

/// The model whose every episode has these values of further parameters: the best plan is one for the scored episodes.
fn of_effects(model: &Model, effects: &[(String, f64)]) -> Model {
    let mut model = model.clone();
    model.effects.retain(|effect| effects.iter().all(|(name, _)| *name != effect.name));
    model.parameters.extend(effects.iter().cloned());
    model
}

/// Request for the episodes, with an empty drive.
fn request(arguments: &EvaluateArgs, model: &Model) -> Result<SimulationRequest> {
    let n = arguments.episodes as usize;
    let thetas = thetas(arguments, model, n, seed::derive(arguments.seed, STREAM))?;
    for (name, value) in &arguments.effect {
        parameter_values::check_effect(name, *value, model, Registry::shipped())?;
    }
    ensure!(thetas.len() == n, "--episodes: expected {n} draws of the parameters, got {}", thetas.len());
    let effects = arguments.effect.iter().map(|(name, value)| (name.clone(), vec![*value; n])).collect();
    Ok(SimulationRequest { effects, ..episodes(thetas, arguments.fidelity.0, arguments.seed) })
}

fn words(report: &Report) -> String {
    let line = |e: &Evaluated| {
        let gained = e
            .mean_return_gained
            .as_ref()
            .map_or(String::new(), |g| format!(", {} more than the first", g.words(1.0, 2)));
        format!(
            "{}: return {}{gained}, success {} %, best reward {}, median distance {:.0} mm, {:.0} % left the workspace",
            e.policy.display(),
            e.mean_return.words(1.0, 2),
            e.success_rate.words(100.0, 0),
            e.mean_best_reward.words(1.0, 3),
            1e3 * e.median_distance_m(),
            100.0 * e.left_workspace
        )
    };
    let mut lines: Vec<String> = report.policies.iter().chain(&report.best_plan).map(line).collect();
    if let Some(plan) = &report.best_plan {
        lines.push(beside_the_plan(&report.policies, plan));
    }
    lines.push(format!(
        "{} episodes of model `{}` each, {} fidelity; intervals of 95 %",
        report.episodes, report.model, report.fidelity
    ));
    lines.extend(report.arm.words());
    lines.join("\n")
}
