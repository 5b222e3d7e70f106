//! Command line of `catenary`, in clap's derive form.

use crate::bags::args::{InfoArgs, RecordArgs, ReindexArgs, ReplayArgs};
use crate::bench::args::BenchArgs;
use crate::demo::args::{DemoArgs, ReportArgs};
use crate::deploy::args::DeployArgs;
use crate::doctor::args::DoctorArgs;
use crate::effects::args::EffectsArgs;
use crate::evaluate::args::EvaluateArgs;
use crate::find_effects::args::FindEffectsArgs;
use crate::import_track::args::ImportArgs;
use crate::infer::args::InferArgs;
use crate::install::args::InstallArgs;
use crate::launch::args::{LaunchArgs, StatusArgs};
use crate::mask::args::MaskArgs;
use crate::node::args::NodeArgs;
use crate::plan::args::PlanArgs;
use crate::propose::args::ProposeArgs;
use crate::segmenter::args::{LabelArgs, TrainSegmenterArgs};
use crate::simulate::args::SimulateArgs;
use crate::study::args::StudyArgs;
use crate::train::args::TrainArgs;
use crate::train_tracker::args::TrainTrackerArgs;
use clap::{Parser, Subcommand};
use std::ffi::OsString;

/// Exit codes, shown at the end of the help page.
const EXIT_CODES: &str = "\
Exit codes of every command and node:
  0    done
  1    failed at its work: a full disk, no answer, a failure of another node, a
       failed check of `doctor` or `bench`
  2    invalid input, so that the same command fails again: the
       command line, a file that it names, or an environment variable
  3    done and written, but the result does not fit the data, or `mask` has seen
       no object
  130  command interrupted by Ctrl-C; a node that is told to end ends with 0";

/// Real2Sim2Real of deformable linear objects held by a Panda: from one recording to a posterior over the object's
/// parameters, a policy trained over it, and that policy's run on the robot.
#[derive(Debug, Parser)]
#[command(name = "catenary", version = env!("CATENARY_VERSION"), long_about = None, term_width = 80, after_help = EXIT_CODES)]
pub struct Cli {
    /// Command to run
    #[command(subcommand)]
    pub command: Command,
    /// Print more log lines to stderr; twice: all of them
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

/// Commands, in the order in which a newcomer meets them.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The whole loop on a simulated cell, with a report
    Demo(DemoArgs),
    /// Start the processes of a ROS 2 launch file and watch them
    Launch(LaunchArgs),
    /// Show the state of a launch's processes
    Status(StatusArgs),
    /// Run one node, with ROS 2 arguments after --ros-args
    Node(NodeArgs),
    /// Posterior over the model's parameters from a recording
    Infer(InferArgs),
    /// Find where model and recordings disagree, and why
    FindEffects(FindEffectsArgs),
    /// Propose the motions to record next, and what they promise
    Propose(ProposeArgs),
    /// Train a policy in simulation over a prior or a posterior
    Train(TrainArgs),
    /// Search the best open-loop plan of a task, and score it
    Plan(PlanArgs),
    /// Run policies on simulated episodes, and compare them
    Evaluate(EvaluateArgs),
    /// Worth of knowing the object: policies compared by task
    Study(StudyArgs),
    /// Run one episode of a policy on the running graph
    Deploy(DeployArgs),
    /// Record topics of the graph to a bag
    Record(RecordArgs),
    /// Publish a bag's messages at the times of the recording
    Replay(ReplayArgs),
    /// Show a bag's contents, and which parts are missing or damaged
    Info(InfoArgs),
    /// Repair a bag whose recorder was killed
    Reindex(ReindexArgs),
    /// Make a bag from a track in a CSV file
    ImportTrack(ImportArgs),
    /// Show what camera and tracker see, and fit colours to a click
    Mask(MaskArgs),
    /// Write frames with their masks, to be corrected by hand
    Label(LabelArgs),
    /// Train the learned segmenter, also on labelled frames
    TrainSegmenter(TrainSegmenterArgs),
    /// Train a learned tracker on simulated masks
    TrainTracker(TrainTrackerArgs),
    /// Show one episode of a model: figures, bag, video, picture
    Simulate(SimulateArgs),
    /// Build the report of a demo folder again
    Report(ReportArgs),
    /// Measure the simulator, training and inference on this machine
    Bench(BenchArgs),
    /// List the effects that a model may have, with units and priors
    Effects(EffectsArgs),
    /// Install nodes and launch files for `ros2 run` and `launch`
    Install(InstallArgs),
    /// Check this machine and its ROS 2 settings
    Doctor(DoctorArgs),
}

/// Parses a command line without running it. The first word is the program's name.
///
/// # Errors
/// The error that the program would print.
pub fn check_command_line<W: Into<OsString> + Clone>(words: impl IntoIterator<Item = W>) -> Result<(), clap::Error> {
    Cli::try_parse_from(words).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn no_two_arguments_have_the_same_name() {
        Cli::command().debug_assert();
    }
}
