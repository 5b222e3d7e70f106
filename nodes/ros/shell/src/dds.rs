//! DDS: the participant of a node, the endpoints of topics, services and actions on RustDDS, and the graph that discovery finds.
//!
//! Message types and names come from ros2-client. Its `Node` is not used, for two reasons. First, its spinner subscribes to
//! `/clock` as `builtin_interfaces/msg/Time`, and the command line of ROS 2 refuses topics of two types. Second, its writer of
//! `/parameter_events` is transient local, unlike the writers of rclcpp and rclpy.

pub(crate) mod action_endpoints;
mod datagram;
pub(crate) mod directory;
pub(crate) mod domain_claim;
pub(crate) mod endpoint;
pub(crate) mod first_contact;
mod fragments;
pub(crate) mod graph;
pub(crate) mod interface;
pub(crate) mod large_reply;
pub(crate) mod log_noise;
pub(crate) mod matches;
mod own_machine;
pub(crate) mod participant;
pub(crate) mod peers;
pub(crate) mod qos;
pub(crate) mod sample_claims;
pub(crate) mod servers;
pub(crate) mod service_endpoints;
pub(crate) mod service_server;
pub(crate) mod session;
pub(crate) mod settle;
mod socket_owner;
mod system_calls;
