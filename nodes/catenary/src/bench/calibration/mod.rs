//! Calibration of posteriors: parameters drawn from the prior, one simulated episode and one inference for each
//! (simulation-based calibration, Talts et al. 2018).

mod page;
mod report;

use super::args::CalibrationArgs;
use super::episodes::hidden_episode;
use crate::exit::{Given, Interrupted};
use crate::inputs::model_file;
use crate::terminal::{output, progress};
use anyhow::{Context, Result, ensure};
use bayes_sim::calibration::{Check, summaries};
use bayes_sim::sequential::Progress;
use bayes_sim::{InferenceError, Settings};
use catenary_core::spelling::did_you_mean;
use catenary_core::{Model, Parameter, ParameterSpace, seed};
use catenary_shell::Shutdown;
use catenary_simulator::{BeamSimulator, workers};
use indicatif::ProgressBar;
use page::page;
use report::{Report, verdict, words};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::ops::{ControlFlow, Range};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::Instant;

/// Posterior draws that each truth is ranked against.
const DRAWS: usize = 2_000;

/// One line of checks.jsonl: a truth and its inference.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    truth: Vec<f64>,
    mean: Vec<f64>,
    sd: Vec<f64>,
    check: Check,
    wall_s: f64,
}

/// Runs the inferences that checks.jsonl does not hold yet, then writes the report.
pub fn run(arguments: &CalibrationArgs) -> Result<()> {
    let model = with_inferred_effects(model_file::read_or_soft_bar(arguments.model.as_deref())?, &arguments.also)?;
    let settings = arguments.preset.inference();
    let path = arguments.out.join("checks.jsonl");
    // Both files are checked before the first inference: a run takes hours.
    output::prepare(&path)?;
    output::prepare(&arguments.out.join("report.html"))?;
    let mut lines = read(&path, model.theta.dimension())?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let made = lines.len() as u64;
    let bar = ProgressBar::new(arguments.truths).with_position(made);
    // The time left counts only the inferences of this run.
    let began = progress::share(made as f64, arguments.truths as f64);
    bar.set_style(progress::style("truths [{bar:24}] {pos}/{len}", began)?);
    // Each line is appended as soon as it is known: an interrupted run loses one inference.
    let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
    let left = lines.len() as u64..arguments.truths;
    in_order_on_all_cores(
        left,
        |number| infer_truth(&model, &settings, number, &shutdown),
        |line| {
            writeln!(file, "{}", serde_json::to_string(&line)?).with_context(|| path.display().to_string())?;
            lines.push(line);
            bar.inc(1);
            Ok(())
        },
    )?;
    bar.finish_and_clear();
    let report = report(&model, &lines);
    std::fs::write(arguments.out.join("report.html"), page(&report))?;
    output::result(&arguments.output, &report, words)
}

/// Returns the model with the named effects moved to theta. Each keeps its own distribution, as its prior.
fn with_inferred_effects(mut model: Model, names: &[String]) -> Result<Model> {
    let mut parameters = model.theta.parameters().to_vec();
    for name in names {
        let place = model.effects.iter().position(|e| e.name == *name).with_context(|| {
            let known: Vec<&str> = model.effects.iter().map(|e| e.name.as_str()).collect();
            let hint = did_you_mean(name, known.iter().copied());
            format!("--also {name}: expected one of the model's effects, {}{hint}", known.join(", "))
        });
        let place = place.given()?;
        parameters.push(Parameter { name: name.clone(), prior: model.effects.remove(place).distribution });
    }
    model.theta = ParameterSpace::new(parameters)?;
    Ok(model)
}

fn read(path: &Path, dimension: usize) -> Result<Vec<Line>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let parse = |(i, line): (usize, &str)| {
        let line: Line = serde_json::from_str(line).with_context(|| format!("{}: line {}", path.display(), i + 1))?;
        ensure!(
            line.truth.len() == dimension,
            "{}: line {}: expected {dimension} parameters, got {}: is it of another model?",
            path.display(),
            i + 1,
            line.truth.len()
        );
        Ok(line)
    };
    text.lines().enumerate().map(parse).collect()
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

/// Infers truth `number`. Simulator and inference share one model, so that a deviation is due to the inference alone.
fn infer_truth(model: &Model, settings: &Settings, number: u64, shutdown: &Shutdown) -> Result<Line> {
    // A seed per truth, so that a resumed run draws the same truths.
    let truth = model.theta.sample_prior(&mut seed::rng(number, 2));
    let measured = hidden_episode(model, &truth, number, settings.fidelity)?;
    // The predictive check costs simulations and is no part of the calibration.
    let settings = Settings { seed: number, predictive_draws: 0, ..settings.clone() };
    let started = Instant::now();
    let simulator = BeamSimulator::new(model, 1)?;
    let mut listen = |_: &Progress<'_>| match shutdown.is_triggered() {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    };
    let result = match bayes_sim::infer(model, &[measured], None, &settings, None, &simulator, &mut listen) {
        Err(InferenceError::Cancelled { .. }) => return Err(Interrupted(format!(" after {number} truths")).into()),
        other => other?,
    };
    let iteration = result.iterations.len();
    let check = Check::new(&result.posterior, &truth, DRAWS, number)
        .map_err(|reason| InferenceError::Posterior { iteration, reason })?;
    let of = |value: fn(&catenary_core::posterior::Marginal) -> f64| result.marginals.iter().map(value).collect();
    Ok(Line { truth, mean: of(|m| m.mean), sd: of(|m| m.sd), check, wall_s: started.elapsed().as_secs_f64() })
}

fn report(model: &Model, lines: &[Line]) -> Report {
    let parameters: Vec<String> = model.theta.parameters().iter().map(|p| p.name.clone()).collect();
    let names: Vec<&str> = parameters.iter().map(String::as_str).collect();
    let checks: Vec<Check> = lines.iter().map(|l| l.check.clone()).collect();
    let checks = summaries(&names, &checks);
    let verdict = verdict(&checks);
    let wall_s_each = lines.iter().map(|l| l.wall_s).sum::<f64>() / lines.len().max(1) as f64;
    Report { model: model.name.clone(), parameters, truths: lines.len(), wall_s_each, checks, verdict }
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
