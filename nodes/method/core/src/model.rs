//! Model file: the object, its parameters and distributions, the camera, the arm and the task.

mod arm_law;
mod check;
mod error;
mod expression;
mod outline;
mod rewrite;
mod task_file;
#[cfg(test)]
mod tests;
mod yaml;

pub use arm_law::LawGap;
pub use error::{ModelError, Place};
pub use expression::{Companion as ExpressionCompanion, Expression};
pub use task_file::TaskFile;

use crate::task::DeltaAnchor;
use crate::{Camera, GripPose, Parameter, ParameterSpace, Prior, Task};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the format that this program reads and writes.
pub const MODEL_VERSION: u32 = 1;

/// Complete description of a model. Inference, training and the effect finder read and write it, and no other file
/// describes a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Version of the format.
    pub version: u32,
    /// Name of the model.
    pub name: String,
    /// Section and material law of the object.
    pub object: Object,
    /// Fixed parameters: one value for each name, which ends with the unit.
    pub parameters: BTreeMap<String, f64>,
    /// Inferred parameters with their priors.
    #[serde(deserialize_with = "crate::parameter::unchecked")]
    pub theta: ParameterSpace,
    /// Known true values of parameters in `theta` and `effects`. A simulated cell and `catenary simulate` use them.
    /// Inference and training do not read them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub nominal: BTreeMap<String, f64>,
    /// Effects and nuisances: parameters that are drawn anew for each episode, with their distributions.
    #[serde(default)]
    pub effects: Vec<Effect>,
    /// Frames, drive and start of an episode in inference.
    pub observation: ObservationModel,
    /// Camera and its noise.
    pub camera: CameraModel,
    /// Arm that moves the clamped end.
    pub arm: Arm,
    /// Task of the policy; none for models that are inferred from recorded paths alone.
    #[serde(default)]
    pub task: Option<Task>,
    /// Prior knowledge about effects that the model lacks.
    #[serde(default, skip_serializing_if = "Lacking::is_empty")]
    pub lacking: Lacking,
    /// Effects that this file states, beside those of the library.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expressions: Vec<Expression>,
}

/// Prior knowledge about effects that a model lacks. The effect finder reads it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lacking {
    /// Effects that are known to be absent. The effect finder does not test them.
    #[serde(default)]
    pub vetoes: Vec<String>,
    /// Prior odds of an effect relative to the others, by name; 1 for effects without an entry.
    #[serde(default)]
    pub prior_odds: BTreeMap<String, f64>,
}

impl Lacking {
    /// True if nothing is known.
    pub fn is_empty(&self) -> bool {
        self.vetoes.is_empty() && self.prior_odds.is_empty()
    }
}

/// Section and material law of the object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    /// Shape and size of the section.
    pub section: Section,
    /// Law of the axial force.
    pub axial_law: AxialLaw,
    /// Places of the four keypoints along the visible centre line: increasing fractions of its deformed length, from
    /// the grip on.
    pub keypoint_fractions: [f64; 4],
    /// Deformed length in m next to the grip that the fingers hide from the camera. The visible centre line begins
    /// after it.
    #[serde(default)]
    pub hidden_length_m: f64,
    /// Angle in rad of the clamped tangent from +x, counter-clockwise in the x-z plane, at pitch 0:
    /// 0 for a bar gripped from above, -pi/2 for a cable that hangs from the flange.
    pub grip_angle_rad: f64,
}

/// Section of the object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Section {
    /// Full square.
    Square {
        /// Side in m.
        side_m: f64,
    },
    /// Full circle.
    Round {
        /// Diameter in m.
        diameter_m: f64,
    },
}

/// Law of the axial force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxialLaw {
    /// Axial force proportional to the stretch.
    Linear,
    /// Incompressible neo-Hookean material. The section shrinks as the object stretches.
    NeoHookean,
}

/// Parameter that is drawn anew for each episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// Name with unit.
    pub name: String,
    /// Distribution of the parameter.
    pub distribution: Prior,
}

/// Input with which inference drives the simulator to reproduce a measured episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveKind {
    /// Measured path of the clamped end.
    Grip,
    /// Recorded actions, executed by the arm model.
    Actions,
    /// Recorded policy, executed by the arm model.
    Policy,
}

impl DriveKind {
    /// Name in a model file.
    pub fn name(self) -> &'static str {
        match self {
            DriveKind::Grip => "grip",
            DriveKind::Actions => "actions",
            DriveKind::Policy => "policy",
        }
    }
}

/// Source of the object's shape at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartKind {
    /// The object hangs at rest from the grip.
    HangingAtRest,
    /// The object has the shape and the velocity of the first measured frames.
    Measured,
}

/// Frames, drive and start of an episode in inference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationModel {
    /// Drive of the clamped end in simulation.
    pub drive: DriveKind,
    /// Shape of the object at the start.
    pub start: StartKind,
    /// Number of frames that inference uses.
    pub frames: usize,
    /// Time between two frames in s.
    pub frame_period_s: f64,
    /// Standard deviation of the velocities of a measured start in m/s. Simulations with noise draw their start
    /// velocities around the measured ones.
    #[serde(default)]
    pub start_velocity_sd_m_s: f64,
    /// Standard deviation in m of the measured x and z of the clamped end. A measured path that drives the simulation is smoothed
    /// by it; 0: the path is followed as it was measured.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub grip_position_sd_m: f64,
    /// Standard deviation in rad of the measured pitch of the clamped end, of which the same holds.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub grip_pitch_sd_rad: f64,
    /// True if the keypoints are compared with the simulator's. False leaves the wrench alone; the shape at the start is the
    /// measured one all the same, and the networks of an inference still look at the keypoints.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub keypoints: bool,
    /// Noise of the wrench on the hand; none if the wrench is not compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wrench: Option<WrenchNoise>,
}

// A field that says nothing is not written, so that fingerprints of models without it stay.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn yes() -> bool {
    true
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_yes(value: &bool) -> bool {
    *value
}

/// Noise of the wrench on the hand. An arm that estimates the wrench from the torques of its joints errs more where its own friction and
/// inertia count: along the motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrenchNoise {
    /// Standard deviations of the force along x and along z, N.
    pub force_sd_n: [f64; 2],
    /// Standard deviation of the torque about y, N m.
    pub torque_sd_n_m: f64,
}

impl WrenchNoise {
    /// Standard deviations in the order of a frame's wrench: N, N, N m.
    #[must_use]
    pub fn sds(&self) -> [f64; 3] {
        [self.force_sd_n[0], self.force_sd_n[1], self.torque_sd_n_m]
    }
}

impl Model {
    /// Fields that a model file leaves out at their defaults, in full, for fingerprints: an encoding without names does not show
    /// which field was left out. An expression leaves out fields, too, and its debug text has their names.
    #[must_use]
    pub fn left_out(&self) -> impl Serialize + '_ {
        let (goal, limit) = (self.task.map(|task| task.goal), self.arm.law.reference_limit_m_s());
        let expressions = format!("{:?}", self.expressions);
        (&self.nominal, &self.lacking, goal, limit, self.observation.defaults(), expressions)
    }
}

impl ObservationModel {
    /// Fields that a model file leaves out at their defaults, for fingerprints.
    #[must_use]
    pub fn defaults(&self) -> (bool, Option<WrenchNoise>, [f64; 2]) {
        (self.keypoints, self.wrench, [self.grip_position_sd_m, self.grip_pitch_sd_rad])
    }
}

/// Camera and its noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraModel {
    /// Geometry of the camera.
    pub view: Camera,
    /// Frames per second.
    pub rate_hz: f64,
    /// Standard deviation of a keypoint coordinate in mask pixels.
    pub keypoint_noise_px: f64,
    /// Half width in m of the uniform jitter of the camera's position from episode to episode.
    pub position_jitter_m: f64,
}

/// Arm that moves the clamped end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Law by which the arm follows a target.
    pub law: ArmLaw,
    /// Pose of the clamped end at the start of an episode.
    pub start: GripPose,
    /// Standard deviation of a measured coordinate of the hand in m, and of its pitch times a lever of 0.1 m. It
    /// applies if the arm's path is predicted (drive: actions or policy). A measured path that drives the simulation
    /// has no noise.
    #[serde(default = "pose_noise_m")]
    pub pose_noise_m: f64,
}

fn pose_noise_m() -> f64 {
    // Half a millimetre.
    5e-4
}

/// Law by which the arm follows a target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ArmLaw {
    /// First-order lag with a speed limit.
    Lag {
        /// Time constant of the approach to the target in s.
        time_constant_s: f64,
        /// Greatest speed in m/s.
        max_speed_m_s: f64,
    },
    /// Cartesian impedance law, m x'' = K clip(r - x) - D x' - friction. Its reference r lags behind the target, and may have a
    /// greatest speed.
    Impedance(Impedance),
}

/// Constants of a Cartesian impedance law along x and z. Omitted constants have the values of a stiff law with a
/// measured step response: 90 % of a step of 6 cm after 0.45 s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Impedance {
    /// Stiffness K in N/m. A larger value follows more stiffly and stops nearer to the target against friction.
    pub stiffness_n_m: f64,
    /// Damping D in N s/m.
    pub damping_n_s_m: f64,
    /// Limit of the error along an axis in m. Together with K it limits the force, and with D the speed.
    pub clip_m: f64,
    /// Time constant in s with which the reference follows the target.
    pub reference_time_constant_s: f64,
    /// Effective mass of the arm at the hand in kg.
    pub mass_kg: f64,
    /// Effective Coulomb friction at the hand in N. A soft law stops short of its target by friction / K.
    pub friction_n: f64,
    /// Greatest speed of the reference in m/s; none: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_speed_m_s: Option<f64>,
}

impl Default for Impedance {
    fn default() -> Self {
        Self {
            stiffness_n_m: 2000.0,
            damping_n_s_m: 89.0,
            clip_m: 0.01,
            reference_time_constant_s: 0.2,
            mass_kg: 3.0,
            friction_n: 0.0,
            max_speed_m_s: None,
        }
    }
}

impl ArmLaw {
    /// Greatest speed of an impedance's reference, m/s, which a law leaves out of its text without one.
    #[must_use]
    pub fn reference_limit_m_s(&self) -> Option<f64> {
        match self {
            ArmLaw::Lag { .. } => None,
            ArmLaw::Impedance(law) => law.max_speed_m_s,
        }
    }

    /// Constants, each with its field name, value, plausible range and unit.
    pub(super) fn constants(&self) -> Vec<(&'static str, f64, [f64; 2], &'static str)> {
        match self {
            ArmLaw::Lag { time_constant_s, max_speed_m_s } => vec![
                ("arm.law.lag.max_speed_m_s", *max_speed_m_s, [1e-3, 5.0], "m/s"),
                ("arm.law.lag.time_constant_s", *time_constant_s, [0.0, 5.0], "s"),
            ],
            ArmLaw::Impedance(i) => [
                ("arm.law.impedance.stiffness_n_m", i.stiffness_n_m, [1.0, 1e5], "N/m"),
                ("arm.law.impedance.clip_m", i.clip_m, [1e-4, 1.0], "m"),
                ("arm.law.impedance.mass_kg", i.mass_kg, [0.01, 100.0], "kg"),
                ("arm.law.impedance.damping_n_s_m", i.damping_n_s_m, [0.0, 1e4], "N s/m"),
                ("arm.law.impedance.reference_time_constant_s", i.reference_time_constant_s, [0.0, 5.0], "s"),
                ("arm.law.impedance.friction_n", i.friction_n, [0.0, 500.0], "N"),
            ]
            .into_iter()
            .chain(i.max_speed_m_s.map(|limit| ("arm.law.impedance.max_speed_m_s", limit, [1e-3, 5.0], "m/s")))
            .collect(),
        }
    }
}

impl Model {
    /// Anchor of the task, or the default anchor for a model without a task.
    pub fn delta_anchor(&self) -> DeltaAnchor {
        self.task.map_or_else(DeltaAnchor::default, |t| t.delta_anchor)
    }

    /// Nominal theta: the nominal value of each parameter, or the median of its prior.
    pub fn nominal_theta(&self) -> Vec<f64> {
        let value = |p: &Parameter| self.nominal.get(&p.name).copied().unwrap_or_else(|| p.prior.from_unit(0.5));
        self.theta.parameters().iter().map(value).collect()
    }
}
