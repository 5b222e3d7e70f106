//! A weight glued to the middle.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{MIDDLE, about};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::sync::Arc;

/// Mass per length in kg/m.
struct Weight(f64);

impl MaterialTerm for Weight {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        if MIDDLE.contains(&place.middle()) {
            element.mass_per_length_kg_m += self.0;
        }
    }
}

/// Effect `middle_mass_kg`: a weight glued to the middle of the object.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("middle_mass_kg", "mass at the middle", "kg", Hook::Force, log_uniform(1e-4, 0.1), 10.0),
        &[],
        |magnitude, episode| {
            let length_m = episode.beam.length_m * (MIDDLE.end - MIDDLE.start);
            episode.terms.materials.push(Arc::new(Weight(magnitude / length_m)));
        },
    )
}
