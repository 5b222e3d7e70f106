//! The command line of catenary, and its nodes under one roof.
#![allow(
    clippy::disallowed_methods,
    reason = "the program at the edge: files, clocks, processes and the environment are its trade"
)]

mod bags;
mod bench;
mod cli;
mod demo;
mod deploy;
mod doctor;
mod figures;
mod import;
mod infer;
mod launch;
mod model_file;
mod nodes;
mod output;
mod report;
mod train;

use clap::Parser;
use cli::{Cli, Command};
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    // A node reads its own command line, in ROS 2's form.
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [command, name, rest @ ..] = &arguments[..]
        && command == "node"
        && !name.starts_with('-')
    {
        return nodes::run(name, rest.to_vec());
    }
    let cli = Cli::parse();
    start_logs(cli.verbose);
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _closed = writeln!(std::io::stderr(), "catenary: {}", format!("{error:#}").replace('\n', " "));
            ExitCode::FAILURE
        }
    }
}

/// Logs go to stderr: warnings and errors, with -v what goes on, with -vv everything of ours.
fn start_logs(verbose: u8) {
    let level = ["warn", "info", "debug"][usize::from(verbose.min(2))];
    let arguments = ["--ros-args", "--log-level", level];
    if let Ok((arguments, _)) = catenary_shell::RosArgs::parse(arguments) {
        catenary_shell::init_logging("catenary", &arguments);
    }
}

fn run(cli: &Cli) -> anyhow::Result<()> {
    match &cli.command {
        Command::Demo(arguments) => demo::run(arguments),
        Command::Launch(arguments) => launch::command::run(arguments),
        Command::Node(_) => nodes::list(),
        Command::Deploy(arguments) => deploy::run(arguments),
        Command::Report(arguments) => {
            tracing::info!("{}", demo::rebuild(&arguments.dir)?.display());
            Ok(())
        }
        Command::Doctor(arguments) => doctor::run(arguments),
        Command::Infer(arguments) => infer::run(arguments),
        Command::Train(arguments) => train::run(arguments),
        Command::ImportTrack(arguments) => import::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Record(arguments) => bags::run_record(arguments),
        Command::Replay(arguments) => bags::run_replay(arguments),
    }
}
