//! `catenary train-tracker`: weights of the trackers by a network.

pub mod args;
mod evaluation;
mod rollouts;

use crate::exit::{Given, Interrupted, WrongInput};
use crate::inputs::model_file;
use crate::kept::Kept;
use crate::terminal::{output, progress, training};
use anyhow::{Context, Result};
use args::{Network, Preset, TrainTrackerArgs};
use catenary_core::{Model, identity};
use catenary_shell::Shutdown;
use evaluation::{Errors, Places, errors, places};
use keypoint_tracker::learned::{
    LearnedTracker, NetworkKind, Stopped, TrainingSettings, Weights, bytes_of, shipped_weights, train, weights_of,
};
use keypoint_tracker::{Error, GeometricTracker, TrackerParams};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Version of the training method. A change of it invalidates saved states.
const METHOD: u32 = 1;
/// Episodes on which the trained tracker is measured, and the first of them: far beyond those of the training.
const TEST_ROLLOUTS: u32 = 20;
const FIRST_TEST: u64 = 1 << 40;

impl Network {
    fn kind(self) -> NetworkKind {
        match self {
            Self::Transporter => NetworkKind::Transporter,
            Self::Ordered => NetworkKind::Ordered,
        }
    }
}

impl Preset {
    /// Number of episodes, and sizes of the training.
    fn sizes(self, network: Network) -> (u32, TrainingSettings) {
        let usual = TrainingSettings { steps: 5000, batch: 32, rate: 2e-3, threads: 1, seed: 1 };
        match (self, network) {
            (Self::Cpu, Network::Ordered) => (400, usual),
            (Self::Cpu, Network::Transporter) => {
                (400, TrainingSettings { steps: 3000, batch: 16, rate: 1e-3, ..usual })
            }
            // 50 x 24,000 pairs in batches of 32.
            (Self::Paper, _) => (1500, TrainingSettings { steps: 37_500, rate: 1e-3, ..usual }),
        }
    }
}

/// Result of a training.
#[derive(Debug, Serialize)]
struct Trained {
    weights: PathBuf,
    rollouts: u32,
    steps: usize,
    /// Mean loss of the last tenth of the steps.
    loss: f64,
    wall_s: f64,
    #[serde(flatten)]
    measured: Measured,
}

/// Tracker on episodes that were not trained on.
#[derive(Debug, Serialize)]
struct Measured {
    /// Places of the keypoints along objects that were not trained on.
    places: Places,
    /// Errors at fixed fractions, of the ordered tracker and of geometry.
    ordered: Option<Compared>,
}

/// Errors of a trained tracker beside those of geometry.
#[derive(Debug, Serialize)]
struct Compared {
    clean: [Errors; 2],
    covered: [Errors; 2],
}

/// Trains a tracker, or measures one. Ctrl-C ends a training, and keeps the state from which `--resume` goes on.
pub fn run(arguments: &TrainTrackerArgs) -> Result<()> {
    let kind = arguments.tracker.kind();
    let model = model_file::read(&arguments.model)?;
    let Some(out) = &arguments.out else {
        let weights = match arguments.measure.as_ref().and_then(Option::as_ref) {
            None => shipped_weights(kind),
            Some(path) => {
                let bytes = catenary_shell::files::read_bytes("weights", path).given()?;
                weights_of(kind, &bytes).with_context(|| path.display().to_string()).given()?
            }
        };
        let measured = measure(kind, &model, arguments.seed, weights)?;
        return output::result(&arguments.output, &measured, |m| words_of(m).join("\n"));
    };
    let began = Instant::now();
    if (arguments.preset, arguments.tracker) == (Preset::Paper, Network::Ordered) {
        return Err(WrongInput::error(
            "--preset paper: expected with --tracker transporter: the paper has no ordered one",
        ));
    }
    let (number, usual) = arguments.preset.sizes(arguments.tracker);
    let number = arguments.rollouts.unwrap_or(number);
    let steps = arguments.steps.map_or(usual.steps, |s| s as usize);
    let threads = arguments.threads.map_or_else(catenary_simulator::workers::available, |t| t as usize);
    let settings = TrainingSettings { steps, threads, seed: arguments.seed, ..usual };
    output::prepare(out)?;
    // The number of threads changes no bit.
    let sizes = format!("{kind:?}, {number} episodes, {:?}", TrainingSettings { threads: 0, ..settings });
    let program = (env!("CARGO_PKG_VERSION"), METHOD, catenary_simulator::fingerprint(&model));
    let asked = (program, model.to_yaml()?, sizes);
    let kept = Kept::beside(out, identity::fingerprint(&asked));
    let begun = training::begun(arguments.resume, &kept, steps)?.map(|begun| *begun);
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let bar = progress::bar("simulation", 0.0)?;
    let mut done = 0;
    let simulated = rollouts::rollouts(&model, arguments.seed, 0, number, |n| {
        done = n;
        progress::advance(&bar, progress::share(f64::from(n), f64::from(number)));
        !shutdown.is_triggered()
    })
    .with_context(|| format!("model `{}`", model.name))
    .given()?
    .ok_or_else(|| {
        let done = format!("{done} of {number} episodes");
        // The state that was to be resumed stays.
        if arguments.resume {
            Interrupted::kept(done, kept.path().display(), "--resume")
        } else {
            Interrupted::lost(done)
        }
    })?;
    bar.finish_and_clear();
    let (weights, loss) =
        training::watch(steps, &kept, &shutdown, |tell| match train(kind, &settings, &simulated, begun, tell) {
            Err(Error::Training(Stopped::Interrupted(begun))) => Ok(Err(begun)),
            other => other.given().map(Ok),
        })?;
    catenary_shell::files::write(out, bytes_of(&weights))?;
    kept.remove();
    let measured = measure(kind, &model, arguments.seed, weights)?;
    let wall_s = began.elapsed().as_secs_f64();
    let result = Trained { weights: out.clone(), rollouts: number, steps, loss, wall_s, measured };
    output::result(&arguments.output, &result, words)
}

/// Measures a tracker with these weights on episodes that no training sees. Those of one seed and model are the same for all weights.
fn measure(kind: NetworkKind, model: &Model, seed: u64, weights: Weights) -> Result<Measured> {
    let unseen = rollouts::rollouts(model, seed, FIRST_TEST, TEST_ROLLOUTS, |_| true)?.unwrap_or_default();
    // Every mask counts: a score must not hide errors here.
    let params = TrackerParams { min_score: 0.0, ..TrackerParams::default() };
    let mut tracker = LearnedTracker::new(kind, params, weights)?;
    let ordered = match kind {
        NetworkKind::Transporter => None,
        NetworkKind::Ordered => {
            let mut geometry = GeometricTracker::new(params)?;
            let mut both = |covered| -> Result<[Errors; 2]> {
                Ok([errors(&mut tracker, &unseen, covered)?, errors(&mut geometry, &unseen, covered)?])
            };
            Some(Compared { clean: both(false)?, covered: both(true)? })
        }
    };
    Ok(Measured { places: places(&mut tracker, &unseen)?, ordered })
}

/// Text for the terminal.
fn words(t: &Trained) -> String {
    let mut lines =
        vec![format!("{} episodes and {} steps in {:.0} s, loss {:.3}", t.rollouts, t.steps, t.wall_s, t.loss)];
    lines.extend(words_of(&t.measured));
    lines.push(format!("weights: {}", t.weights.display()));
    lines.push("use: parameters `tracker` and `weights` of the node keypoint_tracker".to_owned());
    if t.measured.ordered.is_none() {
        lines.push(
            "and `keypoint_fractions` of the model: the fractions above, where inference compares keypoints".to_owned(),
        );
    }
    lines.join("\n")
}

/// Lines about a tracker.
fn words_of(measured: &Measured) -> Vec<String> {
    let mut lines = Vec::new();
    let p = &measured.places;
    let spread: Vec<String> = (0..4).map(|k| format!("{:.3} +- {:.3}", p.fractions[k], p.deviations[k])).collect();
    lines.push(format!("on {TEST_ROLLOUTS} other episodes:"));
    lines.push(format!("  keypoints at these fractions of the length: {}", spread.join(", ")));
    lines.push(format!(
        "  flicker {:.3} of the length from frame to frame; another order in {:.1} % of the frames; {:.3} of the length from the centre line; not found {:.1} %",
        p.flicker,
        100.0 * p.permuted,
        p.distance_lengths,
        100.0 * p.failures
    ));
    if let Some(compared) = &measured.ordered {
        for (name, [ours, geometry]) in [("whole objects", &compared.clean), ("behind a cover", &compared.covered)] {
            let of = |e: &Errors| {
                format!(
                    "median error {:.3} of the length, wrong {:.1} %, reversed {:.1} %",
                    e.median_lengths,
                    100.0 * e.failures,
                    100.0 * e.reversed
                )
            };
            lines.push(format!("  {name}: {}; by geometry: {}", of(ours), of(geometry)));
        }
    }
    lines
}
