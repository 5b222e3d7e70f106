//! Actions over three services and two topics.

use super::endpoint::{Reader, Writer};
use super::matches::Matches;
use super::service::{ClientEnds, Served, ServerEnds};
use super::session::{Made, Session};
use crate::interface::Payload;
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
    /// Which goals: see `action_msgs/srv/CancelGoal`.
    pub(crate) goal_info: GoalInfo,
}

/// Names and profiles of an action.
pub(crate) struct Acted<'a> {
    /// The absolute name.
    pub(crate) name: &'a str,
    /// The DDS name of its type, up to `_SendGoal_Request_` and the like.
    pub(crate) dds_type: &'a str,
    /// The profile of all but the status.
    pub(crate) qos: &'a QosPolicies,
    /// The profile of the status.
    pub(crate) status: &'a QosPolicies,
}

const CANCEL_TYPE: &str = "action_msgs::srv::dds_::CancelGoal";
const STATUS_TYPE: &str = "action_msgs::msg::dds_::GoalStatusArray_";

impl Acted<'_> {
    fn service<T>(&self, part: &str, dds_type: &str, make: impl FnOnce(&Served<'_>) -> Made<T>) -> Made<T> {
        let name = format!("{}/_action/{part}", self.name);
        make(&Served { name: &name, dds_type, requests: self.qos, answers: self.qos })
    }

    fn dds_type(&self, part: &str) -> String {
        format!("{}_{part}", self.dds_type)
    }

    fn topic(&self, part: &str) -> String {
        format!("rt{}/_action/{part}", self.name)
    }
}

/// The server's ends.
pub(crate) struct ActionServerEnds<G: Payload, R: Payload, F: Payload> {
    pub(crate) goals: ServerEnds<SendGoalRequest<G>, SendGoalResponse>,
    pub(crate) cancels: ServerEnds<CancelGoalRequest, CancelGoalResponse>,
    pub(crate) results: ServerEnds<GetResultRequest, GetResultResponse<R>>,
    pub(crate) feedback: Writer<FeedbackMessage<F>>,
    pub(crate) status: Writer<GoalStatusArray>,
}

impl<G: Payload, R: Payload, F: Payload> ActionServerEnds<G, R, F> {
    pub(crate) fn new(session: &Session, of: &Acted<'_>) -> Made<Self> {
        let feedback = of.dds_type("FeedbackMessage_");
        Ok(Self {
            goals: of.service("send_goal", &of.dds_type("SendGoal"), |of| ServerEnds::new(session, of))?,
            cancels: of.service("cancel_goal", CANCEL_TYPE, |of| ServerEnds::new(session, of))?,
            results: of.service("get_result", &of.dds_type("GetResult"), |of| ServerEnds::new(session, of))?,
            feedback: Writer::new(session, &of.topic("feedback"), &feedback, of.qos)?,
            status: Writer::new(session, &of.topic("status"), STATUS_TYPE, of.status)?,
        })
    }
}

/// The client's ends.
pub(crate) struct ActionClientEnds<G: Payload, R: Payload, F: Payload> {
    pub(crate) goals: ClientEnds<SendGoalRequest<G>, SendGoalResponse>,
    pub(crate) cancels: ClientEnds<CancelGoalRequest, CancelGoalResponse>,
    pub(crate) results: ClientEnds<GetResultRequest, GetResultResponse<R>>,
    pub(crate) feedback: Reader<FeedbackMessage<F>>,
    // Unread: the goals' results say how they ended. Clients of rclcpp and rclpy have one, too.
    _status: Reader<GoalStatusArray>,
}

impl<G: Payload, R: Payload, F: Payload> ActionClientEnds<G, R, F> {
    pub(crate) fn new(session: &Session, of: &Acted<'_>) -> Made<Self> {
        let feedback = of.dds_type("FeedbackMessage_");
        Ok(Self {
            goals: of.service("send_goal", &of.dds_type("SendGoal"), |of| ClientEnds::new(session, of))?,
            cancels: of.service("cancel_goal", CANCEL_TYPE, |of| ClientEnds::new(session, of))?,
            results: of.service("get_result", &of.dds_type("GetResult"), |of| ClientEnds::new(session, of))?,
            feedback: Reader::new(session, &of.topic("feedback"), &feedback, of.qos)?,
            _status: Reader::new(session, &of.topic("status"), STATUS_TYPE, of.status)?,
        })
    }

    /// Whether a server has all the ends that the client needs.
    pub(crate) fn is_matched(&self, matches: &Matches) -> bool {
        self.goals.is_matched(matches)
            && self.cancels.is_matched(matches)
            && self.results.is_matched(matches)
            && matches.has_writer(self.feedback.guid())
    }
}
