//! A node: its name, parameters and clock, and everything it publishes, subscribes and serves.

use crate::args::RosArgs;
use crate::clock::{Clock, Tick};
use crate::contract;
use crate::ending::Ending;
use crate::error::ShellError;
use crate::graph::Graph;
use crate::intake::{Intake, Intakes};
use crate::interface::{Msg, Srv, request_type};
use crate::params::Params;
use crate::publisher::Publisher;
use crate::qos::Qos;
use crate::shutdown::Shutdown;
use crate::subscription::{Latest, Queue, Received, Subscription};
use crate::threads::Threads;
use crate::time::Time;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// What the builder puts together.
pub(crate) struct Inner {
    pub(crate) threads: Arc<Threads>,
    pub(crate) graph: Arc<Graph>,
    pub(crate) name: String,
    pub(crate) namespace: String,
    pub(crate) path: String,
    pub(crate) args: RosArgs,
    pub(crate) params: Params,
    pub(crate) intakes: Arc<Intakes>,
    pub(crate) clock: Clock,
    pub(crate) shutdown: Shutdown,
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Inner {
    fn ending(&self) -> Ending {
        Ending {
            threads: Arc::clone(&self.threads),
            graph: Arc::clone(&self.graph),
            params: self.params.clone(),
            shutdown: self.shutdown.clone(),
        }
    }

    fn stop(&self) {
        self.ending().end();
    }
}

/// A node in the graph. Clones are the same node, which leaves the graph at [`Node::stop`], with the last of them, or at the
/// end of [`crate::main`].
#[derive(Clone)]
pub struct Node {
    inner: Arc<Inner>,
    /// Whether subscriptions end with the node.
    binds: bool,
}

impl Node {
    pub(crate) fn new(inner: Inner) -> Self {
        inner.ending().register();
        Self { inner: Arc::new(inner), binds: true }
    }

    /// The same node, whose subscriptions go on after shutdown until they are dropped, which must be soon: for what was sent before
    /// it and has not come yet.
    #[must_use]
    pub fn unbound(&self) -> Self {
        Self { binds: false, ..self.clone() }
    }

    /// What ends a subscription that is made here.
    pub(crate) fn end_of_subscription(&self) -> Shutdown {
        if self.binds { self.shutdown().child() } else { Shutdown::new() }
    }

    /// The base name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// The fully qualified name, such as `/lab/camera`.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.inner.path
    }

    /// The parameters.
    #[must_use]
    pub fn params(&self) -> &Params {
        &self.inner.params
    }

    /// The clock.
    #[must_use]
    pub fn clock(&self) -> &Clock {
        &self.inner.clock
    }

    /// The present time of the clock.
    #[must_use]
    pub fn now(&self) -> Time {
        self.inner.clock.now()
    }

    /// A standard header with the present time.
    #[must_use]
    pub fn header(&self, frame_id: &str) -> catenary_msgs::std_msgs::msg::Header {
        crate::stamp::header(self.now(), frame_id)
    }

    /// What ends the node.
    #[must_use]
    pub fn shutdown(&self) -> &Shutdown {
        &self.inner.shutdown
    }

    /// Whether the node shall end.
    #[must_use]
    pub fn is_shutdown(&self) -> bool {
        self.inner.shutdown.is_triggered()
    }

    /// Ends every thread of the node, waits for them and leaves the graph. The last clone's drop does the same.
    pub fn stop(&self) {
        self.inner.stop();
    }

    /// The thread of the node that panicked first.
    #[must_use]
    pub fn panicked(&self) -> Option<String> {
        self.inner.threads.panicked()
    }

    /// Starts a thread of the node. It must end soon after shutdown; a panic in it is logged and ends the node.
    ///
    /// # Errors
    /// [`ShellError::Create`] where the system has no thread left.
    pub fn spawn(&self, name: &str, body: impl FnOnce() + Send + 'static) -> Result<(), ShellError> {
        self.inner.threads.spawn(name, body)
    }

    /// Calls `turn` every `period` of the node's clock until shutdown or its first error.
    ///
    /// # Errors
    /// That of `turn`, or the name of a thread that panicked.
    pub fn run_until_shutdown(
        &self,
        period: Duration,
        mut turn: impl FnMut(Tick) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let mut rate = self.inner.clock.rate(period);
        while let Some(tick) = rate.tick() {
            turn(tick)?;
        }
        self.outcome()
    }

    /// Waits for shutdown, while subscriptions, services and actions do the work.
    ///
    /// # Errors
    /// The name of a thread that panicked.
    pub fn wait_for_shutdown(&self) -> anyhow::Result<()> {
        self.inner.shutdown.wait();
        self.outcome()
    }

    fn outcome(&self) -> anyhow::Result<()> {
        match self.panicked() {
            Some(thread) => Err(anyhow::anyhow!("thread {thread} panicked")),
            None => Ok(()),
        }
    }

    /// The absolute name of a topic, service or action after expansion and remapping.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn resolve(&self, name: &str) -> Result<String, ShellError> {
        self.inner
            .args
            .resolve(name, &self.inner.namespace, &self.inner.name)
            .map_err(|reason| ShellError::Name { what: format!("name {name:?}"), reason })
    }

    /// Publishes on a topic.
    ///
    /// # Errors
    /// [`ShellError`]: the name, a type that the contract contradicts, the middleware.
    pub fn publisher<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Publisher<M>, ShellError> {
        let qos = qos.of_writer();
        // Whether a publisher of these is there decides whether an arm may move.
        let decides = contract::topic(topic)
            .is_some_and(|topic| *topic == contract::TARGET_POSE || contract::ARM_TOPICS.contains(&topic.name));
        let policies = if decides { qos.policies_with_promise() } else { qos.policies() };
        let name = self.topic::<M>(topic)?;
        let writer = self.graph().writer(&name, M::TYPE_NAME, &policies)?;
        Ok(Publisher::new(writer, name, Arc::clone(self.graph()), self.shutdown().clone()))
    }

    /// Calls `callback` with every message, on a thread of the subscription's own, until the handle is dropped.
    ///
    /// Transient local: of what was sent before, the last `depth` messages of each publisher come, 0.1 s after the
    /// publisher has fallen silent or before its next message.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn subscription<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        mut callback: impl FnMut(Received<M>) + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let intake = self.plain_intake::<M>(topic, qos)?;
        self.take(&intake, move |received| {
            callback(received);
            Ok(())
        })
    }

    /// Subscription whose unreadable messages `intake` counts.
    pub(crate) fn subscribe<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        intake: Option<Intake>,
        callback: impl FnMut(Received<M>) + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let name = self.topic::<M>(topic)?;
        let reader = self.graph().reader(&name, M::TYPE_NAME, &qos.policies())?;
        Subscription::start(self, name, qos, reader, intake, callback)
    }

    /// Keeps the newest message of a topic.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn latest<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Latest<M>, ShellError> {
        Latest::start(self, &self.plain_intake::<M>(topic, qos)?, |_| Ok(()))
    }

    /// Queues the messages of a topic, `capacity` at most; where it is full the oldest go, and are counted.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn queue<M: Msg>(&self, topic: &str, qos: Qos, capacity: usize) -> Result<Queue<M>, ShellError> {
        Queue::start(self, &self.plain_intake::<M>(topic, qos)?, capacity)
    }

    /// How many publishers of a topic are known in the whole graph, this node's own included. One that was killed counts
    /// until its lease ends: 50 s, for publishers of targets, or of the pose or the state of an arm, 6 s.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publisher_count(&self, topic: &str) -> Result<usize, ShellError> {
        let name = self.resolve(topic)?;
        Ok(self.graph().publisher_count(&name))
    }

    /// How many publishers of a topic are known in the whole graph besides this node's own.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn other_publisher_count(&self, topic: &str) -> Result<usize, ShellError> {
        let name = self.resolve(topic)?;
        Ok(self.graph().other_publisher_count(&name))
    }

    /// The absolute names of all services of a type in the graph, and how many nodes serve each: one, where all is well. A
    /// node that went away without a word is in it up to the end of its lease of 10 s.
    ///
    /// # Errors
    /// [`ShellError::TypeName`].
    pub fn services_of_type<S: Srv>(&self) -> Result<BTreeMap<String, usize>, ShellError> {
        let mut found = BTreeMap::new();
        for name in self.graph().services(&request_type(S::TYPE_NAME)?) {
            *found.entry(name).or_default() += 1;
        }
        Ok(found)
    }

    pub(crate) fn threads(&self) -> &Arc<Threads> {
        &self.inner.threads
    }

    pub(crate) fn intakes(&self) -> &Arc<Intakes> {
        &self.inner.intakes
    }

    pub(crate) fn graph(&self) -> &Arc<Graph> {
        &self.inner.graph
    }

    /// The absolute name of a topic, whose type must be the one of the contract.
    fn topic<M: Msg>(&self, topic: &str) -> Result<String, ShellError> {
        if let Some(agreed) = contract::topic(topic)
            && agreed.type_name != M::TYPE_NAME
        {
            return Err(ShellError::ContractType {
                name: topic.to_owned(),
                expected: agreed.type_name,
                got: M::TYPE_NAME,
            });
        }
        self.resolve(topic)
    }
}
