//! Loss of the ordered tracker: distance of each keypoint from its true place, in masks with covers.

use super::grid::{CELLS, KEYPOINTS, SIDE};
use super::heat::{Heat, bell};
use super::view::{Change, Cover, ObjectView, Rollout, fill};
use convnet::{Net, Pass};
use rand::{Rng, RngExt};

/// Fractions of the length at which the shipped keypoints lie.
pub(super) const FRACTIONS: [f64; KEYPOINTS] = [0.125, 0.375, 0.625, 0.875];
/// Width of the heat that the network learns, from -1 to 1 over the view: about a cell.
pub(super) const HEAT_WIDTH: f32 = 0.14;
/// Farthest coordinate of a keypoint that the network learns. Heat maps have no cell beyond 0.94.
pub(super) const EDGE: f32 = 0.9;
/// Weight of the squared distance beside the cross entropy of the heat.
const DISTANCE: f32 = 40.0;
/// Largest shift in pixels and turn in rad of a view. Shifts do not matter in a square around the object.
const SHIFT_PX: f64 = 4.0;
const TURN_RAD: f64 = 0.5;
/// Largest growth of the object's mask in pixels: masks of real segmentations are up to a pixel larger than the object on each side.
const MOST_GROWN_PX: f64 = 1.2;
/// Part of the length at each end that a cover along the line leaves to be seen.
const END_SEEN: f64 = 0.03;
/// Share of the views with a cover over an end, for each end.
const END_COVERED: f64 = 0.04;

/// Mask and the true places of its keypoints, from -1 to 1.
#[derive(Debug, Clone)]
pub(super) struct Labelled {
    pub(super) coverage: Vec<f32>,
    places: [[f32; 2]; KEYPOINTS],
}

impl Labelled {
    /// Draws a view of the rollouts, with covers.
    pub(super) fn draw(rollouts: &[Rollout], rng: &mut impl Rng) -> Self {
        loop {
            let rollout = &rollouts[rng.random_range(0..rollouts.len())];
            let view = &rollout[rng.random_range(0..rollout.len())];
            let view = view.changed(&Change::draw(view, SHIFT_PX, TURN_RAD, rng));
            let covers = covers(&view, rng);
            let Some(square) = view.square(&covers) else { continue };
            let places = FRACTIONS.map(|f| square.scaled(view.at(f)));
            // Nobody can tell where an object ends of which most is hidden.
            if places.iter().flatten().any(|c| c.abs() > EDGE) {
                continue;
            }
            let mut coverage = view.grown(rng.random_range(0.0..MOST_GROWN_PX)).coverage(&square, SIDE, &covers);
            roughen(&mut coverage, rng);
            return Self { coverage, places };
        }
    }

    /// Returns the loss of the network's heat for this mask, and adds its gradient.
    pub(super) fn judge(&self, net: &Net, weights: &[f32], pass: &mut Pass, gradient: &mut [f32]) -> f64 {
        fill(net.shape(0), pass.input(), &self.coverage);
        pass.run(net, weights);
        let shape = net.output();
        let (output, pull) = pass.result(net);
        pull.fill(0.0);
        let mut loss = 0.0;
        for (k, place) in self.places.iter().enumerate() {
            let heat = Heat::of(shape, output, k);
            let aim = bell(*place, HEAT_WIDTH);
            let sum: f32 = aim.iter().sum::<f32>().max(1e-6);
            for y in 0..CELLS {
                for (x, to) in pull[shape.row(k, y)].iter_mut().enumerate() {
                    let (p, t) = (heat.cells[y * CELLS + x], aim[y * CELLS + x] / sum);
                    loss -= t * p.max(1e-9).ln();
                    *to += p - t;
                }
            }
            let off = [0, 1].map(|i| heat.mean[i] - place[i]);
            loss += DISTANCE * (off[0] * off[0] + off[1] * off[1]);
            heat.pull(shape, off.map(|o| 2.0 * DISTANCE * o), k, pull);
        }
        pass.pull_back(net, weights, gradient);
        f64::from(loss)
    }
}

/// Covers of a view: none, one or some, along the line, and seldom one over an end. Object and cover both end straight, so that nobody can tell a
/// covered end from the end of the object, and the keypoints of whole objects would pay for many covered ends.
fn covers(view: &ObjectView, rng: &mut impl Rng) -> Vec<Cover> {
    let number = [0, 0, 1, 1, 2, 3][rng.random_range(0..6)];
    let mut covers = Vec::with_capacity(number + 2);
    for _ in 0..number {
        let share = rng.random_range(0.02..0.2);
        let least = 0.5 * share + END_SEEN;
        covers.push(Cover::across(view, rng.random_range(least..1.0 - least), share));
    }
    for end in [0.0, 1.0] {
        if rng.random_bool(END_COVERED) {
            covers.push(Cover::across(view, end, rng.random_range(0.0..0.16)));
        }
    }
    covers
}

/// Adds the errors of a segmentation: rough borders and specks.
fn roughen(coverage: &mut [f32], rng: &mut impl Rng) {
    let rough = rng.random_range(0.0..0.25_f32);
    for c in coverage.iter_mut().filter(|c| **c > 0.0) {
        *c = (*c + rng.random_range(-rough..=rough)).clamp(0.0, 1.0);
    }
    if rng.random_bool(0.15) {
        let (u, v, side) = (rng.random_range(0..SIDE - 3), rng.random_range(0..SIDE - 3), rng.random_range(1..4));
        for y in v..v + side {
            coverage[y * SIDE + u..y * SIDE + u + side].fill(1.0);
        }
    }
}
