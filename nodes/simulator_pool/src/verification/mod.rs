//! The simulator against theory: what it computes beside what is known, the orders in which its errors fall, and random
//! episodes at the edges of what it is asked for.
//!
//! Nothing here is fitted: every reference is a closed form, a quadrature, or a solver of the same beam's differential
//! equations that knows neither nodes nor elements.

mod at_rest;
mod derivatives;
mod elastica;
mod hand_path;
mod in_motion;
mod on_table;
mod orders;
mod runge_kutta;
mod specimen;
mod stress;
#[cfg(test)]
mod tests;
mod vibration;

pub use derivatives::{DerivativeReport, DerivativeRow, DerivativeTrial};
pub use hand_path::{random_actions, random_hand_path};
pub use orders::{ConvergenceOrder, Divided, orders};
pub use stress::{Extreme, Stress, StressReport, StressedEpisode, default_extremes};

use crate::beam::{BeamError, Discretisation};
use crate::parameters::ParameterError;
use crate::workers;
use catenary_core::Fidelity;
use catenary_core::simulator::SimulatorError;
use serde::Serialize;
use thiserror::Error;

/// Why something could not be compared.
#[derive(Debug, Error, PartialEq)]
pub enum VerificationError {
    /// A beam was refused.
    #[error(transparent)]
    Beam(#[from] BeamError),
    /// A model was refused.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// A shape at rest was not found.
    #[error("verification: expected a beam at rest, but its nodes still moved by {last_move_m} m")]
    NotAtRest {
        /// Largest movement of a node in the last round.
        last_move_m: f64,
    },
    /// Theory or simulation gave no frequency.
    #[error("verification: expected a vibration, found none in the frequencies searched")]
    NoFrequency,
    /// A track was refused.
    #[error("verification: {0}")]
    Track(String),
    /// Episodes need a task.
    #[error("verification: model `{0}` has no task")]
    NoTask(String),
}

impl From<SimulatorError> for VerificationError {
    fn from(error: SimulatorError) -> Self {
        VerificationError::Track(error.to_string())
    }
}

/// One number of the simulator and what it should be.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// What is compared, within its case.
    pub what: String,
    /// Unit of both numbers.
    pub unit: &'static str,
    /// The simulator's.
    pub computed: f64,
    /// The theory's.
    pub reference: f64,
}

impl Comparison {
    fn new(what: String, unit: &'static str, computed: f64, reference: f64) -> Self {
        Self { what, unit, computed, reference }
    }
}

/// A comparison and its promise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the case.
    pub case: &'static str,
    /// What is compared, within its case.
    pub what: String,
    /// Unit of both numbers.
    pub unit: &'static str,
    /// The simulator's.
    pub computed: f64,
    /// The theory's.
    pub reference: f64,
    /// Computed over reference.
    pub ratio: f64,
    /// Promised distance of the ratio from one; none: nothing is promised.
    pub tolerance: Option<f64>,
    /// Whether the promise is kept, if there is one. A NaN keeps none.
    pub passes: Option<bool>,
}

impl Row {
    fn new(case: &'static str, c: Comparison, tolerance: Option<f64>) -> Self {
        let Comparison { what, unit, computed, reference } = c;
        let ratio = computed / reference;
        let passes = tolerance.map(|t| (ratio - 1.0).abs() <= t);
        Self { case, what, unit, computed, reference, ratio, tolerance, passes }
    }
}

type Compare = fn(&Discretisation) -> Result<Vec<Comparison>, VerificationError>;

/// A question to theory.
#[derive(Debug, Clone, Copy)]
struct Case {
    name: &'static str,
    /// Whether friction decides the answer, whose law is smoothed at small speeds.
    friction: bool,
    compare: Compare,
}

const CASES: [Case; 10] = [
    case("hanging elongation", at_rest::hanging_elongation),
    case("small deflection", at_rest::small_deflection),
    case("large deflection", at_rest::large_deflection),
    case("bending frequency", in_motion::bending_frequencies),
    case("swing period", in_motion::swing_period),
    case("energy without damping", in_motion::energy_drift),
    case("free fall", in_motion::free_fall),
    case("momentum of a free bar", in_motion::free_momentum),
    Case { friction: true, ..case("stopping distance", on_table::stopping_distance) },
    Case { friction: true, ..case("drag force", on_table::drag_force) },
];

const fn case(name: &'static str, compare: Compare) -> Case {
    Case { name, friction: false, compare }
}

/// The promised distance of a ratio from one: 1 % at `standard`, 0.2 % at `reference`, 2 % where friction decides, and
/// nothing at `fast` and `fine_mesh`.
fn promise(fidelity: Fidelity, friction: bool) -> Option<f64> {
    match (fidelity, friction) {
        (Fidelity::Fast | Fidelity::FineMesh, _) => None,
        (_, true) => Some(0.02),
        (Fidelity::Standard, false) => Some(0.01),
        (Fidelity::Reference, false) => Some(0.002),
    }
}

/// Compares every case at a fidelity, on `workers` threads, in a fixed order.
pub fn table(fidelity: Fidelity, workers: usize) -> Result<Vec<Row>, VerificationError> {
    let discretisation = Discretisation::of(fidelity);
    let compared = workers::map(CASES.to_vec(), workers, |_, case| -> Result<Vec<Row>, VerificationError> {
        let promised = promise(fidelity, case.friction);
        let comparisons = (case.compare)(&discretisation)?;
        Ok(comparisons.into_iter().map(|c| Row::new(case.name, c, promised)).collect())
    });
    Ok(compared.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}
