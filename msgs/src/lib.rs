#![doc = include_str!("../README.md")]

pub mod cdr;
mod description;

pub use self::catenary_msgs::{action, msg, srv};
pub use cdr::{CdrError, from_cdr, to_cdr};
pub use description::{FieldInfo, StructureInfo, described, structures};

/// Message type.
pub trait Interface {
    /// Full name, for example `geometry_msgs/msg/PoseStamped`.
    const TYPE_NAME: &'static str;
    /// RIHS01 hash of the type description (REP 2011).
    const TYPE_HASH: &'static str;
    /// ros2msg text with all nested definitions, as rosbag2 stores it.
    const DEFINITION: &'static str;
}

/// Service type.
pub trait ServiceInterface {
    /// Request.
    type Request;
    /// Response.
    type Response;
    /// Full name, for example `std_srvs/srv/SetBool`.
    const TYPE_NAME: &'static str;
    /// RIHS01 hash of the type description.
    const TYPE_HASH: &'static str;

    /// Returns a response that reports a failure and its reason; `None` for a response without fields for both: `bool success` and
    /// `string message`, or the names that services of ROS 2 have for them.
    fn refusal(_reason: String) -> Option<Self::Response> {
        None
    }
}

/// Action type.
pub trait ActionInterface {
    /// Goal.
    type Goal;
    /// Result.
    type Result;
    /// Feedback.
    type Feedback;
    /// Full name, for example `catenary_msgs/action/Infer`.
    const TYPE_NAME: &'static str;
    /// RIHS01 hash of the type description.
    const TYPE_HASH: &'static str;

    /// Returns a result that reports a failure and its reason, as [`ServiceInterface::refusal`].
    fn refusal(_reason: String) -> Option<Self::Result> {
        None
    }
}

/// Name, hash and text of a message type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InterfaceInfo {
    /// See [`Interface::TYPE_NAME`].
    pub type_name: &'static str,
    /// See [`Interface::TYPE_HASH`].
    pub type_hash: &'static str,
    /// See [`Interface::DEFINITION`].
    pub definition: &'static str,
}

impl InterfaceInfo {
    /// Returns the info of `T`.
    pub const fn of<T: Interface>() -> Self {
        Self { type_name: T::TYPE_NAME, type_hash: T::TYPE_HASH, definition: T::DEFINITION }
    }
}

/// Returns every message type of this crate.
pub fn messages() -> &'static [InterfaceInfo] {
    MESSAGES
}

/// Returns the message type called `type_name` (`package/msg/Name`).
pub fn find(type_name: &str) -> Option<&'static InterfaceInfo> {
    MESSAGES.iter().find(|i| i.type_name == type_name)
}

/// Returns the full name and the RIHS01 hash of every service and action of this crate.
pub fn services_and_actions() -> &'static [(&'static str, &'static str)] {
    MARKERS
}

/// Deterministic instance in which neighbouring values differ, for comparing bytes with another implementation.
///
/// The k-th primitive is k mod 100 (integers), k + 0.5 (floats), `sk` (strings) or the parity of k (booleans: odd is true).
/// Sequences have two elements, or one if their bound is one.
#[cfg(feature = "filled")]
pub trait Filled: Sized {
    /// Returns the next instance and advances `counter` by the number of its primitives.
    fn filled(counter: &mut u32) -> Self;
}

#[cfg(feature = "filled")]
mod filled;
#[cfg(test)]
mod tests;

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));
