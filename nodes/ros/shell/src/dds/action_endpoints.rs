//! Endpoints of actions: three services and two topics.

use super::endpoint::{Reader, Writer};
use super::interface::Payload;
use super::matches::Matches;
use super::service_endpoints::{ClientEndpoints, ServerEndpoints, ServiceSpec};
use super::session::{Created, Session};
use ros2_client::action::{
    CancelGoalResponse, FeedbackMessage, GetResultRequest, GetResultResponse, GoalInfo, SendGoalRequest,
    SendGoalResponse,
};
use ros2_client::action_msgs::GoalStatusArray;
use rustdds::QosPolicies;
use serde::{Deserialize, Serialize};

/// Request of `action_msgs/srv/CancelGoal`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CancelGoalRequest {
    /// Selected goals: see `action_msgs/srv/CancelGoal`.
    pub(crate) goal_info: GoalInfo,
}

/// Name, type and profiles of an action.
pub(crate) struct ActionSpec<'a> {
    /// Absolute name.
    pub(crate) name: &'a str,
    /// DDS name of the type, without `_SendGoal_Request_` and other suffixes.
    pub(crate) dds_type: &'a str,
    /// Profile of everything except the status.
    pub(crate) qos: &'a QosPolicies,
    /// Profile of the status.
    pub(crate) status: &'a QosPolicies,
}

const CANCEL_TYPE: &str = "action_msgs::srv::dds_::CancelGoal";
const STATUS_TYPE: &str = "action_msgs::msg::dds_::GoalStatusArray_";

impl ActionSpec<'_> {
    fn service<T>(&self, part: &str, dds_type: &str, make: impl FnOnce(&ServiceSpec<'_>) -> Created<T>) -> Created<T> {
        let name = format!("{}/_action/{part}", self.name);
        make(&ServiceSpec { name: &name, dds_type, requests: self.qos, answers: self.qos })
    }

    fn dds_type(&self, part: &str) -> String {
        format!("{}_{part}", self.dds_type)
    }

    fn topic(&self, part: &str) -> String {
        format!("rt{}/_action/{part}", self.name)
    }
}

/// Endpoints of a server.
pub(crate) struct ActionServerEndpoints<G: Payload, R: Payload, F: Payload> {
    pub(crate) goals: ServerEndpoints<SendGoalRequest<G>, SendGoalResponse>,
    pub(crate) cancels: ServerEndpoints<CancelGoalRequest, CancelGoalResponse>,
    pub(crate) results: ServerEndpoints<GetResultRequest, GetResultResponse<R>>,
    pub(crate) feedback: Writer<FeedbackMessage<F>>,
    pub(crate) status: Writer<GoalStatusArray>,
}

impl<G: Payload, R: Payload, F: Payload> ActionServerEndpoints<G, R, F> {
    pub(crate) fn new(session: &Session, of: &ActionSpec<'_>) -> Created<Self> {
        let feedback = of.dds_type("FeedbackMessage_");
        Ok(Self {
            goals: of.service("send_goal", &of.dds_type("SendGoal"), |of| ServerEndpoints::new(session, of))?,
            cancels: of.service("cancel_goal", CANCEL_TYPE, |of| ServerEndpoints::new(session, of))?,
            results: of.service("get_result", &of.dds_type("GetResult"), |of| ServerEndpoints::new(session, of))?,
            feedback: Writer::new(session, &of.topic("feedback"), &feedback, of.qos)?,
            status: Writer::new(session, &of.topic("status"), STATUS_TYPE, of.status)?,
        })
    }
}

/// Endpoints of a client.
pub(crate) struct ActionClientEndpoints<G: Payload, R: Payload, F: Payload> {
    pub(crate) goals: ClientEndpoints<SendGoalRequest<G>, SendGoalResponse>,
    pub(crate) cancels: ClientEndpoints<CancelGoalRequest, CancelGoalResponse>,
    pub(crate) results: ClientEndpoints<GetResultRequest, GetResultResponse<R>>,
    pub(crate) feedback: Reader<FeedbackMessage<F>>,
    // Never read: results carry the status of their goals. It exists because clients of rclcpp and rclpy have one.
    _status: Reader<GoalStatusArray>,
}

impl<G: Payload, R: Payload, F: Payload> ActionClientEndpoints<G, R, F> {
    pub(crate) fn new(session: &Session, of: &ActionSpec<'_>) -> Created<Self> {
        let feedback = of.dds_type("FeedbackMessage_");
        Ok(Self {
            goals: of.service("send_goal", &of.dds_type("SendGoal"), |of| ClientEndpoints::new(session, of))?,
            cancels: of.service("cancel_goal", CANCEL_TYPE, |of| ClientEndpoints::new(session, of))?,
            results: of.service("get_result", &of.dds_type("GetResult"), |of| ClientEndpoints::new(session, of))?,
            feedback: Reader::new(session, &of.topic("feedback"), &feedback, of.qos)?,
            _status: Reader::new(session, &of.topic("status"), STATUS_TYPE, of.status)?,
        })
    }

    /// Returns true if all endpoints that the client needs are matched.
    pub(crate) fn is_matched(&self, matches: &Matches) -> bool {
        self.goals.is_matched(matches)
            && self.cancels.is_matched(matches)
            && self.results.is_matched(matches)
            && matches.has_writer(self.feedback.guid())
    }
}
