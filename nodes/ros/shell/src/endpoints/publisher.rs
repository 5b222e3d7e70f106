//! Publishers.

use crate::contract;
use crate::dds::endpoint::Writer;
use crate::dds::graph::Graph;
use crate::dds::interface::{Msg, Payload};
use crate::dds::matches::Matches;
use crate::dds::qos::Qos;
use crate::error::{PublishError, ShellError};
use crate::process::node::Node;
use crate::time::clock::wall_now;
use crate::time::shutdown::Shutdown;
use crate::time::watchdog::Throttle;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

struct Inner<M: Payload> {
    // Declared before the graph: fields drop in this order, and endpoints must go before their participant.
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
        // RustDDS drops unsent messages with the writer.
        self.graph.linger();
    }
}

/// Publisher of one message type on one topic. Clones share the writer.
pub struct Publisher<M: Payload> {
    inner: Arc<Inner<M>>,
}

impl<M: Payload> Clone for Publisher<M> {
    fn clone(&self) -> Self {
        Self { inner: Arc::clone(&self.inner) }
    }
}

impl Node {
    /// Creates a publisher on a topic.
    ///
    /// # Errors
    /// [`ShellError`]: the name, a type other than the contract's, the middleware.
    pub fn publisher<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Publisher<M>, ShellError> {
        let qos = self.profile(qos).of_writer();
        // A second publisher on one of these topics prevents the arm from moving, so a dead one must be noticed soon.
        let alone = [contract::TARGET_POSE, contract::ARM_LAW];
        let decides = contract::topic(topic)
            .is_some_and(|topic| alone.contains(topic) || contract::ARM_TOPICS.contains(&topic.name));
        let policies = if decides { qos.policies_with_lease() } else { qos.policies() };
        let name = self.topic::<M>(topic)?;
        let writer = self.graph().writer(&name, M::TYPE_NAME, &policies)?;
        Ok(Publisher::new(writer, name, Arc::clone(self.graph()), self.shutdown().clone()))
    }
}

impl<M: Payload> Publisher<M> {
    pub(crate) fn new(writer: Writer<M>, topic: String, graph: Arc<Graph>, shutdown: Shutdown) -> Self {
        let (published, failed) = (AtomicU64::new(0), AtomicU64::new(0));
        // One warning in 5 s: a stream at 200 Hz would flood the log.
        let warnings = Mutex::new(Throttle::new(Duration::from_secs(5)));
        Self { inner: Arc::new(Inner { writer, topic, published, failed, warnings, shutdown, graph }) }
    }

    /// Publishes a message, without waiting for subscribers.
    ///
    /// # Errors
    /// [`PublishError`] if a reliable subscriber is thousands of messages behind, for example a killed one before its lease ends.
    /// The message is then lost for all subscribers.
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

    /// Publishes a message of a stream in which the next message replaces a lost one. A failure is logged as a warning, at most
    /// every 5 s.
    pub fn send(&self, message: M) {
        // After the node has left, failures are expected.
        if let Err(error) = self.publish(message)
            && !self.inner.graph.has_left()
        {
            let mut warnings = self.inner.warnings.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(before) = warnings.pass(wall_now()) {
                tracing::warn!("{error} (and {before} before)");
            }
        }
    }

    /// Waits until every reliable subscription has acknowledged all messages so far. Returns false on timeout.
    #[must_use]
    pub fn wait_acknowledged(&self, timeout: Duration) -> bool {
        self.inner.writer.wait_acknowledged(timeout)
    }

    /// Returns the absolute name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.inner.topic
    }

    /// Returns the number of messages published so far.
    #[must_use]
    pub fn published(&self) -> u64 {
        self.inner.published.load(Ordering::Relaxed)
    }

    /// Returns the number of messages that could not be published.
    #[must_use]
    pub fn failed(&self) -> u64 {
        self.inner.failed.load(Ordering::Relaxed)
    }

    fn is_matched(&self, matches: &Matches) -> bool {
        matches.has_reader(self.inner.writer.guid())
    }

    /// Returns true if a subscription is matched now.
    #[must_use]
    pub fn has_subscriber(&self) -> bool {
        self.is_matched(self.inner.graph.matches())
    }

    /// Waits until a subscription is matched. Returns false on timeout or shutdown.
    #[must_use]
    pub fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        self.inner.graph.wait_matched(&self.inner.shutdown, timeout, &|matches| self.is_matched(matches))
    }
}
