//! Tests of the beam, in addition to the comparisons with theory in [`crate::verification`].

mod episode;
mod friction;
mod load;
mod motion;
mod repeatability;
mod rest;
mod start;
mod strands;
mod tolerance;

use super::{Beam, BeamParameters, Discretisation, GripState, Table};
use catenary_core::Fidelity;
use catenary_core::model::Section;

const SQUARE: Section = Section::Square { side_m: 0.015 };
const DENSITY: f64 = 1055.0;
const GRAVITY: f64 = 9.81;
const DOWN: f64 = -std::f64::consts::FRAC_PI_2;

/// Makes the soft bar of 15 mm square section.
fn bar(length_m: f64, youngs_modulus_pa: f64) -> BeamParameters {
    BeamParameters::from_youngs_modulus(length_m, SQUARE, DENSITY, youngs_modulus_pa, 0.45)
}

/// Makes a grip at the origin with the given tangent in rad.
fn grip(tangent_rad: f64) -> GripState {
    GripState { tangent_rad, ..GripState::default() }
}

fn standard() -> Discretisation {
    Discretisation::of(Fidelity::Standard)
}

/// Makes a beam at rest in equilibrium.
fn hanging(parameters: BeamParameters, discretisation: Discretisation, at: GripState) -> Beam {
    let mut beam = Beam::new(parameters, discretisation, at).unwrap();
    let equilibrium = beam.hang_at_rest(at);
    assert!(equilibrium.converged, "{equilibrium:?} for {parameters:?}");
    beam
}

/// Fails with both numbers unless `got` is within `share` of `expected`.
#[track_caller]
fn assert_close(got: f64, expected: f64, share: f64) {
    assert!((got - expected).abs() <= share * expected.abs(), "got {got}, expected {expected} within {share}");
}
