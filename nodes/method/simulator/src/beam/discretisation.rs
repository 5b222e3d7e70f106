//! Discretisation of time and of the beam.

use super::error::{BeamError, require};
use catenary_core::Fidelity;

/// Time integration rule: how positions at successive times give velocities and accelerations.
///
/// Each variant states its numerical damping per cycle, for a vibration of angular frequency w and steps of length h.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scheme {
    /// First order: the amplitude falls by about pi w h per cycle, a tenth at 18 rad/s and 2 ms.
    ImplicitEuler,
    /// Second-order backward differences: the amplitude falls by about pi / 2 (w h)^3 per cycle, a ten-thousandth
    /// there.
    #[default]
    Bdf2,
}

/// Discretisation of time and of the beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Discretisation {
    /// Number of elements over the whole length; at least 2.
    pub elements: usize,
    /// Time step in s.
    pub time_step_s: f64,
    /// Time integration rule.
    pub scheme: Scheme,
    /// Largest error of a node's position in m that Newton's method may leave in a step.
    pub tolerance_m: f64,
    /// Largest number of Newton iterations in a step. A step that needs more is accepted and counted as unconverged.
    pub max_newton_iterations: usize,
}

impl Discretisation {
    /// Discretisation of a fidelity level: fast 20 elements and 4 ms, fine mesh 40 and 4 ms, standard 20 and 2 ms,
    /// reference 40 and 0.5 ms.
    pub fn of(fidelity: Fidelity) -> Self {
        // The tolerance of `fast` moves a tip by some micrometres, its time step by millimetres, and its mesh by
        // centimetres if a very soft bar lies down in folds: `tests/tolerance.rs` measures tolerance and mesh.
        let (elements, time_step_s, tolerance_m) = match fidelity {
            Fidelity::Fast => (20, 4e-3, 1e-6),
            Fidelity::FineMesh => (40, 4e-3, 1e-6),
            Fidelity::Standard => (20, 2e-3, 1e-7),
            Fidelity::Reference => (40, 5e-4, 1e-7),
        };
        Self { elements, time_step_s, scheme: Scheme::Bdf2, tolerance_m, max_newton_iterations: 30 }
    }

    /// Checks every field.
    pub(super) fn check(&self) -> Result<(), BeamError> {
        require("elements", "at least 2", self.elements as f64, |n| n >= 2.0)?;
        require("time_step_s", "a positive number", self.time_step_s, |v| v > 0.0)?;
        require("tolerance_m", "a positive number", self.tolerance_m, |v| v > 0.0)?;
        require("max_newton_iterations", "at least 1", self.max_newton_iterations as f64, |n| n >= 1.0)
    }
}
