//! Specimen of all comparisons: the soft bar of 15 mm square section, with the prior's lengths and moduli.

use super::error::VerificationError;
use crate::beam::{Beam, BeamParameters, Discretisation, GripState};
use catenary_core::model::Section;

/// Gravity of the beam's parameters in m/s^2.
pub(super) const GRAVITY_M_S2: f64 = 9.81;
/// Tangent in rad of a grip from which the bar hangs straight down.
pub(super) const DOWN_RAD: f64 = -std::f64::consts::FRAC_PI_2;

/// Makes the bar, with length in m and Young's modulus in Pa.
pub(super) fn bar(length_m: f64, youngs_modulus_pa: f64) -> BeamParameters {
    bar_of_poisson_ratio(length_m, youngs_modulus_pa, 0.45)
}

/// Makes the bar with another Poisson's ratio, which sets the shear stiffness.
pub(super) fn bar_of_poisson_ratio(length_m: f64, youngs_modulus_pa: f64, poisson_ratio: f64) -> BeamParameters {
    let section = Section::Square { side_m: 0.015 };
    BeamParameters::from_youngs_modulus(length_m, section, 1055.0, youngs_modulus_pa, poisson_ratio)
}

/// Makes a grip at the origin with the given tangent in rad.
pub(super) fn grip(tangent_rad: f64) -> GripState {
    GripState { tangent_rad, ..GripState::default() }
}

/// Makes a beam at rest in equilibrium.
pub(super) fn at_rest(p: BeamParameters, d: &Discretisation, grip: GripState) -> Result<Beam, VerificationError> {
    let mut beam = Beam::new(p, *d, grip)?;
    let equilibrium = beam.hang_at_rest(grip);
    if !equilibrium.converged {
        return Err(VerificationError::NotAtRest { last_move_m: equilibrium.last_move_m });
    }
    Ok(beam)
}
