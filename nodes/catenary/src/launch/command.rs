//! `catenary launch`: what `ros2 launch` does with the same file.

use super::{LaunchDescription, Supervisor, read};
use crate::cli::LaunchArgs;
use crate::output;
use anyhow::{Context, Result, bail};
use catenary_shell::Shutdown;
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// How often the processes are looked after.
const WATCH: Duration = Duration::from_millis(100);

/// What `--show` prints.
#[derive(Serialize)]
struct Shown {
    arguments: Vec<(String, Option<String>, String)>,
    processes: Vec<(String, String)>,
}

/// Starts the processes of a launch file and watches them until Ctrl-C, or until the last has ended.
pub fn run(arguments: &LaunchArgs) -> Result<()> {
    let given = arguments.arguments.iter().map(|a| argument(a)).collect::<Result<Vec<_>>>()?;
    let description = read(&arguments.file, &given, &|name| std::env::var(name).ok())?;
    if arguments.show {
        return show(arguments, &description);
    }
    if description.processes.is_empty() {
        bail!("{}: it starts no process", arguments.file.display());
    }
    refuse_missing(&given, &description)?;
    // What every node would refuse is refused once.
    catenary_shell::domain_id()?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let mut supervisor = Supervisor::start(description.processes, &arguments.log, true)?;
    let mut failed = Vec::new();
    while !shutdown.is_triggered() && !supervisor.is_done() {
        for event in supervisor.poll()? {
            tracing::warn!("{}", event.describe());
            if !event.success && !event.restarting {
                failed.push(event.name);
                if !supervisor.is_done() {
                    tracing::warn!("the graph runs without {}", failed.join(", "));
                }
            }
        }
        std::thread::sleep(WATCH);
    }
    supervisor.shut_down();
    match failed.is_empty() {
        true => Ok(()),
        false => bail!("ended with an error: {}", failed.join(", ")),
    }
}

/// Refuses a folder of executables that was asked for and is not there; that of the file itself gives way to this program's
/// own nodes.
fn refuse_missing(given: &[(String, String)], description: &LaunchDescription) -> Result<()> {
    for program in description.processes.iter().filter_map(|p| p.command.first()).map(Path::new) {
        let of_argument = |(_, value): &&(String, String)| !value.is_empty() && program.starts_with(value);
        if let (false, Some((name, value))) = (program.exists(), given.iter().find(of_argument)) {
            bail!("{name}:={value}: expected the folder of the nodes' executables, found no {}", program.display());
        }
    }
    Ok(())
}

/// NAME:=VALUE as a pair.
fn argument(text: &str) -> Result<(String, String)> {
    let (name, value) = text.split_once(":=").with_context(|| format!("expected NAME:=VALUE, got `{text}`"))?;
    Ok((name.to_owned(), value.to_owned()))
}

fn show(arguments: &LaunchArgs, description: &LaunchDescription) -> Result<()> {
    let shown = Shown {
        arguments: description
            .arguments
            .iter()
            .map(|a| (a.name.clone(), a.default.clone(), a.description.clone()))
            .collect(),
        processes: description.processes.iter().map(|p| (p.name.clone(), p.command.join(" "))).collect(),
    };
    output::result(&arguments.output, &shown, |s| {
        let argument = |(name, default, description): &(String, Option<String>, String)| {
            format!("  {name} ({}): {description}", default.as_deref().unwrap_or("must be given"))
        };
        let process = |(name, command): &(String, String)| format!("  {name}: {command}");
        let arguments: Vec<String> = s.arguments.iter().map(argument).collect();
        let processes: Vec<String> = s.processes.iter().map(process).collect();
        format!("arguments\n{}\nprocesses\n{}", arguments.join("\n"), processes.join("\n"))
    })
}
