//! Table of all comparisons with theory.

use super::comparison::{Comparison, Row};
use super::error::VerificationError;
use super::{at_rest, in_motion, on_table};
use crate::beam::Discretisation;
use crate::workers;
use catenary_core::Fidelity;

type Compare = fn(&Discretisation) -> Result<Vec<Comparison>, VerificationError>;

/// Comparison with theory, by name.
#[derive(Debug, Clone, Copy)]
struct TheoryCase {
    name: &'static str,
    /// True if friction decides the result. Its law is smoothed at small speeds, so that more error is allowed.
    friction: bool,
    compare: Compare,
}

const CASES: [TheoryCase; 10] = [
    case("hanging elongation", at_rest::hanging_elongation),
    case("small deflection", at_rest::small_deflection),
    case("large deflection", at_rest::large_deflection),
    case("bending frequency", in_motion::bending_frequencies),
    case("swing period", in_motion::swing_period),
    case("energy without damping", in_motion::energy_drift),
    case("free fall", in_motion::free_fall),
    case("momentum of a free bar", in_motion::free_momentum),
    TheoryCase { friction: true, ..case("stopping distance", on_table::stopping_distance) },
    TheoryCase { friction: true, ..case("drag force", on_table::drag_force) },
];

const fn case(name: &'static str, compare: Compare) -> TheoryCase {
    TheoryCase { name, friction: false, compare }
}

/// Promised distance of a ratio from one: 1 % at `standard`, 0.2 % at `reference`, 2 % if friction decides, and nothing
/// at `fast` and `fine_mesh`.
pub(super) fn promise(fidelity: Fidelity, friction: bool) -> Option<f64> {
    match (fidelity, friction) {
        (Fidelity::Fast | Fidelity::FineMesh, _) => None,
        (_, true) => Some(0.02),
        (Fidelity::Standard, false) => Some(0.01),
        (Fidelity::Reference, false) => Some(0.002),
    }
}

/// Runs all comparisons at a fidelity, on `workers` threads. The order of the rows is fixed.
pub fn table(fidelity: Fidelity, workers: usize) -> Result<Vec<Row>, VerificationError> {
    let discretisation = Discretisation::of(fidelity);
    let compared = workers::map(CASES.to_vec(), workers, |_, case| -> Result<Vec<Row>, VerificationError> {
        let promised = promise(fidelity, case.friction);
        let comparisons = (case.compare)(&discretisation)?;
        Ok(comparisons.into_iter().map(|c| Row::new(case.name, c, promised)).collect())
    });
    Ok(compared.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}
