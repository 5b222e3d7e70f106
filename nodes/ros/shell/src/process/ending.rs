//! End of nodes: their threads end and they leave the graph, even if clones of them still exist.
//!
//! A process that ends without leaving the graph leaves a ghost: other nodes count its publishers and services until the lease of
//! its participant ends, 50 s later. Therefore every node is registered here from its start to its end. [`leave_graph`],
//! [`LeaveAtEnd`] and [`exit`] end the registered nodes.

use super::threads::Threads;
use crate::dds::graph::Graph;
use crate::parameters::store::Params;
use crate::time::shutdown::Shutdown;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Duration;

/// Time limit of [`exit`] for the nodes to leave. Chosen: a node lingers 50 ms after its last message.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Parts of a node that must be ended.
#[derive(Clone)]
pub(crate) struct Ending {
    pub(crate) threads: Arc<Threads>,
    pub(crate) graph: Arc<Graph>,
    pub(crate) params: Params,
    pub(crate) shutdown: Shutdown,
}

/// Nodes of this process that have not left the graph.
static NODES: Mutex<Vec<Ending>> = Mutex::new(Vec::new());

fn nodes() -> MutexGuard<'static, Vec<Ending>> {
    NODES.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Ending {
    /// Registers the node, so that it is ended with the process.
    pub(crate) fn register(&self) {
        nodes().push(self.clone());
    }

    /// Ends the threads and leaves the graph. Returns after the other nodes were told. A second call does nothing.
    pub(crate) fn end(&self) {
        self.shutdown.trigger();
        // Threads first: they may still publish their last messages.
        if let Err(late) = self.threads.join() {
            tracing::error!("threads that did not end in time: {}", late.join(", "));
        }
        // Listeners hold writers, which must go before the session.
        self.params.forget_listeners();
        self.graph.leave();
        nodes().retain(|other| !Arc::ptr_eq(&other.graph, &self.graph));
    }
}

/// Ends every node of this process. Returns when all have left the graph.
pub fn leave_graph() {
    // Cloned, because each node takes this lock when it ends.
    let left = nodes().clone();
    left.iter().for_each(Ending::end);
}

/// Guard for `main` that ends every node of this process when it is dropped: a panic or an early return leaves no ghost.
#[must_use = "dropping it ends the nodes of this process"]
pub struct LeaveAtEnd;

impl Drop for LeaveAtEnd {
    fn drop(&mut self) {
        leave_graph();
    }
}

/// Ends the process at once. Its nodes leave the graph, but their threads are not awaited.
pub fn exit(code: i32) -> ! {
    let left = nodes().clone();
    let (sender, done) = mpsc::channel();
    // On its own thread, because a thread that does not end may hold the graph's lock.
    let leaving = std::thread::Builder::new().name("leaving".to_owned()).spawn(move || {
        left.iter().for_each(|node| node.graph.leave());
        let _gone = sender.send(());
    });
    if leaving.is_ok() {
        let _late = done.recv_timeout(LAST_WORDS);
    }
    std::process::exit(code)
}
