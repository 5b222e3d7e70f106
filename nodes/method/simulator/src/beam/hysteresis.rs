//! Bending moments with memory, from terms from outside.

use super::element::{Response, Strain};
use super::mesh::Element;
use super::terms::{HystereticTerm, Reply};
use std::fmt;
use std::sync::Arc;

/// Hysteretic moments of one beam. Without terms it holds nothing and costs nothing.
#[derive(Clone, Default)]
pub(super) struct Hysteresis {
    terms: Vec<Arc<dyn HystereticTerm>>,
    /// Moment in N m of each term, element by element, at the step's start.
    moments: Vec<f64>,
    /// Curvature of each element, less the rest curvature, at the step's start, in 1/m.
    curvatures: Vec<f64>,
    /// False while a shape at rest is searched.
    is_on: bool,
}

impl Hysteresis {
    /// Takes over the terms of a beam.
    pub fn reset(&mut self, terms: &[Arc<dyn HystereticTerm>]) {
        self.terms.clear();
        self.terms.extend(terms.iter().cloned());
    }

    /// Forgets all moments: the present shape is the middle of every loop.
    pub fn restart(&mut self, strain: &[Strain]) {
        if self.terms.is_empty() {
            return;
        }
        self.moments.clear();
        self.moments.resize(self.terms.len() * strain.len(), 0.0);
        self.curvatures.clear();
        self.curvatures.extend(strain.iter().map(|s| s[2]));
    }

    /// Switches the moments on, for a motion, or off, for a shape at rest.
    pub fn set_on(&mut self, is_on: bool) {
        self.is_on = is_on;
    }

    /// Returns true if there is any moment.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        self.is_on && !self.terms.is_empty()
    }

    fn replies(&self, k: usize, curvature: f64) -> impl Iterator<Item = Reply> {
        let own = self.moments[k * self.terms.len()..].iter();
        self.terms.iter().zip(own).map(move |(term, moment)| term.reply(*moment, curvature - self.curvatures[k]))
    }

    /// Adds the moments at the curvature `curvature` in 1/m to the response of element number `k`.
    pub fn add(&self, k: usize, element: &Element, curvature: f64, response: &mut Response) {
        for reply in self.replies(k, curvature) {
            response.energy += element.length * reply.energy_j_m;
            response.bending_moment += reply.moment_n_m;
            response.bending += reply.stiffness_n_m2 * element.inverse_length;
        }
    }

    /// Remembers the moments at the end of a step.
    pub fn end_step(&mut self, strain: &[Strain]) {
        let count = self.terms.len();
        for (k, strain) in strain.iter().enumerate() {
            for (term, moment) in self.terms.iter().zip(&mut self.moments[k * count..]) {
                *moment = term.reply(*moment, strain[2] - self.curvatures[k]).moment_n_m;
            }
            self.curvatures[k] = strain[2];
        }
    }
}

impl fmt::Debug for Hysteresis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} hysteretic moments", self.terms.len())
    }
}
