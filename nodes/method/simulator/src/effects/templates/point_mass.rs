//! A mass at one place.

use super::super::effect::{About, Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::PLACE;
use super::window::Window;
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::sync::Arc;

/// Mass in kg, spread over the window.
struct Weight(f64, Window);

impl MaterialTerm for Weight {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        element.mass_per_length_kg_m += self.0 * self.1.share_in(place) / place.length_m;
    }
}

/// Template `template_point_mass_kg`: a mass at the place.
pub fn effect() -> TermEffect {
    TermEffect::new(
        About {
            name: "template_point_mass_kg",
            title: "mass at a place",
            description: "mass at template_place, spread over a tenth of the length",
            unit: "kg",
            hook: Hook::Force,
            // Prior of a tip mass.
            prior: log_uniform(1e-4, 0.5),
            range: [0.0, 100.0],
        },
        &[PLACE],
        |magnitude, episode| {
            let window = Window::at(episode.templates.place);
            episode.terms.materials.push(Arc::new(Weight(magnitude, window)));
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, GRAVITY, THETA};

    #[test]
    fn the_grip_carries_its_weight_on_every_mesh() {
        fixtures::carries_its_weight(&super::effect());
    }

    /// A level, stiff bar: the moment of the grip grows by the weight times the distance of the place.
    #[test]
    fn its_lever_follows_the_place_smoothly_on_a_coarse_mesh() {
        let moment_n_m = |place| {
            let model = fixtures::template(&super::effect(), 0.02, [place, 1.0], 1e9);
            fixtures::held(&model, 12, 0.0).grip_reaction().moment_n_m
        };
        let per_place = 0.02 * GRAVITY * THETA[0];
        for i in 0..30 {
            let place = 0.15 + 0.7 / 30.0 * f64::from(i);
            let slope = (moment_n_m(place + 1e-3) - moment_n_m(place - 1e-3)) / 2e-3;
            fixtures::close(slope, per_place, 0.1);
        }
        fixtures::close(moment_n_m(0.8) - moment_n_m(0.2), 0.6 * per_place, 5e-3);
    }
}
