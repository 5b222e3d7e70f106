//! The node: an action that infers from a bag, or from the last episode on the topics.
#![allow(clippy::disallowed_methods, reason = "the ROS side reads the bags that goals name")]

use crate::error::InferenceError;
use crate::pools::Pools;
use crate::sequential::Progress;
use crate::{Settings, convert, infer};
use anyhow::{Context, Result, bail};
use catenary_bag::{BagReader, EpisodeTopics, Feed, read_episodes};
use catenary_core::{EpisodeLog, Model, Policy};
use catenary_msgs::action::{Infer, InferGoal, InferResult};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{EefDelta, EpisodeEvent, Keypoints, Mixture, Observation};
use catenary_shell::convert as wire;
use catenary_shell::{
    Concurrency, Decision, GoalHandle, Msg, Node, NodeBuilder, Outcome, ParamSpec, Publisher, Subscription, contract,
};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Messages of a topic that may wait for the log.
const BURST: u16 = 256;
/// How often the live log drops what nobody needs.
const TIDY: Duration = Duration::from_secs(5);
/// How often a goal that waits for an episode looks for it.
const LOOK: Duration = Duration::from_millis(100);

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("bayes_sim", args, run)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let spec = ParamSpec::new(
        "Simulator pools that may be asked: patterns of their services' names with *, or namespaces, separated by commas.",
    );
    let patterns = builder.declare_string("pools", "*", spec)?;
    let spec = ParamSpec::new("How long an inference waits for a pool while none is at work.").unit("s");
    let stall_s = builder.declare_f64("pool_patience_s", 60.0, spec.range(1.0..=86400.0))?;
    let node = builder.build()?;
    let log = Arc::new(Mutex::new(EpisodeLog::default()));
    let _listening = listen(&node, &log)?;
    let (tidied, shutdown) = (Arc::clone(&log), node.shutdown().clone());
    node.spawn("tidy_log", move || {
        while !shutdown.wait_timeout(TIDY) {
            lock(&tidied).forget_old();
        }
    })?;
    let pools = Arc::new(Pools::new(node.clone(), patterns, stall_s));
    let posteriors = node.publisher::<Mixture>(contract::POSTERIOR.name, contract::POSTERIOR.qos)?;
    let (shared, asked) = (Arc::clone(&log), Arc::clone(&pools));
    let _server = node.serve_action::<Infer>(
        contract::INFER.name,
        Concurrency::One,
        |_| Decision::Accept,
        move |handle| serve(&handle, &shared, &asked, &posteriors),
    )?;
    node.report_diagnostics(move |report| {
        report.value("log", lock(&log).summary());
        let totals = pools.totals();
        report.value("pools", totals.pools).value("simulated_episodes", totals.episodes);
        report.value("redone_episodes", totals.redone).value("unconverged_steps", totals.unconverged_steps);
    })?;
    node.wait_for_shutdown()
}

fn lock(log: &Mutex<EpisodeLog>) -> MutexGuard<'_, EpisodeLog> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Records what the topics say of episodes.
fn listen(node: &Node, log: &Arc<Mutex<EpisodeLog>>) -> Result<[Subscription; 5]> {
    Ok([
        follow::<Keypoints>(node, log, &contract::KEYPOINTS)?,
        follow::<PoseStamped>(node, log, &contract::CURRENT_POSE)?,
        follow::<EefDelta>(node, log, &contract::ACTION)?,
        follow::<Observation>(node, log, &contract::OBSERVATION)?,
        follow::<EpisodeEvent>(node, log, &contract::EPISODE_EVENT)?,
    ])
}

/// Feeds every message of a topic to the log: all of a burst, as a fast replay brings it, and not the newest alone.
fn follow<M: Msg + Feed>(node: &Node, log: &Arc<Mutex<EpisodeLog>>, topic: &contract::Topic) -> Result<Subscription> {
    let log = Arc::clone(log);
    let qos = if topic.qos.is_transient_local() { topic.qos } else { topic.qos.with_depth(BURST) };
    Ok(node.subscription::<M>(topic.name, qos, move |received| feed(&mut lock(&log), &*received.message))?)
}

fn feed<M: Feed>(log: &mut EpisodeLog, message: &M) {
    if let Err(error) = message.feed(log) {
        tracing::warn!("{} left out of the log: {error}", M::TYPE_NAME);
    }
}

fn serve(
    handle: &GoalHandle<Infer>,
    log: &Mutex<EpisodeLog>,
    pools: &Pools,
    posteriors: &Publisher<Mixture>,
) -> Outcome<InferResult> {
    match infer_goal(handle, log, pools) {
        Ok(result) => {
            posteriors.send(result.posterior.clone());
            Outcome::Succeeded(result)
        }
        Err(error) => {
            let cancelled = handle.is_cancelled();
            let result = InferResult { message: format!("{error:#}"), ..InferResult::default() };
            if cancelled {
                return Outcome::Canceled(result);
            }
            tracing::error!("inference: {error:#}");
            Outcome::Aborted(result)
        }
    }
}

fn infer_goal(handle: &GoalHandle<Infer>, log: &Mutex<EpisodeLog>, pools: &Pools) -> Result<InferResult> {
    let goal = handle.goal();
    let (model, overridden) = model(goal)?;
    let policy = if goal.policy.is_empty() { None } else { Some(Policy::from_bytes(&goal.policy)?) };
    let settings = settings(goal)?;
    let episode = match goal.source {
        InferGoal::SOURCE_BAG => {
            let bag = BagReader::open(Path::new(&goal.bag))?;
            read_episodes(&bag, &EpisodeTopics::default())?.episode(None)?
        }
        InferGoal::SOURCE_LIVE => loop {
            // Events are told to late joiners: one without poses and keypoints ended before this node listened.
            let last = lock(log).episode(None).ok();
            if let Some(episode) = last.filter(|e| !(e.poses.is_empty() && e.keypoints.is_empty())) {
                break episode;
            }
            if handle.wait_cancelled(LOOK) {
                bail!("cancelled while waiting for an episode");
            }
        },
        other => bail!("source: expected SOURCE_LIVE or SOURCE_BAG, got {other}"),
    };
    let mut measured = episode.measured(&model)?;
    measured.warnings.extend(overridden);
    let is_cancelled = || handle.is_cancelled();
    let simulator = pools.simulator(&goal.model_yaml, &is_cancelled);
    let result = infer(&model, &measured, policy.as_ref(), &settings, &simulator, &mut |progress| {
        if let Progress::Iteration { iteration, of, posterior } = progress {
            handle.feedback(convert::feedback(iteration, *of, posterior));
        }
        if handle.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    tracing::info!("{}", simulator.summary());
    match result {
        Err(InferenceError::Cancelled { .. }) => bail!("cancelled"),
        other => Ok(convert::result(&other?)),
    }
}

/// The goal's model with the goal's drive, and what to say where the model file has another one.
fn model(goal: &InferGoal) -> Result<(Model, Option<String>)> {
    let mut model = Model::from_yaml(&goal.model_yaml)?;
    let drive = wire::drive_from_msg(goal.drive)?;
    let own = std::mem::replace(&mut model.observation.drive, drive);
    let overridden = (own != drive).then(|| {
        format!("the goal's drive by {} took the place of the model file's drive by {}", drive.name(), own.name())
    });
    Ok((model, overridden))
}

fn settings(goal: &InferGoal) -> Result<Settings> {
    let preset = if goal.preset.is_empty() { "default" } else { &goal.preset };
    let mut settings = Settings::preset(preset).context("preset")?;
    if goal.iterations > 0 {
        settings.iterations = goal.iterations as usize;
    }
    if goal.simulations > 0 {
        settings.simulations = goal.simulations as usize;
    }
    settings.seed = goal.seed;
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::model::DriveKind;
    use catenary_msgs::srv::SimulateRequest;

    #[test]
    fn a_drive_that_is_not_the_model_files_is_said() {
        let model_yaml = include_str!("../../../launch_configs/models/soft_bar.yaml").to_owned();
        let of = |drive| model(&InferGoal { model_yaml: model_yaml.clone(), drive, ..InferGoal::default() }).unwrap();
        let (same, nothing) = of(SimulateRequest::DRIVE_GRIP);
        assert_eq!((same.observation.drive, nothing), (DriveKind::Grip, None));
        let (other, said) = of(SimulateRequest::DRIVE_ACTIONS);
        assert_eq!(other.observation.drive, DriveKind::Actions);
        let said = said.unwrap();
        assert!(said.contains("goal's drive by actions") && said.contains("file's drive by grip"), "{said}");
    }
}
