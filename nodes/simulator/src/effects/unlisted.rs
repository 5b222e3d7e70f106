//! Unlisted effects: simulated episodes may have them, but no search offers them as an explanation. A blind test of the
//! effect finder needs episodes whose effect is none of its candidates.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::beam::{
    ElementMaterial, ElementPlace, ForceTerm, GripReaction, GripState, GripTerm, MaterialTerm, PointState,
};
use crate::episode_model::EpisodeModel;
use catenary_core::Prior;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Middle of the object, as fractions of its length.
// Two of the 20 elements of `standard`.
const MIDDLE: std::ops::Range<f64> = 0.45..0.55;
/// Time of the gust in s since the start.
const GUST_S: std::ops::Range<f64> = 1.5..3.0;
/// Frequency of the tremor in Hz.
const TREMOR_HZ: f64 = 3.0;

/// Returns all unlisted effects.
pub(super) fn all() -> Vec<Arc<dyn Effect>> {
    vec![Arc::new(MiddleMass), Arc::new(SoftJoint), Arc::new(Gust), Arc::new(Tremor)]
}

fn about(name: &'static str, title: &'static str, unit: &'static str, hook: Hook, prior: Prior, most: f64) -> About {
    About { name, title, description: title, unit, hook, prior, range: [0.0, most] }
}

/// Effect `middle_mass_kg`: a weight glued to the middle of the object.
struct MiddleMass;
struct Weight(f64);

impl MaterialTerm for Weight {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        if MIDDLE.contains(&place.middle()) {
            element.mass_per_length_kg_m += self.0;
        }
    }
}

impl Effect for MiddleMass {
    fn about(&self) -> About {
        about("middle_mass_kg", "mass at the middle", "kg", Hook::Force, log_uniform(1e-4, 0.1), 10.0)
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        let length_m = episode.beam.length_m * (MIDDLE.end - MIDDLE.start);
        episode.terms.materials.push(Arc::new(Weight(magnitude / length_m)));
        Ok(())
    }
}

/// Effect `soft_joint`: a place in the middle that bends more easily.
struct SoftJoint;
struct Joint(f64);

impl MaterialTerm for Joint {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        if MIDDLE.contains(&place.middle()) {
            element.stiffness[2] /= 1.0 + self.0;
        }
    }
}

impl Effect for SoftJoint {
    fn about(&self) -> About {
        about("soft_joint", "soft joint in the middle", "1", Hook::Material, log_uniform(0.05, 20.0), 1e3)
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.terms.materials.push(Arc::new(Joint(magnitude)));
        Ok(())
    }
}

/// Effect `gust_n_m`: a wind along x that blows for 1.5 s.
struct Gust;
struct Wind(f64);

impl ForceTerm for Wind {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        if GUST_S.contains(&at.time_s) { [self.0 * at.length_m, 0.0] } else { [0.0; 2] }
    }
}

impl Effect for Gust {
    fn about(&self) -> About {
        about("gust_n_m", "gust of wind", "N/m", Hook::Force, log_uniform(1e-3, 2.0), 100.0)
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.terms.forces.push(Arc::new(Wind(magnitude)));
        Ok(())
    }
}

/// Effect `tremor_rad`: a hand that trembles unseen by the encoders.
struct Tremor;
struct Trembling(f64);

impl GripTerm for Trembling {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        grip.tangent_rad += self.0 * (TAU * TREMOR_HZ * time_s).sin();
    }
}

impl Effect for Tremor {
    fn about(&self) -> About {
        about("tremor_rad", "tremor of the hand", "rad", Hook::Boundary, log_uniform(1e-3, 0.3), 1.0)
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.terms.grips.push(Arc::new(Trembling(magnitude)));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Registry;
    use super::super::fixtures::{self, actions};
    use crate::parameters::tests::soft_bar;
    use crate::simulator::BeamSimulator;
    use catenary_core::{Simulator, Track};

    fn episode(effects: &[(&str, f64)]) -> Track {
        let request = fixtures::request(effects, actions(), false);
        let simulator = BeamSimulator::with_effects(&soft_bar(), &Registry::with_unlisted(), 1);
        simulator.unwrap().simulate(&request).unwrap().remove(0)
    }

    #[test]
    fn each_acts_and_is_nothing_at_zero() {
        let nothing = episode(&[]);
        for effect in super::all() {
            let about = effect.about();
            assert_eq!(episode(&[(about.name, 0.0)]), nothing, "{}", about.name);
            let much = about.prior.from_unit(0.9);
            assert_ne!(episode(&[(about.name, much)]), nothing, "{} at {much} does nothing", about.name);
        }
    }

    #[test]
    fn no_search_offers_them() {
        assert!(super::all().iter().all(|e| Registry::shipped().find(e.about().name).is_none()));
    }
}
