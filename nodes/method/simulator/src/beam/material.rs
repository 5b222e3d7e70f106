//! Axial law: force against stretch, with a barrier against collapse.

use super::parameters::BeamParameters;
use catenary_core::model::AxialLaw;

/// Mixture of the two axial laws, by shares.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct AxialMix {
    pub linear: f64,
    pub neo_hookean: f64,
}

impl AxialMix {
    /// Mixture of a beam.
    pub fn of(p: &BeamParameters) -> Self {
        let (own, other) = (1.0 - p.other_law_share, p.other_law_share);
        match p.axial_law {
            AxialLaw::Linear => Self { linear: own, neo_hookean: other },
            AxialLaw::NeoHookean => Self { linear: other, neo_hookean: own },
        }
    }
}

/// Stretch below which the barrier acts.
// The linear law alone has a finite energy at stretch 0, so that an element could turn inside out.
const BARRIER_STRETCH: f64 = 0.4;

/// Axial energy per rest length, with first and second derivative by the stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axial {
    /// Energy per rest length in J/m.
    pub energy: f64,
    /// Axial force in N.
    pub force: f64,
    /// Tangent stiffness in N.
    pub stiffness: f64,
}

/// Evaluates the axial law at stretch `u` > 0, for axial stiffness `ea` in N. `inverse` is 1 / u.
///
/// Linear: w = EA (u - 1)^2 / 2. Neo-Hookean, incompressible, in uniaxial tension: w = EA / 3 (u^2 / 2 + 1 / u - 3 /
/// 2). Below a stretch of 0.4 a barrier EA ln^2(u / 0.4) is added: it keeps the two ends of an element apart.
#[inline(always)]
pub(super) fn axial(mix: AxialMix, ea: f64, u: f64, inverse: f64) -> Axial {
    let mut axial = Axial { energy: 0.0, force: 0.0, stiffness: 0.0 };
    if mix.linear > 0.0 {
        let (ea, strain) = (ea * mix.linear, u - 1.0);
        axial = Axial { energy: 0.5 * ea * strain * strain, force: ea * strain, stiffness: ea };
    }
    if mix.neo_hookean > 0.0 {
        let third = ea * mix.neo_hookean * (1.0 / 3.0);
        let inverse_2 = inverse * inverse;
        axial.energy += third * (0.5 * u * u + inverse - 1.5);
        axial.force += third * (u - inverse_2);
        axial.stiffness += third * (1.0 + 2.0 * inverse_2 * inverse);
    }
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
