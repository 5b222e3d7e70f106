//! Inference in this process, with a progress bar and a resumable state.

use super::args::InferArgs;
use super::page::{Contents, page};
use super::predicted::{self, Predicted};
use super::words::{iteration_words, marginal_words, predictive_words, refinement_words, time_words, widening_words};
use crate::exit::{Interrupted, Misfit};
use crate::inputs::policy_file;
use crate::inputs::posterior_file::PosteriorFile;
use crate::options::PriorSupportName;
use crate::report::RecordedFit;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use bayes_sim::fingerprint;
use bayes_sim::node::StateFile;
use bayes_sim::sequential::Progress;
use bayes_sim::{InferenceError, InferenceResult, Settings, Unseen};
use catenary_bag::read_measured;
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::Until;
use catenary_core::{Model, Policy, SimulationRequest, Simulator, SimulatorError, Track};
use catenary_shell::{Shutdown, files};
use catenary_simulator::{BeamSimulator, workers};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Files of a run: the posterior, the whole result, and the page.
const FILES: [&str; 3] = ["posterior.json", "inference.json", "report.html"];

/// Result in the form of `--json`.
#[derive(Debug, Serialize)]
struct Report {
    bags: Vec<PathBuf>,
    model: String,
    episodes: usize,
    frames: usize,
    duration_s: f64,
    wall_s: f64,
    /// Wall time of the simulations within it, including the posterior predictive check.
    simulation_s: f64,
    /// False if the posterior does not fit the recording; `misfit` has the reason.
    fits: bool,
    #[serde(flatten)]
    result: InferenceResult,
    /// Predictions of recordings that the inference has not seen.
    predictions: Vec<Predicted>,
}

/// Simulator that adds up the wall time of its calls.
struct Timed<'a> {
    simulator: &'a BeamSimulator,
    spent: Mutex<Duration>,
}

impl Timed<'_> {
    fn spent_s(&self) -> f64 {
        self.spent.lock().unwrap_or_else(PoisonError::into_inner).as_secs_f64()
    }
}

impl Simulator for Timed<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let started = Instant::now();
        let tracks = self.simulator.simulate(request);
        *self.spent.lock().unwrap_or_else(PoisonError::into_inner) += started.elapsed();
        tracks
    }

    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        let started = Instant::now();
        let tracks = self.simulator.simulate_until(request, until);
        *self.spent.lock().unwrap_or_else(PoisonError::into_inner) += started.elapsed();
        tracks
    }

    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        self.simulator.range_of(name)
    }
}

/// Result of an inference and the time of its simulations.
pub struct Inferred {
    /// Result of the inference.
    pub result: InferenceResult,
    /// Wall time of its simulations, s.
    pub simulation_s: f64,
}

/// Infers, and writes posterior.json, inference.json and report.html. Ctrl-C ends it, and the same command resumes it.
pub fn run(arguments: &InferArgs, model: &Model) -> Result<()> {
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let measured = read_measured(arguments.bags.all(), &arguments.episode, model)?;
    let policy = arguments.policy.as_deref().map(policy_file::read).transpose()?.map(|(policy, _)| policy);
    // Read and checked before the inference, too.
    let others = match arguments.predict.as_slice() {
        [] => Vec::new(),
        bags => read_measured(bags, &arguments.predict_episode, model)?,
    };
    let bags = predicted::bags(&arguments.predict, &others);
    let unseen = bags.iter().map(|(bag, other)| {
        let unseen = Unseen::new(model, other, &measured, policy.as_ref());
        unseen.with_context(|| format!("--predict {}", bag.display()))
    });
    let unseen = unseen.collect::<Result<Vec<_>>>()?;
    let mut settings = arguments.sizes.settings();
    settings.prior_support = arguments.prior_support.map_or(settings.prior_support, PriorSupportName::setting);
    settings.seed = arguments.seed;
    // Checked before the inference, which takes minutes.
    for name in FILES {
        output::prepare(&arguments.out.join(name))?;
    }
    let started = Instant::now();
    // A state file with another fingerprint is ignored.
    let asked = fingerprint(model, &measured, policy.as_ref(), &settings);
    let file = StateFile::new(arguments.out.join("state.json"), asked);
    let Inferred { result, simulation_s } =
        infer(model, &measured, policy.as_ref(), &settings, Some(&file), &shutdown)?;
    let predictions = predicted::all(bags, &unseen, model, (&result, &settings), (&shutdown, file.path()))?;
    let tracks = || measured.iter().map(|m| &m.track.frames);
    let report = Report {
        bags: arguments.bags.all().to_vec(),
        model: model.name.clone(),
        episodes: measured.len(),
        frames: tracks().map(Vec::len).sum(),
        duration_s: tracks().filter_map(|frames| frames.last()).map(|f| f.time_s).sum(),
        wall_s: started.elapsed().as_secs_f64(),
        simulation_s,
        fits: result.misfit.is_none(),
        result,
        predictions,
    };
    let fits = RecordedFit::at_medians(model, &measured, policy.as_ref(), &report.result.marginals);
    write(&arguments.out, &report, &fits)?;
    // Removed last: until then, a repeated command resumes instead of starting again.
    file.remove();
    output::result(&arguments.output, &report, |r| words(r, &arguments.out))?;
    Misfit::check(report.result.misfit.as_ref(), &arguments.out)
}

/// Infers in this process with a progress bar. With a state file, it resumes from there and updates the file after each
/// iteration.
pub fn infer(
    model: &Model,
    measured: &[MeasuredTrack],
    policy: Option<&Policy>,
    settings: &Settings,
    file: Option<&StateFile>,
    shutdown: &Shutdown,
) -> Result<Inferred> {
    let state = file.and_then(StateFile::read);
    let simulator = BeamSimulator::new(model, workers::available())?;
    let simulator = Timed { simulator: &simulator, spent: Mutex::default() };
    // Iterations of an earlier process count as done.
    let made = state.as_ref().map_or(0, |state| state.iterations().len());
    // A refinement takes about as long as half of the iterations.
    let of = settings.iterations as f64 * if settings.refine { 1.5 } else { 1.0 };
    let share = |iterations: f64| progress::share(iterations, of);
    let bar = progress::bar("inference", share(made as f64))?;
    if let (true, Some(file)) = (state.is_some(), file) {
        let (of, path) = (settings.iterations, file.path().display());
        output::tell(&format!("resumes after {made} of {of} iterations, from {path}"));
    }
    let mut kept = made;
    let result = bayes_sim::infer(model, measured, policy, settings, state, &simulator, &mut |progress| {
        match progress {
            Progress::Working { simulations, .. } => bar.set_message(format!("{simulations} simulations")),
            Progress::Epoch { .. } => {}
            Progress::Refining { share: done, simulations } => {
                progress::advance(&bar, share(settings.iterations as f64 * (1.0 + 0.5 * done)));
                bar.set_message(format!("refines the posterior, {simulations} simulations"));
            }
            Progress::Iteration { iteration, state, .. } => {
                file.iter().for_each(|file| file.write(state));
                kept = iteration.iteration;
                progress::advance(&bar, share(iteration.iteration as f64));
                let effective = iteration.effective_sample_size;
                bar.set_message(iteration_words(iteration.simulations, iteration.loss, effective));
            }
        }
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    match result {
        Err(InferenceError::Cancelled { simulations }) => {
            let done = format!("{simulations} simulations");
            let file = file.filter(|file| kept > 0 && file.path().exists());
            Err(match file {
                Some(file) => {
                    let iterations = format!("{kept} of {} iterations", settings.iterations);
                    Interrupted::kept(done, format!("{} ({iterations})", file.path().display()), "")
                }
                None => Interrupted::lost(done),
            }
            .into())
        }
        other => Ok(Inferred { result: other?, simulation_s: simulator.spent_s() }),
    }
}

fn write(folder: &Path, report: &Report, fits: &[RecordedFit]) -> Result<()> {
    let posterior = PosteriorFile::new(&report.result.posterior, report.result.support_moves()).text()?;
    for (name, text) in FILES.into_iter().zip([posterior, serde_json::to_string_pretty(report)?, html(report, fits)?]) {
        files::write(&folder.join(name), text)?;
    }
    Ok(())
}

fn html(report: &Report, fits: &[RecordedFit]) -> Result<String> {
    let result = &report.result;
    let episodes =
        if report.episodes == 1 { "one episode".to_owned() } else { format!("{} episodes", report.episodes) };
    page(&Contents {
        model: &report.model,
        bags: &report.bags,
        size: format!(": {episodes}, {} frames in {:.2} s", report.frames, report.duration_s),
        posterior: &result.posterior,
        marginals: &result.marginals,
        predictive: result.predictive.as_ref().ok_or("The posterior predictive check could not be made."),
        misfit: result.misfit.as_deref(),
        warnings: &result.warnings,
        losses: result.losses(),
        simulations: result.simulations(),
        refinement: result.refinement.as_ref(),
        fits,
        predicted: &report.predictions,
    })
}

fn words(report: &Report, folder: &Path) -> String {
    let mut lines: Vec<String> = report.result.misfit.iter().map(|reason| Misfit::headline(reason)).collect();
    lines.extend(marginal_words(&report.result.marginals));
    lines.push(match &report.result.refinement {
        Some(refinement) => refinement_words(refinement, &report.result.marginals),
        None => widening_words(&report.result.widening, &report.result.marginals),
    });
    lines.extend(report.result.predictive.as_ref().map(predictive_words));
    lines.extend(report.result.warnings.iter().map(|w| format!("warning: {w}")));
    lines.extend(report.predictions.iter().flat_map(Predicted::lines));
    let refined = report.result.refinement.as_ref().map_or(0, |refinement| refinement.simulations);
    lines.push(time_words(report.result.simulations() + refined, report.wall_s, report.simulation_s));
    lines.push(format!("report: {}", folder.join("report.html").display()));
    lines.join("\n")
}
