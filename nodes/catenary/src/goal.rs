//! Goals of the running graph's actions, followed to their end.

use crate::interrupted::Interrupted;
use crate::wrong_input::Given;
use anyhow::{Context, Error, Result, anyhow, ensure};
use catenary_shell::{Act, ActionClient, CallError, RunningGoal, Shutdown, Status};
use std::time::{Duration, Instant};

/// How often a signal is looked for.
const LOOK: Duration = Duration::from_millis(100);
/// Time without its server after which a goal is given up.
const GONE: Duration = Duration::from_secs(5);
/// Time in which a goal must say that it is being cancelled, and then end.
const CANCEL: Duration = Duration::from_secs(5);
/// How often the server is asked whether it still runs the goal.
const ASK: Duration = Duration::from_secs(2);

/// The time to wait for a server, as `--wait-s` gives it.
pub fn wait(seconds: f64) -> Result<Duration> {
    let wait = Duration::try_from_secs_f64(seconds).ok().filter(|w| !w.is_zero());
    wait.with_context(|| format!("--wait-s: expected a positive number of seconds, got {seconds}")).given()
}

/// Sends a goal and waits for its result, however long it takes; at `interrupted` it is cancelled, and its end awaited.
pub fn follow<A: Act>(
    client: &ActionClient<A>,
    goal: A::Goal,
    wait: Duration,
    interrupted: &Shutdown,
    on_feedback: impl FnMut(A::Feedback) + Send + 'static,
) -> Result<A::Result> {
    let name = client.name();
    let deadline = Instant::now() + wait;
    while !client.wait_for_server(LOOK) {
        if interrupted.is_triggered() {
            return Err(Error::from(Interrupted(String::new())).context(name.to_owned()));
        }
        if Instant::now() >= deadline {
            return Err(CallError::NoServer { name: name.to_owned(), waited: wait }.into());
        }
    }
    let mut running = client.send(goal, wait, on_feedback)?;
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
        ensure!(seen.elapsed() < GONE, "{name}: its server went away while the goal ran");
        // Only its answer tells a server that was started anew from the one that runs the goal.
        if asked.elapsed() > ASK {
            running.ask_again()?;
            asked = Instant::now();
        }
    }
}

/// Cancels a goal and says what came of it.
fn cancel<A: Act>(name: &str, running: &RunningGoal<A>) -> Error {
    let asked = running.cancel(CANCEL);
    match asked.and_then(|_| running.wait(CANCEL)) {
        Ok((Status::Canceled, _)) => Error::from(Interrupted(" and cancelled".to_owned())).context(name.to_owned()),
        Ok((status, _)) => anyhow!("{name}: interrupted when it was over: {status:?}"),
        Err(e) => anyhow!("{name}: interrupted, and may run on: {e}"),
    }
}
