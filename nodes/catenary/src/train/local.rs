//! Training in this process, with a progress bar.

use super::args::TrainArgs;
use super::page::page;
use super::report::Report;
use crate::exit::{Given, Interrupted};
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use catenary_core::{Fidelity, Model, seed};
use catenary_shell::Shutdown;
use catenary_simulator::{VectorEnv, workers};
use ppo_trainer::{Domains, Settings, Trained};
use std::ops::ControlFlow;
use std::time::Instant;

/// Trains, and writes the policy. Ctrl-C ends the training and keeps the policy trained so far.
pub fn run(arguments: &TrainArgs, model: &Model, domains: &Domains, settings: &Settings) -> Result<()> {
    output::prepare_file("out", &arguments.out)?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let (trained, seconds) = train(model, domains, settings, arguments.seed, &shutdown)?;
    std::fs::write(&arguments.out, trained.policy.to_bytes()).with_context(|| arguments.out.display().to_string())?;
    let steps = [trained.steps, settings.total_steps];
    let steps_per_second = trained.steps as f64 / seconds;
    let report = Report::new(arguments.out.clone(), steps, trained.curve, &trained.recent, steps_per_second);
    arguments.page.write(|| page(&report))?;
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

/// Trains in this process with a progress bar. Returns the duration in s, too.
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
        progress::advance(&bar, progress::share(p.now.steps as f64, settings.total_steps as f64));
        bar.set_message(format!("return {:.2}, success {:.0} %", p.now.mean_return, 100.0 * p.now.success_rate));
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    bar.finish_and_clear();
    Ok((trained, started.elapsed().as_secs_f64()))
}
