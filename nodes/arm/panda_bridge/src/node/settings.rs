//! Parameters of the bridge that both transports share, and those of the relay.
#![allow(clippy::disallowed_methods, reason = "the ROS side reads the model file that a parameter names")]

use crate::arm::ArmSettings;
use crate::gate::{BASE_FRAME, GateSettings};
use crate::pose::ArmPose;
use crate::speed::SpeedLimit;
use anyhow::{Context, Result, bail, ensure};
use catenary_core::Model;
use catenary_core::model::ArmLaw;
use catenary_core::task::Workspace;
use catenary_shell::{NodeBuilder, ParamSpec, read_model};
use std::time::Duration;

/// Names of the controller's topics and of its node. The defaults are those of crisp_controllers.
pub struct ControllerNames {
    /// Topic of the measured pose.
    pub current_pose: String,
    /// Topic of the target pose.
    pub target_pose: String,
    /// Topic of the joint states.
    pub joint_states: String,
    /// Node whose parameters set the compliance; empty: none.
    pub node: String,
    /// Frame of the controller's poses.
    pub frame_id: String,
}

/// Settings that are fixed once the bridge runs.
pub struct Settings {
    /// Names of the controller.
    pub controller: ControllerNames,
    /// Law of the arm behind the relay, as far as it is known.
    pub law: Option<ArmLaw>,
    /// Silence of the controller's pose after which the arm counts as disconnected.
    pub silence: Duration,
    /// Gate, start pose and kind of the arm.
    pub arm: ArmSettings,
    /// Greatest speed of followed targets.
    pub speed: SpeedLimit,
}

impl Settings {
    /// Declares the parameters and reads the model file.
    ///
    /// # Errors
    /// Invalid values, a model file that cannot be read.
    pub fn declare(b: &NodeBuilder) -> Result<Self> {
        let text = |name: &str, default: &str, text: &str| b.declare_string(name, default, fixed(text));
        let controller = ControllerNames {
            current_pose: text("controller.current_pose_topic", "current_pose", "Measured pose, PoseStamped.")?.get(),
            target_pose: text("controller.target_pose_topic", "target_pose", "Target pose, PoseStamped.")?.get(),
            joint_states: text("controller.joint_states_topic", "joint_states", "Joint states; passed on.")?.get(),
            node: text(
                "controller.node",
                "cartesian_impedance_controller",
                "Node whose parameters task.k_*, task.d_* and task.error_clip.* set the compliance. If empty, requests to set the compliance are refused.",
            )?
            .get(),
            frame_id: text("controller.frame_id", BASE_FRAME, "Frame of the controller's poses: the arm's base.")?
                .get(),
        };
        let silence = "Silence of the controller's pose after which the arm counts as disconnected; larger tolerates a slow network.";
        let silence = b.declare_f64("controller.silence_s", 0.5, fixed(silence).unit("s").range(0.05..=10.0))?.get();
        let law = law(b)?;
        let model = text("model_file", "", "Model file for start pose and workspace; empty: none.")?.get();
        let model =
            if model.is_empty() { None } else { Some(read_model("model_file", model.as_ref(), Model::from_yaml)?) };
        let real = "True if the arm is physical. Commands of a replay are then rejected.";
        let real = b.declare_bool("is_real", true, fixed(real))?.get();
        let tolerance = "Distance from the start pose up to which a move counts as arrived; soft arms need more.";
        let tolerance = b.declare_f64("start_tolerance_m", 0.03, fixed(tolerance).unit("m").range(0.001..=0.2))?;
        let gate = gate(b, model.as_ref())?;
        let arm = ArmSettings {
            start: start(b, model.as_ref(), &gate.workspace)?,
            gate,
            real,
            start_tolerance_m: tolerance.get(),
        };
        Ok(Self { controller, law, silence: Duration::from_secs_f64(silence), arm, speed: speed(b)? })
    }
}

/// Declares and reads `controller.arm_law`; `None` if the law is unknown.
///
/// # Errors
/// A text that is no law.
pub(super) fn law(b: &NodeBuilder) -> Result<Option<ArmLaw>> {
    let text = "Law of the controller's arm as in a model file, such as {impedance: {clip_m: 0.02}}; empty: unknown until set_compliance.";
    let given = b.declare_string("controller.arm_law", "", fixed(text))?.get();
    if given.is_empty() {
        return Ok(None);
    }
    ArmLaw::from_text(&given).map(Some).context("parameter controller.arm_law")
}

/// Declares and reads the greatest speed of followed targets.
pub(super) fn speed(b: &NodeBuilder) -> Result<SpeedLimit> {
    let d = SpeedLimit::default();
    let linear = "Greatest speed of the hand on the way to a target: a farther target is followed at this speed.";
    let angular = "Greatest angular speed of the hand on the way to a target.";
    Ok(SpeedLimit {
        // At most the limits of a Panda.
        linear_m_s: b.declare_f64("follow_speed_m_s", d.linear_m_s, fixed(linear).unit("m/s").range(0.01..=1.7))?.get(),
        angular_rad_s: b
            .declare_f64("follow_turn_rad_s", d.angular_rad_s, fixed(angular).unit("rad/s").range(0.05..=2.5))?
            .get(),
    })
}

pub(super) fn fixed(text: &str) -> ParamSpec {
    ParamSpec::new(text).read_only()
}

fn gate(b: &NodeBuilder, model: Option<&Model>) -> Result<GateSettings> {
    let d = GateSettings::default();
    let number = |name: &str, default: f64, unit: &str, greatest: f64, text: &str| -> Result<f64> {
        Ok(b.declare_f64(name, default, fixed(text).unit(unit).range(0.001..=greatest))?.get())
    };
    let of_model = model.and_then(|m| m.task).map_or(d.workspace, |t| t.workspace);
    let side = |axis: &str, default: [f64; 2]| -> Result<[f64; 2]> {
        let name = format!("workspace.{axis}_m");
        let text = format!(
            "Least and greatest {axis} of the end effector. If empty, the workspace of the model file's task, or the default without one."
        );
        let given = b.declare(&name, Vec::<f64>::new(), fixed(&text).unit("m").range(-2.0..=2.0))?.get();
        match given[..] {
            [] => Ok(default),
            [low, high] if low < high => Ok([low, high]),
            _ => bail!("parameter {name}: expected the least and a greater value, got {given:?}"),
        }
    };
    Ok(GateSettings {
        workspace: Workspace {
            x_m: side("x", of_model.x_m)?,
            y_m: side("y", of_model.y_m)?,
            z_m: side("z", of_model.z_m)?,
        },
        max_jump_m: number("gate.max_jump_m", d.max_jump_m, "m", 0.3, "Greatest distance of a target from the arm.")?,
        max_turn_rad: number(
            "gate.max_turn_rad",
            d.max_turn_rad,
            "rad",
            1.6,
            "Largest angle between the orientation of a target and the measured one.",
        )?,
        max_age_s: number("gate.max_age_s", d.max_age_s, "s", 5.0, "Greatest age of a target's stamp.")?,
        hold_after_s: number(
            "gate.hold_after_s",
            d.hold_after_s,
            "s",
            10.0,
            "Time without a target after which the arm holds its pose.",
        )?,
        end_after_s: number("gate.end_after_s", d.end_after_s, "s", 60.0, "Silence until the motion ends.")?,
        idle_after_s: number(
            "gate.idle_after_s",
            d.idle_after_s,
            "s",
            3600.0,
            "Time without a target outside an episode after which an enabled arm is disabled.",
        )?,
        allow_replay: b
            .declare_bool("gate.allow_replay", d.allow_replay, fixed("Let a replayed recording move a real arm."))?
            .get(),
    })
}

fn start(b: &NodeBuilder, model: Option<&Model>, workspace: &Workspace) -> Result<Option<ArmPose>> {
    let text = "Start pose: x, y, z in m and the quaternion x, y, z, w; empty: the model file's.";
    let given = b.declare("start_pose", Vec::<f64>::new(), fixed(text))?.get();
    let Workspace { x_m, y_m, z_m } = workspace;
    let is_inside = |[x, y, z]: [f64; 3]| workspace.contains(x, y, z);
    let expected = format!("a place inside the workspace (x {x_m:?}, y {y_m:?}, z {z_m:?} m)");
    match given[..] {
        [] => {
            let Some(start) = model.map(|model| model.arm.start) else { return Ok(None) };
            let pose = ArmPose { position_m: [start.x_m, 0.0, start.z_m], quaternion_xyzw: start.quaternion_xyzw() };
            // A warning only: who never asks for a move to the start needs none.
            if !is_inside(pose.position_m) {
                let got = pose.position_m;
                tracing::warn!("model_file: arm.start: moves there will be refused: expected {expected}, got {got:?}");
            }
            Ok(Some(pose))
        }
        [x, y, z, qx, qy, qz, qw] => {
            let pose = ArmPose { position_m: [x, y, z], quaternion_xyzw: [qx, qy, qz, qw] };
            ensure!(pose.is_normalised(), "parameter start_pose: expected a unit quaternion, got {:?}", &given[3..]);
            ensure!(is_inside(pose.position_m), "parameter start_pose: expected {expected}, got {:?}", &given[..3]);
            Ok(Some(pose))
        }
        _ => bail!("parameter start_pose: expected seven values, got {}", given.len()),
    }
}
