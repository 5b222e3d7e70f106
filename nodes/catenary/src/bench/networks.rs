//! `catenary bench networks`: comparison of set and list embeddings, and of large and small networks, on one set of
//! tracks. Each network is trained once on tracks of the prior. It is then tested on held-out tracks, unchanged and
//! with shuffled, lost, doubled or noisy keypoints.

use super::args::NetworksArgs;
use super::corruption::Corruption;
use super::episodes::batch;
use crate::exit::Interrupted;
use crate::inputs::model_file;
use crate::terminal::{output, progress};
use anyhow::{Result, bail, ensure};
use bayes_sim::Settings;
use bayes_sim::embedding::{Fourier, TrackInput};
use bayes_sim::network::{Ensemble, Outcome, Samples, Shape, Training, TrainingError};
use catenary_core::camera::MASK_SIZE_PX;
use catenary_core::statistics::median_high;
use catenary_core::{Fidelity, Model, SimulationRequest, Simulator, Track, seed};
use catenary_shell::Shutdown;
use catenary_simulator::{BeamSimulator, workers};
use indicatif::ProgressBar;
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Posterior draws that each truth is ranked against.
const DRAWS: usize = 400;
/// Tracks simulated between two checks for Ctrl-C.
const PART: usize = 64;
/// Width of the mask in pixels.
const MASK_PX: f64 = MASK_SIZE_PX as f64;

/// A network in the comparison.
struct Entrant {
    name: &'static str,
    /// True if the network embeds each frame's keypoints as a set, plus channels and principal components; false if it
    /// reads the plain list of coordinates in their given order.
    sees_sets: bool,
    /// Corruption of its training tracks.
    learns: Corruption,
    settings: Settings,
}

#[derive(Debug, Serialize)]
struct Report {
    model: String,
    /// Number of training tracks, without unusable ones.
    tracks: usize,
    truths: usize,
    unusable: usize,
    networks: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Row {
    name: &'static str,
    train_s: f64,
    epochs: usize,
    held_out_loss: f64,
    scores: Vec<Score>,
}

/// Accuracy of the posteriors under one corruption.
#[derive(Debug, Serialize)]
struct Score {
    corruption: Corruption,
    /// Mean log density at the truth in nat, in unit coordinates.
    log_density: f64,
    /// Median absolute error of the posterior mean by parameter, as a share of the prior.
    error: Vec<f64>,
    /// Median posterior standard deviation by parameter, as a share of the prior.
    sd: Vec<f64>,
    /// Share of the truths inside the 90 % region of highest density.
    region_90: f64,
}

fn entrants(with_paper: bool) -> Vec<Entrant> {
    let default = Settings::default;
    let mut cos_sin = default();
    cos_sin.embedding.fourier = Fourier::CosSin;
    // Cosine and sine double the features, so that half the frequencies give the same input size.
    cos_sin.embedding.frequencies /= 2;
    let (set, list, plain) = (true, false, Corruption::None);
    let entrant = |name, sees_sets, learns, settings| Entrant { name, sees_sets, learns, settings };
    let mut all = vec![
        entrant("default", set, plain, default()),
        entrant("default, cos-sin", set, plain, cos_sin),
        entrant("list of keypoints", list, plain, default()),
        entrant("list, learnt shuffled", list, Corruption::Shuffled, default()),
    ];
    if with_paper {
        let mut paper = Settings::paper();
        // Number of gradient steps is that of all its iterations: iteration i trains on the tracks of all iterations so
        // far.
        paper.schedule.max_epochs *= paper.iterations.div_ceil(2);
        paper.schedule.patience_epochs = paper.schedule.max_epochs;
        all.push(entrant("paper", set, plain, paper));
    }
    all
}

/// Trains and tests every network.
pub fn run(arguments: &NetworksArgs) -> Result<()> {
    let model = model_file::read_or_soft_bar(arguments.model.as_deref())?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let (tracks, truths) = (arguments.tracks as usize, arguments.truths as usize);
    let request = batch(&model, Fidelity::Standard, tracks + truths)?;
    if let Some(path) = &arguments.export {
        output::prepare_file("export", path)?;
    }
    let frames = request.frame_times_s.len();
    let simulated = simulate(&model, &request, &shutdown)?;
    let thetas = request.thetas.iter().map(|t| model.theta.to_unit(t));
    // The usable tracks only: inference refuses the others too.
    let usable = simulated.into_iter().zip(thetas).filter(|(track, _)| TrackInput::new(track, frames).is_ok());
    let (simulated, thetas): (Vec<Track>, Vec<Vec<f64>>) = usable.unzip();
    let unusable = tracks + truths - simulated.len();
    let tracks = tracks.min(simulated.len());
    let truths = simulated.len() - tracks;
    // Unusable tracks are taken from the test tracks, so that the training size is the requested one.
    ensure!(truths > 0, "model {}: expected more than {tracks} usable tracks, {unusable} are not", model.name);
    let (learnt, shown) = simulated.split_at(tracks);
    if let Some(path) = &arguments.export {
        export(path, &model, (learnt, &thetas[..tracks]), (shown, &thetas[tracks..]))?;
    }
    let mut report = Report { model: model.name.clone(), tracks, truths, unusable, networks: Vec::new() };
    for entrant in entrants(arguments.paper) {
        // Every network sees one corruption, so that their scores differ by the network alone.
        let mut rng = seed::rng(11, 0);
        let learnt: Vec<Track> = learnt.iter().map(|t| entrant.learns.apply(t, MASK_PX, &mut rng)).collect();
        let samples = entrant.samples(&learnt, &thetas[..tracks], frames)?;
        let started = Instant::now();
        let (ensemble, outcome) = entrant.train(&samples, &shutdown)?;
        let train_s = started.elapsed().as_secs_f64();
        let scores = Corruption::ALL
            .map(|c| match shutdown.is_triggered() {
                true => bail!(Interrupted::lost(format!("a part: {} was shown tracks", entrant.name))),
                false => entrant.score(&ensemble, shown, &thetas[tracks..], frames, c),
            })
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
        let Outcome { epochs, held_out_loss } = outcome;
        tracing::info!("{}: {train_s:.1} s", entrant.name);
        report.networks.push(Row { name: entrant.name, train_s, epochs, held_out_loss, scores });
    }
    output::result(&arguments.output, &report, |report| words(report, &model))
}

fn simulate(model: &Model, request: &SimulationRequest, shutdown: &Shutdown) -> Result<Vec<Track>> {
    let simulator = BeamSimulator::new(model, workers::available())?;
    let bar = ProgressBar::new(request.thetas.len() as u64);
    bar.set_style(progress::style("tracks [{bar:24}] {pos}/{len}", 0.0)?);
    let mut tracks = Vec::with_capacity(request.thetas.len());
    for thetas in request.thetas.chunks(PART) {
        let part = SimulationRequest { thetas: thetas.to_vec(), first_episode: tracks.len() as u64, ..request.clone() };
        tracks.extend(simulator.simulate(&part)?);
        bar.set_position(tracks.len() as u64);
        if shutdown.is_triggered() {
            bail!(Interrupted::lost(format!("{} tracks", tracks.len())));
        }
    }
    bar.finish_and_clear();
    Ok(tracks)
}

/// Writes training and test tracks as lists of coordinates, for estimators of other projects.
fn export(path: &Path, model: &Model, learnt: Tracks<'_>, shown: Tracks<'_>) -> Result<()> {
    let rows = |tracks: &[Track]| tracks.iter().map(list).collect::<Vec<_>>();
    let document = serde_json::json!({
        "parameters": model.theta,
        "thetas": learnt.1,
        "rows": rows(learnt.0),
        "truths": shown.1,
        "observations": rows(shown.0),
    });
    catenary_shell::files::write(path, serde_json::to_string(&document)?)
}

/// Tracks and their thetas in unit coordinates.
type Tracks<'a> = (&'a [Track], &'a [Vec<f64>]);

/// Keypoints of all frames as one list, x before y.
fn list(track: &Track) -> Vec<f32> {
    track.frames.iter().flat_map(|f| f.dlo).flatten().map(|v| v as f32).collect()
}

impl Entrant {
    /// Samples of this network from tracks and their thetas (unit coordinates).
    fn samples(&self, tracks: &[Track], thetas: &[Vec<f64>], frames: usize) -> Result<Samples> {
        let dimension = thetas.first().map_or(0, Vec::len);
        if self.sees_sets {
            let mut samples = Samples::new(frames, dimension);
            for (track, theta) in tracks.iter().zip(thetas) {
                samples.push(&TrackInput::new(track, frames)?, theta);
            }
            return Ok(samples);
        }
        let mut rows = Vec::new();
        for track in tracks {
            // Rows of one length: a track that ended early is padded with zeros.
            let mut row = list(track);
            row.resize(8 * frames, 0.0);
            rows.extend(row);
        }
        Ok(Samples::of_rows(rows, 8 * frames, thetas.concat(), dimension))
    }

    fn train(&self, samples: &Samples, shutdown: &Shutdown) -> Result<(Ensemble, Outcome)> {
        let (n, settings) = (samples.len(), &self.settings);
        let shape = Shape::of_samples(samples, settings);
        let (weights, split_keys) = (vec![1.0; n], (0..n).collect::<Vec<_>>());
        let training =
            Training { data: samples, weights: &weights, split_keys: &split_keys, seed: 1, held_out_seed: 2 };
        let most = (settings.ensemble * settings.schedule.max_epochs) as u64;
        let bar = ProgressBar::new(most);
        bar.set_style(progress::style(&format!("{} [{{bar:20}}]", self.name), 0.0)?);
        let trained = Ensemble::train(&shape, settings, None, training, &mut |_, epoch| {
            bar.inc(u64::from(epoch.is_some()));
            if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        match trained {
            Err(TrainingError::Stopped) => bail!(Interrupted::lost(format!("a part: {} learnt", self.name))),
            other => Ok(other?),
        }
    }

    fn score(
        &self,
        ensemble: &Ensemble,
        tracks: &[Track],
        thetas: &[Vec<f64>],
        frames: usize,
        corruption: Corruption,
    ) -> Result<Score> {
        let dimension = thetas.first().map_or(0, Vec::len);
        let (mut log_density, mut region_90) = (0.0, 0.0);
        let (mut errors, mut sds) = (vec![Vec::new(); dimension], vec![Vec::new(); dimension]);
        let share = 1.0 / tracks.len() as f64;
        for (number, (track, theta)) in tracks.iter().zip(thetas).enumerate() {
            // A stream per track: all networks see the same noise on it.
            let mut rng = seed::rng(12, number as u64);
            let seen = corruption.apply(track, MASK_PX, &mut rng);
            let batch = self.samples(&[seen], std::slice::from_ref(theta), frames)?;
            // The mixture is not truncated to the prior: a network may place the posterior of a gross error wholly
            // outside it.
            let mixture = ensemble.mixture(&batch)?;
            let draws: Vec<Vec<f64>> = (0..DRAWS).map(|_| mixture.sample(&mut rng)).collect();
            let density = mixture.log_density(theta);
            let denser = draws.iter().filter(|u| mixture.log_density(u) > density).count();
            log_density += share * density;
            region_90 += share * f64::from(u8::from((denser as f64) < 0.9 * DRAWS as f64));
            for i in 0..dimension {
                let mean = draws.iter().map(|u| u[i]).sum::<f64>() / DRAWS as f64;
                let variance = draws.iter().map(|u| (u[i] - mean).powi(2)).sum::<f64>() / DRAWS as f64;
                errors[i].push((mean - theta[i]).abs());
                sds[i].push(variance.sqrt());
            }
        }
        let medians = |lists: Vec<Vec<f64>>| {
            lists.into_iter().map(|mut list| median_high(&mut list).unwrap_or(f64::NAN)).collect()
        };
        Ok(Score { corruption, log_density, error: medians(errors), sd: medians(sds), region_90 })
    }
}

fn words(report: &Report, model: &Model) -> String {
    let Report { tracks, truths, unusable, .. } = report;
    let mut lines = vec![format!("{tracks} tracks learnt, {truths} truths shown, {unusable} unusable")];
    for row in &report.networks {
        lines.push(format!(
            "{}: {:.1} s, {} epochs, held-out loss {:.2} nat",
            row.name, row.train_s, row.epochs, row.held_out_loss
        ));
    }
    let names: Vec<&str> = model.theta.parameters().iter().map(|p| p.name.as_str()).collect();
    for row in &report.networks {
        lines.push(format!(
            "\n{}: mean log density at the truth; medians of error and sd of {} in % of the prior",
            row.name,
            names.join(", ")
        ));
        for s in &row.scores {
            let percent = |v: &[f64]| v.iter().map(|v| format!("{:5.2}", 100.0 * v)).collect::<Vec<_>>().join(" ");
            lines.push(format!(
                "  {:<16} {:7.2} nat   error {}   sd {}   90 % regions hold {:3.0} %",
                s.corruption.to_string(),
                s.log_density,
                percent(&s.error),
                percent(&s.sd),
                100.0 * s.region_90
            ));
        }
    }
    lines.join("\n")
}
