//! Controller behind the relay. It follows target poses from one topic and publishes its pose on another.
#![allow(clippy::disallowed_methods, reason = "silence and motion are timed on a clock that does not step")]

use super::settings::ControllerNames;
use crate::arm::Plant;
use crate::convert;
use crate::gate::Order;
use crate::pose::ArmPose;
use crate::speed::SpeedLimit;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_shell::{GraphSnapshot, Node, Publisher, Time, list_peers};
use std::time::Instant;

/// Controller as seen by the relay.
pub struct Controller {
    node: Node,
    /// Time 0 of the plant in the node's clock.
    origin: Time,
    /// Time 0 of the plant in a clock that never steps.
    started: Instant,
    frame_id: String,
    targets: Publisher<PoseStamped>,
    measured: Option<ArmPose>,
    /// Arrival of the newest measured pose.
    measured_at: Instant,
    /// Target of the arm; the controller gets it by and by.
    goal: Option<ArmPose>,
    /// Target that the controller has: it moves to the goal no faster than the limit.
    target: Option<ArmPose>,
    speed: SpeedLimit,
    /// Time of the last step of the target.
    stepped: Instant,
    /// True if the target was sent since the last call of [`Controller::repeat`].
    fresh: bool,
}

/// Longest time that a step of the target makes good, s: three periods of the relay. A stalled relay does not jump.
const LONGEST_STEP_S: f64 = 0.06;

impl Controller {
    /// Creates a controller without a measured pose. It receives `targets` in the frame that `names` gives.
    pub fn new(
        node: &Node,
        origin: Time,
        targets: Publisher<PoseStamped>,
        names: &ControllerNames,
        speed: SpeedLimit,
    ) -> Self {
        Self {
            node: node.clone(),
            origin,
            started: Instant::now(),
            measured_at: Instant::now(),
            frame_id: names.frame_id.clone(),
            targets,
            measured: None,
            goal: None,
            target: None,
            speed,
            stepped: Instant::now(),
            fresh: false,
        }
    }

    /// Records the measured pose.
    pub fn measure(&mut self, pose: ArmPose) {
        self.measured = Some(pose);
        self.measured_at = Instant::now();
    }

    /// Forgets pose and target of a silent controller.
    pub fn lose(&mut self) {
        self.measured = None;
        (self.goal, self.target) = (None, None);
    }

    /// Sends the target in force again, nearer to the goal, unless it was sent since the last call.
    pub fn repeat(&mut self) {
        if !std::mem::take(&mut self.fresh) {
            self.step();
        }
    }

    /// Moves the target toward the goal, and sends it.
    fn step(&mut self) {
        let Some(goal) = self.goal else { return };
        let period_s = self.stepped.elapsed().as_secs_f64().min(LONGEST_STEP_S);
        self.stepped = Instant::now();
        // The first target of a motion leads on from the arm, wherever the last motion ended.
        let from = self.target.or(self.measured).unwrap_or(goal);
        let next = self.speed.toward(&from, &goal, period_s);
        self.target = Some(next);
        self.send(&next);
    }

    fn send(&self, target: &ArmPose) {
        let header = self.node.header(&self.frame_id);
        self.targets.send(PoseStamped { header, pose: convert::pose_message(target) });
    }
}

impl Plant for Controller {
    fn time_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn stamp_time_s(&self) -> f64 {
        self.node.now().secs_since(self.origin)
    }

    fn measured(&self) -> Option<ArmPose> {
        self.measured
    }

    fn measured_age_s(&self) -> f64 {
        self.measured_at.elapsed().as_secs_f64()
    }

    fn speed_limit(&self) -> SpeedLimit {
        self.speed
    }

    fn obey(&mut self, order: &Order) {
        match order {
            Order::Target(pose) => {
                self.goal = Some(*pose);
                self.step();
                self.fresh = true;
            }
            Order::Hold(pose) => {
                (self.goal, self.target) = (Some(*pose), Some(*pose));
                self.stepped = Instant::now();
                self.send(pose);
                self.fresh = true;
            }
            Order::End => {
                self.goal = None;
                // A controller keeps its last target. Without this message the arm would continue to it.
                if let (Some(measured), Some(_)) = (self.measured, self.target.take()) {
                    self.send(&measured);
                }
            }
        }
    }
}

/// Returns the reason why the controller that follows `targets` cannot be commanded; `None` if it can. `topic` is the name of that
/// topic before remapping.
pub fn unready(targets: &Publisher<PoseStamped>, topic: &str, graph: &GraphSnapshot<'_>) -> Option<String> {
    // Both checks ask discovery, not the controller: it may listen and still follow another publisher.
    let resolved = targets.topic();
    if !targets.has_subscriber() {
        return Some(format!("no controller listens on {resolved}"));
    }
    match graph.publishers(topic) {
        Ok(others) if others.is_empty() => None,
        Ok(others) => Some(format!(
            "{} more on {resolved}: {}; expected this relay to be the only publisher",
            others.len(),
            list_peers(&others)
        )),
        Err(error) => Some(error.to_string()),
    }
}
