//! Derivatives of any simulator by differences between its own tracks.

use crate::data::Unknowns;
use catenary_core::simulator::{FrameDerivative, SimulatorError, TrackSensitivities, Until};
use catenary_core::{DifferentiableSimulator, Frame, KeypointOrder, Prior, SimulationRequest, Simulator, Track};

/// Step of a difference in a unit coordinate. The relative error of the derivative is about the square of the step, 1e-6; at
/// an end of the prior, where the difference is one-sided, about 1e-3.
const STEP: f64 = 1e-3;

/// Simulator whose derivatives are central differences between tracks of the simulator inside. It serves simulators
/// that have no derivatives of their own, such as pools behind a service.
pub struct Differences<'a> {
    simulator: &'a dyn Simulator,
    /// Name and prior of each unknown; those of theta come first, in order.
    priors: Vec<(String, Prior)>,
}

/// Place of a parameter in a request.
enum Place {
    Theta(usize),
    Effect(usize),
}

impl<'a> Differences<'a> {
    /// Differences of `simulator` by these unknowns. The steps are shares of the priors' widths.
    pub fn new(simulator: &'a dyn Simulator, unknowns: &Unknowns) -> Self {
        Self { simulator, priors: unknowns.list().iter().map(|u| (u.name.clone(), u.prior.clone())).collect() }
    }

    /// Place of the parameter in the request, with its prior.
    fn find(&self, request: &SimulationRequest, name: &str) -> Result<(Place, &Prior), SimulatorError> {
        let unknown = || SimulatorError::Input(format!("derivative by `{name}`: expected an unknown of the fit"));
        let at = self.priors.iter().position(|(own, _)| own == name).ok_or_else(unknown)?;
        let thetas = request.thetas.first().map_or(0, Vec::len);
        let effect = || request.effects.iter().position(|(own, _)| own == name).map(Place::Effect);
        let place = if at < thetas { Some(Place::Theta(at)) } else { effect() };
        Ok((place.ok_or_else(unknown)?, &self.priors[at].1))
    }
}

impl Simulator for Differences<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.simulator.simulate(request)
    }

    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        self.simulator.simulate_until(request, until)
    }

    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        self.simulator.range_of(name)
    }
}

impl DifferentiableSimulator for Differences<'_> {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let places = names.iter().map(|name| self.find(request, name)).collect::<Result<Vec<_>, _>>()?;
        let count = request.thetas.len();
        // Each episode is followed by a lower and an upper copy for each parameter, all in one batch for all workers.
        let copies = 1 + 2 * names.len();
        let mut all = SimulationRequest {
            thetas: request.thetas.iter().flat_map(|t| std::iter::repeat_n(t.clone(), copies)).collect(),
            effects: request
                .effects
                .iter()
                .map(|(name, v)| (name.clone(), v.iter().flat_map(|x| std::iter::repeat_n(*x, copies)).collect()))
                .collect(),
            ..request.clone()
        };
        let mut spans = vec![Vec::with_capacity(names.len()); count];
        for (episode, spans) in spans.iter_mut().enumerate() {
            for (p, (place, prior)) in places.iter().enumerate() {
                let first = episode * copies + 1 + 2 * p;
                let own = match place {
                    Place::Theta(i) => request.thetas[episode][*i],
                    Place::Effect(i) => request.effects[*i].1[episode],
                };
                let u = prior.to_unit(own);
                // At an end of the prior the difference is one-sided: beyond it nothing may be simulated.
                let ends = [u - STEP, u + STEP].map(|u| prior.from_unit(u.clamp(0.0, 1.0)));
                for (side, end) in ends.into_iter().enumerate() {
                    match place {
                        Place::Theta(i) => all.thetas[first + side][*i] = end,
                        Place::Effect(i) => all.effects[*i].1[first + side] = end,
                    }
                }
                spans.push(ends[1] - ends[0]);
            }
        }
        let tracks = self.simulator.simulate(&all)?;
        if tracks.len() != count * copies {
            let expected = count * copies;
            return Err(SimulatorError::Backend(format!("expected {expected} tracks, got {}", tracks.len())));
        }
        let of = |(set, spans): (&[Track], Vec<f64>)| {
            let (track, pairs) = (set[0].clone(), set[1..].chunks(2));
            let derivatives = pairs.zip(&spans).map(|(pair, span)| derivative(&track, pair, *span)).collect();
            TrackSensitivities { derivatives, changes: spans, track }
        };
        Ok(tracks.chunks(copies).zip(spans).map(of).collect())
    }
}

/// Derivative of each frame of `track` from a lower and an upper track that are `span` apart in a parameter.
fn derivative(track: &Track, pair: &[Track], span: f64) -> Vec<FrameDerivative> {
    let of = |(i, frame): (usize, &Frame)| {
        // A track that ends earlier than the others says nothing about later frames.
        let (Some(low), Some(high)) = (pair[0].frames.get(i), pair[1].frames.get(i)) else {
            return FrameDerivative::default();
        };
        // An observation may sort its keypoints by their place in the image, where two of them may change places.
        let matched = |other: &Frame| KeypointOrder::Unknown.closest(&other.dlo, &frame.dlo).map(|k| other.dlo[k]);
        let (below, above) = (matched(low), matched(high));
        FrameDerivative {
            dlo: std::array::from_fn(|k| std::array::from_fn(|i| (above[k][i] - below[k][i]) / span)),
            target: std::array::from_fn(|i| (high.target[i] - low.target[i]) / span),
            eef: std::array::from_fn(|i| (high.eef[i] - low.eef[i]) / span),
            wrench: low
                .wrench
                .zip(high.wrench)
                .map_or([0.0; 3], |(low, high)| std::array::from_fn(|i| (high[i] - low[i]) / span)),
        }
    };
    track.frames.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};

    #[test]
    fn differences_of_a_linear_simulator_are_its_derivatives_also_at_the_ends_of_priors() {
        let toy = Toy { gain: 0.3 };
        let unknowns = Unknowns::of(&toy::model(), 1);
        let differences = Differences::new(&toy, &unknowns);
        let names = ["length_m", "youngs_modulus_pa"];
        let (_, longest) = unknowns.list()[0].prior.bounds();
        let (softest, _) = unknowns.list()[1].prior.bounds();
        let template = toy::episode(&toy, [0.25, 2e4], &[]).template;
        let request = SimulationRequest { thetas: vec![vec![0.25, 2e4], vec![longest, softest]], ..template };
        let (found, expected) =
            (differences.sensitivities(&request, &names).unwrap(), toy.sensitivities(&request, &names).unwrap());
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found.track, expected.track);
            for (a, b) in found.derivatives.iter().flatten().zip(expected.derivatives.iter().flatten()) {
                for (a, b) in a.dlo.iter().flatten().zip(b.dlo.iter().flatten()) {
                    assert!((a - b).abs() < 1e-6 * b.abs().max(1e-3), "{a} {b}");
                }
            }
        }
        let unknown = differences.sensitivities(&request, &["tip_mass_kg"]).unwrap_err().to_string();
        assert!(unknown.contains("`tip_mass_kg`"), "{unknown}");
    }
}
