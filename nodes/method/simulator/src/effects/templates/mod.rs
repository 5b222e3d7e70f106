//! Templates: forms of what may be missing where no effect of the library explains the data. They are no candidates of a
//! search: a template says in which part of the simulator, where along the object and how fast something acts, and not what
//! it is.
//!
//! Two companions set where and how fast: `template_place` and `template_frequency_hz`. They do nothing alone.

mod arm_gain;
mod axis;
mod camera_drift;
mod grip_drift;
mod harmonic_camera;
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

pub(super) use local_curvature::bend;

use super::companion::Companion;
use super::effect::{About, Effect, Hook, uniform};
use axis::Axis;
use std::sync::Arc;
use wave::Phase;

/// Beginning of the names of templates and of their companions.
const PREFIX: &str = "template_";
/// Name of the companion that sets where a template acts.
pub const PLACE: &str = "template_place";
/// Name of the companion that sets how fast a template acts.
pub const FREQUENCY: &str = "template_frequency_hz";

/// Returns all templates. The companions come first, because the others read what they set.
pub(super) fn all() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(Companion::place(PLACE, |episode| &mut episode.templates.place)),
        Arc::new(Companion::frequency(FREQUENCY, |episode| &mut episode.templates.frequency_hz)),
        Arc::new(point_mass::effect()),
        Arc::new(local_stiffness::effect()),
        Arc::new(local_curvature::effect()),
        Arc::new(harmonic_force::effect(Phase::Sine)),
        Arc::new(harmonic_force::effect(Phase::Cosine)),
        Arc::new(harmonic_camera::effect(Axis::Across, Phase::Sine)),
        Arc::new(harmonic_camera::effect(Axis::Across, Phase::Cosine)),
        Arc::new(harmonic_camera::effect(Axis::Up, Phase::Sine)),
        Arc::new(harmonic_camera::effect(Axis::Up, Phase::Cosine)),
        Arc::new(harmonic_grip::effect(Phase::Sine)),
        Arc::new(harmonic_grip::effect(Phase::Cosine)),
        Arc::new(grip_drift::effect()),
        Arc::new(stiffness_drift::effect()),
        Arc::new(arm_gain::effect()),
        Arc::new(camera_drift::effect(Axis::Across)),
        Arc::new(camera_drift::effect(Axis::Up)),
    ]
}

/// Returns whether `name` is that of a template, and not of a companion.
pub(super) fn is_template(name: &str) -> bool {
    name.starts_with(PREFIX) && ![PLACE, FREQUENCY].contains(&name)
}

/// Description of a template whose magnitude has either sign: name, title, description and unit, with a uniform prior up to
/// `prior` and a range up to `most`.
fn signed(words: [&'static str; 4], hook: Hook, [prior, most]: [f64; 2]) -> About {
    let [name, title, description, unit] = words;
    About { name, title, description, unit, hook, prior: uniform(-prior, prior), range: [-most, most] }
}
