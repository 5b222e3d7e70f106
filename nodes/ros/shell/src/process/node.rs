//! Node: its name, parameters, clock, threads and graph.

use super::ending::Ending;
use super::health::Sources;
use super::threads::Threads;
use crate::contract;
use crate::dds::graph::Graph;
use crate::dds::interface::{Msg, Srv, request_type};
use crate::dds::qos::Qos;
use crate::error::ShellError;
use crate::parameters::args::RosArgs;
use crate::parameters::store::Params;
use crate::time::clock::{Clock, Tick};
use crate::time::point::Time;
use crate::time::shutdown::Shutdown;
use crate::time::stamp;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Parts of a node, assembled by the builder.
pub(crate) struct Inner {
    pub(crate) threads: Arc<Threads>,
    pub(crate) graph: Arc<Graph>,
    pub(crate) name: String,
    pub(crate) namespace: String,
    pub(crate) path: String,
    pub(crate) args: RosArgs,
    pub(crate) params: Params,
    pub(crate) lock_step: bool,
    pub(crate) health_sources: Arc<Sources>,
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

/// Node in the graph. Clones are the same node. It leaves the graph at [`Node::stop`], with its last clone, or at the end of
/// [`crate::main`].
#[derive(Clone)]
pub struct Node {
    inner: Arc<Inner>,
    /// True if subscriptions end with the node.
    binds: bool,
}

impl Node {
    pub(crate) fn new(inner: Inner) -> Self {
        inner.ending().register();
        Self { inner: Arc::new(inner), binds: true }
    }

    /// Returns a clone whose subscriptions do not end at shutdown, but when they are dropped. It receives messages that were sent
    /// before shutdown and have not arrived yet. Drop its subscriptions soon after shutdown.
    #[must_use]
    pub fn unbound(&self) -> Self {
        Self { binds: false, ..self.clone() }
    }

    /// Returns the shutdown of a new subscription.
    pub(crate) fn end_of_subscription(&self) -> Shutdown {
        if self.binds { self.shutdown().child() } else { Shutdown::new() }
    }

    /// Returns the base name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Returns the fully qualified name, for example `/lab/camera`.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.inner.path
    }

    /// Returns the parameters.
    #[must_use]
    pub fn params(&self) -> &Params {
        &self.inner.params
    }

    /// Returns the clock.
    #[must_use]
    pub fn clock(&self) -> &Clock {
        &self.inner.clock
    }

    /// Returns true if the node takes part in lock step: see [`NodeBuilder::in_lock_step`](crate::NodeBuilder::in_lock_step).
    #[must_use]
    pub fn is_in_lock_step(&self) -> bool {
        self.inner.lock_step
    }

    /// Returns the profile that an endpoint of this node has in place of `qos`.
    pub(crate) fn profile(&self, qos: Qos) -> Qos {
        if self.inner.lock_step { qos.repeated() } else { qos }
    }

    /// Returns the present time of the clock.
    #[must_use]
    pub fn now(&self) -> Time {
        self.inner.clock.now()
    }

    /// Creates a standard header with the present time.
    #[must_use]
    pub fn header(&self, frame_id: &str) -> catenary_msgs::std_msgs::msg::Header {
        stamp::header(self.now(), frame_id)
    }

    /// Returns the shutdown of the node.
    #[must_use]
    pub fn shutdown(&self) -> &Shutdown {
        &self.inner.shutdown
    }

    /// Returns true once the node must end.
    #[must_use]
    pub fn is_shutdown(&self) -> bool {
        self.inner.shutdown.is_triggered()
    }

    /// Ends all threads of the node, waits for them, and leaves the graph. Dropping the last clone does the same.
    pub fn stop(&self) {
        self.inner.stop();
    }

    /// Returns the name of the first thread that panicked.
    #[must_use]
    pub fn panicked(&self) -> Option<String> {
        self.inner.threads.panicked()
    }

    /// Starts a thread of the node. The thread must end soon after shutdown. A panic in it is logged and ends the node.
    ///
    /// # Errors
    /// [`ShellError::Create`]: the operating system refuses the thread.
    pub fn spawn(&self, name: &str, body: impl FnOnce() + Send + 'static) -> Result<(), ShellError> {
        self.inner.threads.spawn(name, body)
    }

    /// Calls `turn` every `period` of the node's clock until shutdown or its first error.
    ///
    /// # Errors
    /// Error of `turn`, or the name of a thread that panicked.
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

    /// Waits for shutdown, while subscriptions, services and actions work.
    ///
    /// # Errors
    /// Name of a thread that panicked.
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

    /// Returns the absolute name of a topic, service or action after expansion and remapping.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn resolve(&self, name: &str) -> Result<String, ShellError> {
        self.inner
            .args
            .resolve(name, &self.inner.namespace, &self.inner.name)
            .map_err(|reason| ShellError::Name { what: format!("name {name:?}"), reason })
    }

    /// Returns the number of publishers of a topic in the whole graph, this node's own included. A killed publisher counts until
    /// its lease ends: 6 s for targets and for pose and state of an arm, 50 s for other topics.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publisher_count(&self, topic: &str) -> Result<usize, ShellError> {
        let name = self.resolve(topic)?;
        Ok(self.graph().publisher_count(&name))
    }

    /// Returns the number of publishers of a topic in the whole graph without this node's own.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn other_publisher_count(&self, topic: &str) -> Result<usize, ShellError> {
        let name = self.resolve(topic)?;
        Ok(self.graph().other_publisher_count(&name))
    }

    /// Returns the absolute names of all services of a type in the graph, with the number of their servers, normally one. A killed
    /// server counts until its lease of 10 s ends.
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

    /// Returns the sources of the node's health reports.
    pub(crate) fn health_sources(&self) -> &Arc<Sources> {
        &self.inner.health_sources
    }

    pub(crate) fn graph(&self) -> &Arc<Graph> {
        &self.inner.graph
    }

    /// Returns the absolute name of a topic, after checking its type against the contract.
    pub(crate) fn topic<M: Msg>(&self, topic: &str) -> Result<String, ShellError> {
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
