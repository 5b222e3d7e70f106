//! The end of nodes: their threads end, and they leave the graph, whoever still holds a clone of them.
//!
//! A process that ends while a node is in the graph leaves a ghost behind: the others count it, its publishers and its services
//! until the lease of its participant ends, 50 s later. So every node is known here from its start to its end, and
//! [`leave_graph`], [`LeaveAtEnd`] and [`exit`] end those that are left.

use crate::graph::Graph;
use crate::params::Params;
use crate::shutdown::Shutdown;
use crate::threads::Threads;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Duration;

/// Time that [`exit`] gives the nodes to leave.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Parts of a node that end with it.
#[derive(Clone)]
pub(crate) struct Ending {
    pub(crate) threads: Arc<Threads>,
    pub(crate) graph: Arc<Graph>,
    pub(crate) params: Params,
    pub(crate) shutdown: Shutdown,
}

/// The nodes of this process that have not left.
static NODES: Mutex<Vec<Ending>> = Mutex::new(Vec::new());

fn nodes() -> MutexGuard<'static, Vec<Ending>> {
    NODES.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Ending {
    /// From now on the node is ended with the process.
    pub(crate) fn register(&self) {
        nodes().push(self.clone());
    }

    /// Ends the threads and leaves the graph; returns when the others can know. A second time does nothing.
    pub(crate) fn end(&self) {
        self.shutdown.trigger();
        if let Err(late) = self.threads.join() {
            tracing::error!("threads that did not end in time: {}", late.join(", "));
        }
        self.params.forget_listeners();
        self.graph.leave();
        nodes().retain(|other| !Arc::ptr_eq(&other.graph, &self.graph));
    }
}

/// Ends every node of this process, and returns when all have left the graph.
pub fn leave_graph() {
    // Cloned: a node ends without the lock, which others need in order to end.
    let left = nodes().clone();
    left.iter().for_each(Ending::end);
}

/// Ends every node of this process when it is dropped: for `main`, so that a panic and an early return leave no ghost.
#[must_use = "dropping it ends the nodes of this process"]
pub struct LeaveAtEnd;

impl Drop for LeaveAtEnd {
    fn drop(&mut self) {
        leave_graph();
    }
}

/// Ends the process at once. Its nodes leave the graph, but nothing else is waited for.
pub fn exit(code: i32) -> ! {
    let left = nodes().clone();
    let (sender, done) = mpsc::channel();
    // On a thread of its own: the graph may be held by what does not end.
    let leaving = std::thread::Builder::new().name("leaving".to_owned()).spawn(move || {
        left.iter().for_each(|node| node.graph.leave());
        let _gone = sender.send(());
    });
    if leaving.is_ok() {
        let _late = done.recv_timeout(LAST_WORDS);
    }
    std::process::exit(code)
}
