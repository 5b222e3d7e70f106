//! One process of a launch: its start, its output, its end.

use super::table::{Exit, Row, State};
use crate::launch::description::Process;
use anyhow::{Context, Result};
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Longest time that the output of an ended process takes to reach its log.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Process of a launch with its state.
pub struct Watched {
    /// Description of the process.
    pub process: Process,
    /// Log of the process.
    pub log: PathBuf,
    /// Number of restarts so far.
    pub restarts: u32,
    /// Time of the next restart.
    pub restart_at: Option<Instant>,
    state: State,
    since: SystemTime,
    exit: Option<Exit>,
    child: Option<Child>,
    /// Threads that copy its output to the log.
    copies: Vec<JoinHandle<()>>,
}

impl Watched {
    /// Process that is not started yet. Its log is emptied, so that no line of an earlier launch is reported as a
    /// cause.
    pub fn new(mut process: Process, folder: &Path) -> Result<Self> {
        let log = folder.join(format!("{}.log", process.name));
        File::create(&log).with_context(|| format!("log {}", log.display()))?;
        for (number, file) in process.parameters.iter().enumerate() {
            let path = folder.join(format!("{}.{number}.yaml", process.name));
            std::fs::write(&path, &file.yaml).with_context(|| format!("parameters {}", path.display()))?;
            let path = std::path::absolute(&path).unwrap_or(path);
            process.command[file.word] = path.display().to_string();
        }
        Ok(Self {
            process,
            log,
            restarts: 0,
            restart_at: None,
            state: State::Waiting,
            since: SystemTime::now(),
            exit: None,
            child: None,
            copies: Vec::new(),
        })
    }

    /// Starts the process.
    ///
    /// It leads its own process group, so that Ctrl-C on the terminal reaches the supervisor alone. Its standard input
    /// is one end of a pipe: if the supervisor dies, the pipe closes and the nodes end by themselves.
    pub fn spawn(&mut self, echo: bool) -> Result<()> {
        let (program, arguments) = resolve(&self.process.command);
        let mut command = Command::new(&program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
        for (name, value) in &self.process.environment {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        // Tells the node to end when its standard input closes.
        command.env("CATENARY_SUPERVISED", "1");
        if let Some(directory) = &self.process.directory {
            command.current_dir(directory);
        }
        let started = command.spawn();
        // The system's error is the same for a missing program and a missing folder.
        let nowhere = self.process.directory.as_ref().filter(|directory| !directory.is_dir());
        let mut child = started.with_context(|| match nowhere {
            Some(directory) => {
                format!("cannot start {}: cwd: expected a folder, got {}", self.process.name, directory.display())
            }
            None => format!("cannot start {}: {}", self.process.name, program.display()),
        })?;
        let shown = self.process.shown;
        let streams = [(child.stdout.take().map(boxed), shown.stdout), (child.stderr.take().map(boxed), shown.stderr)];
        self.child = Some(child);
        self.set(State::Running);
        for (stream, shown) in streams.into_iter().filter_map(|(stream, shown)| Some((stream?, shown))) {
            let log = self.open_log();
            let prefix = (echo && shown).then(|| self.process.name.clone());
            self.copies.push(std::thread::spawn(move || copy_lines(stream, log, prefix)));
        }
        Ok(())
    }

    /// Log, opened for appending. If it cannot be opened, output is dropped and the process runs nevertheless.
    fn open_log(&self) -> Box<dyn Write + Send> {
        match File::options().create(true).append(true).open(&self.log) {
            Ok(file) => Box::new(file),
            Err(error) => {
                tracing::warn!("{}: no log in {}: {error}", self.process.name, self.log.display());
                Box::new(std::io::sink())
            }
        }
    }

    /// Sets the state and its time.
    pub fn set(&mut self, state: State) {
        self.state = state;
        self.since = SystemTime::now();
    }

    /// Exit status, once, after the process has ended. Its remaining children are killed.
    pub fn take_exit(&mut self) -> Result<Option<ExitStatus>> {
        let Some(pid) = self.pid() else { return Ok(None) };
        // Until the end is collected, the kernel reuses neither the process number nor the group's.
        let ended = waitid(WaitId::Pid(pid), WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT)?;
        let child = if ended.is_some() { self.child.take() } else { None };
        let Some(mut child) = child else { return Ok(None) };
        // An error means that the group is empty, which is the usual case.
        let _none_left = kill_process_group(pid, Signal::KILL);
        let status = child.wait()?;
        self.wait_for_last_words();
        self.exit = exit(status);
        Ok(Some(status))
    }

    /// Waits until the output has reached the log. The wait is limited, because a child may hold the pipe open.
    fn wait_for_last_words(&mut self) {
        let deadline = Instant::now() + LAST_WORDS;
        while self.copies.iter().any(|c| !c.is_finished()) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(2));
        }
        self.copies.clear();
    }

    /// True from the start until the end is collected.
    pub fn is_started(&self) -> bool {
        self.child.is_some()
    }

    /// Process number.
    pub fn pid(&self) -> Option<Pid> {
        self.child.as_ref().and_then(|c| Pid::from_raw(c.id().cast_signed()))
    }

    /// Sends a signal to the process and its children.
    pub fn signal(&self, signal: Signal) {
        if let Some(Err(e)) = self.pid().map(|pid| kill_process_group(pid, signal)) {
            tracing::debug!("signal to {}: {e}", self.process.name);
        }
    }

    /// Row of the table.
    pub fn row(&self) -> Row {
        Row {
            name: self.process.name.clone(),
            pid: self.child.as_ref().map(Child::id),
            state: self.state,
            since_s: super::table::unix_s(self.since),
            restarts: self.restarts,
            restart_limit: self.process.restart.limit.filter(|_| self.process.restart.respawn),
            last_exit: self.exit,
            log: self.log.clone(),
        }
    }
}

fn boxed<R: Read + Send + 'static>(stream: R) -> Box<dyn Read + Send> {
    Box::new(stream)
}

/// Copies lines to the log, and to stderr with a prefix.
fn copy_lines(stream: Box<dyn Read + Send>, mut log: Box<dyn Write + Send>, prefix: Option<String>) {
    for line in BufReader::new(stream).split(b'\n').map_while(|line| line.ok()) {
        let line = String::from_utf8_lossy(&line);
        // A failed write is ignored: an unread pipe would fill up and block the node.
        let _ = writeln!(log, "{line}");
        if let Some(prefix) = &prefix {
            let _ = writeln!(std::io::stderr(), "[{prefix}] {line}");
        }
    }
}

/// Script of a checkout behind the names in `launch_configs/bin`. It starts the checkout's build of this program.
const STAND_IN: &str = "checkout_node";

/// Program to run: the written one if it exists. A missing program with the name of one of our nodes is replaced by
/// this program's `node NAME`, so that one executable serves the whole graph.
fn resolve(command: &[String]) -> (PathBuf, Vec<String>) {
    let program = PathBuf::from(&command[0]);
    let name = program.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let own = std::env::current_exe();
    // A stand-in would start another build of this program, or fail.
    let real = std::fs::canonicalize(&program).ok();
    let is_absent = real.is_none_or(|real| real.file_name().is_some_and(|name| name == STAND_IN));
    match own {
        Ok(own) if is_absent && crate::node::is_node(&name) => {
            let arguments = ["node".to_owned(), name].into_iter().chain(command[1..].iter().cloned());
            (own, arguments.collect())
        }
        _ => (program, command[1..].to_vec()),
    }
}

fn exit(status: ExitStatus) -> Option<Exit> {
    status.code().map(Exit::Code).or(status.signal().map(Exit::Signal))
}
