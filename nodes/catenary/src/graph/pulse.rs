//! Signs of life of the node that works on a goal.
//!
//! A node that is stopped (SIGSTOP, a debugger, a paused container) stays in discovery until its lease ends, up to a minute. Nodes of catenary
//! publish `/diagnostics` once a second from a thread of their own, however long they compute; other nodes are judged by discovery alone.

use anyhow::Result;
use catenary_msgs::diagnostic_msgs::msg::DiagnosticArray;
use catenary_shell::{Node, Peer, Subscription, contract};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Silence after which a node counts as stopped: five reports.
pub const SILENT: Duration = Duration::from_secs(5);
/// Period of the looks at the graph.
const LOOK: Duration = Duration::from_millis(500);
/// Most time that one look adds to a silence. A process that could not look has not listened either: on a machine that stalls, both stall.
const MOST: Duration = Duration::from_secs(1);

/// Watch over the node that serves a name.
pub struct Pulse {
    /// Numbers of reports, by the identifier of the publisher.
    reports: Arc<Mutex<HashMap<[u8; 16], u64>>>,
    /// Number of messages of feedback.
    feedback: Arc<AtomicU64>,
    _subscription: Subscription,
    silence: Silence,
}

/// Silence of a node, in time in which this process listened.
struct Silence {
    signs: u64,
    looked: Instant,
    silent: Duration,
}

impl Silence {
    fn new(now: Instant) -> Self {
        Self { signs: 0, looked: now, silent: Duration::ZERO }
    }

    /// Returns true if no sign came for [`SILENT`]. `signs` is the number of all signs so far.
    fn is_long(&mut self, signs: u64, now: Instant) -> bool {
        let passed = now.saturating_duration_since(self.looked).min(MOST);
        self.looked = now;
        if signs == self.signs {
            self.silent += passed;
        } else {
            (self.signs, self.silent) = (signs, Duration::ZERO);
        }
        self.silent >= SILENT
    }
}

impl Pulse {
    /// Begins to listen.
    pub fn new(node: &Node) -> Result<Self> {
        let reports = Arc::new(Mutex::new(HashMap::new()));
        let heard = Arc::clone(&reports);
        let topic = contract::DIAGNOSTICS;
        let subscription = node.subscription::<DiagnosticArray>(topic.name, topic.qos, move |received| {
            *heard.lock().unwrap_or_else(PoisonError::into_inner).entry(received.publisher).or_default() += 1;
        })?;
        let silence = Silence::new(Instant::now());
        Ok(Self { reports, feedback: Arc::default(), _subscription: subscription, silence })
    }

    /// Counter of feedback, for its receiver.
    pub fn feedback(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.feedback)
    }

    /// Returns the server of `name` if it has been silent for [`SILENT`]. May be called as often as wanted.
    pub fn silent(&mut self, node: &Node, name: &str) -> Result<Option<Peer>> {
        let now = Instant::now();
        if now.saturating_duration_since(self.silence.looked) < LOOK {
            return Ok(None);
        }
        let graph = node.graph_snapshot();
        let Some(server) = graph.servers(&[name])?.pop() else { return Ok(None) };
        let of_server = |peer: &Peer| peer.shares_participant(&server);
        let mut signs = self.feedback.load(Ordering::Relaxed);
        let reports = self.reports.lock().unwrap_or_else(PoisonError::into_inner);
        signs += reports.iter().filter(|(gid, _)| of_server(&node.peer(**gid))).map(|(_, n)| n).sum::<u64>();
        let reports_at_all = graph.publishers(contract::DIAGNOSTICS.name)?.iter().any(of_server);
        let is_long = self.silence.is_long(signs, now);
        Ok((is_long && reports_at_all).then_some(server))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_is_silent_after_five_seconds_of_listening_without_a_sign() {
        let start = Instant::now();
        let at = |s: f64| start + Duration::from_secs_f64(s);
        let mut silence = Silence::new(start);
        let looks = |silence: &mut Silence, from: u32, to: u32, signs: u64| -> Vec<u32> {
            (from..to).filter(|i| silence.is_long(signs, at(0.5 * f64::from(*i)))).collect()
        };
        assert_eq!(looks(&mut silence, 1, 10, 0), [] as [u32; 0]);
        assert_eq!(looks(&mut silence, 10, 19, 1), [] as [u32; 0], "a sign came");
        assert_eq!(looks(&mut silence, 19, 22, 1), [20, 21]);
        // This process stalled for a minute, and the node with it.
        let mut silence = Silence::new(start);
        assert!(!silence.is_long(0, at(60.0)) && !silence.is_long(0, at(60.5)));
    }
}
