//! One element: its strains, and its energy with first and second derivatives.

use super::material;
use super::mesh::Element;
use super::state::Node;
use catenary_core::model::AxialLaw;
use std::f64::consts::TAU;

/// Stretch less one, shear angle in rad, curvature less the rest curvature in 1/m.
pub(super) type Strain = [f64; 3];

/// Direction of an element's chord. `angle` is continuous in time and close to the sections' angles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Direction {
    pub cos: f64,
    pub sin: f64,
    pub angle: f64,
}

/// Sine of the turn within one step up to which the arcsine's series is used.
const SMALL_SINE: f64 = 0.05;

impl Direction {
    /// The chord between two nodes, its angle the one nearest to the mean of the sections' angles.
    pub fn between(from: &Node, to: &Node) -> Self {
        let (dx, dz) = (to[0] - from[0], to[1] - from[1]);
        let (angle, mean) = (dz.atan2(dx), 0.5 * (from[2] + to[2]));
        let (sin, cos) = angle.sin_cos();
        Self { cos, sin, angle: angle + TAU * ((mean - angle) / TAU).round() }
    }

    /// The angle from this direction to the unit vector (cos, sin), within half a turn.
    #[inline(always)]
    fn angle_to(&self, cos: f64, sin: f64) -> f64 {
        let across = self.cos * sin - self.sin * cos;
        let along = self.cos * cos + self.sin * sin;
        if along > 0.0 && across.abs() < SMALL_SINE { small_arcsine(across) } else { across.atan2(along) }
    }
}

/// Arcsine to the last bit or two for |y| < [`SMALL_SINE`]: its power series, evaluated in pairs.
#[inline(always)]
fn small_arcsine(y: f64) -> f64 {
    let y2 = y * y;
    let y4 = y2 * y2;
    let low = 1.0 / 6.0 + y2 * (3.0 / 40.0);
    let high = 15.0 / 336.0 + y2 * (105.0 / 3456.0) + y4 * (945.0 / 42240.0);
    y + y * y2 * (low + y4 * high)
}

/// Where an element is.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Kinematics {
    pub direction: Direction,
    pub stretch: f64,
    /// 1 / |chord| in 1/m.
    pub inverse_chord: f64,
    pub strain: Strain,
}

/// Strains of an element between two nodes; `reference` is its direction a short while ago.
#[inline(always)]
pub(super) fn kinematics(element: &Element, from: &Node, to: &Node, reference: &Direction) -> Kinematics {
    let (dx, dz) = (to[0] - from[0], to[1] - from[1]);
    let chord = (dx * dx + dz * dz).sqrt().max(1e-6 * element.length);
    let inverse_chord = 1.0 / chord;
    let (cos, sin) = (dx * inverse_chord, dz * inverse_chord);
    let angle = reference.angle + reference.angle_to(cos, sin);
    let stretch = chord * element.inverse_length;
    let shear = angle - 0.5 * (from[2] + to[2]);
    let curvature = (to[2] - from[2]) * element.inverse_length - element.rest_curvature;
    Kinematics {
        direction: Direction { cos, sin, angle },
        stretch,
        inverse_chord,
        strain: [stretch - 1.0, shear, curvature],
    }
}

/// Kelvin-Voigt damping over one step, in which strain rates are `rate_per_strain` times the strain plus a history.
#[derive(Debug, Clone, Copy)]
pub(super) struct Viscosity {
    /// Retardation time in s.
    pub time_s: f64,
    /// d(strain rate) / d(strain) in 1/s.
    pub rate_per_strain: f64,
}

/// Potential of an element in J, with its derivatives by the chord d = (x, z), the mean angle t and the curvature.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Response {
    pub energy: f64,
    /// Derivative by the chord: the force that the later node feels from the element, reversed, in N.
    pub force: [f64; 2],
    /// Derivative by the mean angle, in N m.
    pub shear_moment: f64,
    /// Bending moment in N m.
    pub bending_moment: f64,
    /// Second derivatives by (x, x), (x, z), (z, z).
    pub chord: [f64; 3],
    /// Second derivatives by (x, t), (z, t).
    pub chord_angle: [f64; 2],
    /// Second derivative by (t, t).
    pub angle: f64,
    /// Derivative of the bending moment by the difference of the sections' angles.
    pub bending: f64,
}

/// Evaluates an element where `at` says it is. `history`: strain rates less their share of the present strain.
#[inline(always)]
pub(super) fn respond(
    element: &Element,
    law: AxialLaw,
    viscosity: &Viscosity,
    at: &Kinematics,
    history: &Strain,
) -> Response {
    let [ea, ga, ei] = element.stiffness;
    let [strain, shear, curvature] = at.strain;
    let (h, inverse_chord) = (element.length, at.inverse_chord);
    let Direction { cos: c, sin: s, .. } = at.direction;
    let a0 = viscosity.rate_per_strain;
    let rate = [a0 * strain + history[0], a0 * shear + history[1], a0 * curvature + history[2]];

    let axial = material::axial(law, ea, at.stretch, h * inverse_chord);
    let stored = axial.energy + 0.5 * (ga * shear * shear + ei * curvature * curvature);
    let lost = 0.5 * (ea * rate[0] * rate[0] + ga * rate[1] * rate[1] + ei * rate[2] * rate[2]);
    let energy = h * (stored + viscosity.time_s / a0 * lost);

    let tension = axial.force + viscosity.time_s * ea * rate[0];
    let shear_moment = h * ga * (shear + viscosity.time_s * rate[1]);
    let bending_moment = ei * (curvature + viscosity.time_s * rate[2]);
    let across = shear_moment * inverse_chord;

    let stiffening = 1.0 + viscosity.time_s * a0;
    let angle = h * ga * stiffening;
    let tt = (axial.stiffness + viscosity.time_s * a0 * ea) * element.inverse_length;
    let nn = inverse_chord * (tension + angle * inverse_chord);
    let tn = -across * inverse_chord;
    Response {
        energy,
        force: [tension * c - across * s, tension * s + across * c],
        shear_moment: -shear_moment,
        bending_moment,
        chord: [
            tt * c * c + nn * s * s - 2.0 * tn * c * s,
            (tt - nn) * c * s + tn * (c * c - s * s),
            tt * s * s + nn * c * c + 2.0 * tn * c * s,
        ],
        chord_angle: [angle * inverse_chord * s, -angle * inverse_chord * c],
        angle,
        bending: ei * stiffening * element.inverse_length,
    }
}
