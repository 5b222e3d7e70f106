//! What a demo found: everything that the report shows, as `summary.json`.

use crate::evaluate::Evaluated;
use anyhow::{Context, Result};
use catenary_core::posterior::Marginal;
use catenary_core::{Posterior, Task};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in the demo's folder.
pub const FILE: &str = "summary.json";

/// A whole demo.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Summary {
    /// Seed of everything.
    pub seed: u64,
    /// `default` or `paper`.
    pub preset: String,
    /// Names of the inferred parameters.
    pub parameters: Vec<String>,
    /// Their hidden values, which no node but the cell was told.
    pub truth: Vec<f64>,
    /// The task of both policies.
    pub task: Task,
    /// Distance in m at which an episode is a success.
    pub success_distance_m: f64,
    /// What was inferred.
    pub inference: Inference,
    /// Training before (pi0) and after (pi1) the inference.
    pub training: Vec<Training>,
    /// Episodes on the cell, in order.
    pub episodes: Vec<Episode>,
    /// Looping picture of both episodes, relative to the demo's folder.
    pub film: String,
    /// Score of each policy over simulated episodes of the hidden object.
    pub evaluation: Evaluation,
    /// Where the time went.
    pub stages: Vec<Stage>,
}

/// Scores over simulated episodes of the hidden object, computed after everything else.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Evaluation {
    /// Episodes of each policy; both meet the same ones.
    pub episodes: usize,
    /// Fidelity of the simulation.
    pub fidelity: String,
    /// Seed of camera noise and of the effects that vary from episode to episode.
    pub seed: u64,
    /// The policies, pi0 first.
    pub policies: Vec<Evaluated>,
}

/// The inference.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Inference {
    /// The posterior.
    pub posterior: Posterior,
    /// Its marginals.
    pub marginals: Vec<Marginal>,
    /// Thetas that pi1 was trained on: low-variance samples of the posterior.
    pub domains: Vec<Vec<f64>>,
    /// Held-out loss after each iteration, nat.
    pub losses: Vec<f64>,
    /// Effective sample size at the end.
    pub effective_sample_size: f64,
    /// Share of the mixture outside the prior's support.
    pub mass_outside: f64,
    /// Simulations in all.
    pub simulations: u32,
    /// What the service warns of.
    pub warnings: Vec<String>,
    /// Why the posterior fits nothing of the recording; none where it does, or the demo is of an older program.
    #[serde(default)]
    pub misfit: Option<String>,
}

/// One training.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Training {
    /// Name of the policy.
    pub policy: String,
    /// (environment steps, mean return of the episodes that ended by then).
    pub curve: Vec<(u64, f64)>,
    /// Environment steps per second.
    pub steps_per_second: f64,
}

/// One episode on the cell.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Episode {
    /// Name of the policy.
    pub policy: String,
    /// Why it ended.
    pub end: String,
    /// Reward of each step.
    pub rewards: Vec<f64>,
    /// Their sum.
    pub episode_return: f64,
    /// Distance in m that the task asks to be small, as the camera saw it.
    pub distance_m: f64,
    /// (x, z) in m of the end effector at each observation.
    pub path_m: Vec<[f64; 2]>,
    /// The bag, relative to the demo's folder.
    pub bag: String,
    /// Camera frames, one for each observation.
    pub frames: Vec<Frame>,
    /// Time from an image's stamp to the arrival of its keypoints, over the episode, ms: median and 99 % quantile.
    pub keypoint_latency_ms: [f64; 2],
}

/// One camera frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Frame {
    /// The PNG file, relative to the demo's folder.
    pub file: String,
    /// The object's keypoints and then the target in pixels of the image.
    pub marks_px: Vec<[f64; 2]>,
    /// Step of the episode.
    pub step: u32,
}

/// One stage of the demo.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Stage {
    /// What it did.
    pub name: String,
    /// Wall time in s.
    pub wall_s: f64,
    /// Processor time of all nodes in s.
    pub cpu_s: f64,
}

impl Summary {
    /// Reads `summary.json` in `folder`.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let text = std::fs::read_to_string(&path).with_context(|| format!("demo folder: {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{}", path.display()))
    }

    /// Writes `summary.json` into `folder`.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let path = folder.join(FILE);
        std::fs::write(&path, serde_json::to_string_pretty(self)?).with_context(|| format!("{}", path.display()))
    }
}
