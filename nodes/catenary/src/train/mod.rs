//! `catenary train`: training of a policy in simulation.

pub mod args;
pub mod local;
pub mod on_graph;
mod page;
mod report;
mod scored;

use crate::exit::Given;
use crate::inputs::{model_file, parameter_values, policy_file, posterior_file};
use crate::options::SimulatedArm;
use crate::plan;
use crate::terminal::output;
use anyhow::{Context, Result, ensure};
use args::TrainArgs;
use catenary_core::{Judge, Model, Policy};
use catenary_shell::Shutdown;
use policy_runner::Runner;
use ppo_trainer::{Domains, Settings};
use report::Report;
use std::path::{Path, PathBuf};

/// Parameters of the environments: one theta, a posterior, or the model's prior.
fn domains(arguments: &TrainArgs, model: &Model) -> Result<Domains> {
    if arguments.theta.is_empty() {
        return posterior_file::domains(arguments.posterior.as_deref(), model);
    }
    parameter_values::whole_theta(&arguments.theta, model).map(Domains::Point).given()
}

/// Trains in this process, or with `--node` on the running graph.
pub fn run(arguments: &TrainArgs) -> Result<()> {
    let (own, text) = model_file::read_with_text(&arguments.model)?;
    let model = arguments.task.applied_to(own)?;
    // Before the law, which may be asked of the graph.
    model.task.with_context(|| model_file::no_task(&arguments.model)).given()?;
    let own_law = model.arm.law;
    let model = arguments.start.applied_to(arguments.arm.applied_to(model)?)?;
    let mut settings = arguments.observes.applied_to(arguments.preset.settings());
    settings.total_steps = arguments.steps.unwrap_or(settings.total_steps);
    // Checked before the request to a node, too: a node would refuse it only after the wait for it.
    settings.check().context("--steps, --history").given()?;
    let files =
        [Some(&arguments.out), Some(&arguments.model), arguments.posterior.as_ref(), arguments.task.task.as_ref()];
    arguments.page.prepare(files.into_iter().flatten().map(PathBuf::as_path))?;
    let domains = domains(arguments, &model)?;
    output::prepare_file("out", &arguments.out)?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let plan = match &arguments.plan {
        Some(path) => Some(read_plan(path, &model).given()?),
        None if arguments.no_plan => None,
        None => plan::best_shown(&model, &|n, draws| Ok(domains.rows(n, draws)?), arguments.seed, &shutdown)?,
    };
    // A preset that begins without a plan is measured by it all the same.
    let begins_with = plan.as_ref().filter(|_| arguments.plan.is_some() || settings.searches_plan);
    if let Some(plan) = begins_with {
        settings.begin_with(plan)?;
    }
    let (mut report, interrupted) = match &arguments.on_graph.node {
        Some(namespace) => (on_graph::run(arguments, &domains, model.rewrite(&text)?, begins_with, namespace)?, None),
        None => local::run(arguments, &model, &domains, &settings, &shutdown)?,
    };
    report.arm = Some(SimulatedArm::new(model.arm.law, own_law));
    if let Some(plan) = plan.filter(|_| interrupted.is_none()) {
        let name = arguments.plan.clone().unwrap_or_else(|| PathBuf::from(plan::NAME));
        report.scored = scored::scored(&model, &domains, &arguments.out, (name, plan), arguments.seed, &shutdown)?;
    }
    arguments.page.write(|| page::page(&report))?;
    output::result(&arguments.output, &report, Report::words)?;
    interrupted.map_or(Ok(()), |interrupted| Err(interrupted.into()))
}

/// Reads the plan that a training begins with, which must be one for the model's task.
fn read_plan(path: &Path, model: &Model) -> Result<Policy> {
    let (plan, _) = policy_file::read(path)?;
    let shown = path.display();
    Settings::tuned().begin_with(&plan).with_context(|| format!("--plan {shown}"))?;
    let (steps, most) = (plan.steps, model.task.map_or(0, |task| task.steps));
    ensure!(steps == most, "--plan {shown}: `steps` is {steps}, the task has {most}");
    let judge = Judge::of(model).context("the model has a task")?;
    Runner::new(plan.clone(), judge, policy_runner::Settings::default()).with_context(|| format!("--plan {shown}"))?;
    if let Some(other) = plan.other_arm(&model.arm.law) {
        output::warn(&format!("--plan {shown}: {other}"));
    }
    Ok(plan)
}
