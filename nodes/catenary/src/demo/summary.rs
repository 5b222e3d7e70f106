//! Results of a demo, as stored in `summary.json` and shown in the report.

use crate::evaluate::score::Evaluated;
use crate::graph::own::Cell;
use crate::options::Preset;
use anyhow::{Context, Result};
use catenary_core::posterior::Marginal;
use catenary_core::{Fidelity, Posterior, Task};
use catenary_shell::files;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in the demo's folder.
pub const FILE: &str = "summary.json";

/// Results so far, for the report of a demo that did not come to its end.
#[derive(Debug, Default)]
pub struct Progress {
    /// Trainings.
    pub training: Vec<Training>,
    /// Episodes on the cell.
    pub episodes: Vec<Episode>,
    /// Result of the inference.
    pub inference: Option<Inference>,
}

/// Results of a whole demo.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Summary {
    /// Seed of every random draw.
    pub seed: u64,
    /// Preset: `default` or `paper`.
    pub preset: Preset,
    /// Robot cell.
    #[serde(default)]
    pub cell: Cell,
    /// Names of the inferred parameters.
    pub parameters: Vec<String>,
    /// Hidden values of the parameters, which only the cell's node received.
    pub truth: Vec<f64>,
    /// Task of both policies.
    pub task: Task,
    /// Distance below which an episode is a success, m.
    pub success_distance_m: f64,
    /// Result of the inference.
    pub inference: Inference,
    /// Training before (pi0) and after (pi1) the inference.
    pub training: Vec<Training>,
    /// Episodes on the cell, in order.
    pub episodes: Vec<Episode>,
    /// Looping picture of both episodes, relative to the demo's folder.
    pub film: String,
    /// Score of each policy over simulated episodes of the hidden object.
    pub evaluation: Evaluation,
    /// Time of each stage.
    pub stages: Vec<Stage>,
}

/// Scores over simulated episodes of the hidden object, computed after inference and training.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Evaluation {
    /// Number of episodes of each policy; both run the same ones.
    pub episodes: usize,
    /// Fidelity of the simulation.
    pub fidelity: Fidelity,
    /// Seed of camera noise and of the effects that vary from episode to episode.
    pub seed: u64,
    /// Scores of the policies, pi0 first.
    pub policies: Vec<Evaluated>,
    /// Score of the best plan that a search finds for the hidden object: what can be reached without feedback. None in files of earlier versions.
    #[serde(default)]
    pub best_plan: Option<Evaluated>,
}

/// Result of the inference.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Inference {
    /// Posterior over the parameters.
    pub posterior: Posterior,
    /// Marginals of the posterior.
    pub marginals: Vec<Marginal>,
    /// Thetas that pi1 was trained on: low-variance samples of the posterior.
    pub domains: Vec<Vec<f64>>,
    /// Held-out loss after each iteration, nat.
    pub losses: Vec<f64>,
    /// Effective sample size of the last iteration.
    pub effective_sample_size: f64,
    /// Share of the mixture outside the prior's support.
    pub mass_outside: f64,
    /// Total number of simulations.
    pub simulations: u32,
    /// Warnings of the service.
    pub warnings: Vec<String>,
    /// Reason why the posterior does not fit the recording; `None` if it fits, or if an older program wrote the file.
    #[serde(default)]
    pub misfit: Option<String>,
}

/// Result of one training.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Training {
    /// Name of the policy.
    pub policy: String,
    /// Learning curve: (environment steps, mean return of the episodes that ended by then).
    pub curve: Vec<(u64, f64)>,
    /// Environment steps per second.
    pub steps_per_second: f64,
}

/// One episode on the cell.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Episode {
    /// Name of the policy.
    pub policy: String,
    /// Reason of the end.
    pub end: String,
    /// Reward of each step.
    pub rewards: Vec<f64>,
    /// Sum of the rewards.
    pub episode_return: f64,
    /// Distance that the task minimises, seen by the camera, m.
    pub distance_m: f64,
    /// Position (x, z) of the end effector at each observation, m.
    pub path_m: Vec<[f64; 2]>,
    /// Path of the bag, relative to the demo's folder.
    pub bag: String,
    /// Fingerprint of the recorded episode, stamps included; empty if an older program wrote the file.
    #[serde(default)]
    pub recording: String,
    /// Camera frames, one per observation.
    pub frames: Vec<Frame>,
    /// Delay from an image's stamp, in lock step from its arrival, to the arrival of its keypoints, ms: median and 99 % quantile over the episode.
    pub keypoint_latency_ms: [f64; 2],
}

/// One camera frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Frame {
    /// Path of the PNG file, relative to the demo's folder.
    pub file: String,
    /// Keypoints of the object, then the target, in pixels of the image.
    pub marks_px: Vec<[f64; 2]>,
    /// Step of the episode.
    pub step: u32,
}

/// One stage of the demo.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Stage {
    /// Name of the stage.
    pub name: String,
    /// Wall time, s.
    pub wall_s: f64,
    /// Processor time of all nodes, s.
    pub cpu_s: f64,
}

impl Summary {
    /// Reads `summary.json` in `folder`. Returns an error that names the file if it is missing or malformed.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let text = std::fs::read_to_string(&path).with_context(|| format!("demo folder: {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{}", path.display()))
    }

    /// Writes `summary.json` into `folder`.
    pub fn write(&self, folder: &Path) -> Result<()> {
        files::write(&folder.join(FILE), serde_json::to_string_pretty(self)?)
    }
}
