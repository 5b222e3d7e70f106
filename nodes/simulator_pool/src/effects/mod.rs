//! Effects: ways in which reality may differ from the base simulator, one a file.
//!
//! Each has one magnitude; at zero it changes no bit of a track. A model may fix an effect (`parameters`), infer it
//! (`theta`) or draw it anew for each episode (`effects`), and any number of them act together, in the registry's order.
//! To add one: a file here that implements [`Effect`], and a line in [`Registry::shipped`]; nothing else changes. Physics
//! that [`World`] has no field for comes in through the terms of its hook ([`crate::beam::ForceTerm`] and its like).

mod registry;
#[cfg(test)]
pub(crate) mod trial;

mod arm_delay;
mod arm_lag;
mod arm_standing_error;
mod axial_law;
mod camera_offset_x;
mod camera_offset_z;
mod camera_scale;
mod camera_tilt;
mod creep;
mod delta_anchor;
mod density;
mod dropped_frames;
mod exposure;
mod frame_delay;
mod gravity_tilt;
mod grip_angle;
mod grip_compliance;
mod grip_slip;
mod kelvin_voigt;
mod keypoint_bias;
mod keypoint_noise;
mod lens_distortion;
mod linear_drag;
mod overhang;
mod quadratic_drag;
mod rest_curvature;
mod rolling_shutter;
mod stiffness_gradient;
mod table_adhesion;
mod table_friction;
mod table_height;
mod tip_mass;
mod unlisted;

pub use registry::Registry;

use crate::world::World;
use catenary_core::Prior;

/// Where an effect takes hold of the simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hook {
    /// A force on the object from outside: air, table, gravity, added mass.
    Force,
    /// What the object is made of.
    Material,
    /// How the gripper holds it.
    Boundary,
    /// How the arm follows its commands; it does not act where a measured path moves the grip.
    Actuation,
    /// How the object is seen.
    Observation,
}

impl Hook {
    /// The name that lists print.
    pub fn name(self) -> &'static str {
        match self {
            Hook::Force => "force",
            Hook::Material => "material",
            Hook::Boundary => "boundary",
            Hook::Actuation => "actuation",
            Hook::Observation => "observation",
        }
    }
}

/// Whether a magnitude may be negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sign {
    /// At least zero.
    Positive,
    /// Either side of zero.
    Signed,
}

/// What is to be known of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct About {
    /// Name with its unit, as model files write it.
    pub name: &'static str,
    /// Its name in a sentence.
    pub title: &'static str,
    /// What a larger magnitude does.
    pub description: &'static str,
    /// Unit of the magnitude; 1 for a share or a coefficient.
    pub unit: &'static str,
    /// Where it acts.
    pub hook: Hook,
    /// Distribution of the magnitude where it is unknown but present: it reaches from hardly visible to plainly wrong.
    pub prior: Prior,
    /// Least and greatest magnitude that makes sense; holds zero.
    pub range: [f64; 2],
}

impl About {
    /// Whether the magnitude may be negative.
    pub fn sign(&self) -> Sign {
        if self.range[0] < 0.0 { Sign::Signed } else { Sign::Positive }
    }
}

/// An effect.
pub trait Effect: Send + Sync {
    /// What is to be known of it.
    fn about(&self) -> About;

    /// Puts it into the world with that magnitude, on top of what is there. Says what is missing where it cannot act.
    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str>;
}

/// Uniform on `low` to `high`.
const fn uniform(low: f64, high: f64) -> Prior {
    Prior::Uniform { low, high }
}

/// Uniform in the logarithm on `low` to `high`.
const fn log_uniform(low: f64, high: f64) -> Prior {
    Prior::LogUniform { low, high }
}
