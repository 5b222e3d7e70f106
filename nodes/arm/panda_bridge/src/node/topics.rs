//! Topics on which an arm publishes what it measures. The simulated cell and the direct transport share them.

use crate::convert;
use crate::gate::BASE_FRAME;
use crate::kinematics::JOINTS;
use crate::pose::ArmPose;
use catenary_core::model::ArmLaw;
use catenary_msgs::geometry_msgs::msg::{PoseStamped, TwistStamped, WrenchStamped};
use catenary_msgs::msg::ArmState;
use catenary_msgs::sensor_msgs::msg::JointState;
use catenary_msgs::std_msgs::msg::String as Text;
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{Node, Publisher, ShellError, Time, contract, stamp};
use nalgebra::Vector6;
use std::sync::{Mutex, PoisonError};

/// Measurement of an arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// Pose of panda_hand_tcp in panda_link0.
    pub pose: ArmPose,
    /// Its velocity: m/s, then rad/s.
    pub twist: Vector6<f64>,
    /// Wrench of the world on the hand, in panda_link0: N, then N m.
    pub wrench: Vector6<f64>,
    /// Joint angles, rad.
    pub joints_rad: [f64; JOINTS],
    /// Joint velocities, rad/s.
    pub velocities_rad_s: [f64; JOINTS],
    /// Joint torques, N m; empty if the arm knows none.
    pub torques_n_m: Vec<f64>,
}

/// Publishers of the arm's side of the contract.
pub struct ArmTopics {
    pose: Publisher<PoseStamped>,
    twist: Publisher<TwistStamped>,
    wrench: Publisher<WrenchStamped>,
    joints: Publisher<JointState>,
    tf: Publisher<TFMessage>,
    state: Publisher<ArmState>,
}

impl ArmTopics {
    /// Creates the publishers.
    ///
    /// # Errors
    /// [`ShellError`]: the names after remapping, the middleware.
    pub fn new(node: &Node) -> Result<Self, ShellError> {
        Ok(Self {
            pose: node.publisher(contract::CURRENT_POSE.name, contract::CURRENT_POSE.qos)?,
            twist: node.publisher(contract::CURRENT_TWIST.name, contract::CURRENT_TWIST.qos)?,
            wrench: node.publisher(contract::EXTERNAL_WRENCH.name, contract::EXTERNAL_WRENCH.qos)?,
            joints: node.publisher(contract::JOINT_STATES.name, contract::JOINT_STATES.qos)?,
            tf: node.publisher(contract::TF.name, contract::TF.qos)?,
            state: node.publisher(contract::ARM_STATE.name, contract::ARM_STATE.qos)?,
        })
    }

    /// Publishes a measurement with the time at which it was made.
    pub fn measured(&self, measured: &Measurement, time: Time) {
        let header = stamp::header(time, BASE_FRAME);
        self.tf.send(TFMessage { transforms: vec![convert::hand_transform(&measured.pose, header.clone())] });
        self.pose.send(PoseStamped { header: header.clone(), pose: convert::pose_message(&measured.pose) });
        self.twist.send(TwistStamped { header: header.clone(), twist: convert::twist(&measured.twist) });
        self.wrench.send(WrenchStamped { header: header.clone(), wrench: convert::wrench(&measured.wrench) });
        self.joints.send(JointState {
            header,
            name: (1..=JOINTS).map(|i| format!("panda_joint{i}")).collect(),
            position: measured.joints_rad.to_vec(),
            velocity: measured.velocities_rad_s.to_vec(),
            effort: measured.torques_n_m.clone(),
        });
    }

    /// Publishes the state of the arm.
    pub fn state(&self, state: ArmState) {
        self.state.send(state);
    }
}

/// Topic on which an arm announces its law, so that policies and trainings can be compared with it. It is offered with the first law: who
/// finds no publisher need not wait for a message.
pub struct LawTopic {
    node: Node,
    offered: Mutex<Option<Publisher<Text>>>,
}

impl LawTopic {
    /// Topic of an arm that has told nothing yet.
    #[must_use]
    pub fn new(node: &Node) -> Self {
        Self { node: node.clone(), offered: Mutex::new(None) }
    }

    /// Announces the law. Later subscribers get the newest one, too, as long as this value lives.
    ///
    /// # Errors
    /// [`ShellError`]: the name after remapping, the middleware. Possible for the first law alone, which creates the publisher.
    pub fn announce(&self, law: &ArmLaw) -> Result<(), ShellError> {
        tracing::info!("the arm follows targets as {law}");
        let mut offered = self.offered.lock().unwrap_or_else(PoisonError::into_inner);
        let publisher = match offered.take() {
            Some(publisher) => publisher,
            None => self.node.publisher(contract::ARM_LAW.name, contract::ARM_LAW.qos)?,
        };
        offered.insert(publisher).send(Text { data: law.to_text() });
        Ok(())
    }
}
