//! Many inferences of one benchmark: on all cores, in order, kept in a file from which an interrupted benchmark resumes.

use crate::all_cores;
use crate::exit::Interrupted;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use bayes_sim::sequential::Progress;
use bayes_sim::{InferenceError, InferenceResult, Settings};
use catenary_core::episode::MeasuredTrack;
use catenary_core::{Model, Posterior};
use catenary_shell::Shutdown;
use catenary_simulator::BeamSimulator;
use indicatif::ProgressBar;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::OpenOptions;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::Path;

/// File of the runs of a benchmark, one JSON document per line.
pub struct Runs<'a> {
    /// The file.
    pub path: &'a Path,
    /// Number of runs.
    pub count: u64,
    /// Name of a run in the plural, for the progress bar.
    pub name: &'a str,
}

impl Runs<'_> {
    /// Makes the runs that the file does not hold yet, and returns all in order. `check` refuses lines of another benchmark.
    pub fn complete<L: Serialize + DeserializeOwned + Send>(
        &self,
        check: impl Fn(&L) -> Result<()>,
        work: impl Fn(u64, &Shutdown) -> Result<L> + Sync,
    ) -> Result<Vec<L>> {
        // Checked before the first inference: a benchmark takes hours.
        output::prepare(self.path)?;
        let mut lines = self.read(check)?;
        let shutdown = Shutdown::new();
        catenary_shell::end_on_signals(&shutdown)?;
        let made = lines.len() as u64;
        let bar = ProgressBar::new(self.count).with_position(made);
        // The time left counts only the inferences of this process.
        let began = progress::share(made as f64, self.count as f64);
        bar.set_style(progress::style(&format!("{} [{{bar:24}}] {{pos}}/{{len}}", self.name), began)?);
        // Each line is appended as soon as it is known: an interrupted benchmark loses one inference of each core.
        let mut file = OpenOptions::new().create(true).append(true).open(self.path)?;
        all_cores::in_order(
            made..self.count,
            |number| work(number, &shutdown),
            |line| {
                let text = serde_json::to_string(&line)?;
                writeln!(file, "{text}").with_context(|| self.path.display().to_string())?;
                lines.push(line);
                bar.inc(1);
                Ok(())
            },
        )?;
        bar.finish_and_clear();
        Ok(lines)
    }

    fn read<L: DeserializeOwned>(&self, check: impl Fn(&L) -> Result<()>) -> Result<Vec<L>> {
        if !self.path.exists() {
            return Ok(Vec::new());
        }
        let shown = self.path.display();
        let text = std::fs::read_to_string(self.path).with_context(|| shown.to_string())?;
        let parse = |(i, line): (usize, &str)| {
            let parse = || {
                let line: L = serde_json::from_str(line)?;
                check(&line).map(|()| line)
            };
            parse().with_context(|| format!("{shown}: line {}", i + 1))
        };
        text.lines().enumerate().map(parse).collect()
    }
}

/// Inference with its posterior before the widening of the intervals.
pub struct Inferred {
    /// Result.
    pub result: InferenceResult,
    /// Posterior of the last iteration, not widened.
    pub narrow: Posterior,
}

/// Infers `measured` on one core, without predictive check: it costs simulations and is no part of the benchmarks. `number`
/// names the run in the error of an interruption.
pub fn infer_on_one_core(
    model: &Model,
    measured: MeasuredTrack,
    settings: &Settings,
    number: u64,
    shutdown: &Shutdown,
) -> Result<Inferred> {
    let settings = Settings { predictive_draws: 0, ..settings.clone() };
    let simulator = BeamSimulator::new(model, 1)?;
    let mut narrow = Posterior::prior(model.theta.clone());
    let mut listen = |progress: &Progress<'_>| {
        if let Progress::Iteration { posterior, .. } = progress {
            narrow = (*posterior).clone();
        }
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    match bayes_sim::infer(model, &[measured], None, &settings, None, &simulator, &mut listen) {
        Err(InferenceError::Cancelled { .. }) => Err(Interrupted(format!(" after {number} runs")).into()),
        other => Ok(Inferred { result: other?, narrow }),
    }
}
