//! `catenary launch`: the equivalent of `ros2 launch` for the same file.

use super::args::LaunchArgs;
use super::description::{LaunchDescription, Process};
use super::reader::read;
use super::supervision::table::{Table, unix_s};
use super::supervision::{Supervisor, logs, neighbours};
use crate::exit::{Given, WrongInput};
use crate::terminal::output;
use anyhow::{Context, Result, bail};
use catenary_shell::Shutdown;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Period of the checks on the processes.
const WATCH: Duration = Duration::from_millis(50);

/// Starts the processes of a launch file and watches them until Ctrl-C or the end of the last one.
pub fn run(arguments: &LaunchArgs) -> Result<()> {
    let given = arguments.arguments.iter().map(|a| argument(a)).collect::<Result<Vec<_>>>().given()?;
    let description = read(&arguments.file, &given, &|name| std::env::var(name).ok()).given()?;
    if arguments.show {
        return show(arguments, &description);
    }
    if description.processes.is_empty() {
        return Err(WrongInput::error(format!("{}: it starts no process", arguments.file.display())));
    }
    refuse_missing(&given, &description).given()?;
    // An invalid domain is reported once here, and not by every node.
    catenary_shell::domain_id()?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    // Before the log folder exists: a refused launch leaves no trace.
    neighbours::refuse_second_graph(&description, &shutdown)?;
    let log = logs::folder(arguments.log.as_deref())?;
    let _closed = writeln!(std::io::stderr(), "catenary launch: logs in {}", log.display());
    let mut board = Board::new(&arguments.file, &log);
    let supervisor = Supervisor::start(description.processes, &log, true)?;
    logs::link_latest(&log);
    let failed = watch(supervisor, &shutdown, &mut board)?;
    // Printed only now: the result is the table at the end.
    if arguments.output.json {
        output::result(&arguments.output, &board.table, |_| String::new())?;
    }
    match failed.is_empty() {
        true => Ok(()),
        false => bail!("ended with an error: {}", failed.join(", ")),
    }
}

/// Watches the processes until the launch ends. Returns the names of the failed ones.
fn watch(mut supervisor: Supervisor, shutdown: &Shutdown, board: &mut Board) -> Result<Vec<String>> {
    let mut failed = Vec::new();
    let mut last = None;
    board.show(&supervisor);
    while !shutdown.is_triggered() && last.is_none() && !supervisor.is_done() {
        for event in supervisor.poll()? {
            tracing::warn!("{}", event.describe());
            if event.ends_launch {
                last = Some(event.name.clone());
            }
            if !event.success && !event.restarting {
                failed.push(event.name);
                if !supervisor.is_done() && last.is_none() {
                    tracing::warn!("the graph runs without {}", failed.join(", "));
                }
            }
        }
        board.show(&supervisor);
        std::thread::sleep(WATCH);
    }
    if let Some(last) = last {
        tracing::warn!("{last} has ended, and the launch ends with it");
    }
    supervisor.shut_down();
    board.close(&supervisor);
    Ok(failed)
}

/// Table of the processes, shared with `catenary status`.
struct Board {
    table: Table,
    on_terminal: bool,
    /// True if the last write failed.
    is_lost: bool,
}

impl Board {
    fn new(file: &Path, log: &Path) -> Self {
        Self { table: Table::new(file, log), on_terminal: std::io::stderr().is_terminal(), is_lost: false }
    }

    /// Writes the table if it has changed, and prints it on a terminal.
    fn show(&mut self, supervisor: &Supervisor) {
        let rows = supervisor.rows();
        if rows == self.table.processes {
            return;
        }
        self.table.processes = rows;
        self.write();
        if self.on_terminal {
            self.print();
        }
    }

    /// Writes the table. A full disk does not end the launch: the failure is reported once.
    fn write(&mut self) {
        let written = self.table.write();
        if let (false, Err(error)) = (self.is_lost, &written) {
            tracing::warn!("`catenary status` cannot show this launch: {error:#}");
        }
        self.is_lost = written.is_err();
    }

    /// Writes and prints the table of a launch that has ended.
    fn close(&mut self, supervisor: &Supervisor) {
        self.table.processes = supervisor.rows();
        self.table.ended_s = Some(unix_s(SystemTime::now()));
        self.write();
        self.print();
    }

    fn print(&self) {
        let _closed = writeln!(std::io::stderr(), "{}", self.table.words(SystemTime::now()));
    }
}

/// Returns an error if a program does not exist and its path begins with the value of a given argument. A missing default
/// folder is fine: this program's own nodes replace it.
fn refuse_missing(given: &[(String, String)], description: &LaunchDescription) -> Result<()> {
    for program in description.processes.iter().filter_map(|p| p.command.first()).map(Path::new) {
        let of_argument = |(_, value): &&(String, String)| !value.is_empty() && program.starts_with(value);
        if let (false, Some((name, value))) = (program.exists(), given.iter().find(of_argument)) {
            bail!("{name}:={value}: expected the folder of the nodes' executables, found no {}", program.display());
        }
    }
    Ok(())
}

/// Splits NAME:=VALUE.
fn argument(text: &str) -> Result<(String, String)> {
    let (name, value) = text.split_once(":=").with_context(|| format!("expected NAME:=VALUE, got `{text}`"))?;
    Ok((name.to_owned(), value.to_owned()))
}

/// Result of `--show`.
#[derive(Serialize)]
struct Shown<'a> {
    arguments: Vec<ShownArgument<'a>>,
    processes: Vec<ShownProcess<'a>>,
}

#[derive(Serialize)]
struct ShownArgument<'a> {
    name: &'a str,
    default: Option<&'a str>,
    description: &'a str,
    choices: &'a [String],
}

/// Process in the result of `--show`. Parameter files that are not written yet are replaced by their contents.
#[derive(Serialize)]
struct ShownProcess<'a> {
    name: &'a str,
    command: Vec<&'a str>,
    environment: &'a BTreeMap<String, Option<String>>,
    directory: Option<&'a PathBuf>,
    respawn: bool,
    respawn_delay_s: f64,
    respawn_max_retries: Option<u32>,
    sigterm_timeout_s: f64,
    sigkill_timeout_s: f64,
}

impl<'a> ShownProcess<'a> {
    fn new(process: &'a Process) -> Self {
        let mut command: Vec<&str> = process.command.iter().map(String::as_str).collect();
        process.parameters.iter().for_each(|p| command[p.word] = &p.yaml);
        Self {
            name: &process.name,
            command,
            environment: &process.environment,
            directory: process.directory.as_ref(),
            respawn: process.restart.respawn,
            respawn_delay_s: process.restart.delay.as_secs_f64(),
            respawn_max_retries: process.restart.limit,
            sigterm_timeout_s: process.grace.interrupted.as_secs_f64(),
            sigkill_timeout_s: process.grace.terminated.as_secs_f64(),
        }
    }
}

fn show(arguments: &LaunchArgs, description: &LaunchDescription) -> Result<()> {
    let shown = Shown {
        arguments: description
            .arguments
            .iter()
            .map(|a| ShownArgument {
                name: &a.name,
                default: a.default.as_deref(),
                description: &a.description,
                choices: &a.choices,
            })
            .collect(),
        processes: description.processes.iter().map(ShownProcess::new).collect(),
    };
    output::result(&arguments.output, &shown, |s| {
        let argument = |a: &ShownArgument<'_>| {
            let choices = if a.choices.is_empty() { String::new() } else { format!("; {}", a.choices.join(" or ")) };
            format!("  {} ({}): {}{choices}", a.name, a.default.unwrap_or("must be given"), a.description)
        };
        let process = |p: &ShownProcess<'_>| format!("  {}: {}", p.name, p.command.join(" "));
        let arguments: Vec<String> = s.arguments.iter().map(argument).collect();
        let processes: Vec<String> = s.processes.iter().map(process).collect();
        format!("arguments\n{}\nprocesses\n{}", arguments.join("\n"), processes.join("\n"))
    })
}
