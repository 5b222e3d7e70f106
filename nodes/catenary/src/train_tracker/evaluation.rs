//! Errors of a trained tracker in views that it was not trained on.

use anyhow::Result;
use catenary_core::statistics::{mean, median, sd};
use keypoint_tracker::KeypointTracker;
use keypoint_tracker::learned::view::{Cover, ObjectView, Rollout};
use rand::RngExt;
use serde::Serialize;

/// Fractions of the length at which keypoints belong.
const FRACTIONS: [f64; 4] = [0.125, 0.375, 0.625, 0.875];
/// Distance of a wrong keypoint from its place, in lengths.
const WRONG: f64 = 0.05;
/// Width of the cover across the object, in lengths. It lies anywhere, also over an end.
const COVER: f64 = 0.12;

/// Errors of keypoints at fixed fractions.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Errors {
    /// Median distance of a keypoint from its place, in lengths.
    pub median_lengths: f64,
    /// Share of the masks in which the object was not found, or a keypoint is more than 5 % of the length off in the better of both orders.
    pub failures: f64,
    /// Share of the masks whose keypoints came from the free end on.
    pub reversed: f64,
}

/// Errors of a tracker in the views, with or without a cover across each.
pub fn errors(tracker: &mut dyn KeypointTracker, rollouts: &[Rollout], covered: bool) -> Result<Errors> {
    let mut rng = catenary_core::seed::rng(7, 0);
    let (mut distances, mut failures, mut reversed, mut seen, mut all) = (Vec::new(), 0, 0, 0, 0);
    for view in rollouts.iter().flatten() {
        let cover = Cover::across(view, rng.random_range(0.0..1.0), COVER);
        let covers: &[Cover] = if covered { &[cover] } else { &[] };
        let keypoints = tracker.track(&view.mask(covers))?;
        all += 1;
        if !keypoints.dlo_seen() {
            failures += 1;
            continue;
        }
        seen += 1;
        let (forward, backward) = (off(view, keypoints.dlo_px, false), off(view, keypoints.dlo_px, true));
        let is_reversed = backward.iter().sum::<f64>() < forward.iter().sum::<f64>();
        let best = if is_reversed { backward } else { forward };
        reversed += u32::from(is_reversed);
        failures += u32::from(!best.iter().all(|d| *d <= WRONG));
        distances.extend(best);
    }
    let share = |n: u32, of: u32| f64::from(n) / f64::from(of.max(1));
    Ok(Errors {
        median_lengths: median(&mut distances),
        failures: share(failures, all),
        reversed: share(reversed, seen),
    })
}

/// Distance of each keypoint from its place in lengths.
fn off(view: &ObjectView, keypoints: [[f64; 2]; 4], reversed: bool) -> [f64; 4] {
    std::array::from_fn(|k| {
        let p = view.at(if reversed { FRACTIONS[3 - k] } else { FRACTIONS[k] });
        (keypoints[k][0] - p[0]).hypot(keypoints[k][1] - p[1]) / view.length()
    })
}

/// Keypoints that a training chose by itself.
#[derive(Debug, Clone, Serialize)]
pub struct Places {
    /// Mean fraction of the length of each keypoint, in rising order.
    pub fractions: [f64; 4],
    /// Standard deviation of the fractions over all frames.
    pub deviations: [f64; 4],
    /// Root mean square change of a fraction from one frame to the next.
    pub flicker: f64,
    /// Share of the frames in which the keypoints come in another order along the object than in the frame before.
    pub permuted: f64,
    /// Mean distance from the object's centre line, in lengths.
    pub distance_lengths: f64,
    /// Share of the masks in which the object was not found.
    pub failures: f64,
}

/// Places of a tracker's keypoints along the objects.
pub fn places(tracker: &mut dyn KeypointTracker, rollouts: &[Rollout]) -> Result<Places> {
    let mut fractions: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::new());
    let (mut changes, mut permuted, mut pairs, mut away, mut failures, mut all) = (0.0, 0, 0, 0.0, 0, 0);
    for rollout in rollouts {
        let mut before: Option<[f64; 4]> = None;
        for view in rollout {
            all += 1;
            let keypoints = tracker.track(&view.mask(&[]))?;
            if !keypoints.dlo_seen() {
                (before, failures) = (None, failures + 1);
                continue;
            }
            let nearest = keypoints.dlo_px.map(|p| view.nearest(p));
            away += nearest.iter().map(|(_, d)| d / view.length()).sum::<f64>() / 4.0;
            let now = nearest.map(|(fraction, _)| fraction);
            (0..4).for_each(|k| fractions[k].push(now[k]));
            if let Some(before) = before {
                pairs += 1;
                permuted += u32::from(order(before) != order(now));
                changes += (0..4).map(|k| (now[k] - before[k]).powi(2)).sum::<f64>() / 4.0;
            }
            before = Some(now);
        }
    }
    let seen = f64::from((all - failures).max(1));
    let mut of_each: Vec<(f64, f64)> = fractions.iter().map(|v| (mean(v), sd(v))).collect();
    of_each.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(Places {
        fractions: std::array::from_fn(|k| of_each[k].0),
        deviations: std::array::from_fn(|k| of_each[k].1),
        flicker: (changes / f64::from(pairs.max(1))).sqrt(),
        permuted: f64::from(permuted) / f64::from(pairs.max(1)),
        distance_lengths: away / seen,
        failures: f64::from(failures) / f64::from(all.max(1)),
    })
}

/// Keypoints in the order of their fractions.
fn order(fractions: [f64; 4]) -> [usize; 4] {
    let mut order = [0, 1, 2, 3];
    order.sort_by(|a, b| fractions[*a].total_cmp(&fractions[*b]));
    order
}
