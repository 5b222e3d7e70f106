//! Friction between the strands of a cable: a moment in addition to the elastic one.
//!
//! Sticking strands bend as one solid: the cable is stiffer by `stiffness`. At the moment `moment` they slip, and the
//! moment stays there. Small motions therefore meet the stiff cable; large ones meet the soft cable and lose energy.
//!
//! Source: the elastic, perfectly plastic element of Jenkins; for cables Papailiou 1997, "On the bending stiffness of
//! transmission line conductors".

use super::element::Response;
use super::mesh::Element;

/// Strand friction of one beam, uniform along its length.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct StrandFriction {
    /// Bending stiffness in N m^2 that sticking adds; 0 means no friction.
    pub stiffness: f64,
    /// Moment in N m at which the strands slip.
    pub moment: f64,
}

impl StrandFriction {
    /// Returns true if there is any friction.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        self.stiffness > 0.0
    }

    /// Returns the moment in N m at a curvature in 1/m. It is zero at the curvature `neutral`.
    #[inline(always)]
    pub fn moment_at(&self, curvature: f64, neutral: f64) -> f64 {
        (self.stiffness * (curvature - neutral)).clamp(-self.moment, self.moment)
    }

    /// Returns the stored energy in J/m of sticking strands. Energy lost in slip is not in it.
    pub fn stored(&self, curvature: f64, neutral: f64) -> f64 {
        let moment = self.moment_at(curvature, neutral);
        0.5 * moment * moment / self.stiffness
    }

    /// Adds strand friction to the response of an element of curvature `curvature` in 1/m.
    #[inline(always)]
    pub fn add(&self, element: &Element, curvature: f64, neutral: f64, response: &mut Response) {
        let moment = self.moment_at(curvature, neutral);
        // Within a step the energy is that of a spring that yields, so that its derivative is the moment.
        let slips = moment.abs() >= self.moment;
        let energy = (moment * (curvature - neutral)) - 0.5 * moment * moment / self.stiffness;
        response.energy += element.length * energy;
        response.bending_moment += moment;
        response.bending += if slips { 0.0 } else { self.stiffness * element.inverse_length };
    }

    /// Returns the curvature of zero moment after the slip that `curvature` causes.
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
        // Only the second cycle counts: the first begins in the middle of the loop.
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
