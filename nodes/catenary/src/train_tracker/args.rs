//! Arguments of `train-tracker`.

use crate::options::Output;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Network to train.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Network {
    /// The paper's keypoints, without labels
    Transporter,
    /// Keypoints at fixed fractions of the length, behind covers
    Ordered,
}

/// Sizes of a training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Sizes of the shipped weights: less than an hour of two cores
    Cpu,
    /// Sizes of the paper: 1500 episodes, 50 passes over 24,000 pairs of masks, Adam at 0.001
    Paper,
}

/// `catenary train-tracker`.
#[derive(Debug, Args)]
pub struct TrainTrackerArgs {
    /// Network to train
    #[arg(long, value_enum)]
    pub tracker: Network,
    /// File for the weights
    #[arg(long, required_unless_present = "measure")]
    pub out: Option<PathBuf>,
    /// Train nothing, and measure the weights of this file; without one, the shipped weights
    #[arg(long, num_args = 0..=1, value_name = "FILE", conflicts_with_all = ["out", "preset", "rollouts", "steps", "threads"])]
    pub measure: Option<Option<PathBuf>>,
    /// Model (file or name) whose objects are seen
    #[arg(long, default_value = "soft_bar")]
    pub model: PathBuf,
    /// Sizes of the training
    #[arg(long, value_enum, default_value = "cpu")]
    pub preset: Preset,
    /// Number of simulated episodes; default: that of the preset
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub rollouts: Option<u32>,
    /// Go on with the training that Ctrl-C ended, from its state in OUT.state; the other options must be the same, and the weights then are those of
    /// a training that was not interrupted, to the bit
    #[arg(long, requires = "out")]
    pub resume: bool,
    /// Number of steps; default: that of the preset
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: Option<u32>,
    /// Threads; default: one for each core
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=256))]
    pub threads: Option<u32>,
    /// Seed of the episodes, of the samples and of the first weights
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
