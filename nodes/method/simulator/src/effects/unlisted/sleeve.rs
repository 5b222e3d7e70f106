//! A stiff sleeve.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{PLACE, about, stretch};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::ops::Range;
use std::sync::Arc;

/// Length of the sleeve, as a fraction of the object's.
const WIDTH: f64 = 0.16;

/// Additional stiffness, as a share of the object's, and the sleeve's stretch.
struct Stiff(f64, Range<f64>);

impl MaterialTerm for Stiff {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        let factor = 1.0 + self.0 * place.share_within(&self.1);
        element.stiffness = element.stiffness.map(|stiffness| factor * stiffness);
    }
}

/// Effect `sleeve`: a stretch that is stiffer in bending, shear and tension.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("sleeve", "stiff sleeve", "1", Hook::Material, log_uniform(0.05, 50.0), 1e3),
        &[PLACE],
        |magnitude, episode| {
            episode.terms.materials.push(Arc::new(Stiff(magnitude, stretch(episode.unlisted.place, WIDTH))))
        },
    )
}
