//! ROS node: an action that infers from bags or from the last episode on the topics.
#![allow(clippy::disallowed_methods, reason = "the node reads the bags of a goal and saves states")]

mod pools;
mod state_file;

pub use self::state_file::StateFile;

use self::pools::Pools;
use crate::error::InferenceError;
use crate::fingerprint::fingerprint;
use crate::infer::infer;
use crate::prior_support::PriorSupport;
use crate::sequential::Progress;
use crate::{Settings, convert};
use anyhow::{Context, Result, bail};
use catenary_bag::{LiveEpisodes, read_measured};
use catenary_core::{Model, Policy};
use catenary_msgs::action::{Infer, InferGoal, InferResult};
use catenary_msgs::msg::Mixture;
use catenary_shell::convert as wire;
use catenary_shell::{
    Concurrency, Decision, GoalHandle, Health, NodeBuilder, Outcome, ParamSpec, Publisher, contract, in_one_line,
    remove_old_states, state_folder,
};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("bayes_sim", args, run)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let spec = ParamSpec::new(
        "Simulator pools that may be asked: patterns of their services' names with *, or namespaces, separated by commas.",
    );
    let patterns = builder.declare_string("pools", "*", spec)?;
    let spec = ParamSpec::new("Time that an inference waits for a pool while none is at work.").unit("s");
    let stall_s = builder.declare_f64("pool_patience_s", 60.0, spec.range(1.0..=86400.0))?;
    let spec = ParamSpec::new(
        "Folder of the states of running inferences, from which they continue after a kill; empty: catenary/bayes_sim in ROS_HOME or ~/.ros.",
    );
    let states = builder.declare_string("state_folder", "", spec)?;
    let spec = ParamSpec::new(
        "Prior's support of goals that do not choose: fixed, or adaptive, which grows it where a posterior presses on an edge that physics does not set.",
    );
    let support =
        builder.declare_string("prior_support", PriorSupport::NAMES[0], spec.choices(&PriorSupport::NAMES))?;
    let node = builder.build()?;
    let live = Arc::new(LiveEpisodes::listen(&node)?);
    let pools = Arc::new(Pools::new(node.clone(), patterns, stall_s));
    let posteriors = node.publisher::<Mixture>(contract::POSTERIOR.name, contract::POSTERIOR.qos)?;
    let (heard, asked) = (Arc::clone(&live), Arc::clone(&pools));
    let _server = node.serve_action::<Infer>(
        contract::INFER.name,
        Concurrency::One,
        |_| Decision::Accept,
        move |handle| {
            let states = state_folder(&states.get(), "bayes_sim");
            serve(&handle, &heard, &asked, (states.as_deref(), &support.get()), &posteriors)
        },
    )?;
    node.report_diagnostics(move |report| {
        report.value("log", live.summary());
        let totals = pools.totals();
        report.value("pools", totals.pools).value("simulated_episodes", totals.episodes);
        report.value("redone_episodes", totals.redone).value("unconverged_steps", totals.unconverged_steps);
        if totals.asking && totals.pools == 0 {
            report.problem(Health::Error, "an inference waits, and no simulator pool is in the graph");
        }
    })?;
    node.wait_for_shutdown()
}

/// Runs a goal, publishes its posterior and reports its outcome. `parameters` are the folder of states and the prior's
/// support of goals that do not choose.
fn serve(
    handle: &GoalHandle<Infer>,
    live: &LiveEpisodes,
    pools: &Pools,
    parameters: (Option<&Path>, &str),
    posteriors: &Publisher<Mixture>,
) -> Outcome<InferResult> {
    match infer_goal(handle, live, pools, parameters) {
        Ok(result) => {
            posteriors.send(result.posterior.clone());
            Outcome::Succeeded(result)
        }
        Err(error) => {
            let cancelled = handle.is_cancelled();
            let result = InferResult { message: in_one_line(&error), ..InferResult::default() };
            if cancelled {
                return Outcome::Canceled(result);
            }
            tracing::error!("inference: {}", in_one_line(&error));
            Outcome::Aborted(result)
        }
    }
}

/// Infers as the goal asks.
fn infer_goal(
    handle: &GoalHandle<Infer>,
    live: &LiveEpisodes,
    pools: &Pools,
    (states, support): (Option<&Path>, &str),
) -> Result<InferResult> {
    let goal = handle.goal();
    let (model, overridden) = model(goal)?;
    let policy = if goal.policy.is_empty() { None } else { Some(Policy::from_bytes(&goal.policy)?) };
    let settings = settings(goal, support)?;
    let mut measured = match goal.source {
        InferGoal::SOURCE_BAG => {
            let bags: Vec<PathBuf> = goal.bags.iter().map(PathBuf::from).collect();
            read_measured(&bags, &goal.episodes, &model)?
        }
        InferGoal::SOURCE_LIVE => {
            vec![live.wait(handle).context("cancelled while waiting for an episode")?.measured(&model)?]
        }
        other => bail!("source: expected SOURCE_LIVE or SOURCE_BAG, got {other}"),
    };
    if let Some(first) = measured.first_mut() {
        first.warnings.extend(overridden);
    }
    let asked = fingerprint(&model, &measured, policy.as_ref(), &settings);
    states.inspect(|folder| remove_old_states(folder, state_file::EXTENSION));
    let file = states.map(|folder| StateFile::in_folder(folder, asked));
    let state = file.as_ref().and_then(StateFile::read);
    if let Some(state) = &state {
        tracing::info!("goes on after {} iterations, which an earlier process made", state.iterations().len());
    }
    let is_cancelled = || handle.is_cancelled();
    let simulator = pools.simulator((&goal.model_yaml, &model), &is_cancelled);
    let result = infer(&model, &measured, policy.as_ref(), &settings, state, &simulator, &mut |progress| {
        if let Progress::Iteration { iteration, of, posterior, state } = progress {
            // Saved before the client hears of it: an iteration that was reported is never lost.
            file.iter().for_each(|file| file.write(state));
            handle.feedback(convert::feedback(iteration, *of, posterior));
            crate::diagnostics::support_warnings(&iteration.moves).iter().for_each(|words| tracing::warn!("{words}"));
        }
        if handle.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    tracing::info!("{}", simulator.summary());
    if result.is_ok() {
        file.iter().for_each(StateFile::remove);
    }
    match result {
        Err(InferenceError::Cancelled { .. }) => bail!("cancelled"),
        // A cancel also ends the requests to the pools, which then fail.
        Err(InferenceError::Simulator(_)) if handle.is_cancelled() => bail!("cancelled"),
        other => Ok(convert::result(&other?)),
    }
}

/// Model of the goal with the drive of the goal, and a warning if the model file has another drive.
fn model(goal: &InferGoal) -> Result<(Model, Option<String>)> {
    let mut model = Model::from_yaml(&goal.model_yaml)?;
    let drive = wire::drive_from_msg(goal.drive)?;
    let own = std::mem::replace(&mut model.observation.drive, drive);
    let overridden = (own != drive)
        .then(|| format!("the goal's drive by {} replaced the model file's drive by {}", drive.name(), own.name()));
    Ok((model, overridden))
}

/// Settings of the goal: its preset with the goal's numbers, if they are not zero, and the goal's treatment of the prior's
/// support, or else `support`.
fn settings(goal: &InferGoal, support: &str) -> Result<Settings> {
    let preset = if goal.preset.is_empty() { "default" } else { &goal.preset };
    let mut settings = Settings::preset(preset).context("preset")?;
    if goal.iterations > 0 {
        settings.iterations = goal.iterations as usize;
    }
    if goal.simulations > 0 {
        settings.simulations = goal.simulations as usize;
    }
    let support = if goal.prior_support.is_empty() { support } else { &goal.prior_support };
    settings.prior_support = PriorSupport::from_name(support)
        .with_context(|| format!("prior_support: expected {}, got {support:?}", PriorSupport::NAMES.join(" or ")))?;
    settings.seed = goal.seed;
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::model::DriveKind;
    use catenary_msgs::srv::SimulateRequest;

    #[test]
    fn a_goal_that_does_not_choose_has_the_support_of_the_parameter() {
        let of = |goal: &str, parameter: &str| {
            let goal = InferGoal { prior_support: goal.into(), ..InferGoal::default() };
            settings(&goal, parameter).map(|s| s.prior_support).map_err(|e| e.to_string())
        };
        assert_eq!(of("", "fixed"), Ok(PriorSupport::Fixed));
        assert_eq!(of("", "adaptive"), Ok(PriorSupport::ADAPTIVE));
        assert_eq!(of("fixed", "adaptive"), Ok(PriorSupport::Fixed));
        assert_eq!(of("wide", "fixed"), Err("prior_support: expected fixed or adaptive, got \"wide\"".into()));
    }

    #[test]
    fn a_drive_other_than_the_model_files_gets_a_warning() {
        let model_yaml = include_str!("../../../../launch_configs/models/soft_bar.yaml").to_owned();
        let of = |drive| model(&InferGoal { model_yaml: model_yaml.clone(), drive, ..InferGoal::default() }).unwrap();
        let (same, nothing) = of(SimulateRequest::DRIVE_GRIP);
        assert_eq!((same.observation.drive, nothing), (DriveKind::Grip, None));
        let (other, said) = of(SimulateRequest::DRIVE_ACTIONS);
        assert_eq!(other.observation.drive, DriveKind::Actions);
        let said = said.unwrap();
        assert!(said.contains("goal's drive by actions") && said.contains("file's drive by grip"), "{said}");
    }
}
