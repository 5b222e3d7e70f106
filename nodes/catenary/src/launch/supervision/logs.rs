//! Log folders of launches, and the link to the newest one.

use super::table::{Table, unix_s};
use crate::exit::Given;
use anyhow::{Context, Result};
use catenary_shell::ros_log_dir;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Name of the link to the log folder of the newest launch.
const LATEST: &str = "latest_catenary";

/// Folder of ROS 2's logs.
fn logs() -> Result<PathBuf> {
    ros_log_dir().context("a folder for logs: expected ROS_LOG_DIR, ROS_HOME or HOME to be set, or --log")
}

/// Link to the log folder of the newest launch.
pub fn latest() -> Result<PathBuf> {
    Ok(logs()?.join(LATEST))
}

/// Table of the newest launch, if it runs and `pid` is one of its processes.
pub fn launch_of(pid: u32) -> Option<Table> {
    let table = Table::read(&latest().ok()?).ok()?;
    (table.is_running() && table.processes.iter().any(|row| row.pid == Some(pid))).then_some(table)
}

/// Launch file of the newest launch, if it runs.
pub fn running_launch() -> Option<PathBuf> {
    let table = Table::read(&latest().ok()?).ok()?;
    table.is_running().then_some(table.file)
}

/// Log folder of a new launch: the requested one, else a new one in ROS 2's log folder. The folder is created.
pub fn folder(asked: Option<&Path>) -> Result<PathBuf> {
    let folder = match asked {
        Some(folder) => folder.to_owned(),
        None => logs()?.join(format!("{}-{}-{}", date(SystemTime::now()), host(), std::process::id())),
    };
    std::fs::create_dir_all(&folder).with_context(|| format!("log folder {}", folder.display())).given()?;
    std::path::absolute(&folder).with_context(|| format!("log folder {}", folder.display()))
}

/// Links this launch as the newest, for `catenary status`. A failure is only logged: `--log` still finds the launch.
pub fn link_latest(folder: &Path) {
    let linked = logs().and_then(|logs| {
        std::fs::create_dir_all(&logs)?;
        // Made under another name and renamed: two launches at once leave one whole link.
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

/// Time as `2026-01-31-23-59-59-123456`, UTC. The date follows H. Hinnant's `civil_from_days`.
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
    fn dates_agree_with_the_calendar() {
        for (seconds, expected) in [
            (0.0, "1970-01-01-00-00-00-000000"),
            (951_782_400.0, "2000-02-29-00-00-00-000000"),
            (1_767_225_599.5, "2025-12-31-23-59-59-500000"),
        ] {
            assert_eq!(date(SystemTime::UNIX_EPOCH + Duration::from_secs_f64(seconds)), expected);
        }
    }
}
