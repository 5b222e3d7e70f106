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
mod effects;
mod evaluate;
mod figures;
mod find_effects;
mod goal;
mod import;
mod infer;
mod install;
mod interrupted;
mod launch;
mod misfit;
mod model_file;
mod nodes;
mod one_arm;
mod output;
mod policy_file;
mod progress;
mod report;
mod served;
mod shipped;
mod simulate;
mod theta;
mod train;
mod wrong_input;

use clap::Parser;
use clap::error::ErrorKind;
use cli::{Cli, Command};
use interrupted::Interrupted;
use misfit::Misfit;
use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use wrong_input::WrongInput;

/// Gives back what a node does not use any more. With glibc's, whose heap only shrinks at its end, a recorder of images and
/// states of many sizes grew by a megabyte every few minutes while what it used stayed the same.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    // Commands that take part in a graph leave it however they end.
    let _leaving = catenary_shell::LeaveAtEnd;
    // A node reads its own command line, in ROS 2's form.
    let mut arguments = std::env::args_os();
    let called = arguments.next().and_then(|path| Some(Path::new(&path).file_name()?.to_str()?.to_owned()));
    let arguments: Vec<OsString> = arguments.collect();
    if let Some(name) = called.filter(|name| nodes::is_node(name)) {
        return catenary_shell::in_unicode(&arguments).map_or_else(|code| code, |words| nodes::run(&name, words));
    }
    if let [command, name, rest @ ..] = &arguments[..]
        && command == "node"
        && let Some(name) = name.to_str().filter(|name| !name.starts_with('-'))
    {
        return catenary_shell::in_unicode(rest).map_or_else(|code| code, |words| nodes::run(name, words));
    }
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return refuse(&error),
    };
    start_logs(cli.verbose);
    match run(&cli) {
        // First of all: whatever else was said follows from it.
        _ if catenary_shell::is_network_lost() => {
            let _closed = writeln!(std::io::stderr(), "catenary: {}", catenary_shell::LOST);
            ExitCode::FAILURE
        }
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _closed = writeln!(std::io::stderr(), "catenary: {}", catenary_shell::in_one_line(&error));
            match &error {
                error if error.is::<Interrupted>() => ExitCode::from(Interrupted::EXIT_CODE),
                error if error.is::<Misfit>() => ExitCode::from(Misfit::EXIT_CODE),
                error if WrongInput::is(error) => ExitCode::from(WrongInput::EXIT_CODE),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

/// Shows help where it was asked for; else says what is wrong with the command line, in one line.
fn refuse(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.exit();
    }
    let text = error.to_string();
    let said = text.split("\n\nUsage:").next().and_then(|t| t.split("\n\nFor more").next()).unwrap_or(&text);
    let words: Vec<&str> = said.split_whitespace().collect();
    let words = words.join(" ");
    let words = words.strip_prefix("error: ").unwrap_or(&words);
    let _closed = writeln!(std::io::stderr(), "catenary: {words}; --help lists what there is");
    ExitCode::from(WrongInput::EXIT_CODE)
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
        Command::Status(arguments) => launch::status::run(arguments),
        Command::Node(_) => nodes::list(),
        Command::Deploy(arguments) => deploy::run(arguments),
        Command::Report(arguments) => {
            let page = demo::rebuild(&arguments.dir)?;
            output::result(&arguments.output, &serde_json::json!({ "page": page }), |_| page.display().to_string())
        }
        Command::Effects(arguments) => effects::run(arguments),
        Command::Doctor(arguments) => doctor::run(arguments),
        Command::Infer(arguments) => infer::run(arguments),
        Command::FindEffects(arguments) => find_effects::run(arguments),
        Command::Train(arguments) => train::run(arguments),
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::ImportTrack(arguments) => import::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Record(arguments) => bags::run_record(arguments),
        Command::Replay(arguments) => bags::run_replay(arguments),
        Command::Install(arguments) => install::run(arguments),
        Command::Info(arguments) => bags::run_info(arguments),
        Command::Reindex(arguments) => bags::run_reindex(arguments),
    }
}
