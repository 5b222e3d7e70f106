//! Window along the object: a raised cosine with a width of a tenth of the length.

use crate::beam::ElementPlace;
use std::f64::consts::PI;

/// Distance from the middle of the window at which it vanishes, as a fraction of the length. The width at half height is as
/// large.
// A tenth of the length. The integral over the elements of a mesh of 12 follows the place within 5 %; half of it would
// follow it in steps.
pub const REACH: f64 = 0.1;

/// Window around a place: (1 + cos(pi (s - place) / REACH)) / 2 within [`REACH`] of it, 0 beyond.
///
/// Its integral over each element is exact, so that sums over a mesh do not depend on the mesh, and change smoothly with the
/// place.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    place: f64,
}

impl Window {
    /// Makes the window around `place`, a fraction of the length from the grip (0) to the tip (1).
    pub fn at(place: f64) -> Self {
        Self { place }
    }

    /// Integral of the window from its beginning to the fraction `s`.
    fn integral_to(&self, s: f64) -> f64 {
        let d = (s - self.place).clamp(-REACH, REACH);
        0.5 * (d + REACH + REACH / PI * (PI * d / REACH).sin())
    }

    /// Mean of the window over an element. An element behind the grip has none of it.
    pub fn mean_over(&self, element: &ElementPlace) -> f64 {
        let [from, to] = element.span;
        if to > from { (self.integral_to(to) - self.integral_to(from)) / (to - from) } else { 0.0 }
    }

    /// Share of the window that lies in an element. The shares of all elements add up to 1, wherever the place is.
    pub fn share_in(&self, element: &ElementPlace) -> f64 {
        let [from, to] = element.span;
        (self.integral_to(to) - self.integral_to(from)) / (self.integral_to(1.0) - self.integral_to(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(elements: usize) -> impl Iterator<Item = ElementPlace> {
        let at = move |k: usize| k as f64 / elements as f64;
        (0..elements).map(move |k| ElementPlace { span: [at(k), at(k + 1)], length_m: 0.25 / elements as f64 })
    }

    #[test]
    fn shares_add_up_to_one_on_every_mesh_and_means_keep_the_area() {
        for elements in [12, 20, 33, 40] {
            for place in [0.0, 0.04, 0.31, 0.5, 1.0] {
                let sum: f64 = mesh(elements).map(|e| Window::at(place).share_in(&e)).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{sum} at {place} of {elements}");
            }
            let area: f64 = mesh(elements).map(|e| Window::at(0.4).mean_over(&e) / elements as f64).sum();
            assert!((area - REACH).abs() < 1e-12, "{area} of {elements}");
        }
        let behind = ElementPlace { span: [0.0, 0.0], length_m: 0.01 };
        assert_eq!((Window::at(0.0).share_in(&behind), Window::at(0.0).mean_over(&behind)), (0.0, 0.0));
    }

    /// The middle of the shares is the place, up to the half element in which a share lies.
    #[test]
    fn the_middle_of_the_shares_moves_with_the_place() {
        for (elements, error) in [(12, 1.5e-3), (20, 1e-3), (40, 1e-4)] {
            for i in 0..100 {
                let place = 0.15 + 0.007 * f64::from(i);
                let middle: f64 =
                    mesh(elements).map(|e| 0.5 * (e.span[0] + e.span[1]) * Window::at(place).share_in(&e)).sum();
                assert!((middle - place).abs() < error, "{middle} for {place} of {elements}");
            }
        }
    }

    #[test]
    fn the_window_has_half_its_height_at_half_its_reach() {
        let thin = |s: f64| ElementPlace { span: [s - 1e-6, s + 1e-6], length_m: 1.0 };
        let at = |s: f64| Window::at(0.5).mean_over(&thin(s));
        for (s, height) in [(0.5, 1.0), (0.45, 0.5), (0.55, 0.5), (0.61, 0.0)] {
            assert!((at(s) - height).abs() < 1e-6, "{} at {s}", at(s));
        }
    }
}
