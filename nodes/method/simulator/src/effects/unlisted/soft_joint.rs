//! A soft joint in the middle.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{MIDDLE, about};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::sync::Arc;

/// Compliance in addition to the object's own, as a share of it.
struct Joint(f64);

impl MaterialTerm for Joint {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        if MIDDLE.contains(&place.middle()) {
            element.stiffness[2] /= 1.0 + self.0;
        }
    }
}

/// Effect `soft_joint`: a place in the middle that bends more easily.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("soft_joint", "soft joint in the middle", "1", Hook::Material, log_uniform(0.05, 20.0), 1e3),
        &[],
        |magnitude, episode| episode.terms.materials.push(Arc::new(Joint(magnitude))),
    )
}
