//! Rest curvature that changes along the object.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `rest_curvature_gradient_per_m2`: rest curvature that changes along the object.
pub(super) struct RestCurvatureGradient;

impl Effect for RestCurvatureGradient {
    fn about(&self) -> About {
        About {
            name: "rest_curvature_gradient_per_m2",
            title: "rest curvature gradient",
            description: "slope of the rest curvature along the centre line, from the grip to the tip; its mean stays",
            unit: "1/m^2",
            hook: Hook::Material,
            // Measured cables of 0.4 to 0.75 m have slopes of 0.1 to 6 per m^2, but what shows is the angle between the middle
            // and an end, slope times length squared / 8: 0.5 rad for those cables, and 0.3 rad for a bar of 0.25 m at 40 per m^2.
            prior: uniform(-40.0, 40.0),
            range: [-1e3, 1e3],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.rest_curvature_gradient_per_m2 += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::RestCurvatureGradient;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&RestCurvatureGradient);
    }

    /// The angle of an unloaded bar is the integral of its curvature g (s - L / 2): g s (s - L) / 2.
    #[test]
    fn an_unloaded_bar_turns_there_and_back() {
        let (slope, length) = (40.0, fixtures::THETA[0]);
        // Almost without gravity: only an unloaded bar has its rest curvature.
        let parameters = fixtures::beam(&RestCurvatureGradient, slope, 1e6, |b| b.gravity_m_s2 = [0.0, -1e-6]);
        let beam = fixtures::at_rest(parameters, 0.0);
        let angle = |s: f64| 0.5 * slope * s * (s - length);
        let nodes = beam.nodes();
        let last = nodes.len() - 1;
        for (k, node) in nodes.iter().enumerate() {
            let expected = angle(length * k as f64 / last as f64);
            assert!((node[2] - expected).abs() < 1e-3 * slope * length * length, "{k}: {} not {expected}", node[2]);
        }
        // Height of the tip: the integral of the sine of the angle, by Simpson's rule.
        let steps = 1000;
        let h = length / f64::from(steps);
        let weight = |i: i32| if i == 0 || i == steps { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
        let rise: f64 = (0..=steps).map(|i| weight(i) * angle(h * f64::from(i)).sin()).sum::<f64>() * h / 3.0;
        fixtures::close(beam.tip()[1], rise, 5e-3);
    }
}
