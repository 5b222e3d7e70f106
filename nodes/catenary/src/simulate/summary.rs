//! Result of `catenary simulate`.

use super::eyes::Sight;
use super::player::Setting;
use crate::report::number::figures;
use catenary_core::{Fidelity, KeypointOrder, Model};
use catenary_simulator::beam::Counters;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Result in the form of `--json`.
#[derive(Debug, Default, Serialize)]
pub struct Report {
    /// Episodes, one per model.
    pub episodes: Vec<Episode>,
    /// Path of the bag, if requested.
    pub bag: Option<PathBuf>,
    /// Messages in the bag.
    pub messages: u64,
    /// Path of the video, if requested.
    pub video: Option<PathBuf>,
    /// Path of the picture, if requested.
    pub picture: Option<PathBuf>,
}

/// Result of one episode.
#[derive(Debug, Serialize)]
pub struct Episode {
    /// Name of the model.
    pub model: String,
    /// Theta, and the effects that were not drawn.
    pub parameters: BTreeMap<String, f64>,
    /// Fidelity of the simulation.
    pub fidelity: &'static str,
    /// Seed of every random draw.
    pub seed: u64,
    /// Length of the episode, s.
    pub duration_s: f64,
    /// Keypoints in the camera's last frame, from the grip on, (x, z) in m.
    pub keypoints_m: [[f64; 2]; 4],
    /// Reward of each step; empty without actions.
    pub rewards: Vec<f64>,
    /// First time at which the hand or the target pose was outside the workspace, s.
    pub left_workspace_s: Option<f64>,
    /// Root mean square distance from the measured keypoints, mm; `None` without a measured motion.
    pub rmse_mm: Option<f64>,
    /// Agreement of the keypoints of the pictures with those of the object; none without --eyes.
    pub sight: Option<Sight>,
    /// Time steps of the simulation.
    pub time_steps: u64,
    /// Time steps whose Newton iteration did not converge.
    pub unconverged_steps: u64,
    /// False if the start shape, at rest or through the measured points, was not found.
    pub start_converged: bool,
    /// Mean squared distance from the measured keypoints in each frame, m^2.
    #[serde(skip)]
    squares: Vec<f64>,
}

impl Episode {
    /// Episode before its start.
    pub fn new(model: &Model, setting: &Setting, fidelity: Fidelity) -> Self {
        let theta = model.theta.parameters().iter().map(|p| p.name.clone()).zip(setting.theta.iter().copied());
        Self {
            model: model.name.clone(),
            parameters: theta.chain(setting.given.iter().cloned()).collect(),
            fidelity: fidelity.name(),
            seed: setting.seed,
            duration_s: 0.0,
            keypoints_m: [[f64::NAN; 2]; 4],
            rewards: Vec::new(),
            left_workspace_s: None,
            rmse_mm: None,
            sight: None,
            time_steps: 0,
            unconverged_steps: 0,
            start_converged: true,
            squares: Vec::new(),
        }
    }

    /// Records a step of the policy: its reward, and if the hand was in the workspace.
    pub fn step(&mut self, time_s: f64, reward: Option<f64>, is_inside: bool) {
        self.rewards.extend(reward);
        if !is_inside {
            self.left_workspace_s.get_or_insert(time_s);
        }
    }

    /// Records the distance of simulated from measured keypoints, (x, z) in m; `order` is the known order of the
    /// measured ones.
    pub fn compare(&mut self, simulated: [[f64; 2]; 4], measured: [Option<[f64; 2]>; 4], order: KeypointOrder) {
        let measured = measured.map(|p| p.unwrap_or([f64::NAN; 2]));
        let squares = simulated.iter().zip(order.closest(&measured, &simulated)).map(|(a, i)| {
            let b = measured[i];
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        });
        // A frame with a missing keypoint does not count.
        let least = squares.sum::<f64>() / 4.0;
        if least.is_finite() {
            self.squares.push(least);
        }
    }

    /// Records the end, with the counters of the simulation.
    pub fn finish(&mut self, duration_s: f64, counters: Counters) {
        self.duration_s = duration_s;
        (self.time_steps, self.unconverged_steps) = (counters.steps, counters.unconverged_steps);
        self.start_converged = counters.unconverged_equilibria == 0;
        let mean = self.squares.iter().sum::<f64>() / self.squares.len() as f64;
        self.rmse_mm = (!self.squares.is_empty()).then(|| 1e3 * mean.sqrt());
    }

    fn words(&self) -> String {
        let parameters: Vec<String> =
            self.parameters.iter().map(|(name, v)| format!("{name} {}", figures(*v))).collect();
        let points: Vec<String> = self.keypoints_m.iter().map(|[x, z]| format!("({x:.3}, {z:.3})")).collect();
        let mut lines = vec![
            format!("{}: {}", self.model, parameters.join(", ")),
            format!("keypoints after {:.2} s, (x, z) in m: {}", self.duration_s, points.join(" ")),
        ];
        if let Some(last) = self.rewards.last() {
            let best = self.rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            lines.push(format!("reward {last:.3} at the end, {best:.3} at best"));
        }
        lines.extend(self.left_workspace_s.map(|t| format!("warning: the hand left the workspace at {t:.2} s")));
        if !self.start_converged {
            lines.push("warning: the object's shape at the start was not found".into());
        }
        lines.extend(self.rmse_mm.map(|v| format!("{v:.1} mm (rms) from the measured keypoints")));
        lines.extend(self.sight.map(|s| {
            format!(
                "keypoints from {} pictures: wrong in {:.1} % of them, with good scores in {:.1} %; median error {:.3} of the length",
                s.frames,
                100.0 * s.failures,
                100.0 * s.silent,
                s.median_error_lengths
            )
        }));
        lines.push(format!(
            "{} time steps at {} fidelity, {} of them not converged",
            self.time_steps, self.fidelity, self.unconverged_steps
        ));
        lines.join("\n")
    }
}

impl Report {
    /// Report as text.
    pub fn words(&self) -> String {
        let mut lines: Vec<String> = self.episodes.iter().map(Episode::words).collect();
        lines.extend(self.bag.as_ref().map(|p| format!("bag {}: {} messages", p.display(), self.messages)));
        if self.bag.is_some() && self.episodes.iter().any(|episode| episode.sight.is_none()) {
            lines.push("its keypoints are those of the object: --eyes takes them from pictures, as camera and tracker find them".into());
        }
        lines.extend(self.video.as_ref().map(|p| format!("video {}", p.display())));
        lines.extend(self.picture.as_ref().map(|p| format!("picture {}", p.display())));
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_do_not_depend_on_which_end_was_measured_first() {
        let model = Model::from_yaml(crate::inputs::model_file::SOFT_BAR).unwrap();
        let setting = Setting { theta: vec![0.25, 1e4], given: Vec::new(), seed: 1, noise: false };
        let mut episode = Episode::new(&model, &setting, Fidelity::Fast);
        let points = [[0.0, 0.4], [0.0, 0.3], [0.0, 0.2], [0.0, 0.1]];
        // A shift of 3 and 4 mm is a distance of 5 mm.
        let mut measured = points.map(|[x, z]| Some([x + 0.003, z + 0.004]));
        episode.compare(points, measured, KeypointOrder::Along);
        measured.reverse();
        episode.compare(points, measured, KeypointOrder::Along);
        measured[2] = None;
        episode.compare(points, measured, KeypointOrder::Along);
        episode.finish(1.0, Counters::default());
        assert!((episode.rmse_mm.unwrap() - 5.0).abs() < 1e-9, "{:?}", episode.rmse_mm);
    }
}
