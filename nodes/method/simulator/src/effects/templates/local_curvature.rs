//! A bend at one place of the unloaded object.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::window::Window;
use super::{PLACE, signed};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use crate::episode_model::EpisodeModel;
use std::sync::Arc;

/// Turn in rad, spread over the window.
struct Bend(f64, Window);

/// Adds a bend of `turn_rad` at `place`, a fraction of the length from the grip, to the shape of an unloaded object.
pub fn bend(episode: &mut EpisodeModel, turn_rad: f64, place: f64) {
    episode.terms.materials.push(Arc::new(Bend(turn_rad, Window::at(place))));
}

impl MaterialTerm for Bend {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        element.rest_curvature_per_m += self.0 * self.1.share_in(place) / place.length_m;
    }
}

/// Template `template_local_curvature_rad`: turn of the unloaded centre line at the place.
pub fn effect() -> TermEffect {
    TermEffect::new(
        // The prior of a rest curvature turns a bar of 0.25 m as much.
        signed(
            [
                "template_local_curvature_rad",
                "bend at a place",
                "turn of the unloaded centre line at template_place, counter-clockwise, over a tenth of the length",
                "rad",
            ],
            Hook::Material,
            [1.0, 3.0],
        ),
        &[PLACE],
        |magnitude, episode| bend(episode, magnitude, episode.templates.place),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, THETA};

    #[test]
    fn an_unloaded_bar_turns_by_the_angle_at_the_place_on_every_mesh() {
        let (turn, place) = (0.6f64, 0.4);
        for elements in [12, 20, 40] {
            let mut model = fixtures::template(&super::effect(), turn, [place, 1.0], 1e6);
            // Almost without gravity: only an unloaded bar has the shape of its rest curvature.
            model.beam.gravity_m_s2 = [0.0, -1e-6];
            let beam = fixtures::held(&model, elements, 0.0);
            fixtures::close(beam.nodes()[elements][2], turn, 1e-6);
            // Two straight parts, up to the bend's width.
            let [x, z] = beam.tip();
            fixtures::close(x, THETA[0] * (place + (1.0 - place) * turn.cos()), 0.01);
            fixtures::close(z, THETA[0] * (1.0 - place) * turn.sin(), 0.01);
        }
    }
}
