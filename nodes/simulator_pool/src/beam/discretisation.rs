//! How time and the beam are divided.

use super::error::{BeamError, require};
use catenary_core::Fidelity;

/// The rule that turns positions at successive times into velocities and accelerations.
///
/// What it takes from a vibration of angular frequency w, per cycle, at steps of h.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scheme {
    /// First order: the amplitude falls by about pi w h, a tenth a swing at 18 rad/s and 2 ms.
    ImplicitEuler,
    /// Second-order backward differences: by about pi / 2 (w h)^3, a ten-thousandth.
    #[default]
    Bdf2,
}

/// How time and the beam are divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Discretisation {
    /// Number of elements over the whole length; at least 2.
    pub elements: usize,
    /// Time step in s.
    pub time_step_s: f64,
    /// Rule of time integration.
    pub scheme: Scheme,
    /// Largest error of a node's position, in m, that Newton's method may leave in a step.
    pub tolerance_m: f64,
    /// Newton iterations after which a step is taken as it is, and counted as unconverged.
    pub max_newton_iterations: usize,
}

impl Discretisation {
    /// The division that belongs to a fidelity level: fast 20 elements and 4 ms, fine mesh 40 and 4 ms, standard 20 and 2 ms,
    /// reference 40 and 0.5 ms. The tolerance of `fast` moves a tip by some micrometres, its time step by millimetres, its mesh
    /// by centimetres where a very soft bar lies down in folds.
    pub fn of(fidelity: Fidelity) -> Self {
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
