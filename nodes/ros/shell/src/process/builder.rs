//! Builder of a node.

use super::logging::Rosout;
use super::node::{Inner, Node};
use super::spinner;
use super::threads::Threads;
use crate::dds::graph::Graph;
use crate::dds::participant::{Discovery, Participation};
use crate::dds::sample_claims;
use crate::dds::session::Session;
use crate::dds::settle::settle;
use crate::error::ShellError;
use crate::parameters::args::RosArgs;
use crate::parameters::kinds::ParamKind;
use crate::parameters::names;
use crate::parameters::spec::ParamSpec;
use crate::parameters::store::{Param, Params};
use crate::time::clock::Clock;
use crate::time::shutdown::Shutdown;
use std::sync::Arc;

/// Node before it joins the graph. Parameters are declared here.
pub struct NodeBuilder {
    name: String,
    namespace: String,
    args: RosArgs,
    params: Params,
    /// Warnings about values for nodes of the same name.
    missed: Vec<String>,
    use_sim_time: Param<bool>,
    participation: Option<Participation>,
    lock_step: bool,
    shutdown: Shutdown,
    help: Option<String>,
}

impl NodeBuilder {
    /// Creates a node with a default name in the namespace `/`. The arguments' `__node` and `__ns` replace both.
    ///
    /// # Errors
    /// [`ShellError`] for an invalid name, or a value of `use_sim_time` that is not a boolean.
    pub fn new(name: &str, args: &RosArgs) -> Result<Self, ShellError> {
        names::check_node_name(name).map_err(|reason| ShellError::Name { what: "node".to_owned(), reason })?;
        let default_name = name;
        let (name, namespace) = args.node_identity(name, "/")?;
        let missed = args.missed_values(&namespace, &name, &[&name, default_name]);
        let overrides = args.params_for(&namespace, &name).into_iter().cloned();
        let params = Params::new(names::node_path(&namespace, &name), overrides);
        let spec = ParamSpec::new("Follow /clock instead of the wall clock.");
        let use_sim_time = params.declare("use_sim_time", false, spec)?;
        Ok(Self {
            name,
            namespace,
            args: args.clone(),
            params,
            missed,
            use_sim_time,
            participation: None,
            lock_step: false,
            shutdown: Shutdown::new(),
            help: None,
        })
    }

    /// Joins this domain with this discovery range instead of the environment's.
    #[must_use]
    pub fn domain(mut self, domain: u16, discovery: Discovery) -> Self {
        self.participation = Some(Participation { domain, discovery });
        self
    }

    /// Declares the parameter `lock_step`, and takes part in lock step if it is set: see [`NodeBuilder::in_lock_step`].
    ///
    /// # Errors
    /// [`ShellError::Params`].
    pub fn declare_lock_step(self) -> Result<Self, ShellError> {
        let spec = "Take part in lock step: simulated time waits for every answer, and no message is lost (needs use_sim_time).";
        let on = self.params.declare("lock_step", false, ParamSpec::new(spec).read_only())?.get();
        Ok(self.in_lock_step(on))
    }

    /// Makes best-effort streams reliable if `on` is true, on both sides: in lock step a lost message would change the result, and time waits
    /// for its repetition.
    #[must_use]
    pub fn in_lock_step(mut self, on: bool) -> Self {
        self.lock_step = on;
        self
    }

    /// Makes [`NodeBuilder::build`] print the parameters under this headline instead of joining the graph.
    pub(crate) fn with_help(mut self, headline: String) -> Self {
        self.help = Some(headline);
        self
    }

    /// Returns the shutdown of the node, which may be triggered before the node is built.
    #[must_use]
    pub fn shutdown(&self) -> &Shutdown {
        &self.shutdown
    }

    /// Returns the base name after remapping.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the parameters declared so far.
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

    /// Joins the graph. Every parameter must be declared before.
    ///
    /// # Errors
    /// [`ShellError`]: a value for an undeclared parameter, an environment variable, the middleware.
    pub fn build(self) -> Result<Node, ShellError> {
        if let Some(headline) = self.help {
            crate::parameters::help::print_help(&headline, &self.params);
            return Err(ShellError::HelpShown);
        }
        // Before the node joins: a wrong value must not appear in the graph, not even for a moment.
        let unused = self.params.refuse_unknown()?;
        let (participation, warnings) = match self.participation {
            Some(participation) => (participation, Vec::new()),
            None => Participation::from_environment(&|name| std::env::var(name).ok())?,
        };
        sample_claims::set_limit(&|name| std::env::var(name).ok())?;
        let participant = participation.join()?;
        // Before the first endpoint: see `settle`.
        settle(&participant);
        let failed = |error: &dyn std::fmt::Display| ShellError::create(format!("node {}", self.name), error);
        let ros_name = ros2_client::NodeName::new(&self.namespace, &self.name).map_err(|error| failed(&error))?;
        let session = Session::new(participant, ros_name).map_err(|error| failed(&error))?;
        let path = names::node_path(&self.namespace, &self.name);
        let logger = path.trim_start_matches('/').replace('/', ".");
        let (rosout, lines) = Rosout::new(&logger);
        // Threads of libraries log under the newest node.
        rosout.adopt_process();
        let clock = Clock::new(&self.shutdown);
        let (without_effect, has_rosout) = (self.args.without_effect.clone(), self.args.rosout_logs);
        let (passed_over, missed) = (self.params.passed_over(), self.missed);
        let node = Node::new(Inner {
            threads: Arc::new(Threads::new(rosout, self.shutdown.clone())),
            graph: Arc::new(Graph::new(session)),
            name: self.name,
            namespace: self.namespace,
            path,
            args: self.args,
            params: self.params,
            lock_step: self.lock_step,
            health_sources: Arc::default(),
            clock,
            shutdown: self.shutdown,
        });
        spinner::start(&node, &self.use_sim_time, lines, has_rosout)?;
        // After the start of `/rosout`, so that the warnings reach it.
        for warning in warnings {
            tracing::warn!("{warning}");
        }
        for origin in unused {
            tracing::warn!("{origin}: this node has no such parameter");
        }
        for value in passed_over.into_iter().chain(missed) {
            tracing::warn!("{value}");
        }
        for option in without_effect {
            tracing::warn!("{option}: has no effect here");
        }
        Ok(node)
    }
}
