//! Description of a launch: arguments, and processes to start.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

/// A process to start.
#[derive(Debug, Clone, PartialEq)]
pub struct Process {
    /// Name in logs and messages, unique in a launch.
    pub name: String,
    /// Program and its arguments.
    pub command: Vec<String>,
    /// Environment variables to set, or to remove (`None`).
    pub environment: BTreeMap<String, Option<String>>,
    /// Working directory; `None`: that of the launch.
    pub directory: Option<PathBuf>,
    /// Parameter files to write before the start.
    pub parameters: Vec<Parameters>,
    /// Rule for restarts.
    pub restart: Restart,
    /// Output streams that are shown besides being logged.
    pub shown: Shown,
    /// Time limits for its end.
    pub grace: Grace,
    /// True if the launch ends with it.
    pub ends_launch: bool,
}

impl Process {
    /// Process without restarts, whose output is only logged.
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

/// Parameter file of one process.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Index of the command's word that names the file.
    pub word: usize,
    /// Contents, in ROS 2's parameter file format.
    pub yaml: String,
}

/// Rule for restarts of a process that ended by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Restart {
    /// True if the process is restarted.
    pub respawn: bool,
    /// Delay before a restart.
    pub delay: Duration,
    /// Largest number of restarts in a launch; `None`: unlimited.
    pub limit: Option<u32>,
}

/// Output streams of a process that are shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Standard output.
    pub stdout: bool,
    /// Standard error.
    pub stderr: bool,
}

/// Time limits for the end of a process. The defaults are those of ROS 2's launch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grace {
    /// Time from SIGINT to SIGTERM.
    pub interrupted: Duration,
    /// Time from SIGTERM to SIGKILL.
    pub terminated: Duration,
}

impl Default for Grace {
    fn default() -> Self {
        Self { interrupted: Duration::from_secs(5), terminated: Duration::from_secs(5) }
    }
}

/// Argument that a launch file declares.
#[derive(Debug, Clone, PartialEq)]
pub struct Argument {
    /// Name of the argument.
    pub name: String,
    /// Default value; `None`: the argument is required.
    pub default: Option<String>,
    /// Description from the launch file.
    pub description: String,
    /// Allowed values; empty: any.
    pub choices: Vec<String>,
}

/// Contents of a launch file after substitution.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LaunchDescription {
    /// Arguments in order, including those of included files that are not given there.
    pub arguments: Vec<Argument>,
    /// Processes to start, in order.
    pub processes: Vec<Process>,
}
