//! Friction between the strands of a cable: a moment in addition to the elastic one.
//!
//! Sticking strands bend as one solid: the cable is stiffer. At a moment they slip, and the moment stays there. Small
//! motions therefore meet the stiff cable; large ones meet the soft cable and lose energy. Several layers of strands
//! slip one after the other.
//!
//! The law has a stiffness, the moment at which all strands slip, and the spread of the curvatures at which they slip.
//!
//! Source: the elastic, perfectly plastic element of Jenkins, and several in parallel (Iwan 1966, "A distributed-element
//! model for hysteresis"); for cables Papailiou 1997, "On the bending stiffness of transmission line conductors".

use super::element::Response;
use super::mesh::Element;
use super::parameters::BeamParameters;

/// Layers of strands, of which the last one acts alone if all strands slip at once.
pub(super) const LAYERS: usize = 5;

/// Curvatures in 1/m, less the rest curvature, at which the friction of each layer is zero.
pub(super) type Neutral = [f64; LAYERS];

/// Layer of strands.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Layer {
    /// Bending stiffness in N m^2 that sticking adds.
    stiffness: f64,
    /// Moment in N m at which the layer slips.
    moment: f64,
}

impl Layer {
    /// Returns the moment in N m at a curvature in 1/m. It is zero at the curvature `neutral`.
    #[inline(always)]
    fn moment_at(&self, curvature: f64, neutral: f64) -> f64 {
        (self.stiffness * (curvature - neutral)).clamp(-self.moment, self.moment)
    }
}

/// Strand friction of one beam, uniform along its length.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct StrandFriction {
    layers: [Layer; LAYERS],
    /// Number of the layers that act, the last ones.
    acting: usize,
}

impl StrandFriction {
    /// Returns the friction of a beam.
    pub fn of(p: &BeamParameters) -> Self {
        let acting = match p.sticking_stiffness_n_m2 > 0.0 {
            false => 0,
            // Layers that slip together are one.
            true if p.slip_spread_ratio == 1.0 => 1,
            true => LAYERS,
        };
        Self { layers: layers(p), acting }
    }

    /// Returns true if there is any friction.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        self.acting > 0
    }

    /// Layers that act, each with its curvature of zero friction.
    #[inline(always)]
    fn acting<'a>(&'a self, neutral: &'a Neutral) -> impl Iterator<Item = (&'a Layer, f64)> {
        let from = LAYERS - self.acting;
        self.layers[from..].iter().zip(neutral[from..].iter().copied())
    }

    /// Returns the moment in N m at a curvature in 1/m.
    #[cfg(test)]
    pub fn moment_at(&self, curvature: f64, neutral: &Neutral) -> f64 {
        self.acting(neutral).map(|(layer, neutral)| layer.moment_at(curvature, neutral)).sum()
    }

    /// Returns the power in W/m that slip takes if the curvatures of zero friction move from `before` to `neutral`.
    #[cfg(test)]
    pub fn slipped(&self, curvature: f64, before: &Neutral, neutral: &Neutral) -> f64 {
        let moved = self.acting(neutral).zip(self.acting(before));
        moved.map(|((layer, to), (_, from))| layer.moment_at(curvature, to) * (to - from)).sum()
    }

    /// Returns the stored energy in J/m of sticking strands. Energy lost in slip is not in it.
    pub fn stored(&self, curvature: f64, neutral: &Neutral) -> f64 {
        let of_layer = |(layer, neutral): (&Layer, f64)| {
            let moment = layer.moment_at(curvature, neutral);
            0.5 * moment * moment / layer.stiffness
        };
        self.acting(neutral).map(of_layer).sum()
    }

    /// Adds strand friction to the response of an element of curvature `curvature` in 1/m.
    #[inline(always)]
    pub fn add(&self, element: &Element, curvature: f64, neutral: &Neutral, response: &mut Response) {
        for (layer, neutral) in self.acting(neutral) {
            let moment = layer.moment_at(curvature, neutral);
            // Within a step the energy is that of a spring that yields, so that its derivative is the moment.
            let slips = moment.abs() >= layer.moment;
            let energy = (moment * (curvature - neutral)) - 0.5 * moment * moment / layer.stiffness;
            response.energy += element.length * energy;
            response.bending_moment += moment;
            response.bending += if slips { 0.0 } else { layer.stiffness * element.inverse_length };
        }
    }

    /// Moves the curvatures of zero moment by the slip that `curvature` causes.
    #[inline(always)]
    pub fn slip(&self, curvature: f64, neutral: &mut Neutral) {
        let from = LAYERS - self.acting;
        for (layer, neutral) in self.layers[from..].iter().zip(&mut neutral[from..]) {
            *neutral = curvature - layer.moment_at(curvature, *neutral) / layer.stiffness;
        }
    }
}

/// Returns the layers: equal stiffness, and curvatures of slip at equal ratios from one to the next. Their stiffness and moment
/// add up to those of the cable. Without a spread each one is the whole law.
fn layers(p: &BeamParameters) -> [Layer; LAYERS] {
    let whole = Layer { stiffness: p.sticking_stiffness_n_m2, moment: p.slip_moment_n_m };
    if p.slip_spread_ratio == 1.0 {
        return [whole; LAYERS];
    }
    let relative = |layer: usize| p.slip_spread_ratio.powf(layer as f64 / (LAYERS - 1) as f64);
    let sum: f64 = (0..LAYERS).map(relative).sum();
    std::array::from_fn(|layer| Layer {
        stiffness: whole.stiffness / LAYERS as f64,
        moment: whole.moment * relative(layer) / sum,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::model::Section;

    fn spread(slip_spread_ratio: f64) -> StrandFriction {
        let bar = BeamParameters::from_youngs_modulus(0.4, Section::Round { diameter_m: 0.02 }, 1000.0, 1e7, 0.45);
        let strands = BeamParameters { sticking_stiffness_n_m2: 2.0, slip_moment_n_m: 0.1, ..bar };
        StrandFriction::of(&BeamParameters { slip_spread_ratio, ..strands })
    }

    /// Small motions meet the whole sticking stiffness, and large ones the whole slip moment, whatever the spread.
    #[test]
    fn a_spread_of_the_slip_keeps_the_ends_of_the_law_and_rounds_its_corner() {
        let moment = |ratio: f64, curvature: f64| spread(ratio).moment_at(curvature, &[0.0; LAYERS]);
        assert!((moment(30.0, 1e-4) - 2e-4).abs() < 1e-15 && (moment(30.0, 5.0) - 0.1).abs() < 1e-15);
        // All strands slip at a curvature of 0.05 without a spread.
        assert_eq!(moment(1.0, 0.05), 0.1);
        let at_corner: Vec<f64> = [1.001, 3.0, 30.0, 300.0].map(|ratio| moment(ratio, 0.05)).into();
        assert!(at_corner.windows(2).all(|pair| pair[1] < pair[0]) && at_corner[0] > 0.0999, "{at_corner:?}");
        let (first, last) = (spread(30.0).layers[0], spread(30.0).layers[LAYERS - 1]);
        assert!((last.moment / last.stiffness / (first.moment / first.stiffness) - 30.0).abs() < 1e-9);
    }

    fn at_once() -> StrandFriction {
        spread(1.0)
    }

    #[test]
    fn a_beam_without_sticking_stiffness_has_no_friction() {
        assert!(!StrandFriction::default().acts() && at_once().acts() && spread(30.0).acts());
    }

    #[test]
    fn a_cycle_encloses_the_energy_of_the_slip() {
        let friction = at_once();
        let (mut neutral, mut lost, mut last) = ([0.0; LAYERS], 0.0, 0.0);
        let amplitude = 0.5;
        // Only the second cycle counts: the first begins in the middle of the loop.
        for i in 0..8000 {
            let curvature = amplitude * (std::f64::consts::TAU * f64::from(i) / 4000.0).sin();
            let moment = friction.moment_at(curvature, &neutral);
            lost += if i >= 4000 { moment * (curvature - last) } else { 0.0 };
            friction.slip(curvature, &mut neutral);
            last = curvature;
        }
        let slip = 2.0 * (amplitude - 0.1 / 2.0);
        let expected = 2.0 * 0.1 * slip;
        assert!((lost - expected).abs() < 2e-3 * expected, "{lost} against {expected}");
    }

    #[test]
    fn the_moment_is_the_derivative_of_the_energy() {
        let element = Element { length: 1.0, inverse_length: 1.0, ..Element::default() };
        for friction in [at_once(), spread(30.0)] {
            let response = |curvature: f64| {
                let mut r = Response::default();
                friction.add(&element, curvature, &[0.3; LAYERS], &mut r);
                r
            };
            for curvature in [-0.2, 0.28, 0.3, 0.33, 0.9] {
                let step = 1e-6;
                let slope = (response(curvature + step).energy - response(curvature - step).energy) / (2.0 * step);
                assert!((slope - response(curvature).bending_moment).abs() < 1e-7, "{slope} at {curvature}");
            }
        }
    }

    /// Masing's rule: the branch after a reversal is the virgin curve at twice the scale.
    #[test]
    fn a_reversal_follows_the_virgin_curve_at_twice_the_scale() {
        for friction in [at_once(), spread(30.0)] {
            reverses(&friction);
        }
    }

    fn reverses(friction: &StrandFriction) {
        let virgin = |curvature: f64| friction.moment_at(curvature, &[0.0; LAYERS]);
        let (most, mut neutral) = (3.0, [0.0; LAYERS]);
        friction.slip(most, &mut neutral);
        for back in [0.01, 0.3, 1.0, 4.0, 6.0] {
            let expected = virgin(most) - 2.0 * virgin(0.5 * back);
            let got = friction.moment_at(most - back, &neutral);
            assert!((got - expected).abs() < 1e-12, "{back}: {got}, not {expected}");
        }
    }
}
