//! Small transverse vibrations of a straight, clamped beam, weightless or hanging: frequencies and mode shapes of the
//! differential equations, without nodes or elements.

use super::runge_kutta;
use crate::beam::BeamParameters;

/// Number of integration steps along the beam.
const STEPS: usize = 800;
/// Ratio of successive frequencies in the search for roots. Any two modes are farther apart.
const SCAN_RATIO: f64 = 1.05;
const BISECTIONS: usize = 40;

/// Deflection across the beam, and turn of the section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deflection {
    /// Deflection as a share of the largest.
    pub across: f64,
    /// Turn in rad at a largest deflection of 1 m.
    pub turn_per_m: f64,
}

/// Mode of vibration.
#[derive(Debug, Clone)]
pub(super) struct Mode {
    /// Angular frequency in rad/s.
    pub frequency_rad_s: f64,
    /// Deflections at equal distances from the clamp to the tip.
    shape: Vec<Deflection>,
}

impl Mode {
    /// Returns the deflection at the computed place nearest to a share of the rest length.
    pub fn at(&self, share: f64) -> Deflection {
        self.shape[(share * (self.shape.len() - 1) as f64).round() as usize]
    }

    /// Bends straight, equally spaced nodes (x and z in m, angle in rad) into the mode's shape, by at most
    /// `amplitude_m`.
    pub fn bend(&self, nodes: &[[f64; 3]], amplitude_m: f64) -> Vec<[f64; 3]> {
        let (sin, cos) = nodes[0][2].sin_cos();
        let last = (nodes.len() - 1) as f64;
        let bent = |(k, [x, z, angle]): (usize, &[f64; 3])| {
            let by = self.at(k as f64 / last);
            let across_m = amplitude_m * by.across;
            [x - across_m * sin, z + across_m * cos, angle + amplitude_m * by.turn_per_m]
        };
        nodes.iter().enumerate().map(bent).collect()
    }
}

/// Deflection y, section angle t, moment m and cross force f, in units of the length, 1, EI / length and EI / length^2.
type State = [f64; 4];
const Y: usize = 0;
const T: usize = 1;
const M: usize = 2;
const F: usize = 3;

/// Equations of small harmonic motion about the stretched, straight shape, at rest place s, with the linear axial law.
///
/// Let n(s) be the tension of the weight below, u = 1 + n / EA the stretch and phi = u (f - n t) / (GA + u n) the shear
/// angle. Then y' = u (t + phi), t' = m / EI, m' = -GA phi - rho I w^2 t and f' = -rho A w^2 y. Without weight this is
/// Timoshenko's beam with rotary inertia.
struct Equations<'a> {
    beam: &'a BeamParameters,
    /// Gravity along the beam towards the tip in m/s^2.
    gravity_m_s2: f64,
    frequency_rad_s: f64,
}

/// Two solutions that satisfy the clamp's conditions, at equal distances along the beam.
struct Clamped {
    /// Orthonormal basis of the solutions' values at each place.
    bases: Vec<[State; 2]>,
    /// Transformation from a basis, integrated by one step, to the next basis: dot products (0, 0), (0, 1), (1, 1).
    turns: Vec<[f64; 3]>,
}

impl Equations<'_> {
    /// Derivative by s / length.
    fn slope(&self, share: f64, [y, t, m, f]: &State) -> State {
        let p = self.beam;
        let (length_2, bending) = (p.length_m * p.length_m, p.bending_stiffness_n_m2);
        let frequency_2 = self.frequency_rad_s * self.frequency_rad_s;
        let unit_n = bending / length_2;
        let tension = p.mass_per_length_kg_m * self.gravity_m_s2 * p.length_m * (1.0 - share);
        let stretch = 1.0 + tension / p.axial_stiffness_n;
        let shear = stretch * (f * unit_n - tension * t) / (p.shear_stiffness_n + stretch * tension);
        let [rotary, inertia] = [p.rotary_inertia_per_length_kg_m, p.mass_per_length_kg_m].map(|m| m * frequency_2);
        [
            stretch * (t + shear),
            *m,
            -(p.shear_stiffness_n * shear + rotary * t) / unit_n,
            -inertia * length_2 * length_2 / bending * y,
        ]
    }

    /// Integrates two solutions from the clamp to the tip, orthonormalised after each step (Godunov 1961).
    fn solve(&self) -> Clamped {
        // Without orthonormalisation both solutions grow into the direction of fastest growth and become parallel.
        let h = 1.0 / STEPS as f64;
        let mut basis = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let mut solved = Clamped { bases: vec![basis], turns: Vec::with_capacity(STEPS) };
        for k in 0..STEPS {
            let [a, b] = basis.map(|y| runge_kutta::step(k as f64 * h, h, &y, |s, y| self.slope(s, y)));
            let aa = dot(&a, &a).sqrt();
            let a = a.map(|v| v / aa);
            let ab = dot(&a, &b);
            let b: State = std::array::from_fn(|i| b[i] - ab * a[i]);
            let bb = dot(&b, &b).sqrt();
            basis = [a, b.map(|v| v / bb)];
            solved.bases.push(basis);
            solved.turns.push([aa, ab, bb]);
        }
        solved
    }
}

impl Clamped {
    /// Returns a determinant that is zero if some combination of the solutions leaves the tip free of moment and force.
    fn free_tip(&self) -> f64 {
        let [a, b] = &self.bases[STEPS];
        a[M] * b[F] - a[F] * b[M]
    }

    /// Returns the combination that leaves the tip free, scaled to a largest deflection of one, for a beam of
    /// `length_m`.
    fn shape(&self, length_m: f64) -> Vec<Deflection> {
        let [a, b] = &self.bases[STEPS];
        // Either condition gives the weights; the larger one is far from 0 / 0.
        let by_moment = a[M].hypot(b[M]) > a[F].hypot(b[F]);
        let mut weights = if by_moment { [b[M], -a[M]] } else { [b[F], -a[F]] };
        let mut shape = Vec::with_capacity(STEPS + 1);
        for k in (0..=STEPS).rev() {
            let [a, b] = &self.bases[k];
            shape.push([Y, T].map(|i| weights[0] * a[i] + weights[1] * b[i]));
            if k > 0 {
                let [aa, ab, bb] = self.turns[k - 1];
                let second = weights[1] / bb;
                weights = [(weights[0] - ab * second) / aa, second];
            }
        }
        shape.reverse();
        let largest = shape.iter().fold(0.0, |largest: f64, s| if s[Y].abs() > largest.abs() { s[Y] } else { largest });
        shape.iter().map(|s| Deflection { across: s[Y] / largest, turn_per_m: s[T] / (largest * length_m) }).collect()
    }
}

fn dot(a: &State, b: &State) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the first `COUNT` modes of a beam clamped at its rear end, with gravity in m/s^2 along the beam towards the
/// tip. None if they do not lie within the frequencies searched.
pub(super) fn modes<const COUNT: usize>(beam: &BeamParameters, gravity_m_s2: f64) -> Option<[Mode; COUNT]> {
    let length_2 = beam.length_m * beam.length_m;
    let bending_rad_s = (beam.bending_stiffness_n_m2 / beam.mass_per_length_kg_m).sqrt() / length_2;
    let first_guess_rad_s = 3.5 * bending_rad_s + (gravity_m_s2 / beam.length_m).sqrt();
    let solve = |frequency_rad_s: f64| Equations { beam, gravity_m_s2, frequency_rad_s }.solve();
    let mut low = 0.3 * first_guess_rad_s;
    let mut at_low = solve(low).free_tip();
    let mut found = Vec::with_capacity(COUNT);
    while found.len() < COUNT && low < 100.0 * first_guess_rad_s {
        let high = SCAN_RATIO * low;
        let at_high = solve(high).free_tip();
        if at_low * at_high < 0.0 {
            let frequency_rad_s = bisect([low, high], |w| solve(w).free_tip() * at_low > 0.0);
            found.push(Mode { frequency_rad_s, shape: solve(frequency_rad_s).shape(beam.length_m) });
        }
        (low, at_low) = (high, at_high);
    }
    found.try_into().ok()
}

/// Returns the place up to which `below` holds.
fn bisect([mut low, mut high]: [f64; 2], below: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if below(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::super::specimen::bar;
    use super::*;

    fn without_shear(p: BeamParameters) -> BeamParameters {
        BeamParameters { shear_stiffness_n: 1e7, rotary_inertia_per_length_kg_m: 1e-12, ..p }
    }

    #[test]
    fn a_slender_beam_has_the_frequencies_of_euler_and_bernoulli() {
        let p = without_shear(bar(0.2, 1e4));
        let unit = (p.bending_stiffness_n_m2 / p.mass_per_length_kg_m).sqrt() / 0.04;
        let modes = modes::<3>(&p, 0.0).unwrap();
        for (mode, known) in modes.iter().zip([3.516_015, 22.034_492, 61.697_214]) {
            let got = mode.frequency_rad_s / unit;
            assert!((got / known - 1.0).abs() < 1e-5, "{got}, not {known}");
        }
        let [_, second, _] = modes;
        let (wave, skew) = (4.694_091, 1.018_467);
        for share in [0.1, 0.25, 0.5, 0.75, 0.9, 1.0] {
            let x: f64 = wave * share;
            let known = 0.5 * (x.cosh() - x.cos() - skew * (x.sinh() - x.sin()));
            assert!((second.at(share).across.abs() - known.abs()).abs() < 1e-3, "{:?} at {share}", second.at(share));
        }
    }

    #[test]
    fn a_limp_beam_swings_as_a_hanging_chain() {
        let p =
            BeamParameters { bending_stiffness_n_m2: 1e-7, axial_stiffness_n: 1e6, ..without_shear(bar(0.25, 1e4)) };
        let unit = (9.81_f64 / 0.25).sqrt();
        // A hanging chain has half the zeros of the Bessel function J0 as frequencies. The clamp adds a boundary layer:
        // it holds a piece of length sqrt(EI / weight) straight.
        let held = 1.0 + 0.5 * (1e-7 / (p.mass_per_length_kg_m * 0.25 * 9.81)).sqrt() / 0.25;
        for (mode, zero) in modes::<2>(&p, 9.81).unwrap().iter().zip([2.404_826, 5.520_078]) {
            let got = mode.frequency_rad_s / unit;
            assert!((got / (0.5 * zero * held) - 1.0).abs() < 2e-3, "{got}, not {}", 0.5 * zero * held);
        }
    }
}
