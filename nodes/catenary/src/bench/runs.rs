//! Many inferences of one benchmark: on all cores, in order, kept in a file from which an interrupted benchmark resumes.

use crate::all_cores;
use crate::exit::Interrupted;
use crate::options::Part;
use crate::terminal::{output, progress};
use anyhow::{Context, Result, ensure};
use bayes_sim::sequential::Progress;
use bayes_sim::{InferenceError, InferenceResult, Settings};
use catenary_core::episode::MeasuredTrack;
use catenary_core::{Model, Posterior};
use catenary_shell::Shutdown;
use catenary_simulator::BeamSimulator;
use indicatif::ProgressBar;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// File of the runs of a benchmark, one JSON document per line. The parts of a benchmark that several machines share have files of
/// their own beside it.
pub struct Runs<'a> {
    /// File of all runs.
    pub path: &'a Path,
    /// Part that is made.
    pub part: Part,
    /// Number of runs.
    pub count: u64,
    /// Name of a run in the plural, for the progress bar.
    pub name: &'a str,
}

impl Runs<'_> {
    /// Makes the runs of the part that its file does not hold yet, and returns them in order. For all runs, those of finished or
    /// unfinished parts are taken over. `check` refuses lines of another benchmark.
    pub fn complete<L: Serialize + DeserializeOwned + Send>(
        &self,
        check: impl Fn(&L) -> Result<()>,
        work: impl Fn(u64, &Shutdown) -> Result<L> + Sync,
    ) -> Result<Vec<L>> {
        // Checked before the first inference: a benchmark takes hours.
        let path = self.file(self.part);
        output::prepare(&path)?;
        let (mut lines, known) = (read(&path, &check)?, self.of_parts(&check)?);
        let count = self.part.count(self.count as usize) as u64;
        ensure!(lines.len() as u64 <= count, "{}: expected at most {count} lines, got {}", path.display(), lines.len());
        let shutdown = Shutdown::new();
        catenary_shell::end_on_signals(&shutdown)?;
        let made = lines.len() as u64;
        let bar = ProgressBar::new(count).with_position(made);
        // The time left counts only the inferences of this process.
        let began = progress::share(made as f64, count as f64);
        bar.set_style(progress::style(&format!("{} [{{bar:24}}] {{pos}}/{{len}}", self.name), began)?);
        // Each line is appended as soon as it is known: an interrupted benchmark loses one inference of each core.
        let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
        let known = Mutex::new(known);
        let taken = |number: u64| known.lock().unwrap_or_else(PoisonError::into_inner).remove(&number);
        all_cores::in_order(
            made..count,
            |place| {
                let number = self.part.item(place as usize) as u64;
                taken(number).map_or_else(|| work(number, &shutdown), Ok)
            },
            |line| {
                let text = serde_json::to_string(&line)?;
                writeln!(file, "{text}").with_context(|| path.display().to_string())?;
                lines.push(line);
                bar.inc(1);
                Ok(())
            },
        )?;
        bar.finish_and_clear();
        Ok(lines)
    }

    /// File of a part.
    fn file(&self, part: Part) -> PathBuf {
        if part == Part::WHOLE {
            return self.path.to_owned();
        }
        self.path.with_extension(format!("{}-of-{}.jsonl", part.number, part.of))
    }

    /// Runs in the files of parts, by number; none if a part is made itself.
    fn of_parts<L: DeserializeOwned>(&self, check: impl Fn(&L) -> Result<()>) -> Result<BTreeMap<u64, L>> {
        let mut known = BTreeMap::new();
        let (Some(folder), Some(stem)) = (self.path.parent(), self.path.file_stem().and_then(|s| s.to_str())) else {
            return Ok(known);
        };
        if self.part != Part::WHOLE || !folder.exists() {
            return Ok(known);
        }
        let mut parts = Vec::new();
        for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            let middle = name.strip_prefix(&format!("{stem}.")).and_then(|rest| rest.strip_suffix(".jsonl"));
            let part = middle.and_then(|middle| middle.replace("-of-", "/").parse::<Part>().ok());
            parts.extend(part);
        }
        for part in parts {
            let lines = read(&self.file(part), &check)?;
            known.extend(lines.into_iter().enumerate().map(|(place, line)| (part.item(place) as u64, line)));
        }
        known.retain(|number, _| *number < self.count);
        Ok(known)
    }
}

/// Lines of a file; none if it does not exist.
fn read<L: DeserializeOwned>(path: &Path, check: impl Fn(&L) -> Result<()>) -> Result<Vec<L>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let shown = path.display();
    let text = std::fs::read_to_string(path).with_context(|| shown.to_string())?;
    let parse = |(i, line): (usize, &str)| {
        let parse = || {
            let line: L = serde_json::from_str(line)?;
            check(&line).map(|()| line)
        };
        parse().with_context(|| format!("{shown}: line {}", i + 1))
    };
    text.lines().enumerate().map(parse).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(path: &Path, part: Part) -> Runs<'_> {
        Runs { path, part, count: 11, name: "runs" }
    }

    #[test]
    fn parts_are_taken_over_in_order_and_only_missing_runs_are_made() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs.jsonl");
        let fine = |_: &u64| Ok(());
        let made = |part: &str| {
            let part: Part = part.parse().unwrap();
            runs(&path, part).complete(fine, |number, _| Ok(100 + number)).unwrap()
        };
        assert_eq!(made("2/3"), [101, 104, 107, 110]);
        assert_eq!(made("3/3"), [102, 105, 108]);
        // Only the runs of part 1 are made now; a result of its own tells them apart.
        let all = runs(&path, Part::WHOLE).complete(fine, |number, _| Ok(200 + number)).unwrap();
        assert_eq!(all, [200, 101, 102, 203, 104, 105, 206, 107, 108, 209, 110]);
        let again = runs(&path, Part::WHOLE).complete(fine, |number, _| Ok(300 + number)).unwrap();
        assert_eq!(again, all);
        std::fs::write(&path, "1\n".repeat(12)).unwrap();
        let error = runs(&path, Part::WHOLE).complete(fine, |number, _| Ok(number)).unwrap_err().to_string();
        assert!(error.contains("expected at most 11 lines, got 12"), "{error}");
    }
}
