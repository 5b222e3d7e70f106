//! Frame of a node's `main`: arguments, logs, signals, exit codes.

use super::builder::NodeBuilder;
use super::ending::{self, LeaveAtEnd};
use super::{logging, memory_limit, network_loss};
use crate::error::ShellError;
use crate::parameters::args::RosArgs;
use crate::time::shutdown::Shutdown;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use std::ffi::OsString;
use std::io::{Read, Write as _};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Exit code of a wrong command line, parameter or environment variable.
const USAGE: u8 = 2;

/// Time after the first signal in which further signals are ignored: launchers signal both the process and its group.
const IMPATIENCE: Duration = Duration::from_secs(1);

/// Environment variable set by a supervisor that holds the other end of standard input and never writes to it.
const SUPERVISED: &str = "CATENARY_SUPERVISED";

/// Time for a process to end in order after its supervisor has died. Then it ends itself: no other process would kill it.
const ORPHAN_GRACE: Duration = Duration::from_secs(5);

/// True once a signal that [`end_on_signals`] waits for has come.
static SIGNALLED: AtomicBool = AtomicBool::new(false);

/// Returns true once a signal that [`end_on_signals`] waits for told this process to end. Long work without a [`Shutdown`] of its own
/// looks at it.
#[must_use]
pub fn is_signalled() -> bool {
    SIGNALLED.load(Ordering::Acquire)
}

/// Runs a node from the arguments after the program's name.
///
/// Reads `--ros-args` and starts logging. `--help` lists the node's parameters. SIGINT, SIGTERM, SIGHUP, the death of the
/// supervisor and the loss of the network end the node in order; a further signal a second later ends it at once. All nodes of the
/// process have left the graph before this returns, even after a panic.
///
/// The exit code is 0 after an orderly end, 2 for an invalid command line, parameter or environment variable and for
/// [`Misconfigured`], otherwise 1. An error is printed in one line on stderr.
pub fn main<S: Into<String>>(
    name: &str,
    args: impl IntoIterator<Item = S>,
    run: impl FnOnce(NodeBuilder) -> anyhow::Result<()>,
) -> ExitCode {
    // Neither a panic nor a thread that still holds the node may keep it in the graph.
    let _leaving = LeaveAtEnd;
    // The loss of the network comes first: every other outcome follows from it.
    match start(name, args).and_then(run) {
        _ if network_loss::is_network_lost() => fail(name, &anyhow::anyhow!(network_loss::LOST), 1),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => match error.downcast_ref::<ShellError>() {
            Some(ShellError::HelpShown) => ExitCode::SUCCESS,
            Some(shell) if shell.is_usage() => fail(name, &error, USAGE),
            _ if error.is::<UsageError>() || error.is::<Misconfigured>() => fail(name, &error, USAGE),
            _ => fail(name, &error, 1),
        },
    }
}

/// Converts the arguments of a process to text, as names and parameters of ROS 2 require.
///
/// # Errors
/// Exit code of an invalid command line, after a message on stderr: an argument is not UTF-8.
pub fn in_unicode(arguments: &[OsString]) -> Result<Vec<String>, ExitCode> {
    let text = |argument: &OsString| match argument.to_str() {
        Some(text) => Ok(text.to_owned()),
        None => {
            let _closed = writeln!(std::io::stderr(), "argument {argument:?}: expected UTF-8");
            Err(ExitCode::from(USAGE))
        }
    };
    arguments.iter().map(text).collect()
}

/// Mistake in the user's input, found while a node starts. Exit code 2: a restart would not help.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Misconfigured(String);

impl Misconfigured {
    /// Marks an error and its causes as a mistake in the user's input; for `map_err`.
    #[must_use]
    pub fn new(error: impl Into<anyhow::Error>) -> Self {
        Self(in_one_line(&error.into()))
    }
}

/// Unknown argument of a node.
#[derive(Debug, thiserror::Error)]
#[error("unknown argument {0:?}; expected --help or --ros-args ...")]
struct UsageError(String);

/// Returns an error with its causes in one line. A cause is omitted if the text already contains it.
#[must_use]
pub fn in_one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string).filter(|cause| !cause.is_empty()) {
        if line.is_empty() {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line.replace('\n', " ")
}

fn fail(name: &str, error: &anyhow::Error, code: u8) -> ExitCode {
    let line = in_one_line(error);
    let _closed = writeln!(std::io::stderr(), "{name}: {line}");
    ExitCode::from(code)
}

fn start<S: Into<String>>(name: &str, args: impl IntoIterator<Item = S>) -> anyhow::Result<NodeBuilder> {
    let (args, rest) = RosArgs::parse(args).map_err(ShellError::from)?;
    let help = rest.iter().any(|arg| arg == "--help" || arg == "-h");
    if let (false, Some(unknown)) = (help, rest.into_iter().next()) {
        return Err(UsageError(unknown).into());
    }
    logging::init(name, &args);
    let builder = NodeBuilder::new(name, &args)?;
    if help {
        return Ok(builder.with_help(format!(
            "Usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] [--log-level LEVEL]]"
        )));
    }
    // Not for `--help`, which only prints.
    end_on_signals(builder.shutdown())?;
    memory_limit::apply(&|name| std::env::var(name).ok())?;
    Ok(builder)
}

/// Triggers `shutdown` at SIGINT and SIGTERM, at SIGHUP unless it is ignored as under `nohup`, and at the loss of the network
/// ([`crate::is_network_lost`]). A further signal a second later ends the process at once. SIGXFSZ no longer ends the process: the
/// write to a file that must not grow returns an error.
///
/// If a supervisor has set `CATENARY_SUPERVISED`, the end of standard input also triggers `shutdown`: the pipe closes when the
/// supervisor dies for any reason. A process that has not ended 5 s later is ended at once.
///
/// # Errors
/// [`ShellError::Create`]: the operating system refuses the handlers or a thread.
pub fn end_on_signals(shutdown: &Shutdown) -> Result<(), ShellError> {
    network_loss::ends(shutdown);
    let failed = |error: std::io::Error| ShellError::create("signal handlers", error);
    let hangup = (!is_ignored(SIGHUP)).then_some(SIGHUP);
    let mut signals = Signals::new([SIGINT, SIGTERM].into_iter().chain(hangup)).map_err(failed)?;
    // Any handler replaces the default action, which ends the process. The flag itself is not read.
    signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(failed)?;
    let shutdown = shutdown.clone();
    let on_signal = shutdown.clone();
    let body = move || {
        let mut first: Option<Instant> = None;
        for signal in signals.forever() {
            match first {
                None => {
                    tracing::info!("signal {signal}: shutting down");
                    first = Some(Instant::now());
                    SIGNALLED.store(true, Ordering::Release);
                    on_signal.trigger();
                }
                Some(first) if first.elapsed() < IMPATIENCE => {}
                Some(_) => {
                    tracing::warn!("signal {signal} again: ending at once");
                    // Exit code of a shell for a process ended by a signal.
                    ending::exit(128 + signal);
                }
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(body).map_err(failed)?;
    // Only with a supervisor: a terminal or /dev/null as standard input may end at any time.
    if std::env::var_os(SUPERVISED).is_some() {
        end_with_pipe(std::io::stdin(), shutdown, || {
            std::thread::sleep(ORPHAN_GRACE);
            tracing::warn!("still here {} s after the supervisor: ending at once", ORPHAN_GRACE.as_secs());
            ending::exit(1)
        })?;
    }
    Ok(())
}

/// Returns true if this process was started with a signal ignored.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    is_in_mask(&status, signal)
}

/// Returns true if `status`, in the format of `/proc/PID/status`, lists a signal as ignored.
fn is_in_mask(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}

/// Triggers `shutdown` when `pipe` ends, then calls `last`. The content of the pipe is ignored.
fn end_with_pipe(
    mut pipe: impl Read + Send + 'static,
    shutdown: Shutdown,
    last: impl FnOnce() + Send + 'static,
) -> Result<(), ShellError> {
    let body = move || {
        if let Err(error) = std::io::copy(&mut pipe, &mut std::io::sink()) {
            tracing::debug!("standard input: {error}");
        }
        tracing::info!("the supervisor is gone: shutting down");
        shutdown.trigger();
        last();
    };
    let spawned = std::thread::Builder::new().name("supervisor".to_owned()).spawn(body);
    spawned.map(drop).map_err(|error| ShellError::create("thread supervisor", error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misconfiguration_keeps_its_causes_behind_further_context() {
        use anyhow::Context;
        let cause = anyhow::anyhow!("no such file").context("model_file nope");
        let error = Err::<(), _>(Misconfigured::new(cause)).context("start").unwrap_err();
        assert!(error.is::<Misconfigured>());
        assert_eq!(format!("{error:#}"), "start: model_file nope: no such file");
        assert!(!anyhow::anyhow!("broken").is::<Misconfigured>());
    }

    #[derive(Debug, thiserror::Error)]
    #[error("iteration 3: {source}")]
    struct Outer {
        source: std::io::Error,
    }

    #[test]
    fn a_cause_that_the_error_already_contains_is_printed_once() {
        use anyhow::Context;
        let outer = || Outer { source: std::io::Error::other("the disk\nis full") };
        let error = Err::<(), _>(outer()).context("bag a").unwrap_err();
        assert_eq!(in_one_line(&error), "bag a: iteration 3: the disk is full");
        assert_eq!(in_one_line(&outer().into()), "iteration 3: the disk is full");
        assert_eq!(in_one_line(&anyhow::anyhow!("b").context("a")), "a: b");
        assert_eq!(Misconfigured::new(error).to_string(), "bag a: iteration 3: the disk is full");
    }

    #[test]
    fn ignored_signals_are_read_from_the_mask() {
        let status =
            "Name:\tcatenary\nSigBlk:\tffffffffffffffff\nSigIgn:\t0000000000001001\nSigCgt:\t0000000000000002\n";
        assert!(is_in_mask(status, SIGHUP) && !is_in_mask(status, SIGINT) && !is_in_mask("", SIGHUP));
    }

    #[test]
    fn only_the_end_of_the_supervisors_pipe_ends_the_process_in_order() {
        let (reader, mut writer) = std::io::pipe().unwrap();
        let shutdown = Shutdown::new();
        let (sender, last) = std::sync::mpsc::channel();
        let seen = shutdown.clone();
        end_with_pipe(reader, shutdown.clone(), move || sender.send(seen.is_triggered()).unwrap()).unwrap();
        writer.write_all(b"nothing of meaning\n").unwrap();
        assert!(!shutdown.wait_timeout(Duration::from_millis(50)));
        drop(writer);
        assert!(shutdown.wait_timeout(Duration::from_secs(5)));
        assert_eq!(last.recv_timeout(Duration::from_secs(5)), Ok(true));
    }
}
