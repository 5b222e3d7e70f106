//! Client side of the running graph's actions: a goal is sent and followed to its end.

use super::pulse::{Pulse, SILENT};
use crate::exit::{Given, Interrupted};
use anyhow::{Context, Error, Result, anyhow, ensure};
use catenary_shell::{Act, ActionClient, CallError, Node, Peer, RunningGoal, Shutdown, Status, list_peers};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use thiserror::Error;

/// Period of the checks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(100);
/// Time without a server after which a goal is given up.
const GONE: Duration = Duration::from_secs(5);
/// Time in which a goal must confirm its cancellation, and then end.
const CANCEL: Duration = Duration::from_secs(5);
/// Time in which a silent node may confirm a cancellation. Its request waits in the node's sockets even after the end of this process.
const CANCEL_SILENT: Duration = Duration::from_secs(1);
/// Period of the requests whether the server still runs the goal.
const ASK: Duration = Duration::from_secs(2);

/// Node that fell silent while it worked on a goal: stopped, or its machine.
#[derive(Debug, Error)]
#[error("{name}: {server} has been silent for {} s while its result was awaited; {cancelled}", SILENT.as_secs())]
pub struct SilentServer {
    /// Name of the action.
    name: String,
    /// Node in words.
    server: String,
    /// Outcome of the cancellation.
    cancelled: &'static str,
}

/// Goal that may run without anybody who watches it: its node did not confirm its end.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct Unwatched(String);

/// Time to wait for a server, from `--wait-s`.
pub fn wait(seconds: f64) -> Result<Duration> {
    let wait = Duration::try_from_secs_f64(seconds).ok().filter(|w| !w.is_zero());
    wait.with_context(|| format!("--wait-s: expected a positive number of seconds, got {seconds}")).given()
}

/// Sends a goal and waits for its result without a time limit. When `interrupted` is triggered, the goal is cancelled
/// and its end awaited.
///
/// # Errors
/// No server, or no acceptance, within `wait`; Ctrl-C; a server that went away, or fell silent ([`SilentServer`], [`Unwatched`]).
pub fn follow<A: Act>(
    node: &Node,
    client: &ActionClient<A>,
    goal: A::Goal,
    wait: Duration,
    interrupted: &Shutdown,
    mut on_feedback: impl FnMut(A::Feedback) + Send + 'static,
) -> Result<A::Result> {
    let name = client.name();
    let mut pulse = Pulse::new(node)?;
    let deadline = Instant::now() + wait;
    while !client.wait_for_server(LOOK) {
        if interrupted.is_triggered() {
            return Err(Error::from(Interrupted(String::new())).context(name.to_owned()));
        }
        if Instant::now() >= deadline {
            return Err(CallError::NoServer { name: name.to_owned(), waited: wait }.into());
        }
    }
    let told = pulse.feedback();
    let sent = client.send(goal, wait, move |feedback| {
        told.fetch_add(1, Ordering::Relaxed);
        on_feedback(feedback);
    });
    let mut running = match sent {
        // A stopped node stays in discovery, and takes no goal.
        Err(error @ CallError::Timeout { .. }) => {
            let server = list_peers(&node.servers(&[name])?);
            let words = format!("{error}: {server} did not take the goal, which may still reach it: is it stopped?");
            return Err(Unwatched(words).into());
        }
        sent => sent?,
    };
    let (mut seen, mut asked) = (Instant::now(), Instant::now());
    loop {
        if interrupted.is_triggered() {
            return Err(cancel(name, &running));
        }
        match running.wait(LOOK) {
            Ok((_, result)) => return Ok(result),
            Err(CallError::Timeout { .. }) => {}
            Err(e) => return Err(e.into()),
        }
        if client.wait_for_server(Duration::ZERO) {
            seen = Instant::now();
        }
        // Discovery may lose a busy server for a moment.
        ensure!(seen.elapsed() < GONE, "{name}: its server went away while the goal ran");
        if let Some(server) = pulse.silent(node, name)? {
            return Err(give_up(name, &server, &running).into());
        }
        // Discovery cannot tell a restarted server from the one that runs the goal; the server's own answer can.
        if asked.elapsed() > ASK {
            running.ask_again()?;
            asked = Instant::now();
        }
    }
}

/// Cancels the goal of a silent server.
fn give_up<A: Act>(name: &str, server: &Peer, running: &RunningGoal<A>) -> SilentServer {
    let cancelled = match running.cancel(CANCEL_SILENT) {
        Ok(_) => "the goal was cancelled",
        Err(_) => "it was asked to cancel the goal, and does so when it goes on",
    };
    SilentServer { name: name.to_owned(), server: server.to_string(), cancelled }
}

/// Cancels a goal and returns the error that tells the outcome.
fn cancel<A: Act>(name: &str, running: &RunningGoal<A>) -> Error {
    let asked = running.cancel(CANCEL);
    match asked.and_then(|_| running.wait(CANCEL)) {
        Ok((Status::Canceled, _)) => Error::from(Interrupted(" and cancelled".to_owned())).context(name.to_owned()),
        Ok((status, _)) => anyhow!("{name}: interrupted after its end: {status:?}"),
        Err(e) => Unwatched(format!("{name}: interrupted, but the goal may still run: {e}")).into(),
    }
}
