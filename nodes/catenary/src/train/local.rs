//! Training in this process, with a progress bar, from the beginning or from where Ctrl-C ended it.

use super::args::TrainArgs;
use super::report::{Ended, Report};
use crate::exit::{Given, Interrupted, WrongInput};
use crate::kept::Kept;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use catenary_core::{Fidelity, Model, identity, seed};
use catenary_shell::{Shutdown, files};
use catenary_simulator::vector_env::Ongoing;
use catenary_simulator::{VectorEnv, workers};
use ppo_trainer::{Domains, Settings, State, Trained};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::time::Instant;

/// Version of the training method. A change of it invalidates saved states.
const METHOD: u32 = 3;

/// Training between two updates: networks, optimiser and random generator, and the episodes of the environments.
#[derive(Debug, Serialize, Deserialize)]
struct Begun {
    state: State,
    ongoing: Vec<Ongoing>,
}

/// Trains, and writes the policy. A training that ends with a flat curve leaves its state for `--resume`, too. Ctrl-C ends the training, and keeps the policy trained so far and the state from which `--resume` goes on:
/// then the report comes with the error that says so.
pub fn run(
    arguments: &TrainArgs,
    model: &Model,
    domains: &Domains,
    settings: &Settings,
    shutdown: &Shutdown,
) -> Result<(Report, Option<Interrupted>)> {
    let rows = domains.rows(settings.environments, arguments.seed)?;
    let program = (env!("CARGO_PKG_VERSION"), METHOD, catenary_simulator::fingerprint(model));
    let asked = (program, model.to_yaml()?, &rows, format!("{settings:?}"), arguments.seed);
    // The law comes from whatever graph runs: the same command may be for another arm than before.
    let arm = format!("another arm's law may be the reason: now it is {}, and --arm chooses it", model.arm.law);
    let kept = Kept::beside(&arguments.out, identity::fingerprint(&asked)).with_reason(arm);
    let begun = match arguments.resume {
        true => Some(begun(&kept, settings)?),
        false => None,
    };
    let before = begun.as_ref().map_or(0, |begun| begun.state.steps());
    let (mut trained, begun, seconds) = trained(model, rows, settings, arguments.seed, begun, shutdown)?;
    trained.policy.start_speed_m_s = arguments.start.start_moving;
    let is_interrupted = !trained.is_finished;
    // First: the policy is small, and may have room where the state has none.
    files::write(&arguments.out, trained.policy.to_bytes())?;
    // A flat curve may rise again.
    let may_go_on = trained.flat_at.is_some() && trained.steps < settings.total_steps;
    let state = (is_interrupted || may_go_on).then(|| kept.path().to_owned());
    match &state {
        Some(_) => kept.write(&begun)?,
        // A state of the same training, or of an earlier one whose policy is replaced now.
        None => kept.remove(),
    }
    let steps_per_second = (trained.steps - before) as f64 / seconds;
    let mut report =
        Report::new(arguments.out.clone(), &Ended::of(&trained), trained.curve, &trained.recent, steps_per_second);
    report.state = state;
    let interrupted = is_interrupted.then(|| {
        let done = format!("{} of at most {} steps", trained.steps, settings.total_steps);
        let files = format!("{} (the policy so far) and {}", report.policy.display(), kept.path().display());
        Interrupted::kept(done, files, "--resume")
    });
    Ok((report, interrupted))
}

/// State of the training that `--resume` goes on with.
fn begun(kept: &Kept, settings: &Settings) -> Result<Begun> {
    let begun: Option<Begun> = kept.read()?;
    let path = kept.path().display();
    let begun = begun.ok_or_else(|| {
        WrongInput::error(format!("--resume: {path}: expected the state that Ctrl-C leaves of a training, or a flat return before its most steps; got no file"))
    })?;
    output::tell(&format!(
        "resumes after {} of at most {} steps, from {path}",
        begun.state.steps(),
        settings.total_steps
    ));
    Ok(begun)
}

/// Trains in this process with a progress bar. Returns the duration in s, too.
pub fn train(
    model: &Model,
    domains: &Domains,
    settings: &Settings,
    train_seed: u64,
    shutdown: &Shutdown,
) -> Result<(Trained, f64)> {
    let rows = domains.rows(settings.environments, train_seed)?;
    let (trained, _, seconds) = trained(model, rows, settings, train_seed, None, shutdown)?;
    Ok((trained, seconds))
}

/// Trains from the beginning or from `begun`. Returns the training at its end, and its duration in s.
fn trained(
    model: &Model,
    rows: Vec<Vec<f64>>,
    settings: &Settings,
    train_seed: u64,
    begun: Option<Begun>,
    shutdown: &Shutdown,
) -> Result<(Trained, Begun, f64)> {
    let task =
        model.task.with_context(|| format!("model `{}` has no task: no policy runs on it", model.name)).given()?;
    let env_seed = seed::derive(train_seed, 1);
    let mut env = VectorEnv::open(model, settings.environments, rows, Fidelity::Fast, env_seed, workers::available())?;
    let share = |steps: u64, of: u64| progress::share(steps as f64, of as f64);
    let bar = progress::bar(
        "training",
        begun.as_ref().map_or(0.0, |begun| share(begun.state.steps(), settings.total_steps)),
    )?;
    let state = match begun {
        Some(Begun { state, ongoing }) => {
            env.resume(ongoing)?;
            Some(state)
        }
        None => None,
    };
    let started = Instant::now();
    let (mut trained, state) = ppo_trainer::train_from(state, &mut env, &task, settings, train_seed, &mut |p| {
        progress::advance(&bar, share(p.now.steps, p.total_steps));
        bar.set_message(format!("return {:.2}, success {:.0} %", p.now.mean_return, 100.0 * p.now.success_rate));
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    bar.finish_and_clear();
    trained.policy.arm = Some(model.arm.law);
    let ongoing = env.ongoing().context("the environments have run")?;
    Ok((trained, Begun { state, ongoing }, started.elapsed().as_secs_f64()))
}
