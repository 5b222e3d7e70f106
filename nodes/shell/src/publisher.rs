//! Publishers.

use crate::clock::wall_now;
use crate::error::PublishError;
use crate::graph::Graph;
use crate::interface::Payload;
use crate::shutdown::Shutdown;
use crate::watchdog::Throttle;
use futures::FutureExt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

struct Inner<M: Payload> {
    // Before the graph, so that the writer goes first.
    writer: ros2_client::Publisher<M>,
    topic: String,
    published: AtomicU64,
    failed: AtomicU64,
    /// Whether a subscription was ever matched.
    met: AtomicBool,
    warnings: Mutex<Throttle>,
    shutdown: Shutdown,
    graph: Arc<Graph>,
}

impl<M: Payload> Inner<M> {
    /// Whether any subscription is matched. ros2-client counts those of a writer that had one before; looking for the first
    /// one leaves some memory behind until the graph changes.
    fn is_matched(&self, ros: &ros2_client::Node) -> bool {
        if self.met.load(Ordering::Relaxed) {
            return self.writer.get_subscription_count(ros) > 0;
        }
        let matched = self.writer.wait_for_subscription(ros).now_or_never().is_some();
        self.met.store(matched, Ordering::Relaxed);
        matched
    }
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
    pub(crate) fn new(writer: ros2_client::Publisher<M>, topic: String, graph: Arc<Graph>, shutdown: Shutdown) -> Self {
        let (published, failed) = (AtomicU64::new(0), AtomicU64::new(0));
        let met = AtomicBool::new(false);
        let warnings = Mutex::new(Throttle::new(Duration::from_secs(5)));
        Self { inner: Arc::new(Inner { writer, topic, published, failed, met, warnings, shutdown, graph }) }
    }

    /// Publishes a message. Never waits for subscribers.
    ///
    /// # Errors
    /// [`PublishError`] where a reliable subscriber is thousands of messages behind, as one that was killed is
    /// until its lease ends: the message is lost for all.
    pub fn publish(&self, message: M) -> Result<(), PublishError> {
        match self.inner.writer.publish(message) {
            Ok(()) => {
                self.inner.published.fetch_add(1, Ordering::Relaxed);
                self.inner.graph.touch();
                Ok(())
            }
            Err(error) => {
                self.inner.failed.fetch_add(1, Ordering::Relaxed);
                let reason = match error {
                    ros2_client::WriteError::WouldBlock { .. } => "a subscriber does not keep up".to_owned(),
                    other => other.to_string(),
                };
                Err(PublishError { topic: self.inner.topic.clone(), reason })
            }
        }
    }

    /// Publishes a message, or logs a warning, at most one in five seconds: for streams where the next message replaces
    /// a lost one.
    pub fn send(&self, message: M) {
        if let Err(error) = self.publish(message) {
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

    /// Whether any subscription is matched at present.
    #[must_use]
    pub fn has_subscriber(&self) -> bool {
        self.inner.is_matched(&self.inner.graph.ros())
    }

    /// Waits until a subscription is matched; false: none in time, or shutdown.
    #[must_use]
    pub fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        self.inner.graph.wait_matched(&self.inner.shutdown, timeout, &|ros| self.inner.is_matched(ros))
    }
}
