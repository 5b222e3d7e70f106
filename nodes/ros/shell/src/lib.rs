#![doc = include_str!("../README.md")]
#![allow(
    clippy::disallowed_methods,
    reason = "clocks, threads, files and environment variables are this crate's trade"
)]

pub mod contract;
pub mod convert;
mod dds;
mod endpoints;
mod error;
mod lock_step;
mod parameters;
mod process;
mod time;

pub use dds::domain_claim::DomainClaim;
pub use dds::interface::{Act, Msg, Payload, Srv};
pub use dds::participant::{Discovery, domain_and_range, domain_id, is_domain_used_here};
pub use dds::peers::{Attendance, Peer, Presence, Requester, list_peers};
pub use dds::qos::Qos;
pub use endpoints::action::{
    ActionClient, ActionServer, Concurrency, Decision, GoalHandle, Outcome, RunningGoal, Status,
};
pub use endpoints::diagnostics::resident_bytes;
pub use endpoints::intake::Intake;
pub use endpoints::latest::{Latest, Queue};
pub use endpoints::neighbours::GraphSnapshot;
pub use endpoints::publisher::Publisher;
pub use endpoints::raw::{PublishedTopic, RawMessage};
pub use endpoints::service::{Client, Service};
pub use endpoints::stamp_check::StampCheck;
pub use endpoints::subscription::{Received, Subscription};
pub use endpoints::tally::{Flaw, Names};
pub use error::{CallError, PublishError, ShellError};
pub use lock_step::{DEAD_NODE, DONE_UNTIL};
pub use parameters::args::{ArgError, Level, ParamOverride, Remap, RosArgs};
pub use parameters::kinds::{ParamKind, Value};
pub use parameters::model_file::read_model;
pub use parameters::names::NameError;
pub use parameters::spec::ParamSpec;
pub use parameters::store::{Change, Description, Param, ParamError, Params};
pub use parameters::yaml::{Yaml, YamlEvents};
pub use parameters::{files, names};
pub use process::builder::NodeBuilder;
pub use process::ending::{LeaveAtEnd, exit, leave_graph};
pub use process::health::{Health, Report};
pub use process::logging::init as init_logging;
pub use process::network_loss::{LOST, is_network_lost};
pub use process::node::Node;
pub use process::ros_home::{ros_home, ros_log_dir};
pub use process::run::{Misconfigured, end_on_signals, in_one_line, in_unicode, is_signalled, main};
pub use process::states::{remove_old_states, remove_state, state_file, state_folder};
pub use time::clock::{Clock, Rate, Tick, wall_now};
pub use time::point::Time;
pub use time::shutdown::Shutdown;
pub use time::stamp;
pub use time::watchdog::{Deadline, Throttle, Watchdog};
