//! `catenary train`: a policy, trained in this process.

use crate::cli::TrainArgs;
use crate::interrupted::Interrupted;
use crate::wrong_input::Given;
use crate::{model_file, output, progress, served};
use anyhow::{Context, Result, ensure};
use catenary_core::{Fidelity, Model, Posterior, seed};
use catenary_shell::Shutdown;
use ppo_trainer::{CurvePoint, Domains, Settings, Trained};
use serde::Serialize;
use simulator_pool::{VectorEnv, workers};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a training gave.
#[derive(Debug, Serialize)]
pub struct Report {
    /// The policy's file.
    pub policy: PathBuf,
    /// Environment steps.
    pub steps: u64,
    /// Whether Ctrl-C ended it before its time.
    pub interrupted: bool,
    /// Of the last episodes.
    pub mean_return: f64,
    /// Of the last episodes.
    pub success_rate: f64,
    /// Environment steps per second.
    pub steps_per_second: f64,
    /// Mean return by environment steps.
    pub curve: Vec<(u64, f64)>,
}

impl Report {
    /// The report in a line.
    pub fn words(&self) -> String {
        format!(
            "{}: {} steps, mean return {:.3}, success {:.0} %, {:.0} steps/s",
            self.policy.display(),
            self.steps,
            self.mean_return,
            100.0 * self.success_rate,
            self.steps_per_second
        )
    }
}

/// The posterior of a file, which must be one over the model's parameters.
pub fn read_posterior(path: &Path, model: &Model) -> Result<Posterior> {
    let read = || {
        let text = catenary_shell::files::read_text("posterior", path)?;
        let posterior: Posterior = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(posterior.parameters == model.theta, "{}: its parameters are not those of the model", path.display());
        Ok::<_, anyhow::Error>(posterior)
    };
    read().given()
}

/// Of the posterior in a file, or of the model's prior.
pub fn domains(posterior: Option<&Path>, model: &Model) -> Result<Domains> {
    Ok(match posterior {
        None => Domains::Prior(model.theta.clone()),
        Some(path) => Domains::Mixture(read_posterior(path, model)?),
    })
}

/// Trains and writes the policy; Ctrl-C ends the training and keeps what was learned.
pub fn run(arguments: &TrainArgs) -> Result<()> {
    let model = model_file::read(&arguments.model)?;
    let mut settings = Settings::preset(arguments.preset.name())?;
    settings.total_steps = arguments.steps.unwrap_or(settings.total_steps);
    settings.check().context("--steps").given()?;
    if let Some(namespace) = &arguments.served.node {
        return served::train(arguments, &model, namespace);
    }
    let domains = domains(arguments.posterior.as_deref(), &model)?;
    output::prepare_file("out", &arguments.out)?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let (trained, seconds) = train(&model, &domains, &settings, arguments.seed, &shutdown)?;
    std::fs::write(&arguments.out, trained.policy.to_bytes()).with_context(|| arguments.out.display().to_string())?;
    let last = trained.curve.last().copied();
    let report = Report {
        policy: arguments.out.clone(),
        steps: trained.steps,
        interrupted: trained.steps < settings.total_steps,
        mean_return: last.map_or(f64::NAN, |p| p.mean_return),
        success_rate: last.map_or(0.0, |p| p.success_rate),
        steps_per_second: trained.steps as f64 / seconds,
        curve: trained.curve.iter().map(|p: &CurvePoint| (p.steps, p.mean_return)).collect(),
    };
    output::result(&arguments.output, &report, Report::words)?;
    if report.interrupted {
        let so_far = format!(
            " after {} of {} steps; {} holds the policy so far",
            report.steps,
            settings.total_steps,
            report.policy.display()
        );
        return Err(Interrupted(so_far).into());
    }
    Ok(())
}

/// Trains in this process with a bar; returns the seconds it took too.
pub fn train(
    model: &Model,
    domains: &Domains,
    settings: &Settings,
    train_seed: u64,
    shutdown: &Shutdown,
) -> Result<(Trained, f64)> {
    let task =
        model.task.with_context(|| format!("model `{}` has no task: no policy runs on it", model.name)).given()?;
    let rows = domains.rows(settings.environments, train_seed)?;
    let env_seed = seed::derive(train_seed, 1);
    let mut env = VectorEnv::open(model, settings.environments, rows, Fidelity::Fast, env_seed, workers::available())?;
    let bar = progress::bar("training", 0.0)?;
    let started = Instant::now();
    let trained = ppo_trainer::train(&mut env, &task, settings, train_seed, &mut |p| {
        progress::advance(&bar, progress::share(p.steps as f64, settings.total_steps as f64));
        bar.set_message(format!("return {:.2}, success {:.0} %", p.mean_return, 100.0 * p.success_rate));
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    bar.finish_and_clear();
    Ok((trained, started.elapsed().as_secs_f64()))
}
