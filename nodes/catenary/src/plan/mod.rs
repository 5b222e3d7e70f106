//! `catenary plan`: the best open-loop plan of a task, which tells what can be reached without feedback.

pub mod args;

use crate::evaluate::episodes::{episodes, without_early_success};
use crate::evaluate::score::{Evaluated, score};
use crate::exit::{Given, Interrupted, WrongInput};
use crate::inputs::{model_file, parameter_values, posterior_file};
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use args::PlanArgs;
use catenary_core::{Fidelity, Judge, Model, Policy, SimulationRequest, seed};
use catenary_shell::{Shutdown, files};
use catenary_simulator::{BeamSimulator, workers};
use ppo_trainer::Domains;
use ppo_trainer::plan_search::{EPISODES_STREAM, MOST_STEPS, episodes_of, search};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Name under which a plan stands beside policies.
pub const NAME: &str = "best plan found";
/// Episodes that score a plan.
const SCORED: usize = 100;
/// Random stream of these episodes: others than those of searches and trainings.
const UNSEEN_STREAM: u64 = 2402;

/// Result in the form of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    model: String,
    seed: u64,
    plan: Evaluated,
}

/// Searches a plan, and scores it on episodes that the search has not seen.
pub fn run(arguments: &PlanArgs) -> Result<()> {
    let model = arguments.task.applied_to(model_file::read(&arguments.model)?)?;
    let model = arguments.start.applied_to(model)?;
    let judge = Judge::of(&model).with_context(|| model_file::no_task(&arguments.model)).given()?;
    let model = arguments.arm.applied_to(model)?;
    if !is_searched(&model) {
        let steps = judge.task().steps;
        return Err(WrongInput::error(format!(
            "task of {}: `steps`: expected at most {MOST_STEPS} for the search of a plan, got {steps}",
            arguments.model.display()
        )));
    }
    let domains = match arguments.theta.is_empty() {
        true => posterior_file::domains(arguments.posterior.as_deref(), &model)?,
        false => parameter_values::whole_theta(&arguments.theta, &model).map(Domains::Point).given()?,
    };
    if let Some(out) = &arguments.out {
        output::prepare_file("out", out)?;
    }
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let found = best_shown(&model, &|n, draws| Ok(domains.rows(n, draws)?), arguments.seed, &shutdown)?;
    let mut policy = found.context("a plan for a task of few steps")?;
    policy.start_speed_m_s = arguments.start.start_moving;
    if let Some(out) = &arguments.out {
        files::write(out, policy.to_bytes())?;
    }
    let path = arguments.out.clone().unwrap_or_else(|| PathBuf::from(NAME));
    let requested = unseen(&domains, arguments.seed)?;
    let mut scored =
        score(&model, &judge, vec![(path, policy)], &requested, &mut |_, _| match shutdown.is_triggered() {
            true => Err(Interrupted::lost("the search").into()),
            false => Ok(()),
        })?;
    let report = Report { model: model.name.clone(), seed: arguments.seed, plan: scored.remove(0) };
    output::result(&arguments.output, &report, words)
}

fn words(report: &Report) -> String {
    let plan = &report.plan;
    format!(
        "{}: open loop, affine in the target as it is seen first\nsuccess {} %, return {}, median distance {:.0} mm in {SCORED} episodes at reference fidelity that the search has not seen; intervals of 95 %",
        plan.policy.display(),
        plan.success_rate.words(100.0, 0),
        plan.mean_return.words(1.0, 2),
        1e3 * plan.median_distance_m()
    )
}

/// Request for the episodes that score a plan, and a training that began with it, at reference fidelity: neither has seen them.
pub fn unseen(domains: &Domains, seed: u64) -> Result<SimulationRequest> {
    let mut thetas = domains.rows(SCORED, seed::derive(seed, UNSEEN_STREAM))?;
    // The prior gives more rows than asked for.
    thetas.truncate(SCORED);
    Ok(episodes(thetas, Fidelity::Reference, seed::derive(seed, UNSEEN_STREAM)))
}

/// Draws of a number of objects, by a seed.
pub type Rows<'a> = &'a dyn Fn(usize, u64) -> Result<Vec<Vec<f64>>>;

/// True if the best plan of the model's task is searched: it has few enough steps.
pub fn is_searched(model: &Model) -> bool {
    model.task.is_none_or(|task| task.steps <= MOST_STEPS)
}

/// Best plan for the objects of `rows`, with a progress bar. None, with a message, for a task of too many steps.
///
/// # Errors
/// [`Interrupted`] after Ctrl-C.
pub fn best_shown(model: &Model, rows: Rows<'_>, search_seed: u64, shutdown: &Shutdown) -> Result<Option<Policy>> {
    if !is_searched(model) {
        let steps = model.task.map_or(0, |task| task.steps);
        output::tell(&format!("no best plan: the task has {steps} steps, and the search is for at most {MOST_STEPS}"));
        return Ok(None);
    }
    let bar = progress::bar("best plan", 0.0)?;
    let found = best(model, rows, search_seed, workers::available(), &mut |share| {
        progress::advance(&bar, share);
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    found?.map(Some).ok_or_else(|| Interrupted::lost("the search of the best plan").into())
}

/// Policy of the best plan for the objects of `rows`; none if the progress ended the search.
pub fn best(
    model: &Model,
    rows: Rows<'_>,
    search_seed: u64,
    workers: usize,
    on_progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Option<Policy>> {
    let judge = Judge::of(model).with_context(|| format!("model `{}` has no task", model.name)).given()?;
    let own = seed::derive(search_seed, EPISODES_STREAM);
    let count = episodes_of(judge.task().steps);
    let mut thetas = rows(count, own)?;
    // The prior gives more rows than asked for.
    thetas.truncate(count);
    // Without the noise of the camera: the same plan gives the same episodes.
    let requested = SimulationRequest { noise: false, ..episodes(thetas, Fidelity::Fast, own) };
    let simulator = BeamSimulator::new(&without_early_success(model), workers)?;
    let found = search(&simulator, model, &requested, own, on_progress)?;
    let arm = Some(model.arm.law);
    Ok(found.map(|planned| Policy { arm, ..planned.policy(&judge) }))
}
