//! What a launch file says: arguments, and processes to start.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

/// One process to start.
#[derive(Debug, Clone, PartialEq)]
pub struct Process {
    /// Name in logs and messages, by itself in a launch.
    pub name: String,
    /// Program and arguments.
    pub command: Vec<String>,
    /// Environment variables to set, or to take away.
    pub environment: BTreeMap<String, Option<String>>,
    /// Folder to run in; none: that of the launch.
    pub directory: Option<PathBuf>,
    /// Parameter files to write before the start.
    pub parameters: Vec<Parameters>,
    /// Whether, when and how often it is started again.
    pub restart: Restart,
    /// What of its output is shown, beside its log.
    pub shown: Shown,
    /// How long it may take to end.
    pub grace: Grace,
    /// Whether the launch ends with it.
    pub ends_launch: bool,
}

impl Process {
    /// A process that is started once, and whose output is in its log alone.
    pub fn new(name: String, command: Vec<String>) -> Self {
        Self {
            name,
            command,
            environment: BTreeMap::new(),
            directory: None,
            parameters: Vec::new(),
            restart: Restart::default(),
            shown: Shown { stdout: false, stderr: false },
            grace: Grace::default(),
            ends_launch: false,
        }
    }
}

/// A parameter file that belongs to one process.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Index of the word of the command that names the file.
    pub word: usize,
    /// Contents, in ROS 2's own form.
    pub yaml: String,
}

/// When a process that ended by itself is started again.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Restart {
    /// Whether it is.
    pub respawn: bool,
    /// Time before it is.
    pub delay: Duration,
    /// How often at most during the launch; none: without limit.
    pub limit: Option<u32>,
}

/// The streams of a process that are shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Standard output.
    pub stdout: bool,
    /// Standard error.
    pub stderr: bool,
}

/// Times that a process has for ending.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grace {
    /// After SIGINT, before SIGTERM.
    pub interrupted: Duration,
    /// After SIGTERM, before SIGKILL.
    pub terminated: Duration,
}

impl Default for Grace {
    fn default() -> Self {
        Self { interrupted: Duration::from_secs(5), terminated: Duration::from_secs(5) }
    }
}

/// An argument that a launch file declares.
#[derive(Debug, Clone, PartialEq)]
pub struct Argument {
    /// Its name.
    pub name: String,
    /// Its default; none: it must be given.
    pub default: Option<String>,
    /// What it does.
    pub description: String,
    /// The values that it may have; empty: any.
    pub choices: Vec<String>,
}

/// What a launch file says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LaunchDescription {
    /// Arguments in order: those of the file itself, and of included files where it does not give them.
    pub arguments: Vec<Argument>,
    /// Processes to start, in order.
    pub processes: Vec<Process>,
}
