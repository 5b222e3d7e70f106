//! `catenary status`: the table of a launch, shown from another terminal.

use super::args::StatusArgs;
use super::supervision::logs;
use super::supervision::table::{State, Table};
use crate::terminal::output;
use anyhow::{Context, Result, bail};
use serde::Serialize;
use std::time::SystemTime;

/// Result in the form of `--json`.
#[derive(Serialize)]
struct Status {
    running: bool,
    #[serde(flatten)]
    table: Table,
}

/// Prints the table. Returns an error if the launch has ended or one of its processes has failed.
pub fn run(arguments: &StatusArgs) -> Result<()> {
    let folder = match &arguments.log {
        Some(folder) => folder.clone(),
        None => logs::latest()?,
    };
    let table = Table::read(&folder).with_context(|| format!("no launch has its logs in {}", folder.display()))?;
    let status = Status { running: table.is_running(), table };
    output::result(&arguments.output, &status, |s| s.table.words(SystemTime::now()))?;
    let failed = status.table.processes.iter().filter(|row| row.state == State::Failed);
    let failed: Vec<&str> = failed.map(|row| row.name.as_str()).collect();
    match (status.running, &failed[..]) {
        (false, _) => bail!("the launch of {} is not running", status.table.file.display()),
        (true, []) => Ok(()),
        (true, failed) => bail!("the launch runs without {}", failed.join(", ")),
    }
}
