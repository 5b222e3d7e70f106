//! A load that hangs from the tip.

use super::companion::Companion;
use super::effect::{About, Effect, Hook, log_uniform, uniform};
use crate::episode_model::EpisodeModel;

/// Names of the companions: distance of the load's centre from the tip, and its radius of gyration.
const OFFSET: &str = "tip_load_offset_m";
const GYRATION_RADIUS: &str = "tip_load_gyration_radius_m";

/// Effect `tip_load_kg`: a rigid load fixed to the tip. Its companions place its centre beyond the tip and give it a turning
/// inertia; without them it is a point mass at the tip.
pub(super) struct TipLoad;

impl Effect for TipLoad {
    fn about(&self) -> About {
        About {
            name: "tip_load_kg",
            title: "load at the tip",
            description: "rigid load fixed to the tip, with its centre on the tangent beyond it",
            unit: "kg",
            hook: Hook::Force,
            // The prior of a point mass at the tip.
            prior: log_uniform(1e-4, 0.5),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.tip_load.mass_kg += magnitude;
        Ok(())
    }

    fn companions(&self) -> &'static [&'static str] {
        &[OFFSET, GYRATION_RADIUS]
    }
}

/// Makes the companion that places the load's centre.
pub(super) fn offset() -> Companion {
    let about = About {
        name: OFFSET,
        title: "distance of the load's centre from the tip",
        description: "distance of the centre of the load at the tip from the tip, along the tangent; nothing without tip_load_kg",
        unit: "m",
        hook: Hook::Force,
        // From a weight on the tip to one on a hook below it. A weight pushed over the end has its centre before the tip.
        prior: uniform(0.0, 0.15),
        range: [-0.5, 2.0],
    };
    Companion::new(about, 0.0, |episode| &mut episode.beam.tip_load.offset_m)
}

/// Makes the companion that gives the load a turning inertia.
pub(super) fn gyration_radius() -> Companion {
    let about = About {
        name: GYRATION_RADIUS,
        title: "radius of gyration of the load",
        description: "root of turning inertia about the centre over mass of the load at the tip; nothing without tip_load_kg",
        unit: "m",
        hook: Hook::Force,
        // From a steel ball of 10 mm (3 mm) to a rod of 0.3 m (90 mm).
        prior: log_uniform(2e-3, 0.1),
        range: [0.0, 1.0],
    };
    Companion::new(about, 0.0, |episode| &mut episode.beam.tip_load.gyration_radius_m)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::*;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&TipLoad);
    }

    #[test]
    fn the_grip_carries_its_weight() {
        fixtures::carries_its_weight(&TipLoad);
    }

    #[test]
    fn companions_do_nothing_alone() {
        let base = fixtures::episode(&[], fixtures::actions());
        let alone = fixtures::episode(&[(OFFSET, 0.1), (GYRATION_RADIUS, 0.05)], fixtures::actions());
        assert_eq!(alone, base);
        let [at_tip, with_both] = [0.0, 0.05].map(|value| {
            let effects = [("tip_load_kg", 0.02), (OFFSET, value), (GYRATION_RADIUS, value)];
            fixtures::episode(&effects, fixtures::actions())
        });
        assert_ne!(at_tip, with_both);
    }
}
