//! Arguments of `infer`.

use crate::options::{Bags, InferenceSizes, OnGraph, Output, PriorSupportName};
use clap::Args;
use std::path::PathBuf;

/// `catenary infer`.
#[derive(Debug, Args)]
#[command(mut_arg("bags", |arg| arg.help("Bag (folder, .mcap or .db3 file) that holds the episode; several, of one object, give one posterior")))]
pub struct InferArgs {
    /// Bags that hold the episode; several, of one object, give one posterior
    #[command(flatten)]
    pub bags: Bags,
    /// Model: a file, or the name of a shipped one such as soft_bar
    #[arg(long)]
    pub model: PathBuf,
    /// Folder for posterior.json, inference.json and report.html; with --node without inference.json
    #[arg(long)]
    pub out: PathBuf,
    /// Number of an episode in the bag; repeat the option for several; with several bags, one number for each; default:
    /// the last complete episode of each bag
    #[arg(long, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub episode: Vec<u32>,
    /// Bag of another recording of the object, which the inference does not see and the posterior predicts; repeat the option for
    /// several
    #[arg(long, value_name = "BAG")]
    pub predict: Vec<PathBuf>,
    /// Number of an episode to predict; as --episode, for the bags of --predict
    #[arg(long, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..), requires = "predict")]
    pub predict_episode: Vec<u32>,
    /// Policy that ran in the episode; needed if the model's drive is a policy
    #[arg(long)]
    pub policy: Option<PathBuf>,
    /// Sizes of the inference
    #[command(flatten)]
    pub sizes: InferenceSizes,
    /// Support of the prior: with adaptive, it grows between iterations, and posterior.json records its moves; default:
    /// fixed, or with --node the parameter prior_support of the node
    #[arg(long, value_enum)]
    pub prior_support: Option<PriorSupportName>,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Process that does the work
    #[command(flatten)]
    pub on_graph: OnGraph,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
