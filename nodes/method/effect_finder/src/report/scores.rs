//! Scores of predictions on held-out episodes.

use catenary_core::statistics::{QuantileMethod, quantile};
use catenary_core::{Camera, Track};
use rand::{Rng, RngExt};
use track_fit::data::{MeasuredEpisode, Offset, offsets_mm, rmse_mm};
use track_fit::fitting::Fit;

/// Excess residual energy of a gap on held-out episodes, in standard deviations of noise.
const GAP_SDS: f64 = 3.0;
/// Bootstrap blocks of an episode, because residuals of neighbouring frames are correlated.
const BLOCKS: usize = 8;
/// Bootstrap draws.
const RESAMPLES: usize = 1000;
/// Least number of bootstrap draws with a gap for an interval.
const LEAST_WITH_GAP: usize = 900;

/// Residual energy of all episodes, in variances of the noise.
pub fn cost(fits: &[Fit]) -> f64 {
    fits.iter().map(|f| f.cost).sum()
}

/// Closed share of a gap in distance: (before - after) / (before - floor). None without a gap, or if the share is not finite.
pub fn share_closed(before: f64, after: f64, floor: f64) -> Option<f64> {
    let gap = before - floor;
    // A NaN is no gap.
    (gap > 0.0).then(|| (before - after) / gap).filter(|share| share.is_finite())
}

/// Share of the present model's excess residual energy that a repair removes. 0 if only the repaired model has an excess,
/// none if neither has, or if an energy is not finite.
pub fn share_explained(before: &[Fit], after: &[Fit]) -> Option<f64> {
    let coordinates: f64 = before.iter().map(|f| f.residuals.len() as f64).sum();
    let beyond = |fits: &[Fit]| cost(fits) - coordinates;
    let is_gap = |fits: &[Fit]| beyond(fits) > GAP_SDS * (2.0 * coordinates).sqrt();
    match (is_gap(before), is_gap(after)) {
        // The excess exceeds zero here, but may be infinite.
        (true, _) => Some(1.0 - beyond(after).max(0.0) / beyond(before)).filter(|share| share.is_finite()),
        (false, true) => Some(0.0),
        (false, false) => None,
    }
}

/// Energy score of each frame: the mean distance of predictions from the measurement, less half the mean distance
/// between predictions. Empty without predictions.
pub fn energy_score_mm(episode: &MeasuredEpisode, predictions: &[Track], camera: &Camera) -> Vec<f64> {
    if predictions.is_empty() {
        return Vec::new();
    }
    let distance = |o: &Offset| o.map(|o| o.iter().map(|v| v * v).sum::<f64>().sqrt());
    let n = predictions.len() as f64;
    let mut scores = vec![Some(0.0); episode.measured.frames.len()];
    let mut add = |offsets: &[Offset], weight: f64| {
        for (score, offset) in scores.iter_mut().zip(offsets) {
            *score = score.zip(distance(offset)).map(|(s, d)| s + weight * d);
        }
    };
    for (i, a) in predictions.iter().enumerate() {
        add(&episode.offsets_mm(a, camera), 1.0 / n);
        for b in &predictions[..i] {
            // The mean runs over all ordered pairs of different draws, so that each pair counts twice. There is a pair only
            // with two draws or more.
            add(&offsets_mm(a, b, episode.order, camera), -1.0 / (n * (n - 1.0)));
        }
    }
    scores.into_iter().flatten().collect()
}

/// Interval of the closed share of a gap, by a block bootstrap over frames. `closed` is the share, given the distances of
/// both models; `before` and `after` are their offsets by episode and frame.
pub fn closed_interval(
    before: &[Vec<Offset>],
    after: &[Vec<Offset>],
    closed: &dyn Fn(f64, f64) -> Option<f64>,
    mut rng: impl Rng,
) -> Option<[f64; 2]> {
    let blocks: Vec<(usize, std::ops::Range<usize>)> = before
        .iter()
        .enumerate()
        .flat_map(|(episode, frames)| {
            let (n, count) = (frames.len(), BLOCKS.min(frames.len()));
            (0..count).map(move |b| (episode, b * n / count..(b + 1) * n / count))
        })
        .collect();
    if blocks.is_empty() {
        return None;
    }
    let mut values: Vec<f64> = (0..RESAMPLES)
        .filter_map(|_| {
            // Both models are resampled with the same blocks, so that the choice of frames does not blur their
            // difference.
            let drawn: Vec<_> = (0..blocks.len()).map(|_| &blocks[rng.random_range(0..blocks.len())]).collect();
            let of = |all: &[Vec<Offset>]| {
                rmse_mm(drawn.iter().flat_map(|(episode, frames)| &all[*episode][frames.clone()]))
            };
            closed(of(before), of(after))
        })
        .collect();
    if values.len() < LEAST_WITH_GAP {
        return None;
    }
    values.sort_by(f64::total_cmp);
    Some([0.05, 0.95].map(|q| quantile(&values, q, QuantileMethod::Lower)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;
    use track_fit::toy::{self, Toy};

    /// Fit of 200 coordinates.
    fn fit(cost: f64) -> Fit {
        let (residuals, jacobian) = (DVector::zeros(200), nalgebra::DMatrix::zeros(200, 0));
        Fit { point: Vec::new(), cost, residuals, jacobian, tracks: Vec::new() }
    }

    #[test]
    fn the_explained_share_is_of_the_excess_over_noise() {
        assert_eq!(share_explained(&[fit(700.0), fit(700.0)], &[fit(200.0), fit(450.0)]), Some(0.75));
        assert_eq!(share_explained(&[fit(700.0)], &[fit(150.0)]), Some(1.0));
        assert_eq!(share_explained(&[fit(700.0)], &[fit(1200.0)]), Some(-1.0));
        assert_eq!(share_explained(&[fit(255.0)], &[fit(200.0)]), None);
        assert_eq!(share_explained(&[fit(255.0)], &[fit(300.0)]), Some(0.0), "the repair makes it worse");
    }

    #[test]
    fn shares_without_a_finite_gap_are_none() {
        assert_eq!(share_closed(10.0, 4.0, 2.0), Some(0.75));
        assert_eq!(share_closed(2.0, 1.0, 2.0), None, "the present model is at the floor");
        // Differences of the last bit, and distances that overflow or are no numbers.
        assert_eq!(share_closed(f64::MIN_POSITIVE, -1e9, 0.0), None);
        for (before, after, floor) in [(f64::INFINITY, 1.0, 0.0), (f64::NAN, 1.0, 0.0), (3.0, f64::NAN, 1.0)] {
            assert_eq!(share_closed(before, after, floor), None, "{before} {after} {floor}");
        }
        assert_eq!(share_closed(3.0, 1.0, f64::NAN), None);
        assert_eq!(share_explained(&[fit(f64::INFINITY)], &[fit(f64::INFINITY)]), None);
        assert_eq!(share_explained(&[fit(f64::NAN)], &[fit(200.0)]), None);
    }

    #[test]
    fn an_energy_score_needs_predictions_and_two_have_a_spread() {
        let model = toy::model();
        let episode = toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        let score = |predictions: &[Track]| energy_score_mm(&episode, predictions, &model.camera.view);
        assert_eq!(score(&[]), [0.0; 0]);
        let other = toy::episode(&Toy { gain: 0.3 }, [0.26, 2e4], &[]).measured;
        let one = score(std::slice::from_ref(&other));
        let two = score(&[other.clone(), other]);
        assert!(one.len() == toy::FRAMES && one.iter().all(|v| v.is_finite() && *v > 0.0), "{one:?}");
        assert!(one.iter().zip(&two).all(|(a, b)| (a - b).abs() < 1e-9), "equal draws have no spread: {two:?}");
    }
}
