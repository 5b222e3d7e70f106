//! Friction between the strands of a cable: a moment beside the elastic one.
//!
//! While the strands stick, the cable bends as one solid and is stiffer by `stiffness`; where that moment reaches
//! `moment`, they slip and it stays there. Small motions meet the stiff cable, large ones the soft one and lose energy.
//! (The elastic, perfectly plastic element of Jenkins; for cables: Papailiou 1997, "On the bending stiffness of
//! transmission line conductors".)

use super::element::Response;
use super::mesh::Element;

/// Friction of one beam, the same along its length.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct StrandFriction {
    /// Bending stiffness in N m^2 that sticking adds; 0: there is no friction.
    pub stiffness: f64,
    /// Moment in N m at which the strands slip.
    pub moment: f64,
}

impl StrandFriction {
    /// Whether there is any.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        self.stiffness > 0.0
    }

    /// The moment in N m at a curvature, where it was zero at `neutral`.
    #[inline(always)]
    pub fn moment_at(&self, curvature: f64, neutral: f64) -> f64 {
        (self.stiffness * (curvature - neutral)).clamp(-self.moment, self.moment)
    }

    /// Energy in J per metre that the sticking strands hold; what slip has taken is gone.
    pub fn stored(&self, curvature: f64, neutral: f64) -> f64 {
        let moment = self.moment_at(curvature, neutral);
        0.5 * moment * moment / self.stiffness
    }

    /// Adds the friction of an element whose curvature is `curvature` to its response. Within a step the energy is that of
    /// a spring that gives way: its derivative is the moment.
    #[inline(always)]
    pub fn add(&self, element: &Element, curvature: f64, neutral: f64, response: &mut Response) {
        let moment = self.moment_at(curvature, neutral);
        let slips = moment.abs() >= self.moment;
        let energy = (moment * (curvature - neutral)) - 0.5 * moment * moment / self.stiffness;
        response.energy += element.length * energy;
        response.bending_moment += moment;
        response.bending += if slips { 0.0 } else { self.stiffness * element.inverse_length };
    }

    /// The curvature without moment after the strands have slipped as far as `curvature` makes them.
    #[inline(always)]
    pub fn neutral_after(&self, curvature: f64, neutral: f64) -> f64 {
        curvature - self.moment_at(curvature, neutral) / self.stiffness
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cycle_encloses_the_energy_of_the_slip() {
        let friction = StrandFriction { stiffness: 2.0, moment: 0.1 };
        let (mut neutral, mut lost, mut last) = (0.0, 0.0, 0.0);
        let amplitude = 0.5;
        // The second cycle: the first begins in the middle.
        for i in 0..8000 {
            let curvature = amplitude * (std::f64::consts::TAU * f64::from(i) / 4000.0).sin();
            let moment = friction.moment_at(curvature, neutral);
            lost += if i >= 4000 { moment * (curvature - last) } else { 0.0 };
            (neutral, last) = (friction.neutral_after(curvature, neutral), curvature);
        }
        let slip = 2.0 * (amplitude - friction.moment / friction.stiffness);
        let expected = 2.0 * friction.moment * slip;
        assert!((lost - expected).abs() < 2e-3 * expected, "{lost} against {expected}");
    }

    #[test]
    fn the_moment_is_the_derivative_of_the_energy() {
        let friction = StrandFriction { stiffness: 2.0, moment: 0.1 };
        let element = Element { length: 1.0, inverse_length: 1.0, ..Element::default() };
        let response = |curvature: f64| {
            let mut r = Response::default();
            friction.add(&element, curvature, 0.3, &mut r);
            r
        };
        for curvature in [-0.2, 0.28, 0.3, 0.33, 0.9] {
            let step = 1e-6;
            let slope = (response(curvature + step).energy - response(curvature - step).energy) / (2.0 * step);
            assert!((slope - response(curvature).bending_moment).abs() < 1e-7, "{slope} at {curvature}");
        }
    }
}
