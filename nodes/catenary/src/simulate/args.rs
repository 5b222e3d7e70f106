//! Arguments of `simulate`.

use crate::options::{FidelityName, Output, parameter_value};
use clap::Args;
use std::path::PathBuf;

/// `catenary simulate`.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// Model (file or name); several may be given for a picture
    #[arg(long, required = true)]
    pub model: Vec<PathBuf>,
    /// Actions of the episode: a CSV file with the columns dx_m, dz_m, one row per step
    #[arg(long, required_unless_present = "track", conflicts_with = "track")]
    pub actions: Option<PathBuf>,
    /// Measured motion to follow instead of actions: a CSV track as import-track reads it, or a bag
    #[arg(long)]
    pub track: Option<PathBuf>,
    /// Folder of the bag to make, with the topics of arm, keypoints, tf and episode; no node runs, so that it holds no
    /// mask, no diagnostics and no rosout, and its keypoints are those of the object, which perception may not find: see --eyes
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Add the camera's images to the bag
    #[arg(long, requires = "out")]
    pub images: bool,
    /// Show a laboratory of this seed in images, video and picture: textures, lamp, shadows, clutter; default: the plain look
    #[arg(long)]
    pub laboratory: Option<u64>,
    /// Take the bag's keypoints from the pictures, by camera and tracker of this parameter file, in place of the exact ones
    #[arg(long, requires = "out")]
    pub eyes: Option<PathBuf>,
    /// Video to make: NAME.gif, or NAME.mp4 if ffmpeg is installed
    #[arg(long)]
    pub video: Option<PathBuf>,
    /// Frames per second of the video
    #[arg(long, default_value_t = 25.0, value_parser = rate)]
    pub video_rate: f64,
    /// Picture to make (PNG), with a row of moments for each model
    #[arg(long)]
    pub picture: Option<PathBuf>,
    /// Moments in the picture, including the first and the last of the episode
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=20))]
    pub moments: u32,
    /// Value of an inferred parameter, as NAME=VALUE; default: the model's nominal value, else its prior's median
    #[arg(long, value_parser = parameter_value)]
    pub theta: Vec<(String, f64)>,
    /// Value of another parameter, as NAME=VALUE; default: the median of its distribution, or a draw with --noise
    #[arg(long, value_parser = parameter_value)]
    pub effect: Vec<(String, f64)>,
    /// Fidelity of the simulation
    #[arg(long, value_enum, default_value = "standard")]
    pub fidelity: FidelityName,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Add the model's noise: keypoints, camera, target, effects without a given value
    #[arg(long)]
    pub noise: bool,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// Parses a frame rate in Hz.
fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.1..=1000.0).contains(&rate) => Ok(rate),
        _ => Err("expected 0.1 to 1000 frames per second".to_owned()),
    }
}
