//! Beam at rest as a boundary-value problem, solved by shooting, and its elongation by quadrature: no nodes, no
//! elements.

use super::runge_kutta::integrate;
use crate::beam::BeamParameters;
use std::f64::consts::FRAC_PI_2;

const STEPS: usize = 2000;
const BISECTIONS: usize = 60;

/// Returns the tip (x, z) in m of a beam clamped along +x at the origin under its own weight, with the linear axial
/// law.
///
/// Let t be the chord's direction, n its normal and f the force of the outer part. Then f t = EA (u - 1), f n = GA phi
/// / u, EI theta' = m, m' = -GA phi and r' = u t. At the tip m = 0. The unknown is the tip's angle for which the
/// clamp's angle is 0. Below some 5 kPa the bar of 15 mm shears so much at the clamp that the solution is not unique.
pub(super) fn clamped_tip_m(p: &BeamParameters) -> [f64; 2] {
    // Angles count from straight down. There the tip of a soft beam has an angle too small to be the difference of two
    // others.
    // The clamp's angle grows with the tip's, up to the first horizontal clamp.
    let mut low = 1e-30;
    while shoot(p, 2.0 * low)[2] < FRAC_PI_2 {
        low *= 2.0;
    }
    let mut high = 2.0 * low;
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if shoot(p, middle)[2] > FRAC_PI_2 { high = middle } else { low = middle }
    }
    let [x, z, ..] = shoot(p, 0.5 * (low + high));
    [-x, -z]
}

/// Integrates from the tip, which lies at the origin at the given angle. Returns x, z, angle and moment at the clamp.
fn shoot(p: &BeamParameters, tip_angle_rad: f64) -> [f64; 4] {
    let weight_n_m = -p.mass_per_length_kg_m * p.gravity_m_s2[1];
    let slope = |arc: f64, [_, _, angle, moment]: &[f64; 4]| {
        let weight_n = weight_n_m * (p.length_m - arc);
        let chord = chord_angle_rad(p, weight_n, *angle);
        let (sin, cos) = chord.sin_cos();
        let stretch = 1.0 + weight_n * cos / p.axial_stiffness_n;
        [stretch * sin, -stretch * cos, moment / p.bending_stiffness_n_m2, stretch * weight_n * sin]
    };
    integrate([p.length_m, 0.0], STEPS, [0.0, 0.0, tip_angle_rad, 0.0], slope)
}

/// Returns the direction a of the chord of a section with the given angle under a weight, both from straight down:
/// GA (a - angle) = u f n with u = 1 + f t / EA, by Newton's method.
fn chord_angle_rad(p: &BeamParameters, weight_n: f64, angle_rad: f64) -> f64 {
    let (axial, shear) = (weight_n / p.axial_stiffness_n, weight_n / p.shear_stiffness_n);
    let mut chord = angle_rad;
    for _ in 0..12 {
        let (sin, cos) = chord.sin_cos();
        let stretch = 1.0 + axial * cos;
        let gap = chord - angle_rad + stretch * shear * sin;
        chord -= gap / (1.0 + shear * (stretch * cos - axial * sin * sin));
    }
    chord
}

/// Returns the length in m of a hanging beam with the neo-Hookean law: EA / 3 (u - u^-2) carries the weight below.
pub(super) fn neo_hookean_length_m(p: &BeamParameters) -> f64 {
    let weight_n = -p.mass_per_length_kg_m * p.length_m * p.gravity_m_s2[1];
    let third_n = p.axial_stiffness_n / 3.0;
    let stretch_under = |load_n: f64| {
        let mut u: f64 = 1.5;
        for _ in 0..50 {
            u -= (third_n * (u - u.powi(-2)) - load_n) / (third_n * (1.0 + 2.0 * u.powi(-3)));
        }
        u
    };
    // Simpson's rule over the share of the beam that hangs below.
    let weight = |k: usize| match k {
        0 | STEPS => 1.0,
        k if k % 2 == 1 => 4.0,
        _ => 2.0,
    };
    let sum: f64 = (0..=STEPS).map(|k| weight(k) * stretch_under(weight_n * k as f64 / STEPS as f64)).sum();
    p.length_m * sum / (3 * STEPS) as f64
}

#[cfg(test)]
mod tests {
    use super::super::specimen::bar;
    use super::*;

    #[test]
    fn a_stiff_beam_sags_as_euler_bernoulli_and_timoshenko_say() {
        let p = bar(0.2, 1e9);
        let load = p.mass_per_length_kg_m * 9.81;
        let sag = load * 0.2_f64.powi(4) / (8.0 * p.bending_stiffness_n_m2) + load * 0.04 / (2.0 * p.shear_stiffness_n);
        assert!((clamped_tip_m(&p)[1] / -sag - 1.0).abs() < 1e-4);
    }

    #[test]
    fn small_loads_stretch_both_laws_alike() {
        let p = bar(0.2, 1e8);
        let linear = 0.5 * 1055.0 * 9.81 * 0.04 / 1e8;
        assert!(((neo_hookean_length_m(&p) - 0.2) / linear - 1.0).abs() < 1e-3);
    }
}
