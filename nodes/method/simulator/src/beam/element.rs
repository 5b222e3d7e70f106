//! Beam element: strains, and energy with first and second derivatives.

use super::material::{self, AxialMix};
use super::mesh::Element;
use super::node::Node;
use std::f64::consts::TAU;

/// Strains of an element: stretch less one, shear angle in rad, curvature less the rest curvature in 1/m.
pub(super) type Strain = [f64; 3];

/// Direction of an element's chord. `angle` is continuous in time, whole turns included, and close to the sections'
/// angles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Direction {
    pub cos: f64,
    pub sin: f64,
    pub angle: f64,
}

/// Largest sine of the turn within one step for which the arcsine's series is used.
// The first term left out, 0.017 y^13, is 4e-18 of y there: less than the last bit.
const SMALL_SINE: f64 = 0.05;

impl Direction {
    /// Direction of the chord between two nodes. Whole turns bring its angle nearest to the mean of the sections'
    /// angles.
    pub fn between(from: &Node, to: &Node) -> Self {
        let (dx, dz) = (to[0] - from[0], to[1] - from[1]);
        let (angle, mean) = (dz.atan2(dx), 0.5 * (from[2] + to[2]));
        let (sin, cos) = angle.sin_cos();
        Self { cos, sin, angle: angle + TAU * ((mean - angle) / TAU).round() }
    }

    /// Angle in rad from this direction to the unit vector (cos, sin), within half a turn.
    #[inline(always)]
    fn angle_to(&self, cos: f64, sin: f64) -> f64 {
        let across = self.cos * sin - self.sin * cos;
        let along = self.cos * cos + self.sin * sin;
        // Almost every turn within a step is small, and the series is cheaper than `atan2`.
        if along > 0.0 && across.abs() < SMALL_SINE { small_arcsine(across) } else { across.atan2(along) }
    }
}

/// Arcsine for |y| < [`SMALL_SINE`], to the last bit or two: power series, evaluated in pairs.
#[inline(always)]
fn small_arcsine(y: f64) -> f64 {
    let y2 = y * y;
    let y4 = y2 * y2;
    let low = 1.0 / 6.0 + y2 * (3.0 / 40.0);
    let high = 15.0 / 336.0 + y2 * (105.0 / 3456.0) + y4 * (945.0 / 42240.0);
    y + y * y2 * (low + y4 * high)
}

/// Kinematics of an element: direction, stretch and strains.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Kinematics {
    pub direction: Direction,
    pub stretch: f64,
    /// Inverse length of the chord in 1/m.
    pub inverse_chord: f64,
    pub strain: Strain,
}

/// Computes the strains of an element between two nodes. `reference` is its direction at the last step, for continuity.
#[inline(always)]
pub(super) fn kinematics(element: &Element, from: &Node, to: &Node, reference: &Direction) -> Kinematics {
    let (dx, dz) = (to[0] - from[0], to[1] - from[1]);
    // Two nodes that coincide have no direction: a millionth of the rest length keeps the division finite.
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

/// Contributions of history and strain rate to an element's stresses within one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Memory {
    /// Kelvin-Voigt damping: stress per stiffness and per present strain.
    pub stiffening: f64,
    /// Stress per stiffness that the past fixes: the history part of damping, and relaxation by creep.
    pub shift: Strain,
}

/// Potential of an element in J, with derivatives by the chord d = (x, z), the mean angle t and the curvature.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Response {
    pub energy: f64,
    /// Derivative by the chord in N: the reversed force of the element on the later node.
    pub force: [f64; 2],
    /// Derivative by the mean angle in N m.
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

/// Evaluates potential and derivatives of an element at the kinematics `at`.
#[inline(always)]
pub(super) fn respond(element: &Element, mix: AxialMix, memory: &Memory, at: &Kinematics) -> Response {
    let [ea, ga, ei] = element.stiffness;
    let [strain, shear, curvature] = at.strain;
    let (h, inverse_chord) = (element.length, at.inverse_chord);
    let Direction { cos: c, sin: s, .. } = at.direction;
    let Memory { stiffening, shift } = *memory;
    let full = 1.0 + stiffening;

    // Energies per rest length. The strain-rate part and the history shift are quadratic and linear in the strain.
    let axial = material::axial(mix, ea, at.stretch, h * inverse_chord);
    let in_tension = ea * strain * (0.5 * stiffening * strain + shift[0]);
    let in_shear = ga * shear * (0.5 * full * shear + shift[1]);
    let in_bending = ei * curvature * (0.5 * full * curvature + shift[2]);
    let energy = h * (axial.energy + in_tension + in_shear + in_bending);

    let tension = axial.force + ea * (stiffening * strain + shift[0]);
    let shear_moment = h * ga * (full * shear + shift[1]);
    let bending_moment = ei * (full * curvature + shift[2]);
    let across = shear_moment * inverse_chord;

    // Second derivatives in the chord's frame, tangential (t) and normal (n), before they are turned to x and z.
    let angle = h * ga * full;
    let tt = (axial.stiffness + stiffening * ea) * element.inverse_length;
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
        bending: ei * full * element.inverse_length,
    }
}
