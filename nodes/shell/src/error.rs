//! What can go wrong between a node and ROS 2.

use crate::args::ArgError;
use crate::names::NameError;
use crate::params::ParamError;
use std::time::Duration;
use thiserror::Error;

/// Why a node or one of its endpoints cannot be made.
#[derive(Debug, Error)]
pub enum ShellError {
    /// The command line or a file that it names.
    #[error(transparent)]
    Args(#[from] ArgError),
    /// A parameter's declaration or value.
    #[error(transparent)]
    Params(#[from] ParamError),
    /// An environment variable.
    #[error("{variable}={value:?}: expected {expected}")]
    Environment {
        /// The variable.
        variable: &'static str,
        /// Its value.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// The name of a node, topic, service or action.
    #[error("{what}: {reason}")]
    Name {
        /// What was to be named.
        what: String,
        /// What is wrong with it.
        reason: NameError,
    },
    /// A topic of the contract is used with another type.
    #[error("{name}: expected {expected} by the contract, got {got}")]
    ContractType {
        /// The name in the code.
        name: String,
        /// The contract's type.
        expected: &'static str,
        /// The type in the code.
        got: &'static str,
    },
    /// A type name has the wrong form.
    #[error("type {got:?}: expected package/{expected}/Type")]
    TypeName {
        /// `msg`, `srv` or `action`.
        expected: &'static str,
        /// The name given.
        got: String,
    },
    /// The middleware or the operating system refuses.
    #[error("{what}: {reason}")]
    Create {
        /// What was to be made.
        what: String,
        /// The middleware's words.
        reason: String,
    },
    /// `--help` was asked for and has been answered; there is nothing to run.
    #[error("help was shown")]
    HelpShown,
}

impl ShellError {
    /// Whether it is the command line's fault, which has exit code 2.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Args(_) | Self::Params(_) | Self::Environment { .. })
    }

    pub(crate) fn create(what: impl Into<String>, reason: impl std::fmt::Display) -> Self {
        Self::Create { what: what.into(), reason: reason.to_string() }
    }
}

/// Why a message was not published.
#[derive(Debug, Error)]
#[error("{topic}: not published: {reason}")]
pub struct PublishError {
    /// The topic.
    pub topic: String,
    /// The middleware's words.
    pub reason: String,
}

/// Why a service or an action did not answer.
#[derive(Debug, Error)]
pub enum CallError {
    /// Nobody offers it.
    #[error("{name}: nobody offers it after {} s", waited.as_secs_f64())]
    NoServer {
        /// The service or action.
        name: String,
        /// How long was waited.
        waited: Duration,
    },
    /// It was asked and did not answer in time.
    #[error("{name}: no answer after {} s", waited.as_secs_f64())]
    Timeout {
        /// The service or action.
        name: String,
        /// How long was waited.
        waited: Duration,
    },
    /// It was asked and died: it may have done what was asked.
    #[error("{name}: its server went away without an answer")]
    Left {
        /// The service.
        name: String,
    },
    /// Several nodes offer it, and each would do what is asked. Nothing was sent.
    #[error(
        "{name}: {servers} all offer it, and nothing was sent; end all but one, or give each graph a ROS_DOMAIN_ID or a \
         namespace of its own"
    )]
    Ambiguous {
        /// The service or action.
        name: String,
        /// Its servers.
        servers: String,
    },
    /// The action server refused the goal.
    #[error("{name}: {server} rejected the goal; its log says why")]
    Rejected {
        /// The action.
        name: String,
        /// Its server.
        server: String,
    },
    /// Its server does not know the goal that it accepted: another one took its place.
    #[error("{name}: its server went away while the goal ran, and the one that came does not know the goal")]
    Forgotten {
        /// The action.
        name: String,
    },
    /// This node shuts down.
    #[error("{name}: this node shuts down")]
    Shutdown {
        /// The service or action.
        name: String,
    },
    /// The middleware failed.
    #[error("{name}: {reason}")]
    Middleware {
        /// The service or action.
        name: String,
        /// Its words.
        reason: String,
    },
}
