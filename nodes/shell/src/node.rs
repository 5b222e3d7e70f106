//! A node: its name, parameters and clock, and everything it publishes, subscribes and serves.

use crate::args::RosArgs;
use crate::clock::{Clock, Tick};
use crate::contract;
use crate::error::ShellError;
use crate::interface::{Msg, message_type};
use crate::logging::{self, Rosout};
use crate::names;
use crate::params::{Param, ParamKind, ParamSpec, Params};
use crate::participant::{Discovery, Participation};
use crate::publisher::Publisher;
use crate::qos::Qos;
use crate::shutdown::Shutdown;
use crate::spinner;
use crate::subscription::{Latest, Queue, Received, Subscription};
use crate::threads::Threads;
use crate::time::Time;
use rustdds::{Topic as DdsTopic, TopicKind};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A node before it joins the graph: parameters are declared here.
pub struct NodeBuilder {
    name: String,
    namespace: String,
    args: RosArgs,
    params: Params,
    use_sim_time: Param<bool>,
    participation: Option<Participation>,
    shutdown: Shutdown,
    help: Option<String>,
}

impl NodeBuilder {
    /// A node with a default name in the namespace `/`; both follow the arguments' `__node` and `__ns`.
    ///
    /// # Errors
    /// [`ShellError`] for invalid names and for a value of `use_sim_time` that is no boolean.
    pub fn new(name: &str, args: &RosArgs) -> Result<Self, ShellError> {
        names::check_node_name(name).map_err(|reason| ShellError::Name { what: "node".to_owned(), reason })?;
        let (name, namespace) = args.node_identity(name, "/")?;
        let overrides = args.params_for(&namespace, &name).cloned();
        let params = Params::new(names::node_path(&namespace, &name), overrides);
        let spec = ParamSpec::new("Follow /clock instead of the wall clock.");
        let use_sim_time = params.declare("use_sim_time", false, spec)?;
        Ok(Self {
            name,
            namespace,
            args: args.clone(),
            params,
            use_sim_time,
            participation: None,
            shutdown: Shutdown::new(),
            help: None,
        })
    }

    /// Takes part in this domain and range instead of those of the environment.
    #[must_use]
    pub fn domain(mut self, domain: u16, discovery: Discovery) -> Self {
        self.participation = Some(Participation { domain, discovery });
        self
    }

    /// Makes [`NodeBuilder::build`] print the parameters under this headline instead of joining.
    pub(crate) fn with_help(mut self, headline: String) -> Self {
        self.help = Some(headline);
        self
    }

    /// What ends the node; it can be triggered before the node is built.
    #[must_use]
    pub fn shutdown(&self) -> &Shutdown {
        &self.shutdown
    }

    /// The node's base name after remapping.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The parameters declared so far.
    #[must_use]
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// Declares a parameter of any kind: see [`Params::declare`].
    ///
    /// # Errors
    /// [`ShellError::Params`].
    pub fn declare<T: ParamKind>(&self, name: &str, default: T, spec: ParamSpec) -> Result<Param<T>, ShellError> {
        Ok(self.params.declare(name, default, spec)?)
    }

    /// Declares a number.
    ///
    /// # Errors
    /// [`ShellError::Params`].
    pub fn declare_f64(&self, name: &str, default: f64, spec: ParamSpec) -> Result<Param<f64>, ShellError> {
        self.declare(name, default, spec)
    }

    /// Declares an integer.
    ///
    /// # Errors
    /// [`ShellError::Params`].
    pub fn declare_i64(&self, name: &str, default: i64, spec: ParamSpec) -> Result<Param<i64>, ShellError> {
        self.declare(name, default, spec)
    }

    /// Declares a boolean.
    ///
    /// # Errors
    /// [`ShellError::Params`].
    pub fn declare_bool(&self, name: &str, default: bool, spec: ParamSpec) -> Result<Param<bool>, ShellError> {
        self.declare(name, default, spec)
    }

    /// Declares a string.
    ///
    /// # Errors
    /// [`ShellError::Params`].
    pub fn declare_string(&self, name: &str, default: &str, spec: ParamSpec) -> Result<Param<String>, ShellError> {
        self.declare(name, default.to_owned(), spec)
    }

    /// Joins the graph. Every parameter must have been declared by now.
    ///
    /// # Errors
    /// [`ShellError`]: values for undeclared parameters, environment variables, the middleware.
    pub fn build(self) -> Result<Node, ShellError> {
        if let Some(headline) = self.help {
            crate::run::print_help(&headline, &self.params);
            return Err(ShellError::HelpShown);
        }
        let unused = self.params.refuse_unknown()?;
        let (participation, warnings) = match self.participation {
            Some(participation) => (participation, Vec::new()),
            None => Participation::from_environment(&|name| std::env::var(name).ok())?,
        };
        let participant = participation.join()?;
        let context = ros2_client::Context::from_domain_participant(participant)
            .map_err(|error| ShellError::create("ROS 2 context", error))?;
        let ros_name = ros2_client::NodeName::new(&self.namespace, &self.name)
            .map_err(|error| ShellError::create(format!("node {}", self.name), error))?;
        // The parameter services and events are this crate's own: they describe ranges, units and choices.
        let options =
            ros2_client::NodeOptions::new().enable_rosout(self.args.rosout_logs).start_parameter_services(false);
        let ros = context
            .new_node(ros_name, options)
            .map_err(|error| ShellError::create(format!("node {}", self.name), error))?;
        let path = names::node_path(&self.namespace, &self.name);
        let logger = path.trim_start_matches('/').replace('/', ".");
        let (rosout, lines) = Rosout::new(&logger);
        rosout.adopt_process();
        let clock = Clock::new(&self.shutdown);
        let node = Node {
            inner: Arc::new(Inner {
                threads: Arc::new(Threads::new(rosout, self.shutdown.clone())),
                graph: Arc::new(Graph::new(ros, context)),
                name: self.name,
                namespace: self.namespace,
                path,
                args: self.args,
                params: self.params,
                clock,
                shutdown: self.shutdown,
            }),
        };
        spinner::start(&node, &self.use_sim_time, lines)?;
        for warning in warnings {
            tracing::warn!("{warning}");
        }
        for origin in unused {
            tracing::warn!("{origin}: this node has no such parameter");
        }
        for option in &node.inner.args.without_effect {
            tracing::warn!("{option}: has no effect here");
        }
        Ok(node)
    }
}

/// The middleware's node and context; every endpoint keeps them alive, and the node goes before the context.
pub(crate) struct Graph {
    ros: Mutex<ros2_client::Node>,
    context: ros2_client::Context,
    since: Instant,
    /// Nanoseconds from `since` to the last write of any endpoint.
    written: AtomicU64,
}

/// Graphs of this process.
static LIVE: AtomicUsize = AtomicUsize::new(0);

impl Drop for Graph {
    fn drop(&mut self) {
        if LIVE.fetch_sub(1, Ordering::AcqRel) == 1 {
            logging::hush_middleware(true);
        }
    }
}

/// How long a writer stays after the last write, which leaves the process on another thread.
const LINGER: Duration = Duration::from_millis(50);

impl Graph {
    fn new(ros: ros2_client::Node, context: ros2_client::Context) -> Self {
        LIVE.fetch_add(1, Ordering::AcqRel);
        logging::hush_middleware(false);
        Self { ros: Mutex::new(ros), context, since: Instant::now(), written: AtomicU64::new(0) }
    }

    fn elapsed(&self) -> u64 {
        u64::try_from(self.since.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// Something was written just now.
    pub(crate) fn touch(&self) {
        self.written.store(self.elapsed(), Ordering::Relaxed);
    }

    /// Waits until what was written last has surely left; for the end of a writer.
    pub(crate) fn linger(&self) {
        let written = self.written.load(Ordering::Relaxed);
        let age = Duration::from_nanos(self.elapsed().saturating_sub(written));
        if written > 0 && age < LINGER {
            std::thread::sleep(LINGER - age);
        }
    }

    pub(crate) fn ros(&self) -> MutexGuard<'_, ros2_client::Node> {
        self.ros.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn participant(&self) -> rustdds::DomainParticipant {
        self.context.domain_participant()
    }

    /// The DDS topic behind an absolute name.
    pub(crate) fn topic(&self, name: &str, type_name: &'static str, qos: Qos) -> Result<DdsTopic, ShellError> {
        self.context
            .domain_participant()
            .create_topic(
                format!("rt{name}"),
                message_type(type_name)?.dds_msg_type(),
                &qos.policies(),
                TopicKind::NoKey,
            )
            .map_err(|error| ShellError::create(format!("topic {name}"), error))
    }

    /// Waits until `matched` holds, looking again at every change of the graph.
    pub(crate) fn wait_matched(
        &self,
        shutdown: &Shutdown,
        timeout: Duration,
        matched: &dyn Fn(&ros2_client::Node) -> bool,
    ) -> bool {
        let deadline = Instant::now() + timeout;
        let events = self.ros().status_receiver();
        loop {
            if matched(&self.ros()) {
                return true;
            }
            let Some(events) = &events else {
                return false;
            };
            let event = smol::future::or(async { events.recv().await.is_ok() }, async {
                shutdown.triggered().await;
                false
            });
            if crate::wait::block_until(event, Some(deadline)) != Some(true) {
                return matched(&self.ros());
            }
        }
    }
}

struct Inner {
    threads: Arc<Threads>,
    graph: Arc<Graph>,
    name: String,
    namespace: String,
    path: String,
    args: RosArgs,
    params: Params,
    clock: Clock,
    shutdown: Shutdown,
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Inner {
    fn stop(&self) {
        self.shutdown.trigger();
        if let Err(late) = self.threads.join() {
            tracing::error!("threads that did not end in time: {}", late.join(", "));
        }
        self.params.forget_listeners();
    }
}

/// A node in the graph. Clones are the same node, which leaves the graph with the last of them.
#[derive(Clone)]
pub struct Node {
    inner: Arc<Inner>,
}

impl Node {
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

    /// Ends every thread of the node and waits for them. The last clone's drop does the same.
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
        let (name, dds) = self.topic::<M>(topic, qos)?;
        let publisher = self
            .graph()
            .ros()
            .create_publisher(&dds, None)
            .map_err(|error| ShellError::create(format!("publisher on {name}"), error))?;
        Ok(Publisher::new(publisher, name, Arc::clone(self.graph()), self.shutdown().clone()))
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
        callback: impl FnMut(Received<M>) + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let (name, dds) = self.topic::<M>(topic, qos)?;
        let reader = self
            .graph()
            .ros()
            .create_subscription::<M>(&dds, None)
            .map_err(|error| ShellError::create(format!("subscription of {name}"), error))?;
        Subscription::start(self, name, qos, reader, callback)
    }

    /// Keeps the newest message of a topic.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn latest<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Latest<M>, ShellError> {
        Latest::start(self, topic, qos)
    }

    /// Queues the messages of a topic, `capacity` at most; where it is full the oldest go, and are counted.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn queue<M: Msg>(&self, topic: &str, qos: Qos, capacity: usize) -> Result<Queue<M>, ShellError> {
        Queue::start(self, topic, qos, capacity)
    }

    /// How many publishers of a topic are known in the whole graph, this node's own included.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn publisher_count(&self, topic: &str) -> Result<usize, ShellError> {
        let name = self.resolve(topic)?;
        Ok(self.graph().ros().publisher_count(&name))
    }

    pub(crate) fn threads(&self) -> &Arc<Threads> {
        &self.inner.threads
    }

    pub(crate) fn graph(&self) -> &Arc<Graph> {
        &self.inner.graph
    }

    fn topic<M: Msg>(&self, topic: &str, qos: Qos) -> Result<(String, DdsTopic), ShellError> {
        if let Some(agreed) = contract::topic(topic)
            && agreed.type_name != M::TYPE_NAME
        {
            return Err(ShellError::ContractType {
                name: topic.to_owned(),
                expected: agreed.type_name,
                got: M::TYPE_NAME,
            });
        }
        let name = self.resolve(topic)?;
        let dds = self.graph().topic(&name, M::TYPE_NAME, qos)?;
        Ok((name, dds))
    }
}
