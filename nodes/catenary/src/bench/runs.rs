//! Many inferences of one benchmark: on all cores, in order, kept in a file from which an interrupted benchmark resumes.

use crate::all_cores;
use crate::exit::{Given, Interrupted};
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
use std::fs::{File, OpenOptions};
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
        // A killed process may have left part of a line.
        file.set_len(whole_lines(&std::fs::read(&path)?).len() as u64)?;
        let known = Mutex::new(known);
        let taken = |number: u64| known.lock().unwrap_or_else(PoisonError::into_inner).remove(&number);
        let outcome = all_cores::in_order(
            made..count,
            |place| {
                let number = self.part.item(place as usize) as u64;
                taken(number).map_or_else(|| work(number, &shutdown), Ok)
            },
            |line| {
                append(&mut file, &serde_json::to_string(&line)?).with_context(|| path.display().to_string())?;
                lines.push(line);
                bar.inc(1);
                Ok(())
            },
        );
        bar.finish_and_clear();
        let done = || format!("{} of {count} {}", lines.len(), self.name);
        match outcome {
            Ok(()) => Ok(lines),
            Err(error) if error.is::<Interrupted>() && lines.is_empty() => Err(Interrupted::lost(done()).into()),
            Err(error) if error.is::<Interrupted>() => Err(Interrupted::kept(done(), path.display(), "").into()),
            Err(error) => Err(error),
        }
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

/// Appends a line. A write that fails, as on a full disk, leaves no part of it.
fn append(file: &mut File, line: &str) -> std::io::Result<()> {
    let before = file.metadata()?.len();
    file.write_all(format!("{line}\n").as_bytes()).inspect_err(|_| {
        // The first error is the one that counts.
        let _ = file.set_len(before);
    })
}

/// The lines of a file that are whole.
fn whole_lines(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
    &bytes[..end]
}

/// Whole lines of a file; none if it does not exist.
fn read<L: DeserializeOwned>(path: &Path, check: impl Fn(&L) -> Result<()>) -> Result<Vec<L>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let shown = path.display();
    let bytes = catenary_shell::files::read_bytes("runs", path).given()?;
    let text = std::str::from_utf8(whole_lines(&bytes)).with_context(|| shown.to_string()).given()?;
    let parse = |(i, line): (usize, &str)| {
        let parse = || {
            let line: L = serde_json::from_str(line)?;
            check(&line).map(|()| line)
        };
        parse().with_context(|| format!("{shown}: line {}", i + 1)).given()
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
        Err(InferenceError::Cancelled { .. }) => Err(Interrupted(format!(" in run {number}")).into()),
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
        // A killed process left part of a line, and an interrupted one says what is kept.
        std::fs::write(&path, "100\n101\n10").unwrap();
        let stop =
            |number: u64, _: &Shutdown| if number == 3 { Err(Interrupted(String::new()).into()) } else { Ok(number) };
        let error = runs(&path, "1/1".parse().unwrap()).complete(fine, stop).unwrap_err();
        let words = format!("interrupted after 3 of 11 runs; kept: {}; to go on: the same command", path.display());
        assert!(error.is::<Interrupted>() && error.to_string() == words, "{error}");
        assert!(std::fs::read_to_string(&path).unwrap().starts_with("100\n101\n"));
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 3);
        std::fs::write(&path, "1\n".repeat(12)).unwrap();
        let error = runs(&path, Part::WHOLE).complete(fine, |number, _| Ok(number)).unwrap_err().to_string();
        assert!(error.contains("expected at most 11 lines, got 12"), "{error}");
    }
}
