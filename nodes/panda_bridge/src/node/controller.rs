//! The controller behind the relay: it takes target poses on one topic and tells its pose on another.
#![allow(clippy::disallowed_methods, reason = "silence and motion are timed on a clock that does not step")]

use super::settings::ControllerNames;
use crate::arm::Plant;
use crate::convert;
use crate::gate::Order;
use crate::pose::ArmPose;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_shell::{Node, Publisher, Time, list_peers};
use std::time::Instant;

/// The controller as the relay sees it.
pub struct Controller {
    node: Node,
    /// The same moment in the node's clock and in one that does not step.
    origin: Time,
    started: Instant,
    frame_id: String,
    /// Name of the targets' topic before remapping.
    topic: String,
    targets: Publisher<PoseStamped>,
    measured: Option<ArmPose>,
    /// When that came.
    measured_at: Instant,
    target: Option<ArmPose>,
    /// The target was sent since it was last repeated.
    fresh: bool,
}

impl Controller {
    /// A controller of which nothing is known, that takes `targets` in its frame.
    pub fn new(node: &Node, origin: Time, targets: Publisher<PoseStamped>, names: &ControllerNames) -> Self {
        Self {
            node: node.clone(),
            origin,
            started: Instant::now(),
            measured_at: Instant::now(),
            frame_id: names.frame_id.clone(),
            topic: names.target_pose.clone(),
            targets,
            measured: None,
            target: None,
            fresh: false,
        }
    }

    /// The controller told its pose.
    pub fn measure(&mut self, pose: ArmPose) {
        self.measured = Some(pose);
        self.measured_at = Instant::now();
    }

    /// The controller is silent: nothing is known of it, and it is told nothing.
    pub fn lose(&mut self) {
        self.measured = None;
        self.target = None;
    }

    /// Sends the target in force again, unless it was sent since the last call.
    pub fn repeat(&mut self) {
        if let Some(target) = self.target
            && !std::mem::take(&mut self.fresh)
        {
            self.send(&target);
        }
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

    fn obey(&mut self, order: &Order) {
        match order {
            Order::Target(pose) | Order::Hold(pose) => {
                self.send(pose);
                self.target = Some(*pose);
                self.fresh = true;
            }
            Order::End => {
                // A controller keeps its last target: without this it would go on to it.
                if let (Some(measured), Some(_)) = (self.measured, self.target.take()) {
                    self.send(&measured);
                }
            }
        }
    }

    fn unready(&self) -> Option<String> {
        let topic = self.targets.topic();
        if !self.targets.has_subscriber() {
            return Some(format!("no controller listens on {topic}"));
        }
        match self.node.publishers(&self.topic) {
            Ok(others) if others.is_empty() => None,
            Ok(others) => Some(format!(
                "{} more on {topic}: {}; expected this relay to be the only publisher",
                others.len(),
                list_peers(&others)
            )),
            Err(error) => Some(error.to_string()),
        }
    }
}
