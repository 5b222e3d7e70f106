//! Errors between a node and ROS 2.

use crate::parameters::args::ArgError;
use crate::parameters::names::NameError;
use crate::parameters::store::ParamError;
use std::time::Duration;
use thiserror::Error;

/// Error of creating a node or one of its endpoints.
#[derive(Debug, Error)]
pub enum ShellError {
    /// Error in the command line, or in a file that it names.
    #[error(transparent)]
    Args(#[from] ArgError),
    /// Error in a parameter's declaration or value.
    #[error(transparent)]
    Params(#[from] ParamError),
    /// Invalid environment variable.
    #[error("{variable}={value:?}: expected {expected}")]
    Environment {
        /// The variable.
        variable: &'static str,
        /// Value.
        value: String,
        /// Expected value.
        expected: &'static str,
    },
    /// Invalid name of a node, topic, service or action.
    #[error("{what}: {reason}")]
    Name {
        /// Named thing.
        what: String,
        /// Error of the name.
        reason: NameError,
    },
    /// Topic of the contract with another type.
    #[error("{name}: expected {expected} by the contract, got {got}")]
    ContractType {
        /// Name in the code.
        name: String,
        /// Type in the contract.
        expected: &'static str,
        /// Type in the code.
        got: &'static str,
    },
    /// Type name of the wrong form.
    #[error("type {got:?}: expected package/{expected}/Type")]
    TypeName {
        /// `msg`, `srv` or `action`.
        expected: &'static str,
        /// The name.
        got: String,
    },
    /// Failure of the middleware or the operating system.
    #[error("{what}: {reason}")]
    Create {
        /// Thing that was to be created.
        what: String,
        /// Message of the middleware.
        reason: String,
    },
    /// Request for `--help`, which was answered. There is nothing to run.
    #[error("help was shown")]
    HelpShown,
}

impl ShellError {
    /// Returns true for an error of the user's input, which has exit code 2.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Args(_) | Self::Params(_) | Self::Environment { .. })
    }

    pub(crate) fn create(what: impl Into<String>, reason: impl std::fmt::Display) -> Self {
        Self::Create { what: what.into(), reason: reason.to_string() }
    }
}

/// Error of publishing a message.
#[derive(Debug, Error)]
#[error("{topic}: not published: {reason}")]
pub struct PublishError {
    /// Topic.
    pub topic: String,
    /// Message of the middleware.
    pub reason: String,
}

/// Error of calling a service or an action.
#[derive(Debug, Error)]
pub enum CallError {
    /// No server.
    #[error("{name}: nobody offers it after {} s", waited.as_secs_f64())]
    NoServer {
        /// The service or action.
        name: String,
        /// Time waited.
        waited: Duration,
    },
    /// No answer within the timeout.
    #[error("{name}: no answer after {} s", waited.as_secs_f64())]
    Timeout {
        /// The service or action.
        name: String,
        /// Time waited.
        waited: Duration,
    },
    /// Server that died after the request: it may have carried the request out.
    #[error("{name}: its server went away without an answer")]
    Left {
        /// The service.
        name: String,
    },
    /// Several servers, each of which would carry the request out. Nothing was sent.
    #[error(
        "{name}: {servers} all offer it, and nothing was sent; end all but one, or give each graph a ROS_DOMAIN_ID or a \
         namespace of its own"
    )]
    Ambiguous {
        /// The service or action.
        name: String,
        /// Names of the servers.
        servers: String,
    },
    /// Goal that the action server rejected.
    #[error("{name}: {server} rejected the goal; its log says why")]
    Rejected {
        /// The action.
        name: String,
        /// Name of the server.
        server: String,
    },
    /// Accepted goal that the server no longer knows: another server took its place.
    #[error("{name}: its server went away while the goal ran, and the one that came does not know the goal")]
    Forgotten {
        /// The action.
        name: String,
    },
    /// Shutdown of this node.
    #[error("{name}: this node shuts down")]
    Shutdown {
        /// The service or action.
        name: String,
    },
    /// Failure of the middleware.
    #[error("{name}: {reason}")]
    Middleware {
        /// The service or action.
        name: String,
        /// Message of the middleware.
        reason: String,
    },
}
