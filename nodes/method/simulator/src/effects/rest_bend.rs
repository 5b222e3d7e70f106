//! A bend of the unloaded object at one place.

use super::companion::Companion;
use super::effect::{About, Effect, Hook, uniform};
use super::templates;
use crate::episode_model::{Companions, EpisodeModel};

/// Name of the companion that sets the place.
const PLACE: &str = "rest_bend_place";

/// Effect `rest_bend_rad`: a bend of the unloaded object at the place that its companion sets.
pub(super) struct RestBend;

impl Effect for RestBend {
    fn about(&self) -> About {
        About {
            name: "rest_bend_rad",
            title: "bend",
            description: "turn of the unloaded centre line within a tenth of the length about rest_bend_place, counter-clockwise",
            unit: "rad",
            hook: Hook::Material,
            // A cable that was kept folded has a bend of up to a radian after it was laid straight.
            prior: uniform(-1.0, 1.0),
            range: [-3.0, 3.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        // Not even the last bit of a model without a bend changes.
        if magnitude != 0.0 {
            templates::bend(episode, magnitude, episode.rest_bend_place);
        }
        Ok(())
    }

    fn is_offered_unasked(&self) -> bool {
        // In blind worlds with something that no effect of the library is, a bend at a free place was named for a sleeve, a soft joint and a
        // wave of the rest curvature: three of thirteen false names.
        false
    }

    fn companions(&self) -> &'static [&'static str] {
        &[PLACE]
    }
}

/// Makes the companion that sets the place of the bend.
pub(super) fn place() -> Companion {
    let about = About {
        name: PLACE,
        title: "place of the bend",
        description: "place of the bend, as a fraction of the length from the grip; nothing without rest_bend_rad",
        unit: "1",
        hook: Hook::Material,
        prior: uniform(0.0, 1.0),
        range: [0.0, 1.0],
    };
    Companion::new(about, Companions::default().place, |episode| &mut episode.rest_bend_place)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::*;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&RestBend);
    }

    /// Behind the bend an unloaded bar is turned by it, and before it not.
    #[test]
    fn an_unloaded_bar_turns_at_the_place() {
        let mut episode = fixtures::episode_model(&RestBend, 0.0);
        place().apply(0.3, &mut episode).unwrap();
        RestBend.apply(0.4, &mut episode).unwrap();
        episode.beam.gravity_m_s2 = [0.0, -1e-6];
        let beam = fixtures::held(&episode, 40, 0.0);
        let angle = |fraction: f64| beam.nodes()[(40.0 * fraction) as usize][2];
        assert!(angle(0.1).abs() < 1e-4 && (angle(0.5) - 0.4).abs() < 1e-4, "{} and {}", angle(0.1), angle(0.5));
    }
}
