//! `catenary train-tracker`: weights of the trackers by a network.

pub mod args;
mod evaluation;
mod rollouts;

use crate::exit::{Given, Interrupted, WrongInput};
use crate::inputs::model_file;
use crate::terminal::{output, progress, training};
use anyhow::{Context, Result};
use args::{Network, Preset, TrainTrackerArgs};
use catenary_shell::Shutdown;
use evaluation::{Errors, Places, errors, places};
use keypoint_tracker::learned::{LearnedTracker, NetworkKind, Stopped, TrainingSettings, bytes_of, train};
use keypoint_tracker::{Error, GeometricTracker, TrackerParams};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

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
        let usual = TrainingSettings { steps: 2500, batch: 32, rate: 2e-3, threads: 1, seed: 1 };
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

/// Result of the command.
#[derive(Debug, Serialize)]
struct Trained {
    weights: PathBuf,
    rollouts: u32,
    steps: usize,
    /// Mean loss of the last tenth of the steps.
    loss: f64,
    wall_s: f64,
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

/// Trains a tracker. Ctrl-C ends the training without a file.
pub fn run(arguments: &TrainTrackerArgs) -> Result<()> {
    let began = Instant::now();
    let kind = arguments.tracker.kind();
    let model = model_file::read(&arguments.model)?;
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
    output::prepare(&arguments.out)?;
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
    .ok_or_else(|| Interrupted(format!(" after {done} of {number} episodes")))?;
    bar.finish_and_clear();
    let (weights, loss) = training::watch(steps, &shutdown, |tell| match train(kind, &settings, &simulated, tell) {
        Err(Error::Training(Stopped::Interrupted)) => Ok(None),
        other => other.given().map(Some),
    })?;
    std::fs::write(&arguments.out, bytes_of(&weights)).with_context(|| arguments.out.display().to_string())?;
    let unseen = rollouts::rollouts(&model, arguments.seed, FIRST_TEST, TEST_ROLLOUTS, |_| true)?.unwrap_or_default();
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
    let result = Trained {
        weights: arguments.out.clone(),
        rollouts: number,
        steps,
        loss,
        wall_s: began.elapsed().as_secs_f64(),
        places: places(&mut tracker, &unseen)?,
        ordered,
    };
    output::result(&arguments.output, &result, words)
}

/// Text for the terminal.
fn words(t: &Trained) -> String {
    let mut lines =
        vec![format!("{} episodes and {} steps in {:.0} s, loss {:.3}", t.rollouts, t.steps, t.wall_s, t.loss)];
    let p = &t.places;
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
    if let Some(compared) = &t.ordered {
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
    lines.push(format!("weights: {}", t.weights.display()));
    lines.push("use: parameters `tracker` and `weights` of the node keypoint_tracker".to_owned());
    if t.ordered.is_none() {
        lines.push(
            "and `keypoint_fractions` of the model: the fractions above, where inference compares keypoints".to_owned(),
        );
    }
    lines.join("\n")
}
