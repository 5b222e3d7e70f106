//! Processes of a launch: started together, watched, restarted where asked for, ended in order.

use super::description::Process;
use super::table::{Row, State};
use super::watched::Watched;
use anyhow::{Context, Result};
use rustix::process::Signal;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::{Duration, Instant};

/// Exit code of a node whose command line, parameters or environment are wrong: starting it again would not help.
const USAGE: i32 = 2;
/// Time after SIGKILL in which a process ends, unless the kernel keeps it.
const BEYOND_REACH: Duration = Duration::from_secs(2);
/// Lines of a log that are shown when its process ends badly.
const TAIL_LINES: usize = 5;

/// Something that happened to a process.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeEvent {
    /// Name of the process.
    pub name: String,
    /// How it ended, in words.
    pub how: String,
    /// Whether it ended well.
    pub success: bool,
    /// Whether it is being started again.
    pub restarting: bool,
    /// Why it is not started again though the launch file asks for it.
    pub given_up: Option<String>,
    /// Whether the launch ends with it.
    pub ends_launch: bool,
    /// Where its output is.
    pub log: PathBuf,
}

impl NodeEvent {
    /// The event in one line, with the last words of the process where it failed.
    pub fn describe(&self) -> String {
        let next = match &self.given_up {
            Some(reason) => format!("not restarted: {reason}"),
            None if self.restarting => "starting it again".to_owned(),
            None => "not restarted".to_owned(),
        };
        let tail = if self.success { Vec::new() } else { tail(&self.log) };
        let words = tail.last().map_or(String::new(), |line| format!(": {line}"));
        format!("{} {}{words} ({next}; log {})", self.name, self.how, self.log.display())
    }
}

/// The last lines of a log.
fn tail(log: &Path) -> Vec<String> {
    let text = std::fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).collect();
    lines[lines.len().saturating_sub(TAIL_LINES)..].iter().map(|l| (*l).to_owned()).collect()
}

/// The running processes of a launch. Dropping it ends them.
pub struct Supervisor {
    watched: Vec<Watched>,
    echo: bool,
}

impl Supervisor {
    /// Starts every process, in order; each one's output goes to `log_folder/NAME.log`, and with `echo` to stderr too, as far
    /// as the process asks for it.
    pub fn start(processes: Vec<Process>, log_folder: &Path, echo: bool) -> Result<Self> {
        std::fs::create_dir_all(log_folder).with_context(|| format!("log folder {}", log_folder.display()))?;
        let watched = processes.into_iter().map(|p| Watched::new(p, log_folder)).collect::<Result<Vec<_>>>()?;
        let mut supervisor = Self { watched, echo };
        for watched in &mut supervisor.watched {
            watched.spawn(echo)?;
        }
        Ok(supervisor)
    }

    /// Processor time in s that each live process has used, by name.
    pub fn cpu_seconds(&self) -> Vec<(String, f64)> {
        let pid = |w: &Watched| w.pid().map(|pid| pid.as_raw_nonzero().get().cast_unsigned());
        let seconds = |w: &Watched| Some((w.process.name.clone(), process_cpu_seconds(pid(w)?)?));
        self.watched.iter().filter_map(seconds).collect()
    }

    /// The processes, in the order of their start.
    pub fn rows(&self) -> Vec<Row> {
        self.watched.iter().map(Watched::row).collect()
    }

    /// What ended since the last call; starts again what asks for it and is due.
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
                    events.push(ended(w, format!("could not be started again: {error:#}"), false, false));
                }
            }
        }
        Ok(events)
    }

    /// Whether no process runs or waits to be started again.
    pub fn is_done(&self) -> bool {
        self.watched.iter().all(|w| !w.is_started() && w.restart_at.is_none())
    }

    /// Ends all processes, the last started first, with what they started: SIGINT; SIGTERM for those that are still there
    /// after a while; SIGKILL for those that are there for another while.
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
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.shut_down();
    }
}

/// Takes note of an end, and of when the process is to be started again.
fn ended(w: &mut Watched, how: String, success: bool, refused: bool) -> NodeEvent {
    let restart = w.process.restart;
    let given_up = match restart.limit {
        _ if !restart.respawn => None,
        _ if refused => Some("it refuses its arguments".to_owned()),
        Some(limit) if w.restarts >= limit => Some(format!("it was started again {limit} times, which is its limit")),
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

/// How a process ended, in words.
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

/// User and system time of a process in s, from /proc; ticks are 1/100 s on Linux.
fn process_cpu_seconds(pid: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let fields: Vec<&str> = text.rsplit_once(") ")?.1.split(' ').collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}
