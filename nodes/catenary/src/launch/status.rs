//! `catenary status`: the table of a launch, from another terminal. And where logs lie.

use super::table::{State, Table, unix_s};
use crate::cli::Output;
use crate::output;
use crate::wrong_input::Given;
use anyhow::{Context, Result, bail};
use catenary_shell::ros_log_dir;
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The link to the log folder of the launch that was begun last.
const LATEST: &str = "latest_catenary";

/// `catenary status`.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Log folder of the launch; none: the launch that was begun last
    #[arg(long)]
    log: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    output: Output,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Status {
    running: bool,
    #[serde(flatten)]
    table: Table,
}

/// Prints the table; an error where the launch is over or a process of it failed.
pub fn run(arguments: &StatusArgs) -> Result<()> {
    let folder = match &arguments.log {
        Some(folder) => folder.clone(),
        None => logs()?.join(LATEST),
    };
    let table = Table::read(&folder).with_context(|| format!("no launch has its logs in {}", folder.display()))?;
    let status = Status { running: table.is_running(), table };
    output::result(&arguments.output, &status, |s| s.table.words(SystemTime::now()))?;
    let failed = status.table.processes.iter().filter(|row| row.state == State::Failed);
    let failed: Vec<&str> = failed.map(|row| row.name.as_str()).collect();
    match (status.running, &failed[..]) {
        (false, _) => bail!("the launch of {} does not run", status.table.file.display()),
        (true, []) => Ok(()),
        (true, failed) => bail!("the launch runs without {}", failed.join(", ")),
    }
}

/// Where ROS 2 keeps logs.
fn logs() -> Result<PathBuf> {
    ros_log_dir().context("a folder for logs: expected ROS_LOG_DIR, ROS_HOME or HOME to be set, or --log")
}

/// The launch that was begun last, if it runs and `pid` is one of its processes.
pub fn launch_of(pid: u32) -> Option<Table> {
    let table = Table::read(&logs().ok()?.join(LATEST)).ok()?;
    (table.is_running() && table.processes.iter().any(|row| row.pid == Some(pid))).then_some(table)
}

/// The folder for the logs of a launch that begins: the one asked for, else a new one among ROS 2's.
pub fn log_folder(asked: Option<&Path>) -> Result<PathBuf> {
    let folder = match asked {
        Some(folder) => folder.to_owned(),
        None => logs()?.join(format!("{}-{}-{}", date(SystemTime::now()), host(), std::process::id())),
    };
    std::fs::create_dir_all(&folder).with_context(|| format!("log folder {}", folder.display())).given()?;
    std::path::absolute(&folder).with_context(|| format!("log folder {}", folder.display()))
}

/// Has `catenary status` find this launch; where the link cannot be made, it needs `--log`.
pub fn link_latest(folder: &Path) {
    let linked = logs().and_then(|logs| {
        std::fs::create_dir_all(&logs)?;
        let (link, draft) = (logs.join(LATEST), logs.join(format!("{LATEST}-{}", std::process::id())));
        std::os::unix::fs::symlink(folder, &draft)?;
        std::fs::rename(&draft, &link).with_context(|| link.display().to_string())
    });
    if let Err(error) = linked {
        tracing::info!("`catenary status` needs --log {}: {error:#}", folder.display());
    }
}

fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name: String = name.trim().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    if name.is_empty() { "host".to_owned() } else { name }
}

/// A time as `2026-01-31-23-59-59-123456`, UTC. The date by H. Hinnant's `civil_from_days`.
fn date(time: SystemTime) -> String {
    let seconds = unix_s(time);
    let whole = seconds as u64;
    let days = whole / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + 400 * era + u64::from(month <= 2);
    let (hour, minute, second) = (whole / 3600 % 24, whole / 60 % 60, whole % 60);
    let micros = (seconds.fract() * 1e6) as u64;
    format!("{year:04}-{month:02}-{day:02}-{hour:02}-{minute:02}-{second:02}-{micros:06}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0.0, "1970-01-01-00-00-00-000000"),
            (951_782_400.0, "2000-02-29-00-00-00-000000"),
            (1_767_225_599.5, "2025-12-31-23-59-59-500000"),
        ] {
            assert_eq!(date(SystemTime::UNIX_EPOCH + Duration::from_secs_f64(seconds)), expected);
        }
    }
}
