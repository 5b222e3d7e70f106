//! Supervisor of a launch's processes: it starts them, watches them, restarts them on request, and ends them in order.

use super::table::{Row, State};
use super::watched::Watched;
use crate::launch::description::Process;
use anyhow::{Context, Result};
use rustix::process::Signal;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::{Duration, Instant};

/// Exit code of a node whose command line, parameters or environment are wrong. A restart would fail in the same way.
const USAGE: i32 = 2;
/// Time after SIGKILL in which a process ends, unless it waits in the kernel.
const BEYOND_REACH: Duration = Duration::from_secs(2);
/// Lines of a log that are read when its process fails.
const TAIL_LINES: usize = 5;

/// End of a process.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeEvent {
    /// Name of the process.
    pub name: String,
    /// End of the process in words.
    pub how: String,
    /// True if the process ended with exit code 0.
    pub success: bool,
    /// True if the process is being restarted.
    pub restarting: bool,
    /// Reason why the process is not restarted although the launch file asks for it.
    pub given_up: Option<String>,
    /// True if the launch ends with the process.
    pub ends_launch: bool,
    /// Log of the process.
    pub log: PathBuf,
}

impl NodeEvent {
    /// Event in one line; for a failure, with the last line of the log.
    pub fn describe(&self) -> String {
        let next = match &self.given_up {
            Some(reason) => format!("not restarted: {reason}"),
            None if self.restarting => "restarting".to_owned(),
            None => "not restarted".to_owned(),
        };
        let tail = if self.success { Vec::new() } else { tail(&self.log) };
        let words = tail.last().map_or(String::new(), |line| format!(": {line}"));
        format!("{} {}{words} ({next}; log {})", self.name, self.how, self.log.display())
    }
}

/// Last lines of a log.
fn tail(log: &Path) -> Vec<String> {
    let text = std::fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).collect();
    lines[lines.len().saturating_sub(TAIL_LINES)..].iter().map(|l| (*l).to_owned()).collect()
}

/// Running processes of a launch. Dropping the supervisor ends them.
pub struct Supervisor {
    watched: Vec<Watched>,
    echo: bool,
}

impl Supervisor {
    /// Starts every process in order. The output of each goes to `log_folder/NAME.log`. With `echo`, the streams that
    /// the process asks for go to stderr too.
    pub fn start(processes: Vec<Process>, log_folder: &Path, echo: bool) -> Result<Self> {
        std::fs::create_dir_all(log_folder).with_context(|| format!("log folder {}", log_folder.display()))?;
        let watched = processes.into_iter().map(|p| Watched::new(p, log_folder)).collect::<Result<Vec<_>>>()?;
        let mut supervisor = Self { watched, echo };
        for watched in &mut supervisor.watched {
            watched.spawn(echo)?;
        }
        Ok(supervisor)
    }

    /// Processor time of each live process by name, s.
    pub fn cpu_seconds(&self) -> Vec<(String, f64)> {
        let pid = |w: &Watched| w.pid().map(|pid| pid.as_raw_nonzero().get().cast_unsigned());
        let seconds = |w: &Watched| Some((w.process.name.clone(), process_cpu_seconds(pid(w)?)?));
        self.watched.iter().filter_map(seconds).collect()
    }

    /// Rows of the table, in the order of the start.
    pub fn rows(&self) -> Vec<Row> {
        self.watched.iter().map(Watched::row).collect()
    }

    /// Events since the last call. Processes whose restart is due are restarted.
    pub fn poll(&mut self) -> Result<Vec<NodeEvent>> {
        let mut events = Vec::new();
        for w in &mut self.watched {
            if let Some(status) = w.take_exit()? {
                events.push(ended(w, how(status), status.success(), status.code() == Some(USAGE)));
            }
            if w.restart_at.is_some_and(|t| Instant::now() >= t) {
                w.restart_at = None;
                w.restarts += 1;
                if let Err(error) = w.spawn(self.echo) {
                    events.push(ended(w, format!("could not be restarted: {error:#}"), false, false));
                }
            }
        }
        Ok(events)
    }

    /// True if no process runs or waits for a restart.
    pub fn is_done(&self) -> bool {
        self.watched.iter().all(|w| !w.is_started() && w.restart_at.is_none())
    }

    /// Ends all processes and their children, the last started first. It sends SIGINT, after the first time limit
    /// SIGTERM, after the second SIGKILL.
    pub fn shut_down(&mut self) {
        let begun = Instant::now();
        for w in self.watched.iter_mut().rev() {
            if w.restart_at.take().is_some() {
                w.set(State::Stopped);
            }
            w.signal(Signal::INT);
        }
        let mut sent = vec![Signal::INT; self.watched.len()];
        let longest = self.watched.iter().map(|w| w.process.grace.interrupted + w.process.grace.terminated).max();
        let deadline = begun + longest.unwrap_or_default() + BEYOND_REACH;
        while self.watched.iter().any(Watched::is_started) && Instant::now() < deadline {
            for (w, sent) in self.watched.iter_mut().zip(&mut sent).rev() {
                if !matches!(w.take_exit(), Ok(None)) {
                    w.set(State::Stopped);
                    continue;
                }
                let grace = w.process.grace;
                let next = match *sent {
                    Signal::INT if begun.elapsed() >= grace.interrupted => Signal::TERM,
                    Signal::TERM if begun.elapsed() >= grace.interrupted + grace.terminated => Signal::KILL,
                    _ => continue,
                };
                if w.is_started() {
                    let seconds = begun.elapsed().as_secs_f64();
                    tracing::warn!("{} did not end within {seconds:.1} s: {}", w.process.name, signal_name(next));
                    w.signal(next);
                }
                *sent = next;
            }
            // Short against the time limits, and long enough not to load the machine.
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.shut_down();
    }
}

/// Records an end and decides on a restart.
fn ended(w: &mut Watched, how: String, success: bool, refused: bool) -> NodeEvent {
    let restart = w.process.restart;
    let given_up = match restart.limit {
        _ if !restart.respawn => None,
        // ROS 2's launch would restart it, and it would fail again.
        _ if refused => Some("it refuses its arguments".to_owned()),
        Some(limit) if w.restarts >= limit => Some(format!("it was restarted {limit} times, which is its limit")),
        _ => None,
    };
    let restarting = restart.respawn && given_up.is_none() && !w.process.ends_launch;
    w.restart_at = restarting.then(|| Instant::now() + restart.delay);
    w.set(match (restarting, success) {
        (true, _) => State::Waiting,
        (false, true) => State::Ended,
        (false, false) => State::Failed,
    });
    NodeEvent {
        name: w.process.name.clone(),
        how,
        success,
        restarting,
        given_up,
        ends_launch: w.process.ends_launch,
        log: w.log.clone(),
    }
}

/// End of a process in words.
fn how(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(0), _) => "ended".to_owned(),
        (Some(code), _) => format!("failed with exit code {code}"),
        (None, Some(signal)) => format!("was killed by signal {signal}"),
        (None, None) => "ended in an unknown way".to_owned(),
    }
}

fn signal_name(signal: Signal) -> &'static str {
    if signal == Signal::TERM { "SIGTERM" } else { "SIGKILL" }
}

/// User and system time of a process in s, from /proc. A tick is 1/100 s on Linux.
fn process_cpu_seconds(pid: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let fields: Vec<&str> = text.rsplit_once(") ")?.1.split(' ').collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    // Fields 14 and 15 of proc(5); the first two are cut off with the name.
    Some((ticks(11)? + ticks(12)?) / 100.0)
}
