//! Arguments of `study`.

use super::evidence::Evidence;
use super::further::Further;
use crate::graph::own::Cell;
use crate::options::{ArmOption, ObservesOptions, Output, Part, TrainingPreset};
use clap::Args;
use std::path::PathBuf;

/// `catenary study`.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// Folder for everything that is made; the same command goes on in it
    #[arg(long)]
    pub out: PathBuf,
    /// Model (file or name) for inference and training
    #[arg(long, default_value = "soft_bar")]
    pub model: PathBuf,
    /// Tasks (files or names)
    #[arg(long, num_args = 1.., default_values = ["place_tip", "whip"])]
    pub task: Vec<PathBuf>,
    /// Models (files or names) whose nominal values are the hidden objects
    #[arg(long, num_args = 1.., default_values = ["dlo_0", "dlo_1", "dlo_2", "dlo_3"])]
    pub objects: Vec<PathBuf>,
    /// Policies beside U and those of the posteriors; no value: none
    #[arg(long, value_enum, num_args = 0.., default_values_t = [Further::Mu, Further::Told])]
    pub policies: Vec<Further>,
    /// Trainings of each policy
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(2..=1000))]
    pub seeds: u64,
    /// Most environment steps of a training; default: the preset's
    #[arg(long)]
    pub steps: Option<u64>,
    /// What the policies observe
    #[command(flatten)]
    pub observes: ObservesOptions,
    /// Search no plans: the trainings begin without one, and the best plans are missing in the results
    #[arg(long)]
    pub no_plan: bool,
    /// Preset hyperparameters of the trainings
    #[arg(long, value_enum, default_value = "default")]
    pub preset: TrainingPreset,
    /// Episodes that score a training on an object
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(2..=10_000))]
    pub episodes: u64,
    /// Deployments of the first training of a policy on an object
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub repeats: u64,
    /// Deploy in real time on the whole graph in this robot cell, which holds the hidden object; default: in a simulation of it in this
    /// process
    #[arg(long, value_enum)]
    pub cell: Option<Cell>,
    /// Arm in place of the model's and the tasks'; default: that of --cell emulated there
    #[command(flatten)]
    pub arm: ArmOption,
    /// Evidence of an object's posteriors, as RECORDINGS or RECORDINGS:ROUNDSxSIMULATIONS of the inference. The first one's policies are held
    /// against all others; further ones show what more or less evidence is worth
    #[arg(long, num_args = 1.., default_values = ["1"])]
    pub evidence: Vec<Evidence>,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Part I of N of the work, as I/N, for several machines with one folder; without it, everything that is missing is made, and the report
    #[arg(long, value_name = "I/N")]
    pub part: Option<Part>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
