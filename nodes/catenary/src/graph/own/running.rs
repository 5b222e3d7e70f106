//! Running processes of a command's own graph, and the goals that they serve.

use super::domain::ensure_own_arm;
use super::{Cell, OwnDomain};
use crate::exit::Interrupted;
use crate::launch::{Supervisor, read};
use anyhow::{Result, anyhow, bail, ensure};
use catenary_core::Fidelity;
use catenary_msgs::action::{MoveToStart, MoveToStartGoal};
use catenary_msgs::std_srvs::srv::{Trigger, TriggerRequest};
use catenary_shell::{Act, ActionClient, CallError, Client, DEAD_NODE, Node, Status, contract};
use std::path::Path;
use std::time::{Duration, Instant};

/// Service of a cell that stills the object.
const STILL_OBJECT: &str = "simulated_cell/still_object";
/// Simulated time per real time in lock step: as fast as the machine allows.
const LOCK_STEP_FACTOR: &str = "1000.0";
/// Period of the checks on the processes while a goal runs.
const WATCH: Duration = Duration::from_millis(200);

/// Conditions in the cell of a graph.
pub struct Conditions<'a> {
    /// Robot cell.
    pub cell: Cell,
    /// Name of the model.
    pub model: &'a str,
    /// Text of the model that the graph works with.
    pub model_yaml: &'a str,
    /// Hidden values of the object. The cell's process alone receives them.
    pub truth: &'a [f64],
    /// Seed of the cell and of the arm. Its upper 31 bits count, so that small numbers are all 0: pass a seed of `seed::derive`.
    pub seed: u64,
    /// True to start the nodes of simulation, inference and training, too.
    pub learning: bool,
}

/// Graph that this process started. Its processes end when this value is dropped.
pub struct OwnGraph<'a> {
    /// Node of this process in the graph's domain.
    pub node: &'a Node,
    /// Processes of the graph.
    pub supervisor: Supervisor,
    still_object: Client<Trigger>,
}

impl<'a> OwnGraph<'a> {
    /// Starts the processes of a graph in `domain`, with a cell at reference fidelity, in lock step if the cell can. Its files go to `folder/config`, its logs to `folder/log`. It
    /// does not wait for the nodes: see [`OwnGraph::wait_for`].
    pub fn start(node: &'a Node, domain: &OwnDomain, folder: &Path, conditions: &Conditions<'_>) -> Result<Self> {
        let Conditions { cell, model, model_yaml, truth, seed, learning } = conditions;
        let [launch_file, model_file] = cell.write(&folder.join("config"), model, model_yaml)?;
        let values: Vec<String> = truth.iter().map(|v| format!("{v:?}")).collect();
        let mut given = vec![
            ("model", model_file.display().to_string()),
            ("cell_theta", format!("[{}]", values.join(","))),
            ("cell_fidelity", Fidelity::Reference.name().to_owned()),
            // A ROS integer parameter that is positive in 32 bits, too.
            ("seed", (seed >> 33).to_string()),
            ("learning", learning.to_string()),
            // A node that ends by itself is an error here, and a restart would hide it.
            ("respawn", "false".to_owned()),
        ];
        if cell.is_in_lock_step() {
            given.extend([("lock_step", "true".to_owned()), ("real_time_factor", LOCK_STEP_FACTOR.to_owned())]);
        }
        if *cell == Cell::Emulated {
            // Every domain of this machine has a loopback address of its own, so that two graphs have two arms.
            given.push(("address", format!("127.42.{}.1", domain.id())));
        }
        let given: Vec<_> = given.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        let mut description = read(&launch_file, &given, &|name| std::env::var(name).ok())?;
        description.processes.iter_mut().for_each(|p| p.environment.extend(domain.environment()));
        let still_object = node.client(STILL_OBJECT)?;
        Ok(Self {
            node,
            supervisor: Supervisor::start(description.processes, &folder.join("log"), false)?,
            still_object,
        })
    }

    /// Checks that the arm belongs to this graph, moves it to its start pose, and stills the object, which a person does in a laboratory.
    ///
    /// # Errors
    /// An arm of another process, a motion that failed, a cell that does not answer, or those of [`OwnGraph::goal`].
    pub fn move_to_start(&mut self, client: &ActionClient<MoveToStart>) -> Result<()> {
        self.wait_for_arm()?;
        ensure_own_arm(self.node, &self.supervisor)?;
        let moved = self.goal(client, MoveToStartGoal::default(), |_| {})?;
        ensure!(moved.success, "move to start: {}", moved.message);
        match self.still_object.call(TriggerRequest::default(), DEAD_NODE) {
            Ok(answer) if answer.success => Ok(()),
            Ok(answer) => bail!("{STILL_OBJECT}: {}", answer.message),
            Err(CallError::Shutdown { .. }) => Err(Interrupted(String::new()).into()),
            Err(e) => Err(e.into()),
        }
    }

    /// Waits until every name of the arm has been found: a busy machine may be slow at it.
    fn wait_for_arm(&mut self) -> Result<()> {
        let deadline = Instant::now() + DEAD_NODE;
        for name in contract::ARM.into_iter().chain([contract::RUN_EPISODE.name]) {
            while self.node.servers(&[name])?.is_empty() && Instant::now() < deadline {
                self.pause(Duration::from_millis(50))?;
            }
        }
        Ok(())
    }

    /// Runs a goal to its end, without a time limit. Feedback goes to `on_feedback`. The result of an aborted goal is returned, too: it tells by
    /// itself whether it is one.
    ///
    /// # Errors
    /// No acceptance within [`DEAD_NODE`]; a cancelled goal; Ctrl-C, at which the caller ends the whole graph; the end of a process of the graph, with its
    /// last log lines.
    pub fn goal<A: Act>(
        &mut self,
        client: &ActionClient<A>,
        goal: A::Goal,
        on_feedback: impl FnMut(A::Feedback) + Send + 'static,
    ) -> Result<A::Result> {
        let running = match client.send(goal, DEAD_NODE, on_feedback) {
            Err(CallError::Shutdown { .. }) => return Err(Interrupted(String::new()).into()),
            sent => sent?,
        };
        loop {
            match running.wait(WATCH) {
                Ok((Status::Succeeded, result)) => return Ok(result),
                Ok((Status::Canceled, _)) => bail!("{}: another client cancelled the goal", client.name()),
                // An aborted goal carries the reason in its result, which the caller checks.
                Ok((Status::Aborted, result)) => return Ok(result),
                Err(CallError::Timeout { .. }) => {}
                Err(CallError::Shutdown { .. }) => return Err(Interrupted(String::new()).into()),
                Err(e) => return Err(e.into()),
            }
            if self.node.is_shutdown() {
                return Err(Interrupted(String::new()).into());
            }
            if let Err(e) = self.check() {
                // The goal's server may be the process that died: a failed cancellation is ignored.
                let _ = running.cancel(Duration::from_secs(1));
                return Err(e);
            }
        }
    }

    /// Waits up to [`DEAD_NODE`] for a server. Ctrl-C and the end of a process of the graph interrupt the wait.
    pub fn wait_for<A: Act>(&mut self, client: &ActionClient<A>) -> Result<()> {
        let deadline = Instant::now() + DEAD_NODE;
        while !client.wait_for_server(WATCH) {
            self.pause(Duration::from_millis(10))?;
            ensure!(Instant::now() < deadline, "{}: no server after {} s", client.name(), DEAD_NODE.as_secs());
        }
        Ok(())
    }

    /// Returns an error if a process of the graph has ended by itself.
    pub fn check(&mut self) -> Result<()> {
        match self.supervisor.poll()?.first() {
            Some(event) => Err(anyhow!("{}", event.describe())),
            None => Ok(()),
        }
    }

    /// Waits for `time`. Ctrl-C and the end of a process interrupt the wait.
    pub fn pause(&mut self, time: Duration) -> Result<()> {
        let end = Instant::now() + time;
        while Instant::now() < end {
            if self.node.is_shutdown() {
                return Err(Interrupted(String::new()).into());
            }
            self.check()?;
            std::thread::sleep(Duration::from_millis(50).min(end.saturating_duration_since(Instant::now())));
        }
        Ok(())
    }

    /// Processor time of the running processes so far, s.
    pub fn cpu_s(&self) -> f64 {
        self.supervisor.cpu_seconds().iter().map(|(_, s)| s).sum()
    }
}
