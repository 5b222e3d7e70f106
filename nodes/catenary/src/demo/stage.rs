//! Stages of the demo: progress and time.

use super::kept::{Kept, StageResult};
use super::summary::Stage;
use crate::graph::own::OwnGraph;
use crate::terminal::progress;
use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressDrawTarget};
use serde::Serialize;
use std::io::Write;
use std::time::{Duration, Instant};

/// Runs stages on a running graph and keeps their times.
pub struct Stages<'a> {
    /// Graph of the demo.
    pub graph: OwnGraph<'a>,
    /// Finished stages.
    pub done: Vec<Stage>,
    kept: &'a Kept,
    quiet: bool,
}

impl<'a> Stages<'a> {
    /// Stages on a graph. Progress is shown as bars on a terminal, else as one line per stage.
    pub fn new(graph: OwnGraph<'a>, kept: &'a Kept) -> Self {
        let quiet = !std::io::IsTerminal::is_terminal(&std::io::stderr());
        Self { graph, done: Vec::new(), kept, quiet }
    }

    /// Runs `work` as the stage `name`, with a progress bar of `length` steps.
    pub fn run<T>(
        &mut self,
        name: &str,
        length: u64,
        work: impl FnOnce(&mut Self, &ProgressBar) -> Result<T>,
    ) -> Result<T> {
        let bar = self.bar(name, length)?;
        let (wall, cpu) = (Instant::now(), self.graph.cpu_s());
        let result = work(self, &bar).with_context(|| name.to_owned());
        let stage =
            Stage { name: name.to_owned(), wall_s: wall.elapsed().as_secs_f64(), cpu_s: self.graph.cpu_s() - cpu };
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

    /// Returns the result of a stage that an earlier run of the command kept for these inputs. Otherwise runs it as [`Stages::run`], and keeps
    /// its result.
    pub fn run_or_keep<T: StageResult>(
        &mut self,
        name: &str,
        inputs: &impl Serialize,
        length: u64,
        work: impl FnOnce(&mut Self, &ProgressBar) -> Result<T>,
    ) -> Result<T> {
        let fingerprint = self.kept.fingerprint(inputs);
        if let Some((stage, result)) = self.kept.read(name, &fingerprint) {
            let _closed = writeln!(std::io::stderr(), "{name}: kept, {:.1} s in an earlier run", stage.wall_s);
            self.done.push(stage);
            return Ok(result);
        }
        let result = self.run(name, length, work)?;
        if let Some(stage) = self.done.last() {
            self.kept.write(stage, fingerprint, &result)?;
        }
        Ok(result)
    }

    fn bar(&self, name: &str, length: u64) -> Result<ProgressBar> {
        let bar = ProgressBar::with_draw_target(Some(length.max(1)), ProgressDrawTarget::stderr());
        bar.set_style(progress::style("{prefix:<28} [{bar:12}]", 0.0)?);
        bar.set_prefix(name.to_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        Ok(bar)
    }
}
