//! The same beam as a boundary-value problem of ordinary differential equations, solved by shooting: no nodes, no elements.

use super::*;

/// Tip (x, z) in m of a beam that is clamped along +x at the origin and hangs under its own weight; linear axial law.
///
/// With t the chord's direction, n its normal, f the force that the outer part exerts: f t = EA (u - 1),
/// f n = GA phi / u, EI theta' = m, m' = -GA phi, r' = u t. At the tip m = 0; the tip's angle is sought for which the
/// clamp's is 0.
pub fn clamped_tip(p: &BeamParameters) -> [f64; 2] {
    let (mut low, mut high) = (DOWN, 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shoot(p, middle).angle > 0.0 { high = middle } else { low = middle }
    }
    let root = shoot(p, 0.5 * (low + high));
    [-root.place[0], -root.place[1]]
}

#[derive(Clone, Copy)]
struct Section {
    place: [f64; 2],
    angle: f64,
    moment: f64,
}

/// The section at the clamp when the tip lies at the origin with that angle: Runge-Kutta from the tip inwards.
fn shoot(p: &BeamParameters, tip_angle: f64) -> Section {
    let steps = 2000;
    let h = -p.length_m / steps as f64;
    let mut section = Section { place: [0.0; 2], angle: tip_angle, moment: 0.0 };
    let moved = |a: &Section, by: f64, d: &Section| Section {
        place: [a.place[0] + by * d.place[0], a.place[1] + by * d.place[1]],
        angle: a.angle + by * d.angle,
        moment: a.moment + by * d.moment,
    };
    for k in 0..steps {
        let arc = p.length_m + k as f64 * h;
        let k1 = slope(p, arc, &section);
        let k2 = slope(p, arc + 0.5 * h, &moved(&section, 0.5 * h, &k1));
        let k3 = slope(p, arc + 0.5 * h, &moved(&section, 0.5 * h, &k2));
        let k4 = slope(p, arc + h, &moved(&section, h, &k3));
        for (weight, k) in [(1.0, k1), (2.0, k2), (2.0, k3), (1.0, k4)] {
            section = moved(&section, weight * h / 6.0, &k);
        }
    }
    section
}

fn slope(p: &BeamParameters, arc: f64, section: &Section) -> Section {
    let load = -p.mass_per_length_kg_m * GRAVITY * (p.length_m - arc);
    let (mut stretch, mut shear) = (1.0, 0.0);
    for _ in 0..40 {
        let (sin, cos) = (section.angle + shear).sin_cos();
        stretch = 1.0 + load * sin / p.axial_stiffness_n;
        shear = stretch * load * cos / p.shear_stiffness_n;
    }
    let (sin, cos) = (section.angle + shear).sin_cos();
    Section {
        place: [stretch * cos, stretch * sin],
        angle: section.moment / p.bending_stiffness_n_m2,
        moment: -p.shear_stiffness_n * shear,
    }
}
