//! Status of goals, and the names and profiles that client and server share.

use crate::dds::service_server::SERVICE_QOS;
use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History};

/// End of a goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The goal was reached.
    Succeeded,
    /// A client cancelled the goal.
    Canceled,
    /// The server aborted the goal.
    Aborted,
}

/// Profile of the status topic: late clients get the last status.
pub(super) const STATUS_QOS: QosProfile =
    QosProfile { durability: Durability::TransientLocal, history: History::KeepLast { depth: 1 }, ..SERVICE_QOS };

/// Returns the name of the result service of an action.
pub(super) fn result_service(action: &str) -> String {
    format!("{action}/_action/get_result")
}
