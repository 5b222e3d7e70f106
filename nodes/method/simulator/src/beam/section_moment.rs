//! Bending moments without memory, from terms from outside.

use super::element::{Response, Strain};
use super::mesh::{Element, Mesh};
use super::terms::{BendState, MomentTerm};
use std::fmt;
use std::sync::Arc;

/// Points and weights of Gauss and Legendre's rule on 0 to 1, for the energy of a moment. It is exact up to the fifth power of
/// the curvature.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Difference of curvature in 1/m over which a moment's derivative is taken. Objects bend by 0.1 to 10 per m.
const STEP_PER_M: f64 = 1e-5;

/// Greatest share of the elastic bending stiffness that a moment may take away in Newton's method, so that its matrix keeps an inverse.
const MOST_SOFTENING: f64 = 0.9;

/// Moments without memory of one beam. Without terms it holds nothing and costs nothing.
#[derive(Clone, Default)]
pub(super) struct SectionMoments {
    terms: Vec<Arc<dyn MomentTerm>>,
    /// Middle of each element, as a fraction of the rest length.
    fractions: Vec<f64>,
    /// Curvature of each element, less the rest curvature, at the step's start, in 1/m.
    curvatures: Vec<f64>,
    /// End and length of the time step in s.
    step_s: [f64; 2],
    /// False while a shape at rest is searched.
    in_motion: bool,
}

impl SectionMoments {
    /// Takes over the terms of a beam.
    pub fn reset(&mut self, terms: &[Arc<dyn MomentTerm>]) {
        self.terms.clear();
        self.terms.extend(terms.iter().cloned());
    }

    /// Starts a motion at the present shape.
    pub fn restart(&mut self, mesh: &Mesh, strain: &[Strain]) {
        if self.terms.is_empty() {
            return;
        }
        self.fractions.clear();
        self.fractions.extend((0..strain.len()).map(|k| 0.5 * (mesh.fraction(k) + mesh.fraction(k + 1))));
        self.end_step(strain);
    }

    /// Sets whether the beam moves, or a shape at rest is searched. At rest there are neither rates nor time.
    pub fn set_in_motion(&mut self, in_motion: bool) {
        self.in_motion = in_motion;
    }

    /// Returns true if there is any moment.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        !self.terms.is_empty()
    }

    /// Begins a step that ends at `time_s`.
    pub fn begin_step(&mut self, time_s: f64, time_step_s: f64) {
        self.step_s = [time_s, time_step_s];
    }

    /// Adds the moments at the curvature `curvature` in 1/m to the response of element number `k`.
    pub fn add(&self, k: usize, element: &Element, curvature: f64, response: &mut Response) {
        let from = if self.in_motion { self.curvatures[k] } else { 0.0 };
        let moment = |curvature: f64| -> f64 {
            let [time_s, step_s] = if self.in_motion { self.step_s } else { [0.0, f64::INFINITY] };
            let at = BendState {
                time_s,
                fraction: self.fractions[k],
                curvature_per_m: curvature,
                curvature_rate_per_m_s: (curvature - from) / step_s,
            };
            self.terms.iter().map(|term| term.moment_n_m(&at)).sum()
        };
        let change = curvature - from;
        let mean: f64 = GAUSS.iter().map(|(place, weight)| weight * moment(from + place * change)).sum();
        let slope = (moment(curvature + STEP_PER_M) - moment(curvature - STEP_PER_M)) / (2.0 * STEP_PER_M);
        response.energy += element.length * mean * change;
        response.bending_moment += moment(curvature);
        response.bending += slope.max(-MOST_SOFTENING * element.stiffness[2]) * element.inverse_length;
    }

    /// Remembers the curvatures at the end of a step.
    pub fn end_step(&mut self, strain: &[Strain]) {
        self.curvatures.clear();
        self.curvatures.extend(strain.iter().map(|s| s[2]));
    }
}

impl fmt::Debug for SectionMoments {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} moments of sections", self.terms.len())
    }
}
