//! Arguments of `label` and of `train-segmenter`.

use crate::mask::args::SourceArgs;
use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary label`.
#[derive(Debug, Args)]
pub struct LabelArgs {
    /// Images to label
    #[command(flatten)]
    pub source: SourceArgs,
    /// Parameter file with the segmenter that labels, as `mask` writes it; default: that of the camera node
    #[arg(long)]
    pub params: Option<PathBuf>,
    /// Folder for the frames and their labels
    #[arg(long)]
    pub out: PathBuf,
    /// Write a data set for YOLOv8-seg (256 x 256, polygons, copies with blur and noise) in place of frames for `train-segmenter`
    #[arg(long)]
    pub yolo: bool,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary train-segmenter`.
#[derive(Debug, Args)]
pub struct TrainSegmenterArgs {
    /// File for the weights
    #[arg(long)]
    pub out: PathBuf,
    /// Folder of labelled frames, as `label` writes it: trains further on them, beside generated pictures
    #[arg(long)]
    pub frames: Option<PathBuf>,
    /// Weights to begin with; default: the shipped ones with --frames, otherwise none
    #[arg(long)]
    pub start: Option<PathBuf>,
    /// Go on with the training that Ctrl-C ended, from its state in OUT.state; the other options must be the same, and the weights then are those of
    /// a training that was not interrupted, to the bit
    #[arg(long)]
    pub resume: bool,
    /// Number of steps; default: 400 with --frames, otherwise those of the shipped weights
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: Option<u32>,
    /// Threads; default: one for each core
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=256))]
    pub threads: Option<u32>,
    /// Seed of the pictures and of the first weights
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
