//! A rest curvature that changes its sign twice.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::sync::Arc;

/// Curvature in 1/m at both ends.
struct Wave(f64);

impl MaterialTerm for Wave {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        // Legendre polynomial of second order on 0 to 1.
        let s = place.middle();
        element.rest_curvature_per_m += self.0 * (6.0 * s * s - 6.0 * s + 1.0);
    }
}

/// Effect `curvature_wave_per_m`: a rest curvature of second order along the object. Its mean and its slope are zero, so that
/// neither a rest curvature nor a gradient of it is part of it.
pub fn effect() -> TermEffect {
    let prior = log_uniform(0.05, 20.0);
    TermEffect::new(
        about("curvature_wave_per_m", "wave of the rest curvature", "1/m", Hook::Material, prior, 100.0),
        &[],
        |magnitude, episode| episode.terms.materials.push(Arc::new(Wave(magnitude))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;

    /// The slope of the unloaded centre line is the integral of the curvature: m s (1 - s) (1 - 2 s).
    #[test]
    fn an_unloaded_bar_turns_back_twice() {
        let (magnitude, elements) = (3.0, 40);
        let mut model = fixtures::episode_model(&super::effect(), magnitude);
        // Almost without gravity: only an unloaded bar has the shape of its rest curvature.
        model.beam.gravity_m_s2 = [0.0, -1e-6];
        let beam = fixtures::held(&model, elements, 0.0);
        for k in [10, 20, 30, 40] {
            let s = k as f64 / elements as f64;
            let expected = magnitude * fixtures::THETA[0] * s * (1.0 - s) * (1.0 - 2.0 * s);
            let turned = beam.nodes()[k][2];
            assert!((turned - expected).abs() < 1e-3 * magnitude * fixtures::THETA[0], "{k}: {turned} for {expected}");
        }
    }
}
