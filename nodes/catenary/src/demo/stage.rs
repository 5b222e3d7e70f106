//! Stages of the demo: progress, time, and early ends.

use super::summary::Stage;
use crate::exit::Interrupted;
use crate::launch::Supervisor;
use crate::terminal::progress;
use anyhow::{Context, Result, anyhow, bail};
use catenary_shell::{Act, ActionClient, CallError, Node, Status};
use indicatif::{ProgressBar, ProgressDrawTarget};
use std::io::Write;
use std::time::{Duration, Instant};

/// Time in which a server must accept a goal.
const ACCEPT: Duration = Duration::from_secs(20);
/// Period of the checks on the processes while a goal runs.
const WATCH: Duration = Duration::from_millis(200);

/// Runs stages on a running graph and keeps their times.
pub struct Stages<'a> {
    /// Node of the demo itself.
    pub node: &'a Node,
    /// Processes of the graph.
    pub supervisor: Supervisor,
    /// Finished stages.
    pub done: Vec<Stage>,
    quiet: bool,
}

impl<'a> Stages<'a> {
    /// Stages on the graph that `supervisor` runs. Progress is shown as bars on a terminal, else as one line per stage.
    pub fn new(node: &'a Node, supervisor: Supervisor) -> Self {
        let quiet = !std::io::IsTerminal::is_terminal(&std::io::stderr());
        Self { node, supervisor, done: Vec::new(), quiet }
    }

    /// Runs `work` as the stage `name`, with a progress bar of `length` steps.
    pub fn run<T>(
        &mut self,
        name: &str,
        length: u64,
        work: impl FnOnce(&mut Self, &ProgressBar) -> Result<T>,
    ) -> Result<T> {
        let bar = self.bar(name, length)?;
        let (wall, cpu) = (Instant::now(), self.cpu_s());
        let result = work(self, &bar).with_context(|| name.to_owned());
        let stage = Stage { name: name.to_owned(), wall_s: wall.elapsed().as_secs_f64(), cpu_s: self.cpu_s() - cpu };
        match &result {
            Ok(_) => bar.finish_with_message(format!("{:.1} s", stage.wall_s)),
            Err(_) => bar.abandon_with_message("stopped"),
        }
        if self.quiet && result.is_ok() {
            let _closed = writeln!(std::io::stderr(), "{name}: {:.1} s", stage.wall_s);
        }
        self.done.push(stage);
        result
    }

    /// Runs a goal to its end. Feedback goes to `on_feedback`. Ctrl-C cancels the goal. If a process of the graph ends
    /// by itself, the stage ends with its last log lines as the error.
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

    fn cpu_s(&self) -> f64 {
        self.supervisor.cpu_seconds().iter().map(|(_, s)| s).sum()
    }

    fn bar(&self, name: &str, length: u64) -> Result<ProgressBar> {
        let bar = ProgressBar::with_draw_target(Some(length.max(1)), ProgressDrawTarget::stderr());
        bar.set_style(progress::style("{prefix:<28} [{bar:12}]", 0.0)?);
        bar.set_prefix(name.to_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        Ok(bar)
    }
}
