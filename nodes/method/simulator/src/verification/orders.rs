//! Orders of convergence in space and in time.

use super::elastica;
use super::error::VerificationError;
use super::specimen::{DOWN_RAD, at_rest, bar, grip};
use crate::beam::{BeamParameters, Discretisation, GripState};
use crate::workers;
use catenary_core::Fidelity;
use catenary_core::model::AxialLaw;
use serde::Serialize;

/// Elements, from coarse to fine.
const ELEMENTS: [usize; 5] = [5, 10, 20, 40, 80];
/// Time steps in s, from coarse to fine.
const TIME_STEPS_S: [f64; 5] = [8e-3, 4e-3, 2e-3, 1e-3, 0.5e-3];
/// Time in s at which the tip is compared.
// A multiple of every time step, so that nothing is interpolated.
const COMPARED_AT_S: f64 = 0.48;
/// Retardation time of a damped bar in s.
const DAMPING_S: f64 = 0.02;
/// Tolerated shortfall of a measured order against the expected one.
const SLACK: f64 = 0.25;

/// Error at one refinement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Refinement {
    /// Number of elements, or time step in s.
    pub division: f64,
    /// Error in m: distance to the exact solution, or to the solution at twice the refinement.
    pub error_m: f64,
}

/// Order of convergence of one case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConvergenceOrder {
    /// Name of the case.
    pub case: &'static str,
    /// Refined quantity: `elements` or `time step in s`.
    pub divided: &'static str,
    /// Errors from coarse to fine, each at twice the refinement of the one before.
    pub errors: Vec<Refinement>,
    /// Order of the method in theory.
    pub expected: f64,
    /// Order between the two finest refinements.
    pub measured: f64,
    /// True if the measured order is at least the expected one less a quarter.
    pub passes: bool,
}

type Errors = fn() -> Result<Vec<Refinement>, VerificationError>;

const CASES: [(&str, &str, Errors); 5] = [
    ("tip of a cantilever, 2e5 Pa, to shooting", "elements", cantilever_in_space),
    ("neo-Hookean elongation, 3e3 Pa, to quadrature", "elements", elongation_in_space),
    ("tip in a move of the grip, 1e4 Pa, to twice as fine", "elements", move_in_space),
    ("tip in a move of the grip, 1e4 Pa, to twice as fine", "time step in s", move_in_time),
    ("tip in an undamped move, 1e4 Pa, to twice as fine", "time step in s", undamped_move_in_time),
];

/// Measures the orders of convergence in space and time on smooth cases, on `workers` threads.
pub fn orders(workers: usize) -> Result<Vec<ConvergenceOrder>, VerificationError> {
    let measured = workers::map(CASES.to_vec(), workers, |_, (case, divided, errors)| {
        let errors = errors()?;
        let finest = [errors[errors.len() - 2].error_m, errors[errors.len() - 1].error_m];
        let (expected, measured) = (2.0, (finest[0] / finest[1]).log2());
        Ok(ConvergenceOrder { case, divided, errors, expected, measured, passes: measured >= expected - SLACK })
    });
    measured.into_iter().collect()
}

fn of_elements(elements: usize) -> Discretisation {
    Discretisation { elements, tolerance_m: 1e-10, ..Discretisation::of(Fidelity::Standard) }
}

fn of_step(time_step_s: f64) -> Discretisation {
    Discretisation { time_step_s, ..of_elements(20) }
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn cantilever_in_space() -> Result<Vec<Refinement>, VerificationError> {
    let p = bar(0.2, 2e5);
    let exact_m = elastica::clamped_tip_m(&p);
    let error = |elements: usize| {
        let tip_m = at_rest(p, &of_elements(elements), grip(0.0))?.tip();
        Ok(Refinement { division: elements as f64, error_m: distance_m(tip_m, exact_m) })
    };
    ELEMENTS.into_iter().map(error).collect()
}

fn elongation_in_space() -> Result<Vec<Refinement>, VerificationError> {
    let p = BeamParameters { axial_law: AxialLaw::NeoHookean, ..bar(0.25, 3e3) };
    let exact_m = elastica::neo_hookean_length_m(&p);
    let error = |elements: usize| {
        let length_m = at_rest(p, &of_elements(elements), grip(DOWN_RAD))?.deformed_length_m();
        Ok(Refinement { division: elements as f64, error_m: (length_m - exact_m).abs() })
    };
    ELEMENTS.into_iter().map(error).collect()
}

/// Returns the distances between tips at successive refinements. The last is compared with one twice as fine.
fn to_twice_as_fine(
    divisions: [f64; 5],
    finer: impl Fn(f64) -> f64,
    tip_m: impl Fn(f64) -> Result<[f64; 2], VerificationError>,
) -> Result<Vec<Refinement>, VerificationError> {
    let mut tips = divisions.map(&tip_m).into_iter().collect::<Result<Vec<_>, _>>()?;
    tips.push(tip_m(finer(divisions[4]))?);
    let error = |(division, pair): (f64, &[[f64; 2]])| Refinement { division, error_m: distance_m(pair[0], pair[1]) };
    Ok(divisions.into_iter().zip(tips.windows(2)).map(error).collect())
}

fn move_in_space() -> Result<Vec<Refinement>, VerificationError> {
    to_twice_as_fine(ELEMENTS.map(|n| n as f64), |n| 2.0 * n, |n| tip_in_a_move_m(&of_elements(n as usize), DAMPING_S))
}

fn move_in_time() -> Result<Vec<Refinement>, VerificationError> {
    to_twice_as_fine(TIME_STEPS_S, |h| 0.5 * h, |h| tip_in_a_move_m(&of_step(h), DAMPING_S))
}

fn undamped_move_in_time() -> Result<Vec<Refinement>, VerificationError> {
    to_twice_as_fine(TIME_STEPS_S, |h| 0.5 * h, |h| tip_in_a_move_m(&of_step(h), 0.0))
}

/// Returns the tip of a bar of the given retardation time after a move of the grip by 6 cm within 0.4 s.
fn tip_in_a_move_m(d: &Discretisation, kelvin_voigt_time_s: f64) -> Result<[f64; 2], VerificationError> {
    let p = BeamParameters { kelvin_voigt_time_s, ..bar(0.25, 1e4) };
    let path = |time_s: f64| {
        let s = (time_s / 0.4).clamp(0.0, 1.0);
        // The polynomial of lowest degree with three continuous derivatives at both ends: a kink would spoil second
        // order.
        let share = s.powi(4) * (35.0 - 84.0 * s + 70.0 * s * s - 20.0 * s.powi(3));
        GripState { x_m: 0.06 * share, ..grip(0.0) }
    };
    let mut beam = at_rest(p, d, path(0.0))?;
    beam.advance_to(COMPARED_AT_S, path);
    Ok(beam.tip())
}
