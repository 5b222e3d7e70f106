//! Watchdog of a connection: franka-rs waits for answers over TCP without a timeout.

use super::realtime::{set_priority, supervisor_priority};
use super::shared::Shared;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Period of the checks.
const PERIOD: Duration = Duration::from_millis(100);
/// Silence of the control thread that counts as a hang. A read itself gives up after one second.
const SILENT: Duration = Duration::from_millis(1800);
/// Time for an answer to a request. Recovery takes about a second.
const ANSWER: Duration = Duration::from_secs(4);

/// Watches a control thread with this priority until the link ends. `end_process` ends the process, if nothing else ends the connection.
pub fn run(shared: &Shared, control_priority: i32, end_process: fn()) {
    // A refusal is logged by the control thread, which has the same one.
    if set_priority(supervisor_priority(control_priority)).is_ok() {
        tracing::info!("watchdog: real-time priority {}", supervisor_priority(control_priority));
    }
    let (mut beats, mut since) = (shared.beats.load(Ordering::Relaxed), Instant::now());
    while !shared.ending.load(Ordering::Relaxed) {
        std::thread::sleep(PERIOD);
        let now = shared.beats.load(Ordering::Relaxed);
        if now != beats || !shared.is_connected() {
            (beats, since) = (now, Instant::now());
        }
        let hung = if since.elapsed() > SILENT {
            "the control thread"
        } else if shared.asks_since().is_some_and(|start| start.elapsed() > ANSWER) {
            "a request"
        } else {
            continue;
        };
        tracing::error!("{hung} waits for an answer that the robot does not send: the connection ends");
        if !shared.hang_up() {
            // Without a handle of the socket, only the end of the process closes the connection and frees the robot.
            tracing::error!("the connection cannot be ended from here: the process ends");
            end_process();
        }
        since = Instant::now();
        shared.asking(None);
    }
}
