//! Actions: servers that run each goal on a thread of its own, and clients with a timeout on every wait.

mod client;
mod goal;
mod goals;
mod server;

pub use client::{ActionClient, RunningGoal};
pub use goal::{Concurrency, Decision, GoalHandle, Outcome};
pub use server::ActionServer;

use crate::service::SERVICE_QOS;
use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History};

/// How a goal ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It reached what it was for.
    Succeeded,
    /// The client cancelled it.
    Canceled,
    /// The server gave it up.
    Aborted,
}

/// The profile of the status topic; late clients get the last status.
const STATUS_QOS: QosProfile =
    QosProfile { durability: Durability::TransientLocal, history: History::KeepLast { depth: 1 }, ..SERVICE_QOS };
