//! `catenary bench costs`: the cost of points against a recording, for optimisers and samplers outside of this program.

use super::args::CostsArgs;
use crate::exit::Given;
use crate::inputs::model_file;
use anyhow::{Context, Result, ensure};
use bayes_sim::Fitted;
use catenary_bag::read_measured;
use catenary_core::Fidelity;
use catenary_simulator::{BeamSimulator, workers};
use serde::{Deserialize, Serialize};
use std::io::{BufRead, Read, Write, stdin, stdout};
use std::path::Path;
use track_fit::data::{MeasuredEpisode, Unknowns, rmse_mm};
use track_fit::fitting::Problem;
use track_fit::noise::KeypointNoise;

/// Most bytes of a line of points. It bounds the memory that a caller can claim.
const LONGEST: u64 = 16 << 20;

/// First line of the output.
#[derive(Serialize)]
struct Head<'a> {
    /// Name of each coordinate; what the model draws for each episode has one for each episode.
    names: Vec<&'a str>,
    /// Number of coordinates that belong to parameters; they come first.
    parameters: usize,
    /// Number of measured coordinates: the cost of a right model is about as large.
    measured: usize,
}

/// Costs of the points of a line, and their distances from the recording.
#[derive(Serialize)]
struct Costs {
    /// Sum of squared residuals in variances of the noise, with those of Gaussian priors; none for a point that cannot be simulated.
    costs: Vec<Option<f64>>,
    /// Root mean square distance of keypoints, mm.
    rmse_mm: Vec<Option<f64>>,
}

/// Best fit of an `inference.json`.
#[derive(Deserialize)]
struct Inference {
    refinement: Option<Refinement>,
}

#[derive(Deserialize)]
struct Refinement {
    best_fit: Vec<Fitted>,
    is_corrected: bool,
    noise: Option<KeypointNoise>,
}

/// Reads a line of points in unit coordinates, a JSON array of arrays, and prints a line with their costs, until stdin ends.
pub fn run(arguments: &CostsArgs) -> Result<()> {
    let stated = model_file::read(&arguments.model)?;
    let known = arguments.corrected_at.as_deref().map(refinement).transpose()?;
    // Costs of one noise are not those of another.
    let model = match known.as_ref().and_then(|known| known.noise) {
        Some(noise) => noise.model(&stated),
        None => stated,
    };
    let measured = read_measured(arguments.bags.all(), &[], &model)?;
    let settings = track_fit::Settings { fidelity: Fidelity::Standard, ..track_fit::Settings::default() };
    let episodes = measured.iter().map(|m| MeasuredEpisode::new(&model, m, &settings)).collect::<Result<Vec<_>, _>>();
    let episodes = episodes.given()?;
    let simulator = BeamSimulator::new(&model, workers::available())?;
    let problem = Problem::of(&model, &episodes, &simulator, 1);
    let corrected = known.map(|known| corrected_at(&known, &problem)).transpose()?.flatten();
    let problem = Problem { episodes: corrected.as_deref().unwrap_or(&episodes), ..problem };
    let unknowns = &problem.unknowns;
    let name_of = |column: usize| unknowns.at(column).map_or("", |unknown| unknown.name.as_str());
    let head = Head {
        names: (0..unknowns.columns()).map(name_of).collect(),
        parameters: unknowns.theta(),
        measured: problem.channels().len(),
    };
    print(&head)?;
    let (mut input, mut line) = (stdin().lock(), Vec::new());
    loop {
        line.clear();
        input.by_ref().take(LONGEST + 1).read_until(b'\n', &mut line)?;
        if line.is_empty() {
            return Ok(());
        }
        ensure!(line.len() as u64 <= LONGEST, "stdin: expected lines of at most {LONGEST} bytes");
        let points: Vec<Vec<f64>> =
            serde_json::from_slice(&line).context("stdin: expected arrays of numbers").given()?;
        for point in &points {
            let (expected, got) = (unknowns.columns(), point.len());
            ensure!(expected == got, "stdin: expected {expected} coordinates a point, got {got}");
        }
        print(&answer(&problem, &points, &model.camera.view))?;
    }
}

/// Refinement of an inference.
fn refinement(path: &Path) -> Result<Refinement> {
    let name = path.display();
    let bytes = catenary_shell::files::read_bytes("inference", path).given()?;
    let inference: Inference = serde_json::from_slice(&bytes).with_context(|| name.to_string()).given()?;
    inference.refinement.with_context(|| format!("{name}: refinement: expected one")).given()
}

/// Episodes with the correction of an inference's best fit; none if it has none.
fn corrected_at(refinement: &Refinement, problem: &Problem<'_>) -> Result<Option<Vec<MeasuredEpisode>>> {
    let point = point_of(&problem.unknowns, problem.episodes.len(), &refinement.best_fit)
        .context("--corrected-at: refinement.best_fit")
        .given()?;
    Ok(refinement.is_corrected.then(|| problem.corrected_episodes(&point, Fidelity::Reference)).transpose()?)
}

/// Costs and distances of the points.
fn answer(problem: &Problem<'_>, points: &[Vec<f64>], camera: &catenary_core::Camera) -> Costs {
    let costs = problem.costs(points, &problem.measured());
    let distance = |tracks: Vec<catenary_core::Track>| {
        let pairs = problem.episodes.iter().zip(&tracks);
        rmse_mm(pairs.flat_map(|(e, track)| e.offsets_mm(track, camera)).collect::<Vec<_>>().iter())
    };
    let finite = |value: f64| value.is_finite().then_some(value);
    Costs {
        costs: costs.into_iter().map(finite).collect(),
        // A batch for a picture of the result is small; a sampler's batches need their costs alone.
        rmse_mm: match points.len() {
            1 => problem.tracks_each(points).into_iter().map(|t| finite(distance(t.ok()?))).collect(),
            _ => Vec::new(),
        },
    }
}

/// Unit coordinates of a best fit.
fn point_of(unknowns: &Unknowns, episodes: usize, fitted: &[Fitted]) -> Result<Vec<f64>> {
    let mut point = vec![f64::NAN; unknowns.columns()];
    for (i, unknown) in unknowns.list().iter().enumerate() {
        for episode in 0..episodes {
            let is_own = |f: &&Fitted| f.name == unknown.name && f.episode.is_none_or(|own| own == episode + 1);
            let value = fitted.iter().find(is_own).with_context(|| format!("{}: expected a value", unknown.name))?;
            point[unknowns.column(i, episode)] = unknown.prior.to_unit(value.value);
        }
    }
    Ok(point)
}

/// Prints a line of JSON at once.
fn print(line: &impl Serialize) -> Result<()> {
    let mut out = stdout().lock();
    writeln!(out, "{}", serde_json::to_string(line)?)?;
    Ok(out.flush()?)
}
