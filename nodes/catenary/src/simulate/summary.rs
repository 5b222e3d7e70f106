//! What came of an episode.

use super::player::Setting;
use crate::figures::figures;
use catenary_core::{Fidelity, KeypointOrder, Model};
use serde::Serialize;
use simulator_pool::beam::Counters;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What `--json` prints.
#[derive(Debug, Default, Serialize)]
pub struct Report {
    /// One for each model.
    pub episodes: Vec<Episode>,
    /// The bag, where one was asked for, and its messages.
    pub bag: Option<PathBuf>,
    /// Messages in the bag.
    pub messages: u64,
    /// The video, where one was asked for.
    pub video: Option<PathBuf>,
    /// The picture, where one was asked for.
    pub picture: Option<PathBuf>,
}

/// One episode.
#[derive(Debug, Serialize)]
pub struct Episode {
    /// Name of the model.
    pub model: String,
    /// Theta and the effects that were not drawn.
    pub parameters: BTreeMap<String, f64>,
    /// Fidelity of the simulation.
    pub fidelity: &'static str,
    /// Seed of what was drawn.
    pub seed: u64,
    /// Length in s.
    pub duration_s: f64,
    /// (x, z) in m of the keypoints in the camera's last frame, from the grip on.
    pub keypoints_m: [[f64; 2]; 4],
    /// Rewards of the steps, where there are actions.
    pub rewards: Vec<f64>,
    /// First time in s at which hand or target pose were outside of the workspace.
    pub left_workspace_s: Option<f64>,
    /// Root mean square distance in mm from the measured keypoints, where there are any.
    pub rmse_mm: Option<f64>,
    /// Time steps of the simulation.
    pub time_steps: u64,
    /// Those whose Newton iteration did not converge.
    pub unconverged_steps: u64,
    /// Whether the shape at the start was found, at rest or through the measured points.
    pub start_converged: bool,
    /// Squared distances from the measured keypoints in m^2.
    #[serde(skip)]
    squares: Vec<f64>,
}

impl Episode {
    /// An episode that has not begun.
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
            time_steps: 0,
            unconverged_steps: 0,
            start_converged: true,
            squares: Vec::new(),
        }
    }

    /// A step of the policy: its reward, and whether the hand was in the workspace.
    pub fn step(&mut self, time_s: f64, reward: Option<f64>, is_inside: bool) {
        self.rewards.extend(reward);
        if !is_inside {
            self.left_workspace_s.get_or_insert(time_s);
        }
    }

    /// Keypoints as simulated and as measured, (x, z) in m; `order` is what is known of that of the measured ones.
    pub fn compare(&mut self, simulated: [[f64; 2]; 4], measured: [Option<[f64; 2]>; 4], order: KeypointOrder) {
        let measured = measured.map(|p| p.unwrap_or([f64::NAN; 2]));
        let squares = simulated.iter().zip(order.closest(&measured, &simulated)).map(|(a, i)| {
            let b = measured[i];
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        });
        let least = squares.sum::<f64>() / 4.0;
        if least.is_finite() {
            self.squares.push(least);
        }
    }

    /// The end, with what the simulation has done.
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
        lines.push(format!(
            "{} time steps at {} fidelity, {} of them not converged",
            self.time_steps, self.fidelity, self.unconverged_steps
        ));
        lines.join("\n")
    }
}

impl Report {
    /// The report in words.
    pub fn words(&self) -> String {
        let mut lines: Vec<String> = self.episodes.iter().map(Episode::words).collect();
        lines.extend(self.bag.as_ref().map(|p| format!("bag {}: {} messages", p.display(), self.messages)));
        lines.extend(self.video.as_ref().map(|p| format!("video {}", p.display())));
        lines.extend(self.picture.as_ref().map(|p| format!("picture {}", p.display())));
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_do_not_depend_on_the_end_that_was_measured_first() {
        let model = Model::from_yaml(crate::model_file::SOFT_BAR).unwrap();
        let setting = Setting { theta: vec![0.25, 1e4], given: Vec::new(), seed: 1, noise: false };
        let mut episode = Episode::new(&model, &setting, Fidelity::Fast);
        let points = [[0.0, 0.4], [0.0, 0.3], [0.0, 0.2], [0.0, 0.1]];
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
