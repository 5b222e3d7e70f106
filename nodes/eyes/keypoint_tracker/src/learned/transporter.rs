//! Loss of Transporter (Kulkarni et al. 2019), in the form of v-cdn (Li et al. 2020): a mask is drawn again from the features of
//! another mask of the episode, in which only the surroundings of the keypoints are exchanged.

use super::grid::{CELLS, KEYPOINTS, SIDE};
use super::heat::{Heat, bell};
use super::network::{NetworkKind, decoder_network, feature_network};
use super::square::Square;
use super::view::{Change, Rollout, fill};
use convnet::{Net, Pass};
use rand::{Rng, RngExt};
use std::ops::Range;

/// Width of the bell around a keypoint, from -1 to 1 over the view.
const BELL: f32 = 0.1;
/// Weight of the mean square error of a pixel.
const PIXEL: f32 = 100.0;
/// Largest shift in pixels and turn in rad that both masks of a pair share.
const SHIFT_PX: f64 = 16.0;
const TURN_RAD: f64 = 0.3;
/// Side of the masks of which the views are.
const MASK_PX: f64 = 256.0;

/// Two masks of an episode.
#[derive(Debug, Clone)]
pub(super) struct Pair([Vec<f32>; 2]);

impl Pair {
    /// Draws two views of a rollout.
    pub(super) fn draw(rollouts: &[Rollout], rng: &mut impl Rng) -> Self {
        let rollout = &rollouts[rng.random_range(0..rollouts.len())];
        let first = &rollout[rng.random_range(0..rollout.len())];
        let change = Change::draw(first, SHIFT_PX, TURN_RAD, rng);
        let square = Square { corner: [0.0; 2], side: MASK_PX };
        let mut mask = || {
            let view = &rollout[rng.random_range(0..rollout.len())];
            view.changed(&change).coverage(&square, SIDE, &[])
        };
        Self([mask(), mask()])
    }
}

/// The three networks, with the places of their weights.
#[derive(Debug)]
pub(super) struct Nets {
    heat: Net,
    features: Net,
    decoder: Net,
}

/// Values and gradients of the networks for one pair.
#[derive(Debug, Clone)]
pub(super) struct Passes {
    heat: [Pass; 2],
    features: [Pass; 2],
    decoder: Pass,
}

impl Nets {
    pub(super) fn new() -> Self {
        let features = feature_network();
        let decoder = decoder_network(features.output());
        Self { heat: NetworkKind::Transporter.heat_network(), features, decoder }
    }

    pub(super) fn passes(&self) -> Passes {
        let two = |net: &Net| [Pass::new(net), Pass::new(net)];
        Passes { heat: two(&self.heat), features: two(&self.features), decoder: Pass::new(&self.decoder) }
    }

    /// Weights of all networks before training, those of the heat network first.
    pub(super) fn initial(&self, rng: &mut impl Rng) -> Vec<f32> {
        [&self.heat, &self.features, &self.decoder].into_iter().flat_map(|net| net.initial(rng)).collect()
    }

    fn places(&self) -> [Range<usize>; 3] {
        let (a, b) = (self.heat.weights(), self.features.weights());
        [0..a, a..a + b, a + b..a + b + self.decoder.weights()]
    }

    /// Number of weights of the heat network, the first of all weights.
    pub(super) fn heat_weights(&self) -> usize {
        self.heat.weights()
    }

    /// Returns the loss of a pair, and adds its gradient.
    pub(super) fn judge(&self, pair: &Pair, weights: &[f32], p: &mut Passes, gradient: &mut [f32]) -> f64 {
        let [heat_place, feature_place, decoder_place] = self.places();
        let shape = self.heat.output();
        let features = self.features.output();
        let mut heats: Vec<[Heat; KEYPOINTS]> = Vec::with_capacity(2);
        for (i, mask) in pair.0.iter().enumerate() {
            fill(self.heat.shape(0), p.heat[i].input(), mask);
            p.heat[i].run(&self.heat, &weights[heat_place.clone()]);
            heats.push(Heat::all(shape, p.heat[i].output()));
            fill(self.features.shape(0), p.features[i].input(), mask);
            p.features[i].run(&self.features, &weights[feature_place.clone()]);
        }
        let bells: Vec<Vec<[f32; CELLS * CELLS]>> =
            heats.iter().map(|h| h.iter().map(|heat| bell(heat.mean, BELL)).collect()).collect();
        // Sum of the bells in the source and in the aim.
        let sums: Vec<[f32; CELLS * CELLS]> =
            bells.iter().map(|b| std::array::from_fn(|i| b.iter().map(|bell| bell[i]).sum())).collect();
        for c in 0..features.channels {
            for y in 0..CELLS {
                let row = features.row(c, y);
                for x in 0..CELLS {
                    let (i, at) = (y * CELLS + x, row.start + x);
                    let [source, aim] = [0, 1].map(|k: usize| p.features[k].output()[at]);
                    p.decoder.input()[at] = source * (1.0 - sums[0][i]) * (1.0 - sums[1][i]) + sums[1][i] * aim;
                }
            }
        }
        p.decoder.run(&self.decoder, &weights[decoder_place.clone()]);
        let mut loss = 0.0;
        let (output, pull) = p.decoder.result(&self.decoder);
        pull.fill(0.0);
        let picture = self.decoder.output();
        let share = PIXEL / (SIDE * SIDE) as f32;
        for (v, truth) in pair.0[1].chunks_exact(SIDE).enumerate() {
            let row = picture.row(0, v);
            for ((x, pull), t) in output[row.clone()].iter().zip(&mut pull[row]).zip(truth) {
                loss += share * (x - t) * (x - t);
                *pull = 2.0 * share * (x - t);
            }
        }
        let mixed =
            p.decoder.pull_back_to_input(&self.decoder, &weights[decoder_place.clone()], &mut gradient[decoder_place]);
        // Gradient by the sums of the bells.
        let mut by_sum = [[0.0_f32; CELLS * CELLS]; 2];
        let [source, aim] = &mut p.features;
        let (source, by_source) = source.result(&self.features);
        let (aim, by_aim) = aim.result(&self.features);
        for c in 0..features.channels {
            for y in 0..CELLS {
                let row = features.row(c, y);
                for x in 0..CELLS {
                    let (i, at) = (y * CELLS + x, row.start + x);
                    let g = mixed[at];
                    by_source[at] = g * (1.0 - sums[0][i]) * (1.0 - sums[1][i]);
                    by_aim[at] = g * sums[1][i];
                    by_sum[0][i] -= g * source[at] * (1.0 - sums[1][i]);
                    by_sum[1][i] += g * (aim[at] - source[at] * (1.0 - sums[0][i]));
                }
            }
        }
        for i in 0..2 {
            p.features[i].pull_back(
                &self.features,
                &weights[feature_place.clone()],
                &mut gradient[feature_place.clone()],
            );
            let (_, pull) = p.heat[i].result(&self.heat);
            pull.fill(0.0);
            for (k, heat) in heats[i].iter().enumerate() {
                heat.pull(shape, by_place(&bells[i][k], heat.mean, &by_sum[i]), k, pull);
            }
            p.heat[i].pull_back(&self.heat, &weights[heat_place.clone()], &mut gradient[heat_place.clone()]);
        }
        f64::from(loss)
    }
}

/// Gradient of a loss by the place of a bell, from its gradient by the bell's cells.
fn by_place(bell: &[f32; CELLS * CELLS], place: [f32; 2], by_cell: &[f32; CELLS * CELLS]) -> [f32; 2] {
    let mut sum = [0.0; 2];
    for (i, (b, g)) in bell.iter().zip(by_cell).enumerate() {
        let d = [super::grid::middle(i % CELLS) - place[0], super::grid::middle(i / CELLS) - place[1]];
        (0..2).for_each(|k| sum[k] += g * b * 2.0 * d[k] / (BELL * BELL));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learned::view::ObjectView;
    use catenary_core::seed;

    #[test]
    fn the_gradient_is_that_of_the_loss() {
        let nets = Nets::new();
        let mut rng = seed::rng(3, 0);
        let view = |bend: f64| ObjectView {
            line: (0..=30).map(|k| [120.0 + bend * f64::from(k * k), 60.0 + 4.0 * f64::from(k)]).collect(),
            half_width: 5.0,
        };
        let pair = Pair::draw(&[vec![view(0.0), view(0.04), view(-0.06)]], &mut rng);
        let mut weights = nets.initial(&mut rng);
        weights.iter_mut().for_each(|w| *w += rng.random_range(-0.05..0.05));
        let (mut passes, mut gradient) = (nets.passes(), vec![0.0; weights.len()]);
        nets.judge(&pair, &weights, &mut passes, &mut gradient);
        let places = nets.places();
        for place in places {
            let part = &gradient[place.clone()];
            let norm = part.iter().map(|g| g * g).sum::<f32>().sqrt();
            assert!(norm > 1e-3, "no gradient in {place:?}");
            for _ in 0..6 {
                let direction: Vec<f32> = part.iter().map(|g| g / norm + 0.05 * rng.random_range(-1.0..1.0)).collect();
                let mut at = |h: f32| {
                    let mut moved = weights.clone();
                    moved[place.clone()].iter_mut().zip(&direction).for_each(|(w, d)| *w += h * d);
                    nets.judge(&pair, &moved, &mut passes, &mut vec![0.0; weights.len()])
                };
                let h = 2e-3 / norm.max(1.0);
                let slope = (at(h) - at(-h)) / (2.0 * f64::from(h));
                let expected: f32 = part.iter().zip(&direction).map(|(g, d)| g * d).sum();
                let off = (slope - f64::from(expected)).abs();
                assert!(off < 0.05 * f64::from(norm), "{place:?}: {slope} {expected} of {norm}");
            }
        }
    }
}
