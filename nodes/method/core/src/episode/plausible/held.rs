//! Frames that hold an earlier value instead of showing the object at their own time: they are left out.

use super::KEYPOINTS;
use super::chain::{Plausible, kept, points_m};
use super::repeats::{HeldSummary, PlacedFrame, held_runs, held_summaries};
use crate::{Camera, GripTrajectory, Keypoints};

/// Leaves out the frames that hold an earlier value of all keypoints or of one, and keeps those of an object that may be at
/// rest. `samples` can follow one another.
///
/// # Errors
/// A sentence if fewer than two frames remain.
pub(crate) fn without_held(
    samples: &[(f64, Keypoints)],
    camera: &Camera,
    hand: &GripTrajectory,
) -> Result<Plausible<Keypoints>, String> {
    let placed = |(time_s, k): &(f64, Keypoints)| {
        Some(PlacedFrame { time_s: *time_s, points_m: points_m(k, camera)?, grip: hand.at(*time_s) })
    };
    // Keypoints that the camera cannot place were left out before.
    let Some(frames) = samples.iter().map(placed).collect::<Option<Vec<PlacedFrame>>>() else {
        return Ok(Plausible { kept: samples.to_vec(), warnings: Vec::new() });
    };
    let runs = held_runs(&frames);
    let mut flags = vec![true; samples.len()];
    runs.iter().for_each(|run| flags[run.first + 1..=run.last].fill(false));
    let held: Vec<String> = held_summaries(&runs).iter().map(|held| words(held, &frames)).collect();
    let kept = kept(samples, &flags);
    if kept.len() < 2 && !held.is_empty() {
        return Err(format!(
            "{KEYPOINTS}: {}: expected keypoints that follow the object; the tracker holds its last value",
            held.join("; ")
        ));
    }
    let left_out = |said| format!("{KEYPOINTS}: {said}: left out, as a held value is no observation at its time");
    Ok(Plausible { kept, warnings: held.into_iter().map(left_out).collect() })
}

/// Share of the frames that hold all keypoints or one, and the longest run with its times.
fn words(held: &HeldSummary, frames: &[PlacedFrame]) -> String {
    let HeldSummary { keypoint, count, longest } = held;
    let (what, meanwhile) = match keypoint {
        None => ("the frame before them".to_owned(), "hand or object move"),
        Some(k) => (format!("dlo_u[{k}], dlo_v[{k}] of the frame before them"), "the others move"),
    };
    format!(
        "{count} of {} frames ({:.0} %) repeat {what}, the longest run {} from {:.2} s to {:.2} s, while {meanwhile}",
        frames.len(),
        100.0 * *count as f64 / frames.len() as f64,
        longest.count(),
        frames[longest.first + 1].time_s,
        frames[longest.last].time_s
    )
}

#[cfg(test)]
mod tests;
