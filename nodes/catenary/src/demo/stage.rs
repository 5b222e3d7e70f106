//! Stages of the demo: progress, time, and what ends them early.

use super::summary::Stage;
use crate::interrupted::Interrupted;
use crate::launch::Supervisor;
use crate::progress;
use anyhow::{Context, Result, anyhow, bail};
use catenary_shell::{Act, ActionClient, CallError, Node, Status};
use indicatif::{ProgressBar, ProgressDrawTarget};
use std::io::Write;
use std::time::{Duration, Instant};

/// Time in which a server must answer that it takes a goal.
const ACCEPT: Duration = Duration::from_secs(20);
/// How often the processes are looked after while a goal runs.
const WATCH: Duration = Duration::from_millis(200);

/// Runs stages on a running graph, and keeps their times.
pub struct Stages<'a> {
    /// The demo's own node.
    pub node: &'a Node,
    /// The graph's processes.
    pub supervisor: Supervisor,
    /// The stages so far.
    pub done: Vec<Stage>,
    quiet: bool,
}

impl<'a> Stages<'a> {
    /// Stages on the graph that `supervisor` runs. Where stderr is a terminal it shows bars, else a line a stage.
    pub fn new(node: &'a Node, supervisor: Supervisor) -> Self {
        let quiet = !std::io::IsTerminal::is_terminal(&std::io::stderr());
        Self { node, supervisor, done: Vec::new(), quiet }
    }

    /// Runs `work` as the stage `name`, with a bar of `length`.
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

    /// Runs a goal to its end. Feedback goes to `on_feedback`; Ctrl-C cancels the goal; a process of the graph that ends
    /// by itself ends the stage with its last words.
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
                Ok((Status::Aborted, result)) => return Ok(result),
                Err(CallError::Timeout { .. }) => {}
                Err(CallError::Shutdown { .. }) => return Err(Interrupted(String::new()).into()),
                Err(e) => return Err(e.into()),
            }
            if self.node.is_shutdown() {
                return Err(Interrupted(String::new()).into());
            }
            if let Err(e) = self.check() {
                // The goal's own server may be the one that died: nobody may be left to cancel it.
                let _ = running.cancel(Duration::from_secs(1));
                return Err(e);
            }
        }
    }

    /// Fails where a process of the graph has ended by itself.
    pub fn check(&mut self) -> Result<()> {
        match self.supervisor.poll()?.first() {
            Some(event) => Err(anyhow!("{}", event.describe())),
            None => Ok(()),
        }
    }

    /// Waits `time`, ready for Ctrl-C and for processes that end.
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
