//! Processes of a launch: started together, watched, restarted where asked for, ended in order.

use super::file::Process;
use anyhow::{Context, Result};
use rustix::process::{Pid, Signal, kill_process_group};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time that a process has to end after SIGTERM before it is killed.
const GRACE: Duration = Duration::from_secs(6);
/// Exit code of a node whose command line, parameters or environment are wrong: starting it again would not help.
const USAGE: i32 = 2;
/// Restarts after which a process that keeps ending is given up.
const MAX_RESTARTS: u32 = 10;
/// Time that the output of a process that has ended takes to be in its log at most.
const LAST_WORDS: Duration = Duration::from_millis(500);
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
    /// Where its output is.
    pub log: PathBuf,
}

impl NodeEvent {
    /// The event in one line, with the last words of the process where it failed.
    pub fn describe(&self) -> String {
        let next = if self.restarting { "starting it again" } else { "not restarted" };
        let tail = if self.success { Vec::new() } else { tail(&self.log) };
        let words = tail.last().map_or(String::new(), |line| format!(": {line}"));
        format!("{} {}{words} ({next}; log {})", self.name, self.how, self.log.display())
    }
}

/// The last lines of a log.
fn tail(log: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let lines: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).collect();
    lines[lines.len().saturating_sub(TAIL_LINES)..].iter().map(|l| (*l).to_owned()).collect()
}

struct Watched {
    process: Process,
    log: PathBuf,
    child: Option<Child>,
    /// Threads that copy its output to the log.
    copies: Vec<JoinHandle<()>>,
    restarts: u32,
    restart_at: Option<Instant>,
}

/// The running processes of a launch. Dropping it ends them.
pub struct Supervisor {
    watched: Vec<Watched>,
    echo: bool,
}

impl Supervisor {
    /// Starts every process, in order; each one's output goes to `log_folder/NAME.log`, and to stderr too with `echo`.
    ///
    /// Each process is the leader of its own group, so that Ctrl-C on the terminal reaches the supervisor alone, and holds
    /// one end of a pipe as its standard input: where the supervisor dies, the pipe closes and the nodes end by themselves.
    pub fn start(processes: Vec<Process>, log_folder: &Path, echo: bool) -> Result<Self> {
        std::fs::create_dir_all(log_folder).with_context(|| format!("log folder {}", log_folder.display()))?;
        let logs: Vec<PathBuf> = processes.iter().map(|p| log_folder.join(format!("{}.log", p.name))).collect();
        for log in &logs {
            // What an earlier launch wrote is no cause of anything now.
            File::create(log).with_context(|| format!("log {}", log.display()))?;
        }
        let mut supervisor = Self { watched: Vec::new(), echo };
        for (process, log) in processes.into_iter().zip(logs) {
            let mut watched = Watched { process, log, child: None, copies: Vec::new(), restarts: 0, restart_at: None };
            watched.spawn(echo)?;
            supervisor.watched.push(watched);
        }
        Ok(supervisor)
    }

    /// Processor time in s that each live process has used, by name.
    pub fn cpu_seconds(&self) -> Vec<(String, f64)> {
        let seconds = |w: &Watched| Some((w.process.name.clone(), process_cpu_seconds(w.child.as_ref()?.id())?));
        self.watched.iter().filter_map(seconds).collect()
    }

    /// What ended since the last call; starts again what asks for it and is due.
    pub fn poll(&mut self) -> Result<Vec<NodeEvent>> {
        let mut events = Vec::new();
        for w in &mut self.watched {
            if let Some(status) = w.child.as_mut().map(Child::try_wait).transpose()?.flatten() {
                w.child = None;
                w.wait_for_last_words();
                let curable = status.code() != Some(USAGE);
                let restarting = w.process.respawn && curable && w.restarts < MAX_RESTARTS;
                w.restart_at = restarting.then(|| Instant::now() + w.process.respawn_delay);
                events.push(NodeEvent {
                    name: w.process.name.clone(),
                    how: how(status),
                    success: status.success(),
                    restarting,
                    log: w.log.clone(),
                });
            }
            if w.restart_at.is_some_and(|t| Instant::now() >= t) {
                w.restart_at = None;
                w.restarts += 1;
                w.spawn(self.echo)?;
            }
        }
        Ok(events)
    }

    /// Whether no process runs or waits to be started again.
    pub fn is_done(&self) -> bool {
        self.watched.iter().all(|w| w.child.is_none() && w.restart_at.is_none())
    }

    /// Ends all processes, the last started first: SIGTERM, and SIGKILL for those that are still there after a while.
    pub fn shut_down(&mut self) {
        let deadline = Instant::now() + GRACE;
        for w in self.watched.iter_mut().rev() {
            w.restart_at = None;
            w.signal(Signal::TERM);
        }
        while self.watched.iter_mut().any(Watched::is_running) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
        }
        for w in &mut self.watched {
            if w.is_running() {
                tracing::warn!("{} did not end within {} s; killed", w.process.name, GRACE.as_secs());
                w.signal(Signal::KILL);
                w.child.take().map(|mut c| c.wait());
            }
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.shut_down();
    }
}

impl Watched {
    fn spawn(&mut self, echo: bool) -> Result<()> {
        let (program, arguments) = resolve(&self.process.command);
        let mut child = Command::new(&program)
            .args(arguments)
            .envs(self.process.environment.iter().map(|(k, v)| (k, v)))
            .env("CATENARY_SUPERVISED", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()
            .with_context(|| format!("cannot start {}: {}", self.process.name, program.display()))?;
        for stream in [child.stdout.take().map(boxed), child.stderr.take().map(boxed)].into_iter().flatten() {
            let log = File::options().create(true).append(true).open(&self.log);
            let log = log.with_context(|| format!("log {}", self.log.display()))?;
            let prefix = echo.then(|| self.process.name.clone());
            self.copies.push(std::thread::spawn(move || copy_lines(stream, log, prefix)));
        }
        self.child = Some(child);
        Ok(())
    }

    /// Waits until what the process wrote is in the log; not for ever, as a child of its own may hold the pipe open.
    fn wait_for_last_words(&mut self) {
        let deadline = Instant::now() + LAST_WORDS;
        while self.copies.iter().any(|c| !c.is_finished()) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(2));
        }
        self.copies.clear();
    }

    fn is_running(&mut self) -> bool {
        self.child.as_mut().is_some_and(|c| matches!(c.try_wait(), Ok(None)))
    }

    fn signal(&mut self, signal: Signal) {
        if !self.is_running() {
            return;
        }
        let pid = self.child.as_ref().and_then(|c| Pid::from_raw(c.id().cast_signed()));
        if let Some(Err(e)) = pid.map(|pid| kill_process_group(pid, signal)) {
            tracing::debug!("signal to {}: {e}", self.process.name);
        }
    }
}

fn boxed<R: Read + Send + 'static>(stream: R) -> Box<dyn Read + Send> {
    Box::new(stream)
}

/// Copies lines to the log, and to stderr behind a prefix.
fn copy_lines(stream: Box<dyn Read + Send>, mut log: File, prefix: Option<String>) {
    for line in BufReader::new(stream).split(b'\n').map_while(|line| line.ok()) {
        let line = String::from_utf8_lossy(&line);
        // A log that cannot be written must not stop the node from being read: it would block on a full pipe.
        let _ = writeln!(log, "{line}");
        if let Some(prefix) = &prefix {
            let _ = writeln!(std::io::stderr(), "[{prefix}] {line}");
        }
    }
}

/// The program to run: as it is written where it exists; else, for a name of one of our nodes, this program's own
/// `node NAME`, so that one executable serves the whole graph.
fn resolve(command: &[String]) -> (PathBuf, Vec<String>) {
    let program = PathBuf::from(&command[0]);
    let name = program.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let own = std::env::current_exe();
    match own {
        Ok(own) if !program.exists() && crate::nodes::is_node(&name) => {
            let arguments = ["node".to_owned(), name].into_iter().chain(command[1..].iter().cloned());
            (own, arguments.collect())
        }
        _ => (program, command[1..].to_vec()),
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

/// User and system time of a process in s, from /proc; ticks are 1/100 s on Linux.
fn process_cpu_seconds(pid: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let fields: Vec<&str> = text.rsplit_once(") ")?.1.split(' ').collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn process(name: &str, command: &[&str], respawn: bool) -> Process {
        Process {
            name: name.into(),
            command: command.iter().map(|c| (*c).to_owned()).collect(),
            environment: Vec::new(),
            respawn,
            respawn_delay: Duration::from_millis(10),
        }
    }

    fn wait_for_event(s: &mut Supervisor) -> NodeEvent {
        let deadline = Instant::now() + Duration::from_secs(10);
        loop {
            if let Some(event) = s.poll().unwrap().into_iter().next() {
                return event;
            }
            assert!(Instant::now() < deadline, "nothing happened");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn a_failing_process_is_reported_with_its_last_words() {
        let logs = tempfile::tempdir().unwrap();
        let mut s =
            Supervisor::start(vec![process("a", &["sh", "-c", "echo no luck >&2; exit 3"], false)], logs.path(), false)
                .unwrap();
        let event = wait_for_event(&mut s);
        assert!(!event.success && !event.restarting);
        assert!(event.describe().contains("exit code 3: no luck"), "{}", event.describe());
        assert!(s.is_done());
    }

    #[test]
    fn the_words_of_an_earlier_launch_are_no_cause_of_what_happens_now() {
        let logs = tempfile::tempdir().unwrap();
        for (script, said) in [("echo no luck >&2; exit 3", ": no luck"), ("exit 3", "exit code 3 (")] {
            let mut s =
                Supervisor::start(vec![process("a", &["sh", "-c", script], false)], logs.path(), false).unwrap();
            let words = wait_for_event(&mut s).describe();
            assert!(words.contains(said), "{words}");
        }
    }

    #[test]
    fn a_process_that_refuses_its_arguments_is_not_started_again() {
        let logs = tempfile::tempdir().unwrap();
        let mut s = Supervisor::start(vec![process("a", &["sh", "-c", "exit 2"], true)], logs.path(), false).unwrap();
        let event = wait_for_event(&mut s);
        assert!(!event.success && !event.restarting && s.is_done());
    }

    #[test]
    fn a_killed_process_is_started_again_where_asked_and_all_end_on_shutdown() {
        let logs = tempfile::tempdir().unwrap();
        let mut s = Supervisor::start(
            vec![process("a", &["sleep", "60"], true), process("b", &["sleep", "60"], false)],
            logs.path(),
            false,
        )
        .unwrap();
        let pid = s.watched[0].child.as_ref().unwrap().id();
        kill_process_group(Pid::from_raw(pid.cast_signed()).unwrap(), Signal::KILL).unwrap();
        let event = wait_for_event(&mut s);
        assert!(event.restarting && event.how.contains("signal 9"), "{event:?}");
        std::thread::sleep(Duration::from_millis(50));
        s.poll().unwrap();
        let again = s.watched[0].child.as_ref().unwrap().id();
        assert!(s.watched[0].restarts == 1 && again != pid);
        s.shut_down();
        assert!(s.is_done() || s.watched.iter_mut().all(|w| !w.is_running()));
    }

    #[test]
    fn a_program_that_does_not_exist_is_an_error() {
        let logs = tempfile::tempdir().unwrap();
        let e =
            Supervisor::start(vec![process("ghost", &["/no/such/program"], false)], logs.path(), false).err().unwrap();
        assert!(format!("{e:#}").contains("ghost"), "{e:#}");
    }
}
