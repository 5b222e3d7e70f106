//! Arguments of `bench`.

use crate::options::{Bags, InferencePreset, InferenceSizes, Output, Part};
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// `catenary bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Benchmark to run
    #[command(subcommand)]
    pub benchmark: Benchmark,
}

/// Benchmarks.
#[derive(Debug, Subcommand)]
pub enum Benchmark {
    /// Episodes per core-second of the simulator, by fidelity
    Pool {
        /// Model (file or name); default: soft_bar
        #[arg(long)]
        model: Option<PathBuf>,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
    /// Derivatives of tracks with respect to parameters and effects: their error, and their cost in tracks
    Sensitivities {
        /// Model (file or name); default: soft_bar
        #[arg(long)]
        model: Option<PathBuf>,
        /// Random episodes
        #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
        episodes: u64,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
    /// Simulator against closed-form solutions at each fidelity; fails if a promised bound is missed
    Fidelity(FidelityArgs),
    /// Environment steps per second of training
    Training {
        /// Environment steps to take
        #[arg(long, default_value_t = 6_144)]
        steps: u64,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
    /// Processor time in which a training comes near the best plan, by what the policy observes and begins with
    Policies(PoliciesArgs),
    /// Calibration of posteriors over truths from the prior; a few hundred truths take hours
    Calibration(CalibrationArgs),
    /// Priors whose support excludes the truth: fixed supports against three rules that move them
    Support(SupportArgs),
    /// Networks with a set embedding against networks with a list of keypoints, on clean and corrupted tracks
    Networks(NetworksArgs),
    /// Cost of points against a recording, for other optimisers and samplers: points on stdin, costs on stdout
    Costs(CostsArgs),
    /// Posteriors against hidden truths, over seeds
    Inference {
        /// Number of hidden truths
        #[arg(long, default_value_t = 10, allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..=10_000))]
        seeds: u64,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
}

/// `catenary bench policies`.
#[derive(Debug, Args)]
pub struct PoliciesArgs {
    /// Task (file or name)
    #[arg(long, default_value = "place_tip")]
    pub task: PathBuf,
    /// Models (files or names) whose nominal values are the objects
    #[arg(long, num_args = 1.., default_values = ["dlo_0", "dlo_1", "dlo_2", "dlo_3"])]
    pub objects: Vec<PathBuf>,
    /// Budgets of environment steps, from the least on; default: trainings end when their return is flat
    #[arg(long, num_args = 1.., value_parser = clap::value_parser!(u64).range(768..=10_000_000))]
    pub steps: Vec<u64>,
    /// Leave out all methods but the default preset's
    #[arg(long)]
    pub default_only: bool,
    /// Compare other hyperparameters in place of what the policy observes
    #[arg(long, conflicts_with = "default_only")]
    pub hyperparameters: bool,
    /// Trainings of each method with each budget
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=100))]
    pub seeds: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench costs`.
#[derive(Debug, Args)]
pub struct CostsArgs {
    /// Bags that hold the episode
    #[command(flatten)]
    pub bags: Bags,
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// inference.json of an `infer`; the discretisation error is taken out at its best fit, as there
    #[arg(long)]
    pub corrected_at: Option<PathBuf>,
}

/// `catenary bench calibration`.
#[derive(Debug, Args)]
pub struct CalibrationArgs {
    /// Truths drawn from the prior, each with an episode and an inference of its own
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u64).range(10..=100_000))]
    pub truths: u64,
    /// Folder for report.html and checks.jsonl; an interrupted run resumes from checks.jsonl
    #[arg(long)]
    pub out: PathBuf,
    /// Model (file or name); default: soft_bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Effect of the model to infer along with theta; repeat the option for several
    #[arg(long)]
    pub also: Vec<String>,
    /// Sizes of the network and the schedule
    #[arg(long, value_enum, default_value = "default")]
    pub preset: InferencePreset,
    /// Part I of N of the truths, as I/N, for several machines with one folder; without it, what is missing is made, and the report
    #[arg(long, value_name = "I/N")]
    pub part: Option<Part>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench support`.
#[derive(Debug, Args)]
pub struct SupportArgs {
    /// Truths outside of the prior support, and as many inside; each is inferred with every rule
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub truths: u64,
    /// Motions of each of the bars dlo_0 to dlo_3
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(0..=10_000))]
    pub motions: u64,
    /// Folder for runs.jsonl, from which an interrupted benchmark resumes
    #[arg(long)]
    pub out: PathBuf,
    /// Model (file or name) of the truths; default: soft_bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Sizes of the inference
    #[command(flatten)]
    pub sizes: InferenceSizes,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench networks`.
#[derive(Debug, Args)]
pub struct NetworksArgs {
    /// Training tracks, drawn from the prior
    #[arg(long, default_value_t = 1500, value_parser = clap::value_parser!(u64).range(100..=20_000))]
    pub tracks: u64,
    /// Held-out test tracks
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u64).range(10..=10_000))]
    pub truths: u64,
    /// Model (file or name); default: soft_bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Include the paper's network, with as many steps as its fifteen iterations make; half an hour
    #[arg(long)]
    pub paper: bool,
    /// JSON file to write the tracks and their thetas to, for estimators of other projects
    #[arg(long)]
    pub export: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench fidelity`.
#[derive(Debug, Args)]
pub struct FidelityArgs {
    /// Random episodes at the edges of every parameter, at the fidelities fast and standard; 0: none
    #[arg(long, default_value_t = 0)]
    pub stress: usize,
    /// Model (file or name) whose prior the random episodes span; default: soft_bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
