//! Everything ROS 2, once, so that a node's `node.rs` is a page of glue between messages and its pure library.
//!
//! A node is made by [`main`], which reads the command line, starts logs and signals and hands over a
//! [`NodeBuilder`]: parameters are declared on it, [`NodeBuilder::build`] joins the graph, and the [`Node`] makes
//! publishers, subscriptions, services and actions. Plain threads throughout: everything that waits sleeps until a
//! message, a deadline or shutdown, and nothing here is `async` to the caller.
//!
//! | of a node | by |
//! |---|---|
//! | parameter | [`NodeBuilder::declare_f64`] and its like, with a [`ParamSpec`]; a [`Param`] is read with `get` |
//! | time | [`Node::clock`], [`Node::now`], [`Node::run_until_shutdown`] |
//! | topic out | [`Node::publisher`] |
//! | topic in | [`Node::subscription`] (callback), [`Node::latest`] (newest message), [`Node::queue`] |
//! | topic of any type | [`Node::published_topics`], [`Node::raw_subscription`], [`Node::raw_publisher`] |
//! | service | [`Node::serve`], [`Node::client`] |
//! | action | [`Node::serve_action`], [`Node::action_client`] |
//! | topic in, with bad messages counted | [`Node::intake`], [`Node::take`], [`Node::take_latest`] |
//! | health | [`Watchdog`], [`Deadline`], [`Node::report_diagnostics`] |
//! | names, types and profiles that the nodes agree on | [`contract`] |
//! | posteriors, tracks and enumerations to and from the wire | [`convert`] |
//!
//! This crate does not know any message's meaning, does no control and no computation, and is not seen by the
//! algorithm libraries. Its unit tests need no network; its integration tests use the loopback interface.
#![allow(
    clippy::disallowed_methods,
    reason = "clocks, threads, files and environment variables are this crate's trade"
)]

mod action;
mod args;
mod builder;
mod clock;
pub mod contract;
pub mod convert;
mod diagnostics;
mod domain_claim;
mod ending;
mod error;
pub mod files;
mod first_contact;
mod graph;
mod intake;
mod interface;
mod large_reply;
mod late_join;
mod logging;
mod middleware;
mod model_file;
pub mod names;
mod network_loss;
mod node;
mod params;
mod participant;
mod peers;
mod process_of;
mod publisher;
mod qos;
mod raw;
mod ros_home;
mod run;
mod service;
mod settle;
mod shutdown;
mod spinner;
pub mod stamp;
mod stamp_check;
mod states;
mod subscription;
mod tally;
mod threads;
mod time;
mod type_description;
mod wait;
mod watchdog;
mod yaml;

pub use action::{ActionClient, ActionServer, Concurrency, Decision, GoalHandle, Outcome, RunningGoal, Status};
pub use args::{ArgError, Level, ParamOverride, Remap, RosArgs};
pub use builder::NodeBuilder;
pub use clock::{Clock, Rate, Tick, wall_now};
pub use diagnostics::{Health, Report, resident_bytes};
pub use domain_claim::DomainClaim;
pub use ending::{LeaveAtEnd, exit, leave_graph};
pub use error::{CallError, PublishError, ShellError};
pub use intake::Intake;
pub use interface::{Act, Msg, Payload, Srv};
pub use logging::init as init_logging;
pub use model_file::read_model;
pub use names::NameError;
pub use network_loss::{LOST, is_network_lost};
pub use node::Node;
pub use params::{Change, Description, Param, ParamError, ParamKind, ParamSpec, Params, Value};
pub use participant::{Discovery, domain_and_range, domain_id, is_domain_used_here};
pub use peers::{Peer, Requester, list_peers};
pub use publisher::Publisher;
pub use qos::Qos;
pub use raw::{PublishedTopic, RawMessage};
pub use ros_home::{ros_home, ros_log_dir};
pub use run::{Misconfigured, end_on_signals, in_one_line, in_unicode, main};
pub use service::{Client, Service};
pub use shutdown::Shutdown;
pub use stamp_check::StampCheck;
pub use states::{remove_old_states, remove_state, state_file, state_folder};
pub use subscription::{Latest, Queue, Received, Subscription};
pub use tally::{Flaw, Names};
pub use time::Time;
pub use watchdog::{Deadline, Throttle, Watchdog};
pub use yaml::{Yaml, YamlEvents};
