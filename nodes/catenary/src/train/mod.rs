//! `catenary train`: training of a policy in simulation.

pub mod args;
pub mod local;
pub mod on_graph;
mod page;
mod report;

use crate::exit::Given;
use crate::inputs::{model_file, parameter_values, posterior_file};
use anyhow::{Context, Result};
use args::TrainArgs;
use catenary_core::Model;
use ppo_trainer::Domains;
use std::path::PathBuf;

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
    model.task.with_context(|| model_file::no_task(&arguments.model)).given()?;
    let mut settings = arguments.preset.settings();
    settings.total_steps = arguments.steps.unwrap_or(settings.total_steps);
    settings.observes.history = arguments.history as usize;
    // Checked before the request to a node, too: a node would refuse it only after the wait for it.
    settings.check().context("--steps, --history").given()?;
    let files =
        [Some(&arguments.out), Some(&arguments.model), arguments.posterior.as_ref(), arguments.task.task.as_ref()];
    arguments.page.prepare(files.into_iter().flatten().map(PathBuf::as_path))?;
    let domains = domains(arguments, &model)?;
    match &arguments.on_graph.node {
        Some(namespace) => on_graph::run(arguments, &domains, model.rewrite(&text)?, namespace),
        None => local::run(arguments, &model, &domains, &settings),
    }
}
