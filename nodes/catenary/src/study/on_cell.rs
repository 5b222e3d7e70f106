//! Deployments of a study on the whole graph, in a robot cell that holds the hidden object: in lock step if it is simulated, in real time if it is
//! emulated.

use super::deployment::{Deployment, Planned};
use super::files;
use super::plan::Place;
use super::work::{Work, stream};
use crate::graph::own::{Cell, Conditions, OwnDomain, OwnGraph};
use anyhow::{Context, Result, ensure};
use catenary_core::policy::Memory;
use catenary_core::track::End;
use catenary_core::{Frame, Model, Observation, Policy, Task, Track, seed};
use catenary_msgs::action::{MoveToStart, RunEpisode, RunEpisodeGoal};
use catenary_msgs::msg::Observation as ObservationMsg;
use catenary_shell::{ActionClient, Discovery, Node, NodeBuilder, Queue, contract};
use indicatif::ProgressBar;
use std::collections::BTreeMap;
use std::time::Duration;

/// Wait after a subscription, in which it finds its publishers.
const DISCOVERY_WAIT: Duration = Duration::from_secs(1);
/// Wait after the result of an episode, in which its last observation arrives.
const LAST_OBSERVATION_WAIT: Duration = Duration::from_millis(500);

/// Runs each of the `planned` deployments on objects that has no file yet, and writes its file. For each task, object and number it starts one
/// graph, and runs all policies in it, one after another: they meet the same target, camera and other parameters of the cell. The cell's process
/// alone gets the hidden values. `bar` advances by one a deployment, also for those that exist.
///
/// # Errors
/// The first start, goal or file that failed. Files that were written before stay.
pub fn deploy(work: &Work<'_>, cell: Cell, builder: NodeBuilder, planned: &[Planned], bar: &ProgressBar) -> Result<()> {
    let missing: Vec<&Planned> = planned.iter().filter(|p| !work.deployment_file(p).exists()).collect();
    bar.inc((planned.len() - missing.len()) as u64);
    if missing.is_empty() {
        return Ok(());
    }
    let domain = OwnDomain::claim()?;
    work.check()?;
    let node = builder.domain(domain.id(), Discovery::Localhost).build()?;
    tracing::info!("{}", domain.words());
    let mut groups: BTreeMap<(usize, usize, u64), Vec<&Planned>> = BTreeMap::new();
    for planned in missing {
        if let Place::Object(object) = planned.place {
            groups.entry((planned.chain.task, object, planned.number)).or_default().push(planned);
        }
    }
    for ((task, object, number), here) in groups {
        let (model, task_name, hidden) = (&work.models.tasks[task], &work.plan.tasks[task], &work.plan.objects[object]);
        let conditions = Conditions {
            cell,
            model: task_name,
            model_yaml: &work.plan.task_yamls[task],
            truth: &hidden.truth,
            // It draws what else the cell holds. The noise of an episode is that of its time.
            seed: seed::derive(work.seed(stream::DEPLOYMENTS, object as u64), number),
            learning: false,
        };
        let name = format!("{task_name}_on_{}_{}", hidden.name, number + 1);
        let folder = work.folder.join(format!("cells_{}/{name}", cell.name()));
        let outcome = Deployer::start(&node, &domain, &folder, &conditions).and_then(|mut deployer| {
            let outcome: Result<()> = here.iter().try_for_each(|planned| {
                let deployment = deployer.run(work, model, planned)?;
                files::write_json(&work.deployment_file(planned), &deployment)?;
                bar.inc(1);
                Ok(())
            });
            // Before an error is reported, so that no log line follows it.
            deployer.graph.supervisor.shut_down();
            outcome
        });
        work.check()?;
        outcome.with_context(|| format!("{task_name} on {} in the {} cell", hidden.name, cell.name()))?;
    }
    Ok(())
}

/// Running graph whose cell holds one object, with the clients that deploy policies in it.
struct Deployer<'a> {
    graph: OwnGraph<'a>,
    move_to_start: ActionClient<MoveToStart>,
    run_episode: ActionClient<RunEpisode>,
    observations: Queue<ObservationMsg>,
}

impl<'a> Deployer<'a> {
    fn start(
        node: &'a Node,
        domain: &OwnDomain,
        folder: &std::path::Path,
        conditions: &Conditions<'_>,
    ) -> Result<Self> {
        let mut graph = OwnGraph::start(node, domain, folder, conditions)?;
        let move_to_start = node.action_client(contract::MOVE_TO_START.name)?;
        let run_episode = node.action_client(contract::RUN_EPISODE.name)?;
        graph.wait_for(&move_to_start)?;
        graph.wait_for(&run_episode)?;
        let steps = 1 + catenary_core::task::MOST_STEPS;
        let observations = node.queue(contract::OBSERVATION.name, contract::OBSERVATION.qos, steps)?;
        graph.pause(DISCOVERY_WAIT)?;
        Ok(Self { graph, move_to_start, run_episode, observations })
    }

    /// Moves the arm to its start, and runs one whole episode. Returns an error for a goal that failed or an observation that was lost.
    fn run(&mut self, work: &Work<'_>, model: &Model, planned: &Planned) -> Result<Deployment> {
        let task = model.task.context("a task file has a task")?;
        let (policy, _) = work.training(&planned.chain)?;
        self.graph.move_to_start(&self.move_to_start)?;
        while self.observations.try_next().is_some() {}
        let goal = RunEpisodeGoal {
            policy: policy.to_bytes(),
            policy_name: work.plan.policy_name(planned.chain.knowledge),
            // The episode goes on after a success: all have the same number of rewards.
            run_all_steps: true,
            ..RunEpisodeGoal::default()
        };
        let result = self.graph.goal(&self.run_episode, goal, |_| {})?;
        ensure!(result.success, "{}", result.message);
        self.graph.pause(LAST_OBSERVATION_WAIT)?;
        let mut seen = Vec::new();
        while let Some(received) = self.observations.try_next() {
            seen.push(received.message);
        }
        seen.retain(|o| o.episode == result.episode);
        seen.sort_by_key(|o| o.step);
        // An episode of n actions has n rewards, and observations 0 to n.
        let (n, steps) = (result.rewards.len(), seen.iter().map(|o| o.step as usize).collect::<Vec<usize>>());
        ensure!(
            steps.iter().copied().eq(0..=n),
            "expected the observations of steps 0 to {n} of an episode, got those of {steps:?}"
        );
        let observations: Vec<Observation> = seen.iter().map(|o| Observation(o.values)).collect();
        let end = End::from_name(&result.end).with_context(|| format!("end {} of an episode", result.end))?;
        Ok(Deployment { track: track(&policy, &task, &observations, end), rewards: result.rewards })
    }
}

/// Track of an episode from its observations. The actions are computed again by the policy, whose mean actions the episode took; the last
/// frame has none.
fn track(policy: &Policy, task: &Task, observations: &[Observation], end: End) -> Track {
    let mut memory = Memory::default();
    let frame = |(step, o): (usize, &Observation)| {
        let acts = step < task.steps && step + 1 < observations.len();
        Frame {
            time_s: step as f64 * task.step_period_s,
            dlo: o.dlo(),
            target: o.target(),
            // x and z in m, and a pitch of 0, which an observation does not have.
            eef: [o.eef_m()[0], o.eef_m()[1], 0.0],
            action: if acts { policy.act(o, &mut memory) } else { [0.0; 2] },
            wrench: None,
        }
    };
    Track { frames: observations.iter().enumerate().map(frame).collect(), end }
}
