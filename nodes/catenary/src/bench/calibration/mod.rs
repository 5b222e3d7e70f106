//! Calibration of posteriors: parameters drawn from the prior, one simulated episode and one inference for each
//! (simulation-based calibration, Talts et al. 2018).

mod page;
mod report;

use super::args::CalibrationArgs;
use super::episodes::hidden_episode;
use super::runs::{Inferred, Runs, infer_on_one_core};
use crate::exit::Given;
use crate::inputs::model_file;
use crate::options::Part;
use crate::terminal::output;
use anyhow::{Context, Result, ensure};
use bayes_sim::calibration::{Check, summaries};
use bayes_sim::{InferenceError, Settings};
use catenary_core::mixture::MixtureError;
use catenary_core::posterior::Marginal;
use catenary_core::spelling::did_you_mean;
use catenary_core::statistics::mean;
use catenary_core::{Model, Parameter, ParameterSpace, Posterior, seed};
use catenary_shell::Shutdown;
use page::page;
use report::{Report, verdict, words};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Instant;

/// Posterior draws that each truth is ranked against.
const DRAWS: usize = 2_000;

/// One line of checks.jsonl: a truth and its inference.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    truth: Vec<f64>,
    mean: Vec<f64>,
    sd: Vec<f64>,
    #[serde(flatten)]
    calibration: Calibration,
    /// Figures before the widening of the intervals.
    narrow: Calibration,
    wall_s: f64,
}

/// Figures of one posterior.
#[derive(Debug, Serialize, Deserialize)]
struct Calibration {
    check: Check,
    /// Width of each 90 % interval (D) as a share of the prior.
    width: Vec<f64>,
}

impl Calibration {
    fn new(posterior: &Posterior, truth: &[f64], seed: u64) -> Result<Self, MixtureError> {
        let parameters = posterior.parameters.parameters();
        let width = |(m, p): (Marginal, &Parameter)| p.prior.to_unit(m.q95) - p.prior.to_unit(m.q05);
        Ok(Self {
            check: Check::new(posterior, truth, DRAWS, seed)?,
            width: posterior.marginals()?.into_iter().zip(parameters).map(width).collect(),
        })
    }
}

/// Answer about a part.
#[derive(Debug, Serialize)]
struct PartDone {
    out: PathBuf,
    part: String,
    truths: usize,
}

/// Runs the inferences that checks.jsonl does not hold yet, then writes the report.
pub fn run(arguments: &CalibrationArgs) -> Result<()> {
    let model = with_inferred_effects(model_file::read_or_soft_bar(arguments.model.as_deref())?, &arguments.also)?;
    let settings = arguments.preset.settings();
    output::prepare(&arguments.out.join("report.html"))?;
    let dimension = model.theta.dimension();
    let of_this_model = |line: &Line| {
        let got = line.truth.len();
        ensure!(got == dimension, "expected {dimension} parameters, got {got}: is it of another model?");
        Ok(())
    };
    let path = arguments.out.join("checks.jsonl");
    let part = arguments.part.unwrap_or(Part::WHOLE);
    let runs = Runs { path: &path, part, count: arguments.truths, name: "truths" };
    let lines = runs.complete(of_this_model, |number, shutdown| infer_truth(&model, &settings, number, shutdown))?;
    if arguments.part.is_some() {
        let said =
            PartDone { out: arguments.out.clone(), part: format!("{}/{}", part.number, part.of), truths: lines.len() };
        return output::result(&arguments.output, &said, |said| {
            format!("part {} is done in {}: {} truths", said.part, said.out.display(), said.truths)
        });
    }
    let report = report(&model, &lines);
    catenary_shell::files::write(&arguments.out.join("report.html"), page(&report))?;
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

/// Infers truth `number`. Simulator and inference share one model, so that a deviation is due to the inference alone.
fn infer_truth(model: &Model, settings: &Settings, number: u64, shutdown: &Shutdown) -> Result<Line> {
    // A seed per truth, so that a resumed run draws the same truths.
    let truth = model.theta.sample_prior(&mut seed::rng(number, 2));
    let measured = hidden_episode(model, &truth, number, settings.fidelity)?;
    let settings = Settings { seed: number, ..settings.clone() };
    let started = Instant::now();
    let Inferred { result, narrow } = infer_on_one_core(model, measured, &settings, number, shutdown)?;
    let iteration = result.iterations.len();
    let figures = |posterior: &Posterior| {
        let figures = Calibration::new(posterior, &truth, number);
        figures.map_err(|reason| InferenceError::Posterior { iteration, reason })
    };
    let (calibration, narrow) = (figures(&result.posterior)?, figures(&narrow)?);
    let of = |value: fn(&Marginal) -> f64| result.marginals.iter().map(value).collect();
    let (mean, sd) = (of(|m| m.mean), of(|m| m.sd));
    Ok(Line { mean, sd, calibration, narrow, wall_s: started.elapsed().as_secs_f64(), truth })
}

fn report(model: &Model, lines: &[Line]) -> Report {
    let parameters: Vec<String> = model.theta.parameters().iter().map(|p| p.name.clone()).collect();
    let names: Vec<&str> = parameters.iter().map(String::as_str).collect();
    let of = |figures: fn(&Line) -> &Calibration| {
        let checks: Vec<Check> = lines.iter().map(|l| figures(l).check.clone()).collect();
        let width = |i: usize| mean(&lines.iter().map(|l| figures(l).width[i]).collect::<Vec<_>>());
        (summaries(&names, &checks), (0..names.len()).map(width).collect())
    };
    let ((checks, widths), (narrow_checks, narrow_widths)) = (of(|l| &l.calibration), of(|l| &l.narrow));
    let verdict = verdict(&checks);
    let wall_s_each = lines.iter().map(|l| l.wall_s).sum::<f64>() / lines.len().max(1) as f64;
    Report {
        model: model.name.clone(),
        truths: lines.len(),
        wall_s_each,
        checks,
        widths,
        narrow_checks,
        narrow_widths,
        verdict,
        parameters,
    }
}
