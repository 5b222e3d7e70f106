//! A node before it joins the graph.

use crate::args::RosArgs;
use crate::clock::Clock;
use crate::error::ShellError;
use crate::graph::Graph;
use crate::intake::Intakes;
use crate::logging::Rosout;
use crate::middleware::Session;
use crate::names;
use crate::node::{Inner, Node};
use crate::params::{Param, ParamKind, ParamSpec, Params};
use crate::participant::{Discovery, Participation};
use crate::settle::settle;
use crate::shutdown::Shutdown;
use crate::spinner;
use crate::threads::Threads;
use std::sync::Arc;

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
        let overrides = args.params_for(&namespace, &name).into_iter().cloned();
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
        settle(&participant);
        let failed = |error: &dyn std::fmt::Display| ShellError::create(format!("node {}", self.name), error);
        let ros_name = ros2_client::NodeName::new(&self.namespace, &self.name).map_err(|error| failed(&error))?;
        let session = Session::new(participant, ros_name).map_err(|error| failed(&error))?;
        let path = names::node_path(&self.namespace, &self.name);
        let logger = path.trim_start_matches('/').replace('/', ".");
        let (rosout, lines) = Rosout::new(&logger);
        rosout.adopt_process();
        let clock = Clock::new(&self.shutdown);
        let (without_effect, has_rosout) = (self.args.without_effect.clone(), self.args.rosout_logs);
        let passed_over = self.params.passed_over();
        let node = Node::new(Inner {
            threads: Arc::new(Threads::new(rosout, self.shutdown.clone())),
            graph: Arc::new(Graph::new(session)),
            name: self.name,
            namespace: self.namespace,
            path,
            args: self.args,
            params: self.params,
            intakes: Arc::new(Intakes::new(&clock)),
            clock,
            shutdown: self.shutdown,
        });
        spinner::start(&node, &self.use_sim_time, lines, has_rosout)?;
        for warning in warnings {
            tracing::warn!("{warning}");
        }
        for origin in unused {
            tracing::warn!("{origin}: this node has no such parameter");
        }
        for value in passed_over {
            tracing::warn!("{value}");
        }
        for option in without_effect {
            tracing::warn!("{option}: has no effect here");
        }
        Ok(node)
    }
}
