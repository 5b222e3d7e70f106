//! The command line.

use crate::bags::Bags;
pub use crate::bags::{InfoArgs, RecordArgs, ReindexArgs, ReplayArgs};
pub use crate::install::InstallArgs;
pub use crate::launch::status::StatusArgs;
use catenary_core::Fidelity;
use clap::builder::PossibleValue;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// End of the help page.
const EXIT_CODES: &str = "\
Exit codes of every command and node:
  0    done
  1    failed at its work: a full disk, nobody answers, another node failed, a
       check of `doctor` or `bench` says no
  2    given something wrong, so that the same command would fail again: the
       command line, a file that it names, or an environment variable
  3    done, and written, but the result does not fit the data
  130  interrupted by Ctrl-C";

/// Real2Sim2Real of deformable linear objects held by a Panda: from one recording to a posterior over the object's
/// parameters, a policy trained over it, and that policy's run on the robot.
#[derive(Debug, Parser)]
#[command(name = "catenary", version = env!("CATENARY_VERSION"), long_about = None, term_width = 80, after_help = EXIT_CODES)]
pub struct Cli {
    /// What to do
    #[command(subcommand)]
    pub command: Command,
    /// Print more of what goes on (to stderr); twice: everything
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

/// The commands, in the order in which a newcomer meets them.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The whole loop on a simulated cell, from training to the report
    Demo(DemoArgs),
    /// Start the processes of a ROS 2 launch file and watch them
    Launch(LaunchArgs),
    /// Say what the processes of a launch do
    Status(StatusArgs),
    /// Run one node, with ROS 2 arguments after --ros-args
    Node(NodeArgs),
    /// Posterior over the model's parameters from a recording
    Infer(InferArgs),
    /// Where model and recordings disagree, and which effect is why
    FindEffects(FindEffectsArgs),
    /// Train a policy in simulation over what is known of the object
    Train(TrainArgs),
    /// Run policies on simulated episodes of a model, and compare them
    Evaluate(EvaluateArgs),
    /// Run one episode of a policy on the running graph
    Deploy(DeployArgs),
    /// Record topics of the graph to a bag
    Record(RecordArgs),
    /// Publish a bag's messages in time
    Replay(ReplayArgs),
    /// Say what a bag holds, and what of it is missing or damaged
    Info(InfoArgs),
    /// Finish a bag whose recorder was killed, and index it anew
    Reindex(ReindexArgs),
    /// Make a bag from a track in a CSV file
    ImportTrack(ImportArgs),
    /// Show one episode of a model: figures, a bag, a video, a picture
    Simulate(SimulateArgs),
    /// Build the report of a demo folder again
    Report(ReportArgs),
    /// Measure the simulator, training and inference on this machine
    Bench(BenchArgs),
    /// List the effects that a model may have, with units and priors
    Effects(EffectsArgs),
    /// Install nodes and launch files for `ros2 run` and `ros2 launch`
    Install(InstallArgs),
    /// Check this machine and its ROS 2 settings
    Doctor(DoctorArgs),
}

/// Machine-readable output.
#[derive(Debug, Args)]
pub struct Output {
    /// Print the result as JSON on stdout
    #[arg(long)]
    pub json: bool,
}

/// `catenary demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for the bags, policies, posterior and report
    #[arg(long, default_value = "demo")]
    pub out: PathBuf,
    /// The sizes of the paper: hours instead of minutes
    #[arg(long)]
    pub paper: bool,
    /// Seed of everything, the hidden parameters included
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary launch`.
#[derive(Debug, Args)]
pub struct LaunchArgs {
    /// Launch file in ROS 2's XML form
    pub file: PathBuf,
    /// Arguments of the launch file, as NAME:=VALUE
    pub arguments: Vec<String>,
    /// Show the file's arguments and processes and start nothing
    #[arg(long)]
    pub show: bool,
    /// Folder for the processes' output; none: a new one where ROS 2 keeps logs, in ROS_LOG_DIR or ~/.ros/log
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Machine-readable output, of --show or of how the launch ended
    #[command(flatten)]
    pub output: Output,
}

/// `catenary node`.
#[derive(Debug, Args)]
pub struct NodeArgs {
    /// Name of the node; none: list them
    pub name: Option<String>,
    /// Arguments of the node
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<String>,
}

/// Sizes of inference and training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Well calibrated in minutes
    Default,
    /// The paper's sizes
    Paper,
}

impl Preset {
    /// Its name in goals and settings.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Default => "default",
            Preset::Paper => "paper",
        }
    }
}

/// Hyperparameters of training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TrainingPreset {
    /// Many small updates, within a minute
    Default,
    /// Those of Stable-Baselines3, as in the paper
    Sb3,
}

impl TrainingPreset {
    /// Its name in goals and settings.
    pub fn name(self) -> &'static str {
        match self {
            TrainingPreset::Default => "default",
            TrainingPreset::Sb3 => "sb3",
        }
    }
}

/// A fidelity on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FidelityName(pub Fidelity);

impl ValueEnum for FidelityName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [FidelityName; Fidelity::ALL.len()] = {
            let mut all = [FidelityName(Fidelity::Fast); Fidelity::ALL.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = FidelityName(Fidelity::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.description()))
    }
}

/// Work that the running graph may do.
#[derive(Debug, Args)]
pub struct Served {
    /// Have it done by the running graph, whose nodes are in this namespace
    #[arg(long, value_name = "NAMESPACE", num_args = 0..=1, require_equals = true, default_missing_value = "/")]
    pub node: Option<String>,
    /// Seconds to wait for the graph
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true, requires = "node")]
    pub wait_s: f64,
}

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
    /// Folder for posterior.json and the pictures; with --node for posterior.json alone
    #[arg(long)]
    pub out: PathBuf,
    /// Number of an episode in the bag, or several in several --episode; with several bags one for each; none: the last
    /// complete one of each bag
    #[arg(long, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub episode: Vec<u32>,
    /// Policy that the episode ran, where the model's drive is a policy
    #[arg(long)]
    pub policy: Option<PathBuf>,
    /// Sizes of the network and the schedule
    #[arg(long, value_enum, default_value = "default")]
    pub preset: Preset,
    /// Rounds of simulation and training; none: the preset's
    #[arg(long)]
    pub iterations: Option<usize>,
    /// Simulations in each round; none: the preset's
    #[arg(long)]
    pub simulations: Option<usize>,
    /// Seed
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Who does it
    #[command(flatten)]
    pub served: Served,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary find-effects`.
#[derive(Debug, Args)]
#[command(mut_arg("bags", |arg| arg.help("Bag (folder, .mcap or .db3 file) whose complete episodes are looked at; several may be given")))]
pub struct FindEffectsArgs {
    /// Bags whose complete episodes are looked at
    #[command(flatten)]
    pub bags: Bags,
    /// Bag whose episodes no fit sees, by which the repair is judged; several may be given; none: the last third of the episodes
    #[arg(long)]
    pub verify: Vec<PathBuf>,
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// Folder for verdict.json, model.yaml and report/index.html; with --node without verdict and report
    #[arg(long)]
    pub out: PathBuf,
    /// Data sets without a gap that each test is held against; with --node, the node's parameter says how many
    #[arg(long, default_value_t = 199, conflicts_with = "node")]
    pub null_sets: usize,
    /// Seed. Searches of one seed draw the same noise: where many p-values are looked at together, each needs a seed of its own
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Who does it
    #[command(flatten)]
    pub served: Served,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// posterior.json to train over; none: the model's prior
    #[arg(long)]
    pub posterior: Option<PathBuf>,
    /// Policy file to write (safetensors)
    #[arg(long)]
    pub out: PathBuf,
    /// Environment steps; none: the preset's
    #[arg(long)]
    pub steps: Option<u64>,
    /// Hyperparameters
    #[arg(long, value_enum, default_value = "default")]
    pub preset: TrainingPreset,
    /// Seed
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Who does it
    #[command(flatten)]
    pub served: Served,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Policy file (safetensors); several run the same episodes, and are held against the first
    #[arg(long, required = true)]
    pub policy: Vec<PathBuf>,
    /// Model (file or name) of the cell that they run on
    #[arg(long)]
    pub model: PathBuf,
    /// posterior.json to draw the object's parameters from; none: the model's prior
    #[arg(long)]
    pub posterior: Option<PathBuf>,
    /// An inferred parameter's value in every episode, as NAME=VALUE
    #[arg(long, value_parser = assignment)]
    pub theta: Vec<(String, f64)>,
    /// Another parameter's value in every episode, as NAME=VALUE; effects of the model that nobody gives are drawn
    #[arg(long, value_parser = assignment)]
    pub effect: Vec<(String, f64)>,
    /// Episodes of each policy
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(30..=100_000))]
    pub episodes: u64,
    /// Fidelity of the simulation
    #[arg(long, value_enum, default_value = "reference")]
    pub fidelity: FidelityName,
    /// Seed of what is drawn
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary deploy`.
#[derive(Debug, Args)]
pub struct DeployArgs {
    /// Policy file (safetensors)
    #[arg(long)]
    pub policy: PathBuf,
    /// Go on to the step limit after the goal was reached
    #[arg(long)]
    pub run_all_steps: bool,
    /// Do not move to the start pose first
    #[arg(long)]
    pub from_here: bool,
    /// Seconds to wait for the graph
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true)]
    pub wait_s: f64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary import-track`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// Track: t_s, grip_x_m, grip_z_m, grip_pitch_rad, p1_x_m .. p4_z_m, and optionally the wrench
    pub track: PathBuf,
    /// Model (file or name), for its camera
    #[arg(long)]
    pub model: PathBuf,
    /// Folder of the bag to make
    #[arg(long)]
    pub out: PathBuf,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary simulate`.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// Model (file or name); several may be given for a picture
    #[arg(long, required = true)]
    pub model: Vec<PathBuf>,
    /// Actions of the episode: a CSV file with the columns dx_m, dz_m, a row for each step
    #[arg(long, required_unless_present = "track", conflicts_with = "track")]
    pub actions: Option<PathBuf>,
    /// Measured motion to follow in place of actions: a CSV track as import-track reads it, or a bag
    #[arg(long)]
    pub track: Option<PathBuf>,
    /// Folder of the bag to make: the topics of arm, keypoints, tf and episode; no node runs, so there is no mask, no
    /// diagnostics and no rosout
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Put the camera's images into the bag too
    #[arg(long, requires = "out")]
    pub images: bool,
    /// Video to make: NAME.gif, or NAME.mp4 where there is an ffmpeg
    #[arg(long)]
    pub video: Option<PathBuf>,
    /// Frames per second of the video
    #[arg(long, default_value_t = 25.0, value_parser = rate)]
    pub video_rate: f64,
    /// Picture to make (PNG): a row of moments for each model
    #[arg(long)]
    pub picture: Option<PathBuf>,
    /// Moments in the picture, the first and the last of the episode among them
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=20))]
    pub moments: u32,
    /// An inferred parameter's value, as NAME=VALUE; else the model's nominal one, else its prior's median
    #[arg(long, value_parser = assignment)]
    pub theta: Vec<(String, f64)>,
    /// Another parameter's value, as NAME=VALUE; effects that nobody gives are at their medians, with --noise drawn
    #[arg(long, value_parser = assignment)]
    pub effect: Vec<(String, f64)>,
    /// Fidelity of the simulation
    #[arg(long, value_enum, default_value = "standard")]
    pub fidelity: FidelityName,
    /// Seed of what is drawn
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Add the model's noise: keypoints, camera, target, effects that nobody gives
    #[arg(long)]
    pub noise: bool,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// NAME=VALUE with a finite value.
fn assignment(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(name, value)| Some((name.trim(), value.trim().parse::<f64>().ok()?)));
    match parts {
        Some((name, value)) if !name.is_empty() && value.is_finite() => Ok((name.to_owned(), value)),
        _ => Err("expected NAME=VALUE with a finite number".to_owned()),
    }
}

/// A frame rate.
fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.1..=1000.0).contains(&rate) => Ok(rate),
        _ => Err("expected 0.1 to 1000 frames per second".to_owned()),
    }
}

/// `catenary report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder that a demo wrote
    #[arg(long, default_value = "demo")]
    pub dir: PathBuf,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// What to measure
    #[command(subcommand)]
    pub what: BenchWhat,
}

/// Things to measure.
#[derive(Debug, Subcommand)]
pub enum BenchWhat {
    /// Episodes per core-second of the simulator by fidelity
    Pool {
        /// Model (file or name); none: the soft bar
        #[arg(long)]
        model: Option<PathBuf>,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
    /// Derivatives of tracks by parameters and effects: their error, and their cost in tracks
    Sensitivities {
        /// Model (file or name); none: the soft bar
        #[arg(long)]
        model: Option<PathBuf>,
        /// Random episodes
        #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
        episodes: u64,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
    /// The simulator against theory at each fidelity; fails where a promised bound is missed
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
    /// Whether posteriors are as often right as they say, over truths from the prior; hours for some hundreds
    Calibration(CalibrationArgs),
    /// Networks that see keypoints as a set beside others that see a list, on tracks with keypoints that went wrong
    Networks(NetworksArgs),
    /// Posterior against hidden truths, over seeds
    Inference {
        /// Number of hidden truths
        #[arg(long, default_value_t = 10, allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..=10_000))]
        seeds: u64,
        /// Machine-readable output
        #[command(flatten)]
        output: Output,
    },
}

/// `catenary bench calibration`.
#[derive(Debug, Args)]
pub struct CalibrationArgs {
    /// Truths drawn from the prior, each with an episode and an inference of its own
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u64).range(10..=100_000))]
    pub truths: u64,
    /// Folder for checks.jsonl, which a run that was cut off goes on from, and report.html
    #[arg(long)]
    pub out: PathBuf,
    /// Model (file or name); none: the soft bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// What the model draws anew for each episode, to be inferred with the rest
    #[arg(long)]
    pub also: Vec<String>,
    /// Sizes of the network and the schedule
    #[arg(long, value_enum, default_value = "default")]
    pub preset: Preset,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench networks`.
#[derive(Debug, Args)]
pub struct NetworksArgs {
    /// Tracks of the prior to learn from
    #[arg(long, default_value_t = 1500, value_parser = clap::value_parser!(u64).range(100..=20_000))]
    pub tracks: u64,
    /// Further tracks to look at
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u64).range(10..=10_000))]
    pub truths: u64,
    /// Model (file or name); none: the soft bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// The paper's network, too, with as many steps as its fifteen iterations make; half an hour
    #[arg(long)]
    pub paper: bool,
    /// A JSON file for the tracks and their thetas, for estimators elsewhere
    #[arg(long)]
    pub export: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary bench fidelity`.
#[derive(Debug, Args)]
pub struct FidelityArgs {
    /// Random episodes at the edges of every parameter, at fast and at standard; 0: none
    #[arg(long, default_value_t = 0)]
    pub stress: usize,
    /// Model (file or name) whose prior the random episodes span; none: the soft bar
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary effects`.
#[derive(Debug, Args)]
pub struct EffectsArgs {
    /// Name of an effect to list; several may be given; none: all
    #[arg(long)]
    pub name: Vec<String>,
    /// Model (file or name): say how large each effect must be to show in an episode of it
    #[arg(long, requires = "actions")]
    pub model: Option<PathBuf>,
    /// Actions of that episode: a CSV file with the columns dx_m, dz_m, a row for each step
    #[arg(long, requires = "model")]
    pub actions: Option<PathBuf>,
    /// A parameter's or an effect's value in it, as NAME=VALUE; else the model's nominal one, else its distribution's median
    #[arg(long, requires = "model", value_parser = assignment)]
    pub value: Vec<(String, f64)>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Model (file or name) to check too
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
