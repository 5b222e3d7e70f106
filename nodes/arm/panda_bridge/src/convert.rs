//! Conversions between messages and the types of the bridge.

use crate::arm::{Arm, Plant};
use crate::compliance::Compliance;
use crate::gate::{Command, Mode, Verdict, Writer};
use crate::pose::ArmPose;
use catenary_msgs::geometry_msgs::msg::{
    Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Twist, Vector3, Wrench,
};
use catenary_msgs::msg::{AcceptedTarget, ArmState};
use catenary_msgs::srv::SetComplianceRequest;
use catenary_msgs::std_msgs::msg::Header;
use nalgebra::Vector6;

/// Converts the pose of a message.
#[must_use]
pub fn arm_pose(pose: &Pose) -> ArmPose {
    let (p, q) = (&pose.position, &pose.orientation);
    ArmPose { position_m: [p.x, p.y, p.z], quaternion_xyzw: [q.x, q.y, q.z, q.w] }
}

/// Converts a pose to a message.
#[must_use]
pub fn pose_message(pose: &ArmPose) -> Pose {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.position_m, pose.quaternion_xyzw);
    Pose { position: Point { x, y, z }, orientation: Quaternion { x: qx, y: qy, z: qz, w: qw } }
}

/// Converts a velocity: m/s, then rad/s.
#[must_use]
pub fn twist(v: &Vector6<f64>) -> Twist {
    Twist { linear: vector(v[0], v[1], v[2]), angular: vector(v[3], v[4], v[5]) }
}

/// Converts a wrench: N, then N m.
#[must_use]
pub fn wrench(w: &Vector6<f64>) -> Wrench {
    Wrench { force: vector(w[0], w[1], w[2]), torque: vector(w[3], w[4], w[5]) }
}

fn vector(x: f64, y: f64, z: f64) -> Vector3 {
    Vector3 { x, y, z }
}

/// Makes the transform from panda_link0 to panda_hand_tcp.
#[must_use]
pub fn hand_transform(pose: &ArmPose, header: Header) -> TransformStamped {
    let [x, y, z] = pose.position_m;
    TransformStamped {
        header,
        child_frame_id: "panda_hand_tcp".to_owned(),
        transform: Transform { translation: vector(x, y, z), rotation: pose_message(pose).orientation },
    }
}

/// Makes a command of a target of this writer and this age, s. `simulated_time`: the age was measured with `/clock`.
#[must_use]
pub fn command(message: &PoseStamped, writer: Writer, age_s: f64, simulated_time: bool) -> Command {
    let (frame_id, pose) = (message.header.frame_id.clone(), arm_pose(&message.pose));
    Command { writer, age_s, simulated_time, frame_id, pose }
}

/// Converts the settings of a request.
#[must_use]
pub fn compliance(r: &SetComplianceRequest) -> Compliance {
    Compliance { stiffness: r.stiffness, damping: r.damping, error_clip_m: r.error_clip }
}

/// Makes the answer to a command with this header.
#[must_use]
pub fn accepted_target<P: Plant>(arm: &Arm<P>, verdict: &Verdict, header: Header) -> AcceptedTarget {
    let (accepted_count, rejected_count) = arm.counts();
    let pose = arm.target().map(|t| pose_message(&t)).unwrap_or_default();
    let answer = AcceptedTarget { header, pose, accepted_count, rejected_count, ..AcceptedTarget::default() };
    match verdict {
        Verdict::Accepted { clip, .. } => AcceptedTarget {
            accepted: true,
            reason: if clip.any() { "clamped to the workspace".to_owned() } else { String::new() },
            clipped_x: clip.x,
            clipped_y: clip.y,
            clipped_z: clip.z,
            ..answer
        },
        Verdict::Rejected(why) => AcceptedTarget { reason: why.to_string(), ..answer },
    }
}

/// Makes the state of an arm. `header` is the header of its measurement, `success_rate` the share of control cycles in time, 0 to 1.
#[must_use]
pub fn arm_state<P: Plant>(arm: &Arm<P>, success_rate: f64, header: Header) -> ArmState {
    let mode = arm.mode();
    let reflex = mode == Mode::Reflex;
    ArmState {
        header,
        mode: match mode {
            Mode::Idle => ArmState::MODE_IDLE,
            Mode::Tracking => ArmState::MODE_TRACKING,
            Mode::Hold => ArmState::MODE_HOLD,
            Mode::Moving => ArmState::MODE_MOVING,
            Mode::Reflex => ArmState::MODE_REFLEX,
            Mode::UserStop => ArmState::MODE_USER_STOP,
            Mode::Disconnected => ArmState::MODE_DISCONNECTED,
        },
        // Only a reflex is an error of the arm. Other faults, such as a second publisher, are refusals of the gate.
        errors: if reflex { vec![arm.fault().to_owned()] } else { Vec::new() },
        reflex,
        success_rate,
        fault: arm.fault().to_owned(),
        is_sim: !arm.is_real(),
    }
}
