//! The model file: which simulator is meant, with which parameters and distributions.

mod check;
mod error;
mod outline;
mod rewrite;
#[cfg(test)]
mod tests;

pub use error::{ModelError, Place};

use crate::task::DeltaAnchor;
use crate::{Camera, GripPose, Parameter, ParameterSpace, Prior, Task};
use outline::Node;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The version of the format that this program reads and writes.
pub const MODEL_VERSION: u32 = 1;

/// The whole description of a model. Inference, training and the effect finder read and write it, and nothing else
/// describes the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Version of the format.
    pub version: u32,
    /// Name of the model.
    pub name: String,
    /// The object's section and material law.
    pub object: Object,
    /// Parameters with one value, by name with unit.
    pub parameters: BTreeMap<String, f64>,
    /// Parameters that are inferred, with their priors.
    pub theta: ParameterSpace,
    /// The object's own values, where they are known, of parameters in `theta` and `effects`: what a simulated cell holds
    /// and `catenary simulate` shows. Inference and training do not read them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub nominal: BTreeMap<String, f64>,
    /// Parameters that are drawn anew for each episode: effects and nuisances, with their distributions.
    #[serde(default)]
    pub effects: Vec<Effect>,
    /// What an episode looks like to inference.
    pub observation: ObservationModel,
    /// The camera and its noise.
    pub camera: CameraModel,
    /// The arm.
    pub arm: Arm,
    /// The task of the policy; none for models that are inferred from recorded paths alone.
    #[serde(default)]
    pub task: Option<Task>,
    /// What is known beforehand of effects that the model lacks.
    #[serde(default, skip_serializing_if = "Lacking::is_empty")]
    pub lacking: Lacking,
}

/// What is known beforehand of effects that a model lacks: the effect finder reads it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lacking {
    /// Effects that are not present: they are not looked for.
    #[serde(default)]
    pub vetoes: Vec<String>,
    /// How likely an effect is to be present, over the others, by name; 1 where nothing is said.
    #[serde(default)]
    pub prior_odds: BTreeMap<String, f64>,
}

impl Lacking {
    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        self.vetoes.is_empty() && self.prior_odds.is_empty()
    }
}

/// The object's section and material law.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    /// Shape and size of the section.
    pub section: Section,
    /// Law of the axial force.
    pub axial_law: AxialLaw,
    /// The four keypoints' places along the visible centre line, as fractions of its deformed length from the grip on,
    /// increasing.
    pub keypoint_fractions: [f64; 4],
    /// Deformed length next to the grip that the fingers hide from the camera, m: the visible centre line begins behind it.
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
    /// A full square.
    Square {
        /// Side in m.
        side_m: f64,
    },
    /// A full circle.
    Round {
        /// Diameter in m.
        diameter_m: f64,
    },
}

/// Law of the axial force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxialLaw {
    /// Force proportional to the stretch.
    Linear,
    /// Incompressible neo-Hookean material; the section shrinks as the object stretches.
    NeoHookean,
}

/// A parameter that is drawn anew for each episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// Name with unit.
    pub name: String,
    /// Its distribution.
    pub distribution: Prior,
}

/// How inference drives the simulator to reproduce a measured episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveKind {
    /// The measured path of the clamped end.
    Grip,
    /// The recorded actions, through the arm model.
    Actions,
    /// The policy that was run, through the arm model.
    Policy,
}

impl DriveKind {
    /// Its name in a model file.
    pub fn name(self) -> &'static str {
        match self {
            DriveKind::Grip => "grip",
            DriveKind::Actions => "actions",
            DriveKind::Policy => "policy",
        }
    }
}

/// What the object's shape is at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartKind {
    /// It hangs at rest from the grip.
    HangingAtRest,
    /// It has the shape and the velocity of the first measured frames.
    Measured,
}

/// What an episode looks like to inference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationModel {
    /// What moves the clamped end in simulation.
    pub drive: DriveKind,
    /// The shape at the start.
    pub start: StartKind,
    /// Number of frames that inference looks at.
    pub frames: usize,
    /// s between two of them.
    pub frame_period_s: f64,
    /// Standard deviation of a measured start's velocities, m/s: simulations with noise start from draws around what was
    /// measured, as the true start may have been.
    #[serde(default)]
    pub start_velocity_sd_m_s: f64,
}

/// The camera and its noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraModel {
    /// The camera itself.
    pub view: Camera,
    /// Frames per second.
    pub rate_hz: f64,
    /// Standard deviation of a keypoint coordinate in mask pixels.
    pub keypoint_noise_px: f64,
    /// Half width of the uniform jitter of the camera's position from episode to episode, m.
    pub position_jitter_m: f64,
}

/// The arm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// How it follows a target.
    pub law: ArmLaw,
    /// Pose at the start of an episode.
    pub start: GripPose,
    /// Standard deviation of a measured coordinate of the hand in m, and of its pitch per 0.1 m of lever, where the arm's path
    /// is a prediction (drive: actions or policy). A measured path that drives the simulation is taken as it is.
    #[serde(default = "pose_noise_m")]
    pub pose_noise_m: f64,
}

fn pose_noise_m() -> f64 {
    5e-4
}

/// How the arm follows a target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ArmLaw {
    /// A first-order lag with a speed limit.
    Lag {
        /// Time constant of the approach to the target in s.
        time_constant_s: f64,
        /// Greatest speed in m/s.
        max_speed_m_s: f64,
    },
    /// A Cartesian impedance law, m x'' = K clip(r - x) - D x' - friction, whose reference r lags behind the target.
    Impedance(Impedance),
}

/// Constants of a Cartesian impedance law along x and z. What is left out has the values of a stiff law whose answer to a
/// step of 6 cm was measured: 90 % after 0.45 s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Impedance {
    /// Stiffness K in N/m. Larger follows more stiffly and stands nearer to the target against friction.
    pub stiffness_n_m: f64,
    /// Damping D in N s/m.
    pub damping_n_s_m: f64,
    /// Greatest error along an axis that the law takes, in m: with K it bounds the force, and with D the speed.
    pub clip_m: f64,
    /// Time constant in s with which the reference follows the target.
    pub reference_time_constant_s: f64,
    /// Mass of the arm as the hand feels it, in kg.
    pub mass_kg: f64,
    /// Coulomb friction as the hand feels it, in N: a soft law stops short of its target by friction / K.
    pub friction_n: f64,
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
        }
    }
}

impl ArmLaw {
    /// Constants that must be positive, and constants that must be at least zero, by name.
    #[allow(clippy::type_complexity, reason = "two short lists of named numbers, read in one place")]
    pub(super) fn constants(&self) -> (Vec<(&'static str, f64)>, Vec<(&'static str, f64)>) {
        match self {
            ArmLaw::Lag { time_constant_s, max_speed_m_s } => (
                vec![("arm.law.lag.max_speed_m_s", *max_speed_m_s)],
                vec![("arm.law.lag.time_constant_s", *time_constant_s)],
            ),
            ArmLaw::Impedance(i) => (
                vec![
                    ("arm.law.impedance.stiffness_n_m", i.stiffness_n_m),
                    ("arm.law.impedance.clip_m", i.clip_m),
                    ("arm.law.impedance.mass_kg", i.mass_kg),
                ],
                vec![
                    ("arm.law.impedance.damping_n_s_m", i.damping_n_s_m),
                    ("arm.law.impedance.reference_time_constant_s", i.reference_time_constant_s),
                    ("arm.law.impedance.friction_n", i.friction_n),
                ],
            ),
        }
    }
}

impl Model {
    /// Reads and checks a model file's text; errors name line and field.
    ///
    /// # Errors
    /// [`ModelError`]: another version, no model, values that make no sense.
    pub fn from_yaml(text: &str) -> Result<Self, ModelError> {
        let outline = Node::of(text);
        check::version(outline.as_ref())?;
        let options = serde_saphyr::options! { with_snippet: false };
        let read = serde_saphyr::from_str_with_options(text, options);
        let model: Model = read.map_err(|e| ModelError::from_yaml(&e, text, outline.as_ref()))?;
        model.check().map_err(|e| e.in_text(text))?;
        Ok(model)
    }

    /// The model as a file's text; reading it gives the same model, to the bit.
    ///
    /// # Errors
    /// [`ModelError`] where YAML cannot hold a value.
    pub fn to_yaml(&self) -> Result<String, ModelError> {
        serde_saphyr::to_string(self).map_err(|e| ModelError::text("", e))
    }

    /// What a delta is added to: the task's, or the default where there is no task.
    pub fn delta_anchor(&self) -> DeltaAnchor {
        self.task.map_or_else(DeltaAnchor::default, |t| t.delta_anchor)
    }

    /// Theta of the object itself: its nominal values, and the prior's median where there is none.
    pub fn nominal_theta(&self) -> Vec<f64> {
        let value = |p: &Parameter| self.nominal.get(&p.name).copied().unwrap_or_else(|| p.prior.from_unit(0.5));
        self.theta.parameters().iter().map(value).collect()
    }
}
