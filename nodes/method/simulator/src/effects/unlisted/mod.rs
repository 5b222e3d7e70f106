//! Unlisted effects: simulated episodes may have them, but no search offers them as an explanation. A blind test of the
//! effect finder needs episodes whose residual is none of its candidates, and no [template](super::templates) exactly.
//!
//! Two companions set where and how fast: `unlisted_place` and `unlisted_frequency_hz`.

mod camera_bump;
mod clump;
mod curvature_wave;
mod dahl_friction;
mod gust;
mod kink;
mod loosening_grip;
mod middle_mass;
mod periodic_push;
mod sleeve;
mod soft_joint;
mod start_pull;
mod tremor;
mod undershoot;
mod varying_wind;

use super::companion::Companion;
use super::effect::{About, Effect, Hook};
use catenary_core::Prior;
use std::ops::Range;
use std::sync::Arc;

/// Name of the companion that sets where an unlisted effect acts.
const PLACE: &str = "unlisted_place";
/// Name of the companion that sets how fast an unlisted effect acts.
const FREQUENCY: &str = "unlisted_frequency_hz";
/// Middle of the object, as fractions of its length.
// Two of the 20 elements of `standard`.
const MIDDLE: Range<f64> = 0.45..0.55;

/// Returns all unlisted effects. The companions come first, because the others read what they set.
pub(super) fn all() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(Companion::place(PLACE, |episode| &mut episode.unlisted.place)),
        Arc::new(Companion::frequency(FREQUENCY, |episode| &mut episode.unlisted.frequency_hz)),
        Arc::new(middle_mass::effect()),
        Arc::new(soft_joint::effect()),
        Arc::new(gust::effect()),
        Arc::new(tremor::effect()),
        Arc::new(curvature_wave::effect()),
        Arc::new(kink::effect()),
        Arc::new(sleeve::effect()),
        Arc::new(dahl_friction::effect()),
        Arc::new(clump::effect()),
        Arc::new(varying_wind::effect()),
        Arc::new(periodic_push::effect()),
        Arc::new(start_pull::effect()),
        Arc::new(loosening_grip::effect()),
        Arc::new(undershoot::effect()),
        Arc::new(camera_bump::effect()),
    ]
}

/// Description of an effect whose magnitude is positive, up to `most`.
fn about(name: &'static str, title: &'static str, unit: &'static str, hook: Hook, prior: Prior, most: f64) -> About {
    About { name, title, description: title, unit, hook, prior, range: [0.0, most] }
}

/// Stretch of the object, `width` long, around a place: all of it lies within the object.
fn stretch(place: f64, width: f64) -> Range<f64> {
    let from = (place - 0.5 * width).clamp(0.0, 1.0 - width);
    from..from + width
}

#[cfg(test)]
mod tests {
    use super::super::Registry;
    use super::super::fixtures::{self, actions};
    use super::{FREQUENCY, PLACE};
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
            let much = episode(&[(about.name, about.prior.from_unit(0.9))]);
            let is_companion = [PLACE, FREQUENCY].contains(&about.name);
            assert_eq!(much == nothing, is_companion, "{}", about.name);
        }
    }

    #[test]
    fn each_acts_where_and_as_fast_as_its_companions_say() {
        for effect in super::all() {
            let about = effect.about();
            let much = about.prior.from_unit(0.9);
            let of = |companion, value| episode(&[(about.name, much), (companion, value)]);
            for (companion, default, other) in [(PLACE, 0.5, 0.2), (FREQUENCY, 1.0, 0.4)] {
                let has_it = effect.companions().contains(&companion);
                assert_eq!(of(companion, default), episode(&[(about.name, much)]), "{} {companion}", about.name);
                assert_eq!(of(companion, other) != of(companion, default), has_it, "{} {companion}", about.name);
            }
        }
    }

    #[test]
    fn no_search_offers_them_and_no_template_is_one() {
        let templates = Registry::with_templates();
        assert!(super::all().iter().all(|e| templates.find(e.about().name).is_none()));
    }

    #[test]
    fn a_stretch_lies_within_the_object() {
        for (place, from, to) in [(0.5, 0.45, 0.55), (0.02, 0.0, 0.1), (1.0, 0.9, 1.0)] {
            let stretch = super::stretch(place, 0.1);
            assert!((stretch.start - from).abs() < 1e-12 && (stretch.end - to).abs() < 1e-12, "{stretch:?}");
        }
    }
}
