//! Lock step: agreements between nodes whose simulated time waits for their answers.

use crate::dds::qos::Qos;
use std::time::Duration;

/// Topic on which a policy runner tells the time until which it has done all that is due, and its profile. Type rosgraph_msgs/msg/Clock. The
/// simulated cell then goes on to the next frame. The topic is no part of the contract: a real cell waits for nobody.
pub const DONE_UNTIL: (&str, Qos) = ("policy/done_until", Qos::Reliable { depth: 10 });

/// Wall time after which a node that owes an answer counts as dead. Long: a slow node must not fail.
pub const DEAD_NODE: Duration = Duration::from_secs(120);
