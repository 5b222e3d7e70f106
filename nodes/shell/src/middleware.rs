//! ROS 2 on top of RustDDS: the participant of a node, and its endpoints.
//!
//! Message types and names come from ros2-client. Its `Node` is not used, for two reasons. Its spinner subscribes `/clock`
//! as a `builtin_interfaces/msg/Time`, and the command line of ROS 2 refuses topics of two types. Its writer of
//! `/parameter_events` is transient local, which those of rclcpp and rclpy are not.

mod action;
mod datagram;
mod endpoint;
mod matches;
mod service;
mod session;

pub(crate) use action::{Acted, ActionClientEnds, ActionServerEnds, CancelGoalRequest};
pub(crate) use endpoint::{Reader, Writer};
pub(crate) use matches::Matches;
pub(crate) use service::{ClientEnds, Served, ServerEnds};
pub(crate) use session::{Made, Session};
