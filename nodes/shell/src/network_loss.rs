//! What happens to a process whose middleware stopped listening to the network.
//!
//! RustDDS ends its threads where their wait is interrupted: when the process is stopped and goes on (Ctrl-Z and `fg`), or
//! the machine wakes up. The process would live on without hearing the graph; it ends instead, and says why.

use crate::logging;
use crate::shutdown::Shutdown;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// What is said of a process that lost the network.
pub const LOST: &str = "the network was lost, as after Ctrl-Z and fg or when the machine was suspended; start anew";

static IS_LOST: AtomicBool = AtomicBool::new(false);

/// What the loss ends.
static ENDS: Mutex<Option<Shutdown>> = Mutex::new(None);

/// Whether the process ends because it lost the network. Whoever maps its outcome to an exit code looks here first: all else
/// that went wrong or was cut short by then follows from it.
#[must_use]
pub fn is_network_lost() -> bool {
    IS_LOST.load(Ordering::Acquire)
}

/// Has a loss of the network trigger `shutdown`.
pub(crate) fn ends(shutdown: &Shutdown) {
    *ENDS.lock().unwrap_or_else(PoisonError::into_inner) = Some(shutdown.clone());
}

/// Takes note of a warning or error of the middleware. In a process that ends already, what its threads say is no loss.
pub(crate) fn hear(target: &str, message: &str) {
    if !ends_listening(target, message) {
        return;
    }
    let shutdown = ENDS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    if let Some(shutdown) = shutdown.filter(|s| !s.is_triggered()) {
        IS_LOST.store(true, Ordering::Release);
        // What follows from it is said of each topic.
        logging::hush_middleware(true);
        shutdown.trigger();
    }
}

/// What the middleware's threads, that of all datagrams and that of discovery, say when they end for a reason of their own.
fn ends_listening(target: &str, message: &str) -> bool {
    match target {
        "rustdds::rtps::dp_event_loop" => message.starts_with("dp_event_loop poll failed"),
        "rustdds::discovery::discovery" => message.starts_with("Failed in waiting of poll in discovery"),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAID: (&str, &str) = ("rustdds::rtps::dp_event_loop", "dp_event_loop poll failed: Interrupted");

    #[test]
    fn a_loss_ends_the_process_once_and_is_none_where_it_ends_already() {
        hear(SAID.0, SAID.1);
        assert!(!is_network_lost(), "nothing to end");
        let ending = Shutdown::new();
        ends(&ending);
        ending.trigger();
        hear(SAID.0, SAID.1);
        assert!(!is_network_lost(), "it ends already");
        let running = Shutdown::new();
        ends(&running);
        hear(SAID.0, "a datagram was lost");
        hear("catenary", SAID.1);
        assert!(!is_network_lost() && !running.is_triggered());
        hear(SAID.0, SAID.1);
        assert!(is_network_lost() && running.is_triggered());
        IS_LOST.store(false, Ordering::Release);
        logging::hush_middleware(false);
    }
}
