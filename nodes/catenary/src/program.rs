//! Entry point: the program acts as the node that it is called as, or runs a command.

use crate::cli::{Cli, Command};
use crate::exit::{Interrupted, Misfit, Unseen, WrongInput};
use crate::{
    bags, bench, demo, deploy, doctor, effects, evaluate, find_effects, import_track, infer, install, launch, mask,
    node, plan, propose, segmenter, simulate, study, train, train_tracker,
};
use clap::Parser;
use clap::error::ErrorKind;
use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// Runs the program with the arguments of the process, and returns its exit code.
pub fn main() -> ExitCode {
    // Commands that take part in a graph leave it at every kind of end.
    let _leaving = catenary_shell::LeaveAtEnd;
    // A node parses its own command line, which has ROS 2's form.
    let mut arguments = std::env::args_os();
    let called = arguments.next().and_then(|path| Some(Path::new(&path).file_name()?.to_str()?.to_owned()));
    let arguments: Vec<OsString> = arguments.collect();
    if let Some(name) = called.filter(|name| node::is_node(name)) {
        return catenary_shell::in_unicode(&arguments).map_or_else(|code| code, |words| node::run(&name, words));
    }
    if let [command, name, rest @ ..] = &arguments[..]
        && command == "node"
        && let Some(name) = name.to_str().filter(|name| !name.starts_with('-'))
    {
        return catenary_shell::in_unicode(rest).map_or_else(|code| code, |words| node::run(name, words));
    }
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return refuse(&error),
    };
    start_logs(cli.verbose);
    match run(&cli) {
        // Checked first, because every other error follows from it.
        _ if catenary_shell::is_network_lost() => {
            let _closed = writeln!(std::io::stderr(), "catenary: {}", catenary_shell::LOST);
            ExitCode::FAILURE
        }
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _closed = writeln!(std::io::stderr(), "catenary: {}", catenary_shell::in_one_line(&error));
            match &error {
                error if Interrupted::is(error) => ExitCode::from(Interrupted::EXIT_CODE),
                error if error.is::<Misfit>() => ExitCode::from(Misfit::EXIT_CODE),
                error if error.is::<Unseen>() => ExitCode::from(Unseen::EXIT_CODE),
                error if WrongInput::is(error) => ExitCode::from(WrongInput::EXIT_CODE),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

/// Prints help if requested, else the error of the command line in one line.
fn refuse(error: &clap::Error) -> ExitCode {
    // clap prints requested help to stdout, and help on a missing command to stderr.
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.exit();
    }
    let text = error.to_string();
    // clap's message has several lines; a log of a script keeps one.
    let said = text.split("\n\nUsage:").next().and_then(|t| t.split("\n\nFor more").next()).unwrap_or(&text);
    let words: Vec<&str> = said.split_whitespace().collect();
    let words = words.join(" ");
    let words = words.strip_prefix("error: ").unwrap_or(&words);
    let given: Vec<String> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let hint = bags::order::hint(error, &given).map_or_else(String::new, |hint| format!(": {hint}"));
    let _closed = writeln!(std::io::stderr(), "catenary: {words}{hint}; see --help");
    ExitCode::from(WrongInput::EXIT_CODE)
}

/// Starts logging to stderr: warnings and errors; with -v also information, with -vv all of our log lines.
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
        Command::Node(_) => node::list(),
        Command::Deploy(arguments) => deploy::run(arguments),
        Command::Report(arguments) => demo::run_report(arguments),
        Command::Effects(arguments) => effects::run(arguments),
        Command::Doctor(arguments) => doctor::run(arguments),
        Command::Infer(arguments) => infer::run(arguments),
        Command::Mask(arguments) => mask::run(arguments),
        Command::Label(arguments) => segmenter::label(arguments),
        Command::TrainSegmenter(arguments) => segmenter::train(arguments),
        Command::TrainTracker(arguments) => train_tracker::run(arguments),
        Command::FindEffects(arguments) => find_effects::run(arguments),
        Command::Train(arguments) => train::run(arguments),
        Command::Plan(arguments) => plan::run(arguments),
        Command::Propose(arguments) => propose::run(arguments),
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::ImportTrack(arguments) => import_track::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Study(arguments) => study::run(arguments),
        Command::Record(arguments) => bags::record::run(arguments),
        Command::Replay(arguments) => bags::replay::run(arguments),
        Command::Install(arguments) => install::run(arguments),
        Command::Info(arguments) => bags::info::run(arguments),
        Command::Reindex(arguments) => bags::reindex::run(arguments),
    }
}
