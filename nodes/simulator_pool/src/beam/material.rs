//! Law of the axial force, and the barrier against collapse.

use catenary_core::model::AxialLaw;

/// Stretch below which the barrier acts.
const BARRIER_STRETCH: f64 = 0.4;

/// Axial energy per rest length, its first and its second derivative by the stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axial {
    /// Energy per rest length in J/m.
    pub energy: f64,
    /// Axial force in N.
    pub force: f64,
    /// Tangent stiffness in N.
    pub stiffness: f64,
}

/// The axial law at stretch `u` > 0, whose inverse is `inverse`, for axial stiffness `ea` in N.
///
/// Linear: w = EA (u - 1)^2 / 2. Neo-Hookean, incompressible, in uniaxial tension: w = EA / 3 (u^2 / 2 + 1 / u - 3 / 2).
/// Below a stretch of 0.4 a barrier EA ln^2(u / 0.4) keeps the two ends of an element apart.
#[inline(always)]
pub(super) fn axial(law: AxialLaw, ea: f64, u: f64, inverse: f64) -> Axial {
    let mut axial = match law {
        AxialLaw::Linear => {
            let strain = u - 1.0;
            Axial { energy: 0.5 * ea * strain * strain, force: ea * strain, stiffness: ea }
        }
        AxialLaw::NeoHookean => {
            let third = ea * (1.0 / 3.0);
            let inverse_2 = inverse * inverse;
            Axial {
                energy: third * (0.5 * u * u + inverse - 1.5),
                force: third * (u - inverse_2),
                stiffness: third * (1.0 + 2.0 * inverse_2 * inverse),
            }
        }
    };
    if u < BARRIER_STRETCH {
        add_barrier(&mut axial, ea, u);
    }
    axial
}

#[cold]
fn add_barrier(axial: &mut Axial, ea: f64, u: f64) {
    let log = (u / BARRIER_STRETCH).ln();
    axial.energy += ea * log * log;
    axial.force += 2.0 * ea * log / u;
    axial.stiffness += 2.0 * ea * (1.0 - log) / (u * u);
}
