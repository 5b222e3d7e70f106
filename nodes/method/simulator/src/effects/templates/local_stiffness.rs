//! A stiffer or softer place.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::window::Window;
use super::{PLACE, signed};
use crate::beam::{ElementMaterial, ElementPlace, MaterialTerm};
use std::sync::Arc;

/// Log change at the middle of the window.
struct Stiffer(f64, Window);

impl MaterialTerm for Stiffer {
    fn change(&self, place: &ElementPlace, element: &mut ElementMaterial) {
        element.stiffness[2] *= (self.0 * self.1.mean_over(place)).exp();
    }
}

/// Template `template_local_stiffness`: log change of the bending stiffness at the place.
pub fn effect() -> TermEffect {
    TermEffect::new(
        // A twentieth to twenty times the stiffness.
        signed(
            [
                "template_local_stiffness",
                "stiffness at a place",
                "log change of the bending stiffness at template_place, over a tenth of the length",
                "1",
            ],
            Hook::Material,
            [3.0, 6.0],
        ),
        &[PLACE],
        |magnitude, episode| {
            let window = Window::at(episode.templates.place);
            episode.terms.materials.push(Arc::new(Stiffer(magnitude, window)));
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, GRAVITY, THETA};
    use std::f64::consts::PI;

    /// Cantilever of length L under its weight q per length: the tip sinks by the integral of M(s) (L - s) / EI(s), with the
    /// moment M = q (L - s)^2 / 2.
    #[test]
    fn a_cantilever_sinks_as_its_stiffness_allows() {
        let (magnitude, place, e) = (-1.5, 0.3, 1e8);
        let sinks_m = |magnitude| {
            let model = fixtures::template(&super::effect(), magnitude, [place, 1.0], e);
            -fixtures::held(&model, 40, 0.0).tip()[1]
        };
        let stiffness_n_m2 = e * 0.015f64.powi(4) / 12.0;
        let load_n_m = 1055.0 * 0.015f64.powi(2) * GRAVITY;
        let more_m = |i: i32| {
            let s = (f64::from(i) + 0.5) / 2000.0;
            let d = (s - place) / 0.1;
            let window = if d.abs() < 1.0 { 0.5 * (1.0 + (PI * d).cos()) } else { 0.0 };
            let left = (1.0 - s) * THETA[0];
            let softer = (-magnitude * window).exp() - 1.0;
            0.5 * load_n_m * left.powi(3) / stiffness_n_m2 * softer * THETA[0] / 2000.0
        };
        fixtures::close(sinks_m(magnitude) - sinks_m(0.0), (0..2000).map(more_m).sum(), 0.02);
    }
}
