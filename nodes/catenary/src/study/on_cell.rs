//! Deployments of a study on the whole graph, in a robot cell that holds the hidden object. In real time.

use super::deployment::{Deployment, Planned};
use super::files;
use super::plan::Place;
use super::work::{Work, read_policy, stream};
use crate::graph::own::{Cell, Conditions, OwnDomain, OwnGraph};
use anyhow::{Context, Result, ensure};
use catenary_core::policy::Memory;
use catenary_core::track::End;
use catenary_core::{Frame, Model, Observation, Policy, Task, Track};
use catenary_msgs::action::{MoveToStart, RunEpisode, RunEpisodeGoal};
use catenary_msgs::msg::Observation as ObservationMsg;
use catenary_shell::{ActionClient, Discovery, Node, NodeBuilder, Queue, contract};
use indicatif::ProgressBar;
use std::time::Duration;

/// Time in which a new subscription has found its publishers.
const DISCOVERED: Duration = Duration::from_secs(1);
/// Time for the last observation of an episode to come.
const LAST: Duration = Duration::from_millis(500);

/// Makes the deployments on objects that are missing. Each object hangs in a cell of its own, whose process alone gets the hidden values.
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
    for (task, model) in work.models.tasks.iter().enumerate() {
        for (object, hidden) in work.plan.objects.iter().enumerate() {
            let of_cell = |p: &&&Planned| p.chain.task == task && p.place == Place::Object(object);
            let here: Vec<&Planned> = missing.iter().filter(of_cell).copied().collect();
            if here.is_empty() {
                continue;
            }
            let name = &work.plan.tasks[task];
            let conditions = Conditions {
                cell,
                model: name,
                model_yaml: &work.plan.task_yamls[task],
                truth: &hidden.truth,
                seed: work.seed(stream::DEPLOYMENTS, object as u64),
                learning: false,
            };
            let folder = work.folder.join(format!("cells/{name}_on_{}", hidden.name));
            let mut running = Running::start(&node, &domain, &folder, &conditions)?;
            let outcome: Result<()> = here.iter().try_for_each(|planned| {
                let deployment = running.run(work, model, planned)?;
                files::write_json(&work.deployment_file(planned), &deployment)?;
                bar.inc(1);
                Ok(())
            });
            // Before an error is reported, so that no log line follows it.
            running.graph.supervisor.shut_down();
            outcome.with_context(|| format!("{name} on {} in the {} cell", hidden.name, cell.name()))?;
        }
    }
    Ok(())
}

/// Graph with one object.
struct Running<'a> {
    graph: OwnGraph<'a>,
    move_to_start: ActionClient<MoveToStart>,
    run_episode: ActionClient<RunEpisode>,
    observations: Queue<ObservationMsg>,
}

impl<'a> Running<'a> {
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
        graph.pause(DISCOVERED)?;
        Ok(Self { graph, move_to_start, run_episode, observations })
    }

    fn run(&mut self, work: &Work<'_>, model: &Model, planned: &Planned) -> Result<Deployment> {
        let task = model.task.context("a task file has a task")?;
        let bytes =
            catenary_shell::files::read_bytes("policy", &work.folder.join(work.plan.training_file(&planned.chain)))?;
        let policy = read_policy(&work.folder.join(work.plan.training_file(&planned.chain)))?;
        self.graph.move_to_start(&self.move_to_start)?;
        while self.observations.try_next().is_some() {}
        let goal = RunEpisodeGoal {
            policy: bytes,
            policy_name: work.plan.policy_name(planned.chain.knowledge),
            // Success ends no scored episode.
            run_all_steps: true,
            ..RunEpisodeGoal::default()
        };
        let result = self.graph.goal(&self.run_episode, goal, |_| {})?;
        ensure!(result.success, "{}", result.message);
        self.graph.pause(LAST)?;
        let mut seen = Vec::new();
        while let Some(received) = self.observations.try_next() {
            seen.push(received.message);
        }
        seen.retain(|o| o.episode == result.episode);
        seen.sort_by_key(|o| o.step);
        let expected = result.rewards.len() + 1;
        let is_whole = seen.len() == expected && seen.iter().enumerate().all(|(i, o)| o.step as usize == i);
        ensure!(is_whole, "expected the {expected} observations of an episode, got {}", seen.len());
        let observations: Vec<Observation> = seen.iter().map(|o| Observation(o.values)).collect();
        let end = End::from_name(&result.end).with_context(|| format!("end {} of an episode", result.end))?;
        Ok(Deployment { track: track(&policy, &task, &observations, end), rewards: result.rewards })
    }
}

/// Track of an episode from its observations. The actions are those of the policy, which has no chance in it.
fn track(policy: &Policy, task: &Task, observations: &[Observation], end: End) -> Track {
    let mut memory = Memory::default();
    let frame = |(step, o): (usize, &Observation)| {
        let acts = step < task.steps && step + 1 < observations.len();
        Frame {
            time_s: step as f64 * task.step_period_s,
            dlo: o.dlo(),
            target: o.target(),
            // An observation has no pitch.
            eef: [o.eef_m()[0], o.eef_m()[1], 0.0],
            action: if acts { policy.act(o, &mut memory) } else { [0.0; 2] },
        }
    };
    Track { frames: observations.iter().enumerate().map(frame).collect(), end }
}
