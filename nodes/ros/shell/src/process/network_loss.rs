//! Loss of the network: the end of a process whose middleware no longer listens.
//!
//! A thread of RustDDS may end by itself, by a panic or a failed wait. The process would live on without hearing the graph. It ends
//! instead, and says why.
//!
//! A process that was stopped and continues goes on: see `dds::system_calls`. Only after a long stop the others have dropped it from the
//! graph, or it drops them. Then a participant on Fast DDS may never hear of its endpoints again (seen after 25 s and 65 s, not after 12 s),
//! and the process ends, too.

use crate::dds::graph::Graph;
use crate::dds::log_noise;
use crate::time::shutdown::Shutdown;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Message of a process that lost the network.
pub const LOST: &str =
    "the network was lost: the process stood still for more than 15 s, or a thread of the middleware ended; start anew";

/// Standstill after which the network is lost. Participants on Fast DDS have a lease of 20 s, and announce themselves every 3 s.
const LEASE: Duration = Duration::from_secs(15);

/// Time between two checks. Chosen: a check reads one file of /proc.
const PERIOD: Duration = Duration::from_millis(500);

static IS_LOST: AtomicBool = AtomicBool::new(false);

/// Shutdown that a loss triggers.
static ENDS: Mutex<Option<Shutdown>> = Mutex::new(None);

/// Returns true if the process ends because it lost the network. Check this before mapping an outcome to an exit code: every
/// other failure follows from the loss.
#[must_use]
pub fn is_network_lost() -> bool {
    IS_LOST.load(Ordering::Acquire)
}

/// Makes a loss of the network trigger `shutdown`.
pub(crate) fn ends(shutdown: &Shutdown) {
    *ENDS.lock().unwrap_or_else(PoisonError::into_inner) = Some(shutdown.clone());
}

/// Checks a node's graph until the node ends, and ends the process at a loss.
pub(crate) fn watch(graph: &Graph, end: &Shutdown) {
    let mut was_lost = false;
    let mut checked = uptime();
    while !end.wait_timeout(PERIOD) {
        let now = uptime();
        if has_stood_still(checked, now) {
            declare();
            return;
        }
        checked = now;
        let is_lost = graph.has_lost_network();
        // Two checks in a row: the kernel's table of sockets can leave out a row while other sockets come and go.
        if is_lost && was_lost {
            declare();
            return;
        }
        was_lost = is_lost;
    }
}

/// Returns the time since the start of the machine, including the time for which it was suspended; `None` without /proc.
fn uptime() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/uptime").ok()?;
    Duration::try_from_secs_f64(text.split_whitespace().next()?.parse().ok()?).ok()
}

/// Returns true if more time than a lease has passed between two checks.
fn has_stood_still(before: Option<Duration>, now: Option<Duration>) -> bool {
    before.zip(now).is_some_and(|(before, now)| now.saturating_sub(before) > LEASE + PERIOD)
}

/// Ends the process, unless it ends already: at its end the threads of the middleware end as well.
fn declare() {
    let shutdown = ENDS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    if let Some(shutdown) = shutdown.filter(|s| !s.is_triggered()) {
        IS_LOST.store(true, Ordering::Release);
        // Every topic would complain about the consequences.
        log_noise::hush(true);
        shutdown.trigger();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standstill_beyond_a_lease_is_a_loss() {
        let at = |seconds: f64| Some(Duration::from_secs_f64(seconds));
        assert!(!has_stood_still(at(100.0), at(100.5)));
        assert!(!has_stood_still(at(100.0), at(112.5)), "a stop of 12 s");
        assert!(has_stood_still(at(100.0), at(116.0)));
        assert!(!has_stood_still(None, at(116.0)) && !has_stood_still(at(116.0), at(100.0)));
        assert!(uptime().is_some_and(|uptime| uptime > Duration::ZERO));
    }

    #[test]
    fn a_loss_ends_a_running_process_and_no_other() {
        declare();
        assert!(!is_network_lost(), "nothing to end");
        let ending = Shutdown::new();
        ends(&ending);
        ending.trigger();
        declare();
        assert!(!is_network_lost(), "it ends already");
        let running = Shutdown::new();
        ends(&running);
        declare();
        assert!(is_network_lost() && running.is_triggered());
        IS_LOST.store(false, Ordering::Release);
        log_noise::hush(false);
    }
}
