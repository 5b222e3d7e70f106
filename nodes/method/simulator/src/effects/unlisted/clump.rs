//! A clump of mass.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{PLACE, about, stretch};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::ops::Range;
use std::sync::Arc;

/// Length of the clump, as a fraction of the object's.
const WIDTH: f64 = 0.04;

/// Mass in kg, and the clump's stretch.
struct Weight(f64, Range<f64>);

impl MaterialTerm for Weight {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        element.mass_per_length_kg_m += self.0 * place.share_of(&self.1) / place.length_m;
    }
}

/// Effect `clump_kg`: a mass on a short stretch, evenly spread and with sharp ends.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("clump_kg", "clump of mass", "kg", Hook::Force, log_uniform(1e-4, 0.1), 10.0),
        &[PLACE],
        |magnitude, episode| {
            episode.terms.materials.push(Arc::new(Weight(magnitude, stretch(episode.unlisted.place, WIDTH))))
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;

    #[test]
    fn the_grip_carries_its_weight_on_every_mesh() {
        fixtures::carries_its_weight(&super::effect());
    }
}
