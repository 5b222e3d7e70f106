//! A sharp bend at one place.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{PLACE, about};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::sync::Arc;

/// Angle in rad and place.
struct Bend(f64, f64);

impl MaterialTerm for Bend {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        if place.holds(self.1) {
            element.rest_curvature_per_m += self.0 / place.length_m;
        }
    }
}

/// Effect `kink_rad`: the unloaded object has a sharp bend at one place, within one element.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("kink_rad", "kink", "rad", Hook::Material, log_uniform(0.01, 2.0), 3.0),
        &[PLACE],
        |magnitude, episode| episode.terms.materials.push(Arc::new(Bend(magnitude, episode.unlisted.place))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;

    #[test]
    fn one_element_of_an_unloaded_bar_has_the_whole_bend() {
        let angle = 0.7;
        let mut model = fixtures::episode_model(&super::effect(), angle);
        model.beam.gravity_m_s2 = [0.0, -1e-6];
        for elements in [12, 20, 40] {
            let nodes = fixtures::held(&model, elements, 0.0).nodes().to_vec();
            let turns: Vec<f64> = nodes.windows(2).map(|two| two[1][2] - two[0][2]).collect();
            let bent: Vec<f64> = turns.into_iter().filter(|turn| turn.abs() > 1e-4).collect();
            assert!(bent.len() == 1 && (bent[0] - angle).abs() < 1e-5, "{elements}: {bent:?}");
        }
    }
}
