//! Rest curvature.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `rest_curvature_per_m`: rest curvature.
pub(super) struct RestCurvature;

impl Effect for RestCurvature {
    fn about(&self) -> About {
        About {
            name: "rest_curvature_per_m",
            title: "rest curvature",
            description: "curvature of the unloaded centre line, counter-clockwise from the grip on",
            unit: "1/m",
            hook: Hook::Material,
            // The prior of the measured cable; over 0.25 m it is a turn of 1 rad.
            prior: uniform(-4.0, 4.0),
            range: [-100.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.rest_curvature_per_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::RestCurvature;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&RestCurvature);
    }

    #[test]
    fn an_unloaded_bar_is_an_arc() {
        let magnitude = 2.0;
        // Almost without gravity: only an unloaded bar is an exact arc.
        let parameters = fixtures::beam(&RestCurvature, magnitude, 1e6, |b| b.gravity_m_s2 = [0.0, -1e-6]);
        let angle = magnitude * fixtures::THETA[0];
        let [x, z] = fixtures::at_rest(parameters, 0.0).tip();
        fixtures::close(x, angle.sin() / magnitude, 1e-3);
        fixtures::close(z, (1.0 - angle.cos()) / magnitude, 1e-3);
    }
}
