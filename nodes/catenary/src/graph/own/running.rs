//! Running processes of a command's own graph, and the goals that they serve.

use super::domain::ensure_own_arm;
use super::{Cell, OwnDomain};
use crate::exit::Interrupted;
use crate::launch::{Supervisor, read};
use anyhow::{Result, anyhow, bail, ensure};
use catenary_core::Fidelity;
use catenary_msgs::action::{MoveToStart, MoveToStartGoal};
use catenary_shell::{Act, ActionClient, CallError, Node, Status};
use std::path::Path;
use std::time::{Duration, Instant};

/// Time in which a server must accept a goal.
const ACCEPT: Duration = Duration::from_secs(20);
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
    /// Seed of the cell and of the arm.
    pub seed: u64,
    /// True to start the nodes of simulation, inference and training, too.
    pub learning: bool,
}

/// Graph that this process started. It ends with this value.
pub struct OwnGraph<'a> {
    /// Node of this process in the graph's domain.
    pub node: &'a Node,
    /// Processes of the graph.
    pub supervisor: Supervisor,
}

impl<'a> OwnGraph<'a> {
    /// Starts a graph in `domain` with a cell at the highest fidelity. Its files go to `folder/config`, its logs to `folder/log`.
    pub fn start(node: &'a Node, domain: &OwnDomain, folder: &Path, conditions: &Conditions<'_>) -> Result<Self> {
        let Conditions { cell, model, model_yaml, truth, seed, learning } = conditions;
        let [launch_file, model_file] = cell.write(&folder.join("config"), model, model_yaml)?;
        let values: Vec<String> = truth.iter().map(|v| format!("{v:?}")).collect();
        let mut given = vec![
            ("model", model_file.display().to_string()),
            ("cell_theta", format!("[{}]", values.join(","))),
            ("cell_fidelity", Fidelity::Reference.name().to_owned()),
            ("seed", (seed >> 33).to_string()),
            ("learning", learning.to_string()),
            // A node that ends by itself is an error here, and a restart would hide it.
            ("respawn", "false".to_owned()),
        ];
        if *cell == Cell::Emulated {
            // Every domain of this machine has a loopback address of its own, so that two graphs have two arms.
            given.push(("address", format!("127.42.{}.1", domain.id())));
        }
        let given: Vec<_> = given.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        let mut description = read(&launch_file, &given, &|name| std::env::var(name).ok())?;
        description.processes.iter_mut().for_each(|p| p.environment.extend(domain.environment()));
        Ok(Self { node, supervisor: Supervisor::start(description.processes, &folder.join("log"), false)? })
    }

    /// Moves the arm to its start, after a check that it is the graph's own.
    pub fn move_to_start(&mut self, client: &ActionClient<MoveToStart>) -> Result<()> {
        ensure_own_arm(self.node, &self.supervisor)?;
        let moved = self.goal(client, MoveToStartGoal::default(), |_| {})?;
        ensure!(moved.success, "move to start: {}", moved.message);
        Ok(())
    }

    /// Runs a goal to its end. Feedback goes to `on_feedback`. Ctrl-C cancels the goal. If a process of the graph ends
    /// by itself, its last log lines are the error.
    pub fn goal<A: Act>(
        &mut self,
        client: &ActionClient<A>,
        goal: A::Goal,
        on_feedback: impl FnMut(A::Feedback) + Send + 'static,
    ) -> Result<A::Result> {
        let running = match client.send(goal, ACCEPT, on_feedback) {
            Err(CallError::Shutdown { .. }) => return Err(Interrupted(String::new()).into()),
            sent => sent?,
        };
        loop {
            match running.wait(WATCH) {
                Ok((Status::Succeeded, result)) => return Ok(result),
                Ok((Status::Canceled, _)) => bail!("cancelled"),
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

    /// Waits for a server. Ctrl-C and the end of a process of the graph interrupt the wait.
    pub fn wait_for<A: Act>(&mut self, client: &ActionClient<A>) -> Result<()> {
        // 100 turns of 0.2 s each.
        const PATIENCE: usize = 100;
        for _ in 0..PATIENCE {
            if client.wait_for_server(Duration::from_millis(200)) {
                return Ok(());
            }
            self.pause(Duration::from_millis(10))?;
        }
        bail!("{}: no server after 20 s", client.name())
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

    /// Processor time of the processes so far, s.
    pub fn cpu_s(&self) -> f64 {
        self.supervisor.cpu_seconds().iter().map(|(_, s)| s).sum()
    }
}
