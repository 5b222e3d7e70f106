//! Templates: forms of what may be missing where no effect of the library explains the data. They are no candidates of a
//! search: a template says in which part of the simulator, where along the object and how fast something acts, and not what
//! it is.
//!
//! Two companions set where and how fast: `template_place` and `template_frequency_hz`. They do nothing alone.

mod arm_gain;
mod camera_drift;
mod grip_drift;
mod harmonic_force;
mod harmonic_grip;
mod local_curvature;
mod local_stiffness;
mod point_mass;
mod stiffness_drift;
#[cfg(test)]
mod tests;
mod wave;
mod window;

use super::companion::{Frequency, Place};
use super::effect::{About, Effect, Hook, uniform};
use std::sync::Arc;
use wave::Phase;

/// Name of the companion that sets where a template acts.
pub const PLACE: &str = "template_place";
/// Name of the companion that sets how fast a template acts.
pub const FREQUENCY: &str = "template_frequency_hz";

/// Returns all templates. The companions come first, because the others read what they set.
pub(super) fn all() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(Place { name: PLACE, own: |episode| &mut episode.templates }),
        Arc::new(Frequency { name: FREQUENCY, own: |episode| &mut episode.templates }),
        Arc::new(point_mass::PointMass),
        Arc::new(local_stiffness::LocalStiffness),
        Arc::new(local_curvature::LocalCurvature),
        Arc::new(harmonic_force::HarmonicForce(Phase::Sine)),
        Arc::new(harmonic_force::HarmonicForce(Phase::Cosine)),
        Arc::new(harmonic_grip::HarmonicGrip(Phase::Sine)),
        Arc::new(harmonic_grip::HarmonicGrip(Phase::Cosine)),
        Arc::new(grip_drift::GripDrift),
        Arc::new(stiffness_drift::StiffnessDrift),
        Arc::new(arm_gain::ArmGain),
        Arc::new(camera_drift::CameraDrift(camera_drift::Axis::Across)),
        Arc::new(camera_drift::CameraDrift(camera_drift::Axis::Up)),
    ]
}

/// Description of a template whose magnitude has either sign, with a uniform prior up to `prior` and a range up to `most`.
fn signed(
    name: &'static str,
    title: &'static str,
    description: &'static str,
    unit: &'static str,
    hook: Hook,
    [prior, most]: [f64; 2],
) -> About {
    About { name, title, description, unit, hook, prior: uniform(-prior, prior), range: [-most, most] }
}
