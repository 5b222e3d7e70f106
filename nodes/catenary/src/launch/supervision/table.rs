//! Table of a launch: its processes with their states, times and restarts. The launch writes it to its log folder at
//! each change, and `catenary status` reads it from there.

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Name of the table in the log folder.
const FILE: &str = "status.json";

/// Table of a launch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Path of the launch file.
    pub file: PathBuf,
    /// Process number of the launch.
    pub pid: u32,
    /// Start of that process in ticks of the kernel. It tells the process from a later one with the same number.
    pub began_ticks: u64,
    /// Start of the launch, Unix time in s.
    pub since_s: f64,
    /// End of the launch, Unix time in s; `None` while it runs, or if it was killed.
    pub ended_s: Option<f64>,
    /// Folder of the processes' logs.
    pub log: PathBuf,
    /// Processes in the order of the launch file.
    pub processes: Vec<Row>,
}

/// Process of a launch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the process.
    pub name: String,
    /// Process number, while it runs.
    pub pid: Option<u32>,
    /// State of the process.
    pub state: State,
    /// Start of this state, Unix time in s.
    pub since_s: f64,
    /// Number of restarts so far.
    pub restarts: u32,
    /// Largest number of restarts; `None`: no restarts, or no limit.
    pub restart_limit: Option<u32>,
    /// Last end of the process.
    pub last_exit: Option<Exit>,
    /// Log of the process.
    pub log: PathBuf,
}

/// State of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Running.
    Running,
    /// Waiting for a restart.
    Waiting,
    /// Ended by itself, successfully.
    Ended,
    /// Ended with an error, and not restarted.
    Failed,
    /// Ended by the launch.
    Stopped,
}

/// End of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Exit {
    /// Exit by itself, with this code.
    Code(i32),
    /// Death by this signal.
    Signal(i32),
}

impl Table {
    /// Table of a launch that this process starts.
    pub fn new(file: &Path, log: &Path) -> Self {
        let pid = std::process::id();
        Self {
            file: file.to_owned(),
            pid,
            began_ticks: began_ticks(pid).unwrap_or_default(),
            since_s: unix_s(SystemTime::now()),
            ended_s: None,
            log: std::path::absolute(log).unwrap_or_else(|_| log.to_owned()),
            processes: Vec::new(),
        }
    }

    /// Writes the table atomically, so that a reader finds the old or the new one.
    pub fn write(&self) -> Result<()> {
        catenary_shell::files::write(&self.log.join(FILE), serde_json::to_vec_pretty(self)?)
    }

    /// Reads the table of the launch with this log folder.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        serde_json::from_str(&text).with_context(|| format!("{}: no table of a launch", path.display()))
    }

    /// Names of the processes that outlived a killed launch: their numbers are taken by processes that started after
    /// it.
    fn survivors(&self) -> Vec<&str> {
        let lives = |row: &&Row| row.pid.and_then(began_ticks).is_some_and(|ticks| ticks >= self.began_ticks);
        self.processes.iter().filter(lives).map(|row| row.name.as_str()).collect()
    }

    /// True if the launch itself still runs.
    pub fn is_running(&self) -> bool {
        self.ended_s.is_none() && began_ticks(self.pid) == Some(self.began_ticks)
    }

    /// Table as text.
    pub fn words(&self, now: SystemTime) -> String {
        let until_now = |since_s: f64| duration((unix_s(now) - since_s).max(0.0));
        let launch = match self.ended_s {
            Some(ended) => format!("ended after {}", duration(ended - self.since_s)),
            None if self.is_running() => format!("process {}, for {}", self.pid, until_now(self.since_s)),
            // A launch killed by SIGKILL could not write its end.
            None => match self.survivors().as_slice() {
                [] => "was killed, and its processes with it".to_owned(),
                names => format!("was killed, and {} may still run", names.join(", ")),
            },
        };
        let title = ["name", "pid", "state", "for", "restarts", "last exit", "log"].map(str::to_owned);
        let rows = self.processes.iter().map(|row| {
            let name = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let limit = row.restart_limit.map_or_else(String::new, |limit| format!(" of {limit}"));
            [
                row.name.clone(),
                row.pid.map_or_else(|| "-".to_owned(), |pid| pid.to_string()),
                format!("{:?}", row.state).to_lowercase(),
                until_now(row.since_s),
                format!("{}{limit}", row.restarts),
                row.last_exit.map_or_else(|| "-".to_owned(), Exit::words),
                name(&row.log),
            ]
        });
        let rows: Vec<[String; 7]> = std::iter::once(title).chain(rows).collect();
        let widths: [usize; 7] = std::array::from_fn(|i| rows.iter().map(|row| row[i].len()).max().unwrap_or(0));
        let line = |row: &[String; 7]| {
            let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}"));
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
        };
        let lines: Vec<String> = rows.iter().map(line).collect();
        format!("{}: {launch}; logs in {}\n{}", self.file.display(), self.log.display(), lines.join("\n"))
    }
}

impl Exit {
    fn words(self) -> String {
        match self {
            Self::Code(code) => format!("code {code}"),
            Self::Signal(signal) => format!("signal {signal}"),
        }
    }
}

/// Unix time in s.
pub fn unix_s(time: SystemTime) -> f64 {
    time.duration_since(SystemTime::UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs_f64()
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 60.0 => format!("{s:.0} s"),
        s if s < 3600.0 => format!("{:.0} min {:.0} s", (s / 60.0).floor(), s % 60.0),
        s => format!("{:.0} h {:.0} min", (s / 3600.0).floor(), (s % 3600.0 / 60.0).floor()),
    }
}

/// Start of a process in the kernel's ticks since boot. `None` if there is no such process, or if it is a zombie.
fn began_ticks(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = text.rsplit_once(") ")?.1.split(' ');
    // Fields 3 and 22 of proc(5); the first two are cut off with the name.
    if fields.next()? == "Z" { None } else { fields.nth(18)?.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read_back_and_tells_who_runs() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = Table::new(Path::new("sim.launch.xml"), folder.path());
        let row = Row {
            name: "camera".into(),
            pid: Some(77),
            state: State::Running,
            since_s: table.since_s - 75.0,
            restarts: 1,
            restart_limit: Some(10),
            last_exit: Some(Exit::Signal(9)),
            log: folder.path().join("camera.log"),
        };
        table.processes = vec![row];
        table.write().unwrap();
        assert_eq!(Table::read(folder.path()).unwrap(), table);
        assert!(table.is_running());
        let words = table.words(SystemTime::now());
        let cells: Vec<&str> =
            words.lines().last().unwrap().split("  ").map(str::trim).filter(|c| !c.is_empty()).collect();
        assert_eq!(cells, ["camera", "77", "running", "1 min 15 s", "1 of 10", "signal 9", "camera.log"], "{words}");
        let killed = Table { began_ticks: 1, ..table };
        assert!(!killed.is_running() && killed.words(SystemTime::now()).contains("was killed"));
    }
}
