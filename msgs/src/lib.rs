//! ROS 2 interfaces: Rust types, type names, RIHS01 hashes and ros2msg texts, generated at build time from the .msg, .srv
//! and .action files beside this crate.
//!
//! Does: hold every type that goes over a topic, service or action, and its CDR form.
//! Does not: send anything, and know nothing of the types that the algorithms use.
//!
//! `Default` of a structure is zeros and empty strings: default values written in .msg files are not taken over, so a default
//! `Quaternion` is no rotation.

pub mod cdr;
mod description;

pub use self::catenary_msgs::{action, msg, srv};
pub use cdr::{CdrError, from_cdr, to_cdr};
pub use description::{FieldInfo, StructureInfo, described, structures};

/// A message type.
pub trait Interface {
    /// Full name, such as `geometry_msgs/msg/PoseStamped`.
    const TYPE_NAME: &'static str;
    /// RIHS01 hash of the type description (REP 2011).
    const TYPE_HASH: &'static str;
    /// ros2msg text with all nested definitions, as rosbag2 stores it.
    const DEFINITION: &'static str;
}

/// A service type.
pub trait ServiceInterface {
    /// What the client sends.
    type Request;
    /// What the server answers.
    type Response;
    /// Full name, such as `std_srvs/srv/SetBool`.
    const TYPE_NAME: &'static str;
    /// RIHS01 hash of the type description.
    const TYPE_HASH: &'static str;
}

/// An action type.
pub trait ActionInterface {
    /// What is asked for.
    type Goal;
    /// What comes of it.
    type Result;
    /// How it goes.
    type Feedback;
    /// Full name, such as `catenary_msgs/action/Infer`.
    const TYPE_NAME: &'static str;
    /// RIHS01 hash of the type description.
    const TYPE_HASH: &'static str;
}

/// Name, hash and text of a message type, as a value.
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
    /// The info of `T`.
    pub const fn of<T: Interface>() -> Self {
        Self { type_name: T::TYPE_NAME, type_hash: T::TYPE_HASH, definition: T::DEFINITION }
    }
}

/// Every message type held here.
pub fn messages() -> &'static [InterfaceInfo] {
    MESSAGES
}

/// The message type called `type_name` (`package/msg/Name`).
pub fn find(type_name: &str) -> Option<&'static InterfaceInfo> {
    MESSAGES.iter().find(|i| i.type_name == type_name)
}

/// Full name and RIHS01 hash of every service and action held here.
pub fn services_and_actions() -> &'static [(&'static str, &'static str)] {
    MARKERS
}

/// An instance in which every value differs from its neighbours, made by counting: the k-th primitive holds k (whole
/// numbers: k mod 100; booleans: whether k is odd; floats: k + 0.5; strings: `sk`), and sequences hold two elements, or one where that is their bound. Another
/// program can count the same way, so that both can compare bytes.
#[cfg(feature = "filled")]
pub trait Filled: Sized {
    /// The next instance; advances `counter` by the number of primitives in it.
    fn filled(counter: &mut u32) -> Self;
}

#[cfg(feature = "filled")]
mod filled;
#[cfg(test)]
mod tests;

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));
