//! Many inferences of one benchmark: on all cores, in order, kept in a file from which an interrupted benchmark resumes.

use crate::exit::Interrupted;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use bayes_sim::sequential::Progress;
use bayes_sim::{InferenceError, InferenceResult, Settings};
use catenary_core::episode::MeasuredTrack;
use catenary_core::{Model, Posterior};
use catenary_shell::Shutdown;
use catenary_simulator::{BeamSimulator, workers};
use indicatif::ProgressBar;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::ops::{ControlFlow, Range};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;

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
        in_order_on_all_cores(
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

/// Sets the shared counter to its end when dropped, so that no worker takes another number.
struct StopOnDrop<'a>(&'a AtomicU64, u64);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(self.1, Ordering::Relaxed);
    }
}

/// Calls `work` with all `numbers` on every core, and `keep` with each result, in order. The first error stops it.
fn in_order_on_all_cores<T: Send>(
    numbers: Range<u64>,
    work: impl Fn(u64) -> Result<T> + Sync,
    mut keep: impl FnMut(T) -> Result<()>,
) -> Result<()> {
    let (next, end) = (AtomicU64::new(numbers.start), numbers.end);
    let (sender, done) = channel();
    std::thread::scope(|scope| {
        for _ in 0..workers::available() {
            let (sender, next, work) = (sender.clone(), &next, &work);
            scope.spawn(move || {
                // A worker that panics stops the other workers too.
                let _last = StopOnDrop(next, end);
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    // A closed channel means that `keep` has failed: nobody needs further results.
                    if number >= end || sender.send((number, work(number))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let _last = StopOnDrop(&next, end);
        // Results that arrived before their turn.
        let mut early = BTreeMap::new();
        for number in numbers {
            let outcome = loop {
                if let Some(outcome) = early.remove(&number) {
                    break outcome;
                }
                let (of, outcome) = done.recv().context("a worker died")?;
                early.insert(of, outcome);
            };
            outcome.and_then(&mut keep)?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_on_all_cores_is_kept_in_order_up_to_the_first_error() {
        let slow_first = |number: u64| {
            // Results arrive out of order: every third number takes longest.
            std::thread::sleep(std::time::Duration::from_millis(if number.is_multiple_of(3) { 20 } else { 1 }));
            if number == 40 { anyhow::bail!("no {number}") } else { Ok(number) }
        };
        let mut kept = Vec::new();
        in_order_on_all_cores(3..20, slow_first, |number| {
            kept.push(number);
            Ok(())
        })
        .unwrap();
        assert_eq!(kept, (3..20).collect::<Vec<_>>());
        kept.clear();
        // The range is far longer than the test may take: it ends in time only if the error stops the workers.
        let error = in_order_on_all_cores(30..1_000_000, slow_first, |number| {
            kept.push(number);
            Ok(())
        });
        assert_eq!((error.unwrap_err().to_string(), kept), ("no 40".to_owned(), (30..40).collect()));
        assert!(in_order_on_all_cores(0..10, slow_first, |_| anyhow::bail!("full")).is_err());
    }
}
