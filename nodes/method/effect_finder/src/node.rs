//! Node with an action that searches bags, or the last episode on the topics.
#![allow(clippy::disallowed_methods, reason = "the ROS side reads the bags that goals name, and keeps journals")]

pub mod convert;
pub mod journal;
pub mod names;

use self::journal::Journal;
use self::names::named_apart;
use crate::error::FinderError;
use crate::settings::Settings;
use crate::{Question, find};
use anyhow::{Context, Result, anyhow, bail};
use catenary_bag::{BagReader, EpisodeTopics, LiveEpisodes, visit_episodes};
use catenary_core::episode::MeasuredTrack;
use catenary_core::{DifferentiableSimulator, Model};
use catenary_msgs::action::{FindEffects, FindEffectsResult};
use catenary_shell::{
    Concurrency, Decision, GoalHandle, NodeBuilder, Outcome, Param, ParamSpec, contract, in_one_line,
    remove_old_states, state_file, state_folder,
};
use catenary_simulator::{BeamSimulator, Registry, model_text, workers};
use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;

/// Main function of the node; `args` are the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("effect_finder", args, run)
}

/// Parameters of the node.
struct Parameters {
    workers: Param<i64>,
    null_sets: Param<i64>,
    states: Param<String>,
}

/// Every third episode is held out by default.
const HELD_OUT: usize = 3;

/// Takes the validation episodes out of `episodes`, by default: the last third, and at least one of several.
pub fn hold_out<T>(episodes: &mut Vec<T>) -> Vec<T> {
    let count = (episodes.len() / HELD_OUT).max(usize::from(episodes.len() > 1));
    episodes.split_off(episodes.len() - count)
}

/// Refuses an episode that stands twice among those of a search: validation episodes could then not judge the fit. Episodes are
/// compared by their contents, because a copy of a bag has another path.
///
/// # Errors
/// The names of both.
pub fn check_each_once(episodes: &[&MeasuredTrack]) -> Result<()> {
    for (i, first) in episodes.iter().enumerate() {
        if let Some(second) = episodes[i + 1..].iter().find(|e| e.track == first.track && e.grip == first.grip) {
            bail!("episodes: expected each episode once, got {} and {}, which are the same", first.name, second.name);
        }
    }
    Ok(())
}

fn run(builder: NodeBuilder) -> Result<()> {
    let workers =
        ParamSpec::new("Threads that simulate; 0: as many as the machine has processors. Results do not depend on it.");
    let null_sets = ParamSpec::new(
        "Null data sets of each test (B). The least p-value is 1 / (1 + B); the time of a search grows with B.",
    );
    let states = ParamSpec::new(
        "Folder of the journals from which a killed search goes on; empty: catenary/effect_finder in ROS_HOME or ~/.ros.",
    );
    let parameters = Parameters {
        workers: builder.declare_i64("workers", 0, workers.integer_range(0..=1024))?,
        null_sets: builder.declare_i64("null_sets", 199, null_sets.integer_range(19..=99_999))?,
        states: builder.declare_string("state_folder", "", states)?,
    };
    let node = builder.build()?;
    let live = std::sync::Arc::new(LiveEpisodes::listen(&node)?);
    let heard = std::sync::Arc::clone(&live);
    let _server = node.serve_action::<FindEffects>(
        contract::FIND_EFFECTS.name,
        Concurrency::One,
        |_| Decision::Accept,
        move |handle| serve(&handle, &live, &parameters),
    )?;
    node.report_diagnostics(move |report| {
        report.value("log", heard.summary());
    })?;
    node.wait_for_shutdown()
}

fn serve(handle: &GoalHandle<FindEffects>, live: &LiveEpisodes, parameters: &Parameters) -> Outcome<FindEffectsResult> {
    match search(handle, live, parameters) {
        Ok(result) => Outcome::Succeeded(result),
        Err(error) => {
            let cancelled = handle.is_cancelled();
            let result = FindEffectsResult { message: in_one_line(&error), ..FindEffectsResult::default() };
            if cancelled {
                return Outcome::Canceled(result);
            }
            tracing::error!("search: {}", in_one_line(&error));
            Outcome::Aborted(result)
        }
    }
}

fn search(handle: &GoalHandle<FindEffects>, live: &LiveEpisodes, parameters: &Parameters) -> Result<FindEffectsResult> {
    let goal = handle.goal();
    let model = model_text::read(&goal.model_yaml).context("model_yaml")?;
    let (measured, validation) = measured(handle, live, &model)?;
    let settings =
        Settings { seed: goal.seed, null_sets: usize::try_from(parameters.null_sets.get())?, ..Settings::default() };
    let registry = Registry::with_templates();
    let simulator = BeamSimulator::with_effects(&model, &registry, workers::asked_for(parameters.workers.get()))?;
    let candidates = convert::candidates(Registry::shipped(), &model)?;
    let templates = convert::templates(&registry, &model);
    let question = Question {
        model: &model,
        measured: &measured,
        validation: &validation,
        held_out: &[],
        candidates: &candidates,
        templates: &templates,
    };
    let journal = state_folder(&parameters.states.get(), "effect_finder").map(|folder| {
        remove_old_states(&folder, journal::EXTENSION);
        let fingerprint = journal::fingerprint(&question, &settings);
        Journal::open(state_file(&folder, fingerprint, journal::EXTENSION), fingerprint, &simulator)
    });
    if let Some(known) = journal.as_ref().map(Journal::len).filter(|known| *known > 0) {
        tracing::info!("goes on with {known} answers of the simulator from an earlier process");
    }
    let asked: &dyn DifferentiableSimulator = journal.as_ref().map_or(&simulator, |journal| journal);
    let found = find(question, asked, &settings, &mut |progress| {
        handle.feedback(convert::feedback(progress));
        if let Some(conclusion) = &progress.conclusion {
            tracing::info!("{}: {conclusion}", progress.stage.name());
        }
        if handle.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    if !matches!(found, Err(FinderError::Cancelled(_))) {
        journal.into_iter().for_each(Journal::remove);
    }
    match found {
        Err(FinderError::Cancelled(_)) => bail!("cancelled"),
        Err(other) => Err(other.into()),
        Ok(crate::Outcome { finding, model, .. }) => {
            let text = match model {
                Some(model) => model.rewrite(&goal.model_yaml)?,
                None => goal.model_yaml.clone(),
            };
            Ok(convert::result(&finding, text))
        }
    }
}

/// Measured episodes of the goal, and its validation episodes (`verify`). Without bags the goal waits for the next episode on the topics.
fn measured(
    handle: &GoalHandle<FindEffects>,
    live: &LiveEpisodes,
    model: &Model,
) -> Result<(Vec<MeasuredTrack>, Vec<MeasuredTrack>)> {
    let goal = handle.goal();
    let all: Vec<&Path> = goal.bags.iter().chain(&goal.verify).map(Path::new).collect();
    let of_bags = |bags: &[String]| -> Result<Vec<MeasuredTrack>> {
        let named = |bag: &String| Ok(named_apart(episodes_of(Path::new(bag), model)?, Path::new(bag), &all));
        let episodes = bags.iter().map(named).collect::<Result<Vec<_>>>()?;
        Ok(episodes.into_iter().flatten().map(|(_, measured)| measured).collect())
    };
    let held_out = of_bags(&goal.verify)?;
    if goal.bags.is_empty() {
        let episode = live.wait(handle).context("cancelled while waiting for an episode")?;
        return Ok((vec![episode.measured(model)?], held_out));
    }
    let mut measured = of_bags(&goal.bags)?;
    check_each_once(&measured.iter().chain(&held_out).collect::<Vec<_>>())?;
    let held_out = if goal.verify.is_empty() { hold_out(&mut measured) } else { held_out };
    Ok((measured, held_out))
}

/// Complete episodes of a bag with their numbers. Episodes that the model cannot be compared with, or that ended in a
/// fault, are left out with a warning.
///
/// # Errors
/// A bag that cannot be read, or that has no such episode.
pub fn episodes_of(bag: &Path, model: &Model) -> Result<Vec<(u32, MeasuredTrack)>> {
    let named = || bag.display().to_string();
    let reader = BagReader::open(bag)?;
    let mut episodes = Vec::new();
    let mut refused = Vec::new();
    let mut said = BTreeSet::new();
    // Fails with the missing topics if the bag has no episode.
    visit_episodes(&reader, &EpisodeTopics::default(), |episode| {
        if let Some(fault) = episode.fault_warning() {
            refused.push(anyhow!(fault));
            return;
        }
        match episode.measured(model) {
            Ok(measured) => {
                // Every episode repeats the warnings of its recording; each warning is logged once.
                for warning in measured.warnings.iter().filter(|w| said.insert((*w).clone())) {
                    tracing::warn!("{}: episode {}: {warning}", named(), episode.number);
                }
                episodes.push((episode.number, measured));
            }
            Err(error) => refused.push(error.into()),
        }
    })?;
    // Without another episode the last reason becomes the error, so that it is not logged as well.
    if episodes.is_empty()
        && let Some(error) = refused.pop()
    {
        return Err(error).with_context(named);
    }
    refused.iter().for_each(|error| tracing::warn!("{}: left out: {}", named(), in_one_line(error)));
    Ok(episodes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_third_is_held_out_and_one_of_two_but_none_of_one() {
        let split = |count: usize| {
            let mut fitted: Vec<usize> = (0..count).collect();
            let held_out = hold_out(&mut fitted);
            (fitted, held_out)
        };
        assert_eq!(split(1), (vec![0], vec![]));
        assert_eq!(split(2), (vec![0], vec![1]));
        assert_eq!(split(3), (vec![0, 1], vec![2]));
        assert_eq!(split(7), (vec![0, 1, 2, 3, 4], vec![5, 6]));
    }

    #[test]
    fn a_copy_of_an_episode_is_refused_whatever_its_name() {
        let simulator = track_fit::toy::Toy { gain: 3.0 };
        let episode = |theta: [f64; 2], name: &str| {
            let mut measured = track_fit::toy::measured(&simulator, theta, &[]);
            measured.name = name.to_owned();
            measured
        };
        let (first, other, copy) = (episode([0.25, 2e4], "a"), episode([0.26, 2e4], "b"), episode([0.25, 2e4], "c"));
        assert!(check_each_once(&[&first, &other]).is_ok());
        let message = check_each_once(&[&first, &other, &copy]).unwrap_err().to_string();
        assert_eq!(message, "episodes: expected each episode once, got a and c, which are the same");
    }
}
