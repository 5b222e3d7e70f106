//! Whether posteriors are as often right as they say: truths from the prior, an episode of each, an inference of each.

mod page;

use super::hidden_episode;
use crate::cli::{CalibrationArgs, Preset};
use crate::interrupted::Interrupted;
use crate::wrong_input::Given;
use crate::{model_file, output, progress};
use anyhow::{Context, Result, ensure};
use bayes_sim::calibration::{Check, LEVELS, Summary, summaries};
use bayes_sim::sequential::Progress;
use bayes_sim::{InferenceError, Settings};
use catenary_core::spelling::did_you_mean;
use catenary_core::{Model, Parameter, ParameterSpace, seed};
use catenary_shell::Shutdown;
use indicatif::ProgressBar;
use page::page;
use serde::{Deserialize, Serialize};
use simulator_pool::{BeamSimulator, workers};
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::ops::{ControlFlow, Range};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::Instant;

/// Draws of a posterior that its truth is held against.
const DRAWS: usize = 2_000;
/// p value of all tests together below which posteriors count as miscalibrated.
const LEVEL: f64 = 0.05;

/// One line of checks.jsonl.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    truth: Vec<f64>,
    mean: Vec<f64>,
    sd: Vec<f64>,
    check: Check,
    wall_s: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    model: String,
    parameters: Vec<String>,
    truths: usize,
    wall_s_each: f64,
    checks: Vec<Summary>,
    verdict: String,
}

/// Runs what is left of the inferences, and sums all up.
pub fn run(arguments: &CalibrationArgs) -> Result<()> {
    let model = also(model_file::read_or_soft_bar(arguments.model.as_deref())?, &arguments.also)?;
    let settings = match arguments.preset {
        Preset::Default => Settings::default(),
        Preset::Paper => Settings::paper(),
    };
    let path = arguments.out.join("checks.jsonl");
    output::prepare(&path)?;
    output::prepare(&arguments.out.join("report.html"))?;
    let mut lines = read(&path, model.theta.dimension())?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let made = lines.len() as u64;
    let bar = ProgressBar::new(arguments.truths).with_position(made);
    let began = progress::share(made as f64, arguments.truths as f64);
    bar.set_style(progress::style("truths [{bar:24}] {pos}/{len}", began)?);
    let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
    let left = lines.len() as u64..arguments.truths;
    each(
        left,
        |number| one(&model, &settings, number, &shutdown),
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

/// The model with effects moved to theta, under their own distributions.
fn also(mut model: Model, names: &[String]) -> Result<Model> {
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

/// Lets no further number be taken once it is dropped.
struct Last<'a>(&'a AtomicU64, u64);

impl Drop for Last<'_> {
    fn drop(&mut self) {
        self.0.store(self.1, Ordering::Relaxed);
    }
}

/// Calls `work` for all `numbers`, on every core, and `keep` with what it returns, in order; the first error ends it.
fn each<T: Send>(
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
                // A worker that dies takes the others along.
                let _last = Last(next, end);
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= end || sender.send((number, work(number))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let _last = Last(&next, end);
        // What came before its turn.
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

/// Truth `number`: the model that makes the episode is the model that inference knows.
fn one(model: &Model, settings: &Settings, number: u64, shutdown: &Shutdown) -> Result<Line> {
    let truth = model.theta.sample_prior(&mut seed::rng(number, 2));
    let measured = hidden_episode(model, &truth, number, settings.fidelity)?;
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

/// Which checks say that too few truths are held, and which that too many are, each by where it is furthest off, at the level of all of
/// them together.
fn verdict(checks: &[Summary]) -> String {
    let p = |s: &Summary| (s.p_value * checks.len() as f64).min(1.0);
    let refuted = |is_few: bool| {
        let says = |s: &&Summary| p(s) < LEVEL && (furthest_off(s).1 < furthest_off(s).0) == is_few;
        let one = |s: &Summary| {
            let (nominal, held) = furthest_off(s);
            format!("{} ({:.0} % in {:.0} %, p = {:.1e})", s.name, 100.0 * held, 100.0 * nominal, p(s))
        };
        checks.iter().filter(says).map(one).collect::<Vec<_>>().join(", ")
    };
    let least = checks.iter().map(p).fold(1.0, f64::min);
    match (refuted(true).as_str(), refuted(false).as_str()) {
        ("", "") => {
            format!("calibrated: no check of {} refutes it (p = {least:.2}, corrected for their number)", checks.len())
        }
        (few, "") => format!("not calibrated: too few truths are held by {few}"),
        ("", many) => format!("not calibrated, and cautious: more truths are held than should be by {many}"),
        (few, many) => format!("not calibrated: too few truths are held by {few}; and more than should be by {many}"),
    }
}

/// A nominal share and the share of truths that it holds, where the two are furthest apart in standard deviations.
fn furthest_off(s: &Summary) -> (f64, f64) {
    let pairs = LEVELS.into_iter().zip(s.coverage);
    let off = |(nominal, held): &(f64, f64)| (held - nominal).abs() / (nominal * (1.0 - nominal)).sqrt();
    pairs.max_by(|a, b| off(a).total_cmp(&off(b))).expect("there are levels")
}

fn rows(report: &Report) -> Vec<Vec<String>> {
    let row = |s: &Summary| {
        let coverage = s.coverage.iter().map(|c| format!("{:.1} %", 100.0 * c));
        std::iter::once(s.name.clone()).chain(coverage).chain([format!("{:.3}", s.p_value)]).collect()
    };
    report.checks.iter().map(row).collect()
}

const HEAD: [&str; 6] = ["check", "50 %", "80 %", "90 %", "95 %", "p of uniformity"];

fn words(report: &Report) -> String {
    let line = |cells: Vec<String>| {
        cells
            .iter()
            .enumerate()
            .map(|(i, c)| format!("{c:<width$}", width = if i == 0 { 24 } else { 9 }))
            .collect::<String>()
    };
    let mut lines = vec![line(HEAD.map(str::to_owned).to_vec())];
    lines.extend(rows(report).into_iter().map(line));
    lines.push(format!("{} truths, {:.1} s each", report.truths, report.wall_s_each));
    lines.push(report.verdict.clone());
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_names_what_is_too_narrow_and_what_is_too_wide() {
        let check = |name: &str, p_value: f64, coverage: [f64; 4]| Summary {
            name: name.into(),
            values: Vec::new(),
            coverage,
            p_value,
        };
        let fine = check("fine", 0.5, [0.5, 0.8, 0.88, 0.95]);
        let few = check("few", 1e-4, [0.45, 0.75, 0.8, 0.93]);
        // Half of the truths should lie within, and two thirds do, while those without are as far off as they should be.
        let many = check("many", 1e-5, [0.67, 0.85, 0.89, 0.95]);
        let near = check("near", 0.03, [0.5, 0.8, 0.85, 0.95]);
        assert!(verdict(&[fine.clone(), near]).starts_with("calibrated: no check of 2 refutes it (p = 0.06"));
        assert_eq!(
            verdict(&[fine.clone(), few.clone()]),
            "not calibrated: too few truths are held by few (80 % in 90 %, p = 2.0e-4)"
        );
        let cautious =
            "not calibrated, and cautious: more truths are held than should be by many (67 % in 50 %, p = 2.0e-5)";
        assert_eq!(verdict(&[fine, many.clone()]), cautious);
        let both = verdict(&[few, many]);
        assert!(both.ends_with("; and more than should be by many (67 % in 50 %, p = 2.0e-5)"), "{both}");
    }

    #[test]
    fn work_on_all_cores_is_kept_in_order_up_to_the_first_error() {
        let slow_first = |number: u64| {
            std::thread::sleep(std::time::Duration::from_millis(if number.is_multiple_of(3) { 20 } else { 1 }));
            if number == 40 { anyhow::bail!("no {number}") } else { Ok(number) }
        };
        let mut kept = Vec::new();
        each(3..20, slow_first, |number| {
            kept.push(number);
            Ok(())
        })
        .unwrap();
        assert_eq!(kept, (3..20).collect::<Vec<_>>());
        kept.clear();
        let error = each(30..1_000_000, slow_first, |number| {
            kept.push(number);
            Ok(())
        });
        assert_eq!((error.unwrap_err().to_string(), kept), ("no 40".to_owned(), (30..40).collect()));
        assert!(each(0..10, slow_first, |_| anyhow::bail!("full")).is_err());
    }
}
