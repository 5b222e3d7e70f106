//! Publishers.

use crate::clock::wall_now;
use crate::error::PublishError;
use crate::graph::Graph;
use crate::interface::Payload;
use crate::middleware::{Matches, Writer};
use crate::shutdown::Shutdown;
use crate::watchdog::Throttle;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

struct Inner<M: Payload> {
    // Before the graph, so that the writer goes first.
    writer: Writer<M>,
    topic: String,
    published: AtomicU64,
    failed: AtomicU64,
    warnings: Mutex<Throttle>,
    shutdown: Shutdown,
    graph: Arc<Graph>,
}

impl<M: Payload> Drop for Inner<M> {
    fn drop(&mut self) {
        self.graph.linger();
    }
}

/// Publishes messages of one type on one topic. Clones share the writer.
pub struct Publisher<M: Payload> {
    inner: Arc<Inner<M>>,
}

impl<M: Payload> Clone for Publisher<M> {
    fn clone(&self) -> Self {
        Self { inner: Arc::clone(&self.inner) }
    }
}

impl<M: Payload> Publisher<M> {
    pub(crate) fn new(writer: Writer<M>, topic: String, graph: Arc<Graph>, shutdown: Shutdown) -> Self {
        let (published, failed) = (AtomicU64::new(0), AtomicU64::new(0));
        let warnings = Mutex::new(Throttle::new(Duration::from_secs(5)));
        Self { inner: Arc::new(Inner { writer, topic, published, failed, warnings, shutdown, graph }) }
    }

    /// Publishes a message. Never waits for subscribers.
    ///
    /// # Errors
    /// [`PublishError`] where a reliable subscriber is thousands of messages behind, as one that was killed is
    /// until its lease ends: the message is lost for all.
    pub fn publish(&self, message: M) -> Result<(), PublishError> {
        let inner = &self.inner;
        let written = match inner.graph.has_left() {
            false => inner.writer.write(message),
            true => Err("the node has left the graph".to_owned()),
        };
        match written {
            Ok(()) => {
                inner.published.fetch_add(1, Ordering::Relaxed);
                inner.graph.touch();
                Ok(())
            }
            Err(reason) => {
                inner.failed.fetch_add(1, Ordering::Relaxed);
                Err(PublishError { topic: inner.topic.clone(), reason })
            }
        }
    }

    /// Publishes a message, or logs a warning, at most one in five seconds: for streams where the next message replaces
    /// a lost one.
    pub fn send(&self, message: M) {
        // A node that has left has nobody to tell.
        if let Err(error) = self.publish(message)
            && !self.inner.graph.has_left()
        {
            let mut warnings = self.inner.warnings.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(before) = warnings.pass(wall_now()) {
                tracing::warn!("{error} (and {before} before)");
            }
        }
    }

    /// The absolute topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.inner.topic
    }

    /// Messages published so far.
    #[must_use]
    pub fn published(&self) -> u64 {
        self.inner.published.load(Ordering::Relaxed)
    }

    /// Messages that could not be published.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.inner.failed.load(Ordering::Relaxed)
    }

    fn is_matched(&self, matches: &Matches) -> bool {
        matches.has_reader(self.inner.writer.guid())
    }

    /// Whether any subscription is matched at present.
    #[must_use]
    pub fn has_subscriber(&self) -> bool {
        self.is_matched(self.inner.graph.matches())
    }

    /// Waits until a subscription is matched; false: none in time, or shutdown.
    #[must_use]
    pub fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        self.inner.graph.wait_matched(&self.inner.shutdown, timeout, &|matches| self.is_matched(matches))
    }
}
