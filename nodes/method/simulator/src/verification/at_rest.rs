//! Shapes at rest compared with theory. They reveal a wrong axial law, a locking element or a wrong shear correction.

use super::comparison::Comparison;
use super::elastica;
use super::error::VerificationError;
use super::specimen::{DOWN_RAD, GRAVITY_M_S2, at_rest, bar, bar_of_poisson_ratio, grip};
use crate::beam::{BeamParameters, Discretisation};
use catenary_core::model::AxialLaw;

const MODULI_PA: [f64; 4] = [1e3, 3e3, 1e4, 5e4];

/// Elongation of a bar hanging under its own weight.
pub(super) fn hanging_elongation(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let mut rows = Vec::new();
    for law in [AxialLaw::Linear, AxialLaw::NeoHookean] {
        for youngs_modulus_pa in MODULI_PA {
            let p = BeamParameters { axial_law: law, ..bar(0.25, youngs_modulus_pa) };
            let (name, exact_m) = match law {
                AxialLaw::Linear => ("linear", p.mass_kg() * GRAVITY_M_S2 * p.length_m / (2.0 * p.axial_stiffness_n)),
                AxialLaw::NeoHookean => ("neo-Hookean", elastica::neo_hookean_length_m(&p) - p.length_m),
            };
            let elongation_m = at_rest(p, d, grip(DOWN_RAD))?.deformed_length_m() - p.length_m;
            rows.push(Comparison::new(format!("{name}, {youngs_modulus_pa:e} Pa"), "m", elongation_m, exact_m));
        }
    }
    Ok(rows)
}

/// Sag of a stiff horizontal cantilever: rho A g L^4 / 8 EI of bending and rho A g L^2 / 2 GA of shear.
pub(super) fn small_deflection(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let p = bar(0.2, 1e8);
    let load_n_m = p.mass_per_length_kg_m * GRAVITY_M_S2;
    let bending_m = load_n_m * p.length_m.powi(4) / (8.0 * p.bending_stiffness_n_m2);
    let shear_m = load_n_m * p.length_m.powi(2) / (2.0 * p.shear_stiffness_n);
    let sag_m = -at_rest(p, d, grip(0.0))?.tip()[1];
    Ok(vec![Comparison::new("sag, 1e8 Pa".into(), "m", sag_m, bending_m + shear_m)])
}

/// Tip of a soft horizontal cantilever. At Poisson's ratio 0 the reference is published boundary values (rounded to
/// 0.01 mm); otherwise it is this crate's solution of the boundary-value problem.
pub(super) fn large_deflection(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let published = [(1e6, [0.17435, -0.09166]), (5e4, [0.03397, -0.19158])];
    let published = published.map(|(e, tip)| ("published", bar_of_poisson_ratio(0.2, e, 0.0), e, tip));
    let own = [1e6, 2e5, 5e4, 1e4].map(|e| {
        let p = bar(0.2, e);
        ("shooting", p, e, elastica::clamped_tip_m(&p))
    });
    let mut rows = Vec::new();
    for (source, p, youngs_modulus_pa, exact_m) in published.into_iter().chain(own) {
        let tip_m = at_rest(p, d, grip(0.0))?.tip();
        for (axis, name) in ["x", "z"].into_iter().enumerate() {
            let what = format!("tip {name}, {source}, {youngs_modulus_pa:e} Pa");
            rows.push(Comparison::new(what, "m", tip_m[axis], exact_m[axis]));
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    // The shooting method is checked here against values that are not ours.
    fn our_boundary_values_are_the_published_ones() {
        for (youngs_modulus_pa, tip_mm) in [(1e6, [174.35, -91.66]), (5e4, [33.97, -191.58])] {
            let tip = elastica::clamped_tip_m(&bar_of_poisson_ratio(0.2, youngs_modulus_pa, 0.0));
            for axis in 0..2 {
                assert!((1e3 * tip[axis] - tip_mm[axis]).abs() < 0.02, "{tip:?} m, not {tip_mm:?} mm");
            }
        }
    }
}
