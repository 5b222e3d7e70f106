//! Coverage of an episode by poses and frames, and the warnings about gaps.

/// Longest time between two poses in s that is interpolated without a warning. An arm accelerates by 3 m/s^2 at most
/// (0.5 m/s within its time constant of 0.16 s). That bends the path by 3 m/s^2 (0.1 s)^2 / 8 = 4 mm, about the
/// uncertainty of the camera's position.
const SPARSE_S: f64 = 0.1;
/// Longest time without a pose in s that a simulation is driven across: one step of a policy.
const LOST_S: f64 = 0.5;
/// Share of the possible frames of an episode below which a warning is given: fewer are not a few lost images.
const MOST_FRAMES: f64 = 0.9;
/// Share of the model's frames below which a warning is given: the posterior then rests on a small part of the track.
const FEW_FRAMES: f64 = 0.5;

/// Part of an episode in which the grip's path was measured.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PathCoverage {
    /// Time since the start in s up to which frames may be used; negative if no frame may be used.
    pub(super) until_s: f64,
    /// Warning about a gap.
    pub(super) warning: Option<String>,
}

/// Finds the gaps between poses from the start of an episode to its end.
///
/// Frames after a long gap are not used: the state of the object depends on the motion in the gap, which is unknown.
pub(super) fn path_coverage(pose_times_s: &[f64], duration_s: f64) -> PathCoverage {
    let started = pose_times_s.partition_point(|t| *t <= 0.0);
    let inside = pose_times_s[started..].iter().copied().filter(|t| *t < duration_s);
    // Without a pose at or before the start, the first pose is held back to the start. That time counts as a gap.
    let times_s: Vec<f64> = std::iter::once(0.0).chain(inside).chain([duration_s]).collect();
    let gap_s = |w: &[f64]| w[1] - w[0];
    if let Some(lost) = times_s.windows(2).find(|w| gap_s(w) > LOST_S) {
        let known = started > 0 || lost[0] > 0.0;
        return PathCoverage {
            // A camera frame shortly after the last pose is still usable.
            until_s: if known { lost[0] + SPARSE_S } else { -1.0 },
            warning: Some(format!(
                "no pose of the grip from {:.2} s to {:.2} s of {duration_s:.2} s: later frames are not used",
                lost[0], lost[1]
            )),
        };
    }
    let widest = times_s.windows(2).max_by(|a, b| gap_s(a).total_cmp(&gap_s(b))).filter(|w| gap_s(w) > SPARSE_S);
    let warning = widest.map(|w| {
        format!("no pose of the grip from {:.2} s to {:.2} s: its path is assumed to be straight there", w[0], w[1])
    });
    PathCoverage { until_s: f64::INFINITY, warning }
}

/// Warning about a track with `got` frames, if its time has room for `room` and the model uses `frames`.
pub(super) fn frame_warning(got: usize, room: usize, frames: usize) -> Option<String> {
    if (got as f64) < MOST_FRAMES * room as f64 {
        return Some(format!(
            "only {got} of {room} frames show all four keypoints: the object was hidden or out of the picture, or images were lost"
        ));
    }
    ((got as f64) < FEW_FRAMES * frames as f64)
        .then(|| format!("the track has {got} frames, and the model uses {frames}: the posterior rests on few data"))
}

/// Warning about a start shape that was computed from `count` frames, the first and the last at these times in s, if they are
/// late or far apart.
pub(super) fn start_warning([first_s, last_s]: [f64; 2], count: usize) -> Option<String> {
    let apart_s = (last_s - first_s) / count.saturating_sub(1).max(1) as f64;
    (first_s > SPARSE_S || apart_s > SPARSE_S).then(|| {
        format!(
            "shape and velocity at the start come from {count} frames between {first_s:.2} s and {last_s:.2} s: no earlier or closer frames show the object"
        )
    })
}
