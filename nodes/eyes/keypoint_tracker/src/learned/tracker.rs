//! Tracker by a trained network.

use super::grid::SIDE;
use super::heat::Heat;
use super::network::{NetworkKind, Weights};
use super::ordered::{EDGE, FRACTIONS, HEAT_WIDTH};
use super::square::Square;
use crate::target::TargetFinder;
use crate::{Error, KeypointTracker, TrackerParams, check};
use catenary_core::image::label;
use catenary_core::{Keypoints, LabelMask};
use convnet::{Net, Pass, WeightsError};

/// Distance from the object in mask pixels at which a keypoint of Transporter has half of its score.
const OFF_OBJECT_PX: f64 = 4.0;

/// Tracker that reads keypoints from the heat maps of a network.
///
/// [`NetworkKind::Ordered`] sees a square around the object. Its keypoints lie at fixed fractions of the length, hidden parts between
/// the ends included, from the fingers on; the score is the concentration of the heat.
///
/// [`NetworkKind::Transporter`] sees the whole mask. Its keypoints lie where its training put them, in an order of their own that may change
/// between frames; the score falls with the distance from the object.
///
/// Keypoints depend on their mask alone, not on earlier masks.
#[derive(Debug, Clone)]
pub struct LearnedTracker {
    kind: NetworkKind,
    params: TrackerParams,
    net: Net,
    weights: Weights,
    pass: Pass,
    target: TargetFinder,
}

impl LearnedTracker {
    /// Builds a tracker. Of the parameters, areas and `min_score` count.
    ///
    /// # Errors
    /// [`Error::Parameter`] if a parameter is out of range, or for fractions that the ordered network was not trained for;
    /// [`Error::Weights`] for weights of another network.
    pub fn new(kind: NetworkKind, params: TrackerParams, weights: Weights) -> Result<Self, Error> {
        params.check()?;
        if params.fractions != FRACTIONS {
            let got = format!("{:?}", params.fractions);
            let expected = "[0.125, 0.375, 0.625, 0.875], the default, with a tracker whose training fixed its places";
            return Err(Error::Parameter { field: "fractions", expected, got });
        }
        let net = kind.heat_network();
        if weights.len() != net.weights() {
            let fault = WeightsError { expected: net.weights(), got: format!("{} numbers", weights.len()) };
            return Err(Error::Weights { network: kind.name(), fault });
        }
        let pass = Pass::new(&net);
        Ok(Self { kind, params, net, weights, pass, target: TargetFinder::default() })
    }

    /// Fills the keypoints of the object from the heat maps.
    fn find(&mut self, mask: &LabelMask, square: &Square, keypoints: &mut Keypoints) {
        let shape = self.net.shape(0);
        fill(mask, square, shape, self.pass.input());
        self.pass.run(&self.net, &self.weights);
        for (k, heat) in Heat::all(self.net.output(), self.pass.output()).iter().enumerate() {
            keypoints.dlo_px[k] = square.px(heat.mean);
            let score = match self.kind {
                NetworkKind::Ordered => concentration(heat),
                NetworkKind::Transporter => {
                    let far = distance_px(mask, keypoints.dlo_px[k]) / OFF_OBJECT_PX;
                    (1.0 / (1.0 + far * far)) as f32
                }
            };
            keypoints.scores[k] = score.clamp(0.01, 1.0);
        }
        if keypoints.scores.iter().any(|&score| f64::from(score) < self.params.min_score) {
            keypoints.scores = [0.0; 4];
        }
    }
}

impl KeypointTracker for LearnedTracker {
    fn track(&mut self, mask: &LabelMask) -> Result<Keypoints, Error> {
        check(mask)?;
        let target = self.target.find(mask, self.params.min_target_area_px);
        let mut keypoints = Keypoints::unseen(mask, target);
        let area = mask.data.iter().filter(|l| **l == label::DLO).count();
        if area >= self.params.min_area_px {
            let square = match self.kind {
                NetworkKind::Ordered => Square::around_object(mask),
                NetworkKind::Transporter => Some(Square::whole(mask)),
            };
            if let Some(square) = square {
                self.find(mask, &square, &mut keypoints);
            }
        }
        Ok(keypoints)
    }
}

/// Concentration of a heat map: 1 if it is as narrow as the heat that was learned. 0 at the edge of the map, beyond which the keypoint
/// may lie.
fn concentration(heat: &Heat) -> f32 {
    if heat.mean.iter().any(|c| c.abs() > EDGE) {
        return 0.0;
    }
    // The mean square distance from the middle of a bell exp(-d^2 / w^2) is w^2.
    (HEAT_WIDTH * HEAT_WIDTH / heat.spread().max(1e-9)).min(1.0)
}

/// Share of each pixel of the network's input that the object covers, written to `input`. Beyond the mask there is no object.
fn fill(mask: &LabelMask, square: &Square, shape: convnet::Shape, input: &mut [f32]) {
    let scale = square.side / SIDE as f64;
    let (width, height) = (mask.width as usize, mask.height as usize);
    // Mask pixels of a row or column of the input, each with the fraction of it that lies inside. Whole pixels would not do: with 1.5 of them to one of
    // the input, an upright object is up to a third too wide or too narrow.
    let parts = |corner: f64, k: usize, size: usize| {
        let [low, high] = [k, k + 1].map(|k| (corner + scale * k as f64).clamp(0.0, size as f64));
        (low.floor() as usize..high.ceil() as usize).map(move |i| (i, high.min(i as f64 + 1.0) - low.max(i as f64)))
    };
    for y in 0..SIDE {
        for (x, to) in input[shape.row(0, y)].iter_mut().enumerate() {
            let of_row = |v: usize| -> f64 {
                let is_object = |u: &usize| mask.data[v * width + u] == label::DLO;
                parts(square.corner[0], x, width).filter(|(u, _)| is_object(u)).map(|(_, part)| part).sum()
            };
            let object: f64 = parts(square.corner[1], y, height).map(|(v, part)| part * of_row(v)).sum();
            *to = (object / (scale * scale)) as f32;
        }
    }
}

/// Distance in pixels from a place to the nearest pixel of the object.
fn distance_px(mask: &LabelMask, place: [f64; 2]) -> f64 {
    let width = mask.width as usize;
    let square = |i: usize| {
        let d = [(i % width) as f64 + 0.5 - place[0], (i / width) as f64 + 0.5 - place[1]];
        d[0] * d[0] + d[1] * d[1]
    };
    let object = mask.data.iter().enumerate().filter(|(_, l)| **l == label::DLO);
    (object.map(|(i, _)| square(i)).fold(f64::MAX, f64::min).sqrt() - 0.7).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upright_object_is_as_wide_in_the_input_as_in_the_mask() {
        let net = NetworkKind::Ordered.heat_network();
        let shape = net.shape(0);
        for (first, side, shift) in [(40, 97.0, 0.0), (41, 97.0, 0.3), (42, 150.3, 0.7), (43, 40.0, 0.5)] {
            let mut mask = LabelMask::new(256, 256);
            for v in 30..90 {
                mask.data[v * 256 + first..v * 256 + first + 4].fill(label::DLO);
            }
            let square = Square { corner: [first as f64 + 2.0 + shift - 0.5 * side, 60.0 - 0.5 * side], side };
            let mut pass = Pass::new(&net);
            fill(&mask, &square, shape, pass.input());
            let scale = side / SIDE as f64;
            for y in [28, 31, 36] {
                let wide: f32 = pass.input()[shape.row(0, y)].iter().sum();
                assert!((f64::from(wide) * scale - 4.0).abs() < 1e-4, "{wide} in a square of {side}");
            }
            let area: f32 = (0..SIDE).map(|y| pass.input()[shape.row(0, y)].iter().sum::<f32>()).sum();
            let seen = 4.0 * side.min(60.0);
            assert!((f64::from(area) * scale * scale - seen).abs() < 1e-2, "{area} in a square of {side}");
        }
    }
}
