//! Whether poses and frames cover an episode, and what to say where they do not.

/// Longest time between two poses, s, over which the path is taken for straight without a word. An arm speeds up by 3 m/s^2
/// at most (0.5 m/s within its time constant of 0.16 s), which bends the path by 3 m/s^2 (0.1 s)^2 / 8 = 4 mm: as much as
/// a camera's position is uncertain by.
const SPARSE_S: f64 = 0.1;
/// Longest time without a pose, s, that a simulation is driven across: a whole step of a policy fits in.
const LOST_S: f64 = 0.5;
/// Least share of the frames that an episode's time has room for, under which more is amiss than a few lost images.
const MOST_FRAMES: f64 = 0.9;
/// Least share of the model's frames, under which a posterior rests on a small part of what the model looks at.
const FEW_FRAMES: f64 = 0.5;

/// The part of an episode for which the grip's path was measured.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PathCoverage {
    /// s since the start up to which frames may be used; below zero where none may.
    pub(super) until_s: f64,
    /// What is missing, in words.
    pub(super) warning: Option<String>,
}

/// Looks for times without a pose from the start of an episode to its end. What follows a long one is not used: the object
/// remembers a motion that nobody measured.
pub(super) fn path_coverage(pose_times_s: &[f64], duration_s: f64) -> PathCoverage {
    let started = pose_times_s.partition_point(|t| *t <= 0.0);
    let inside = pose_times_s[started..].iter().copied().filter(|t| *t < duration_s);
    // Without a pose at or before the start, the first one stands for it; the time up to it counts as missing.
    let times_s: Vec<f64> = std::iter::once(0.0).chain(inside).chain([duration_s]).collect();
    let gap_s = |w: &[f64]| w[1] - w[0];
    if let Some(lost) = times_s.windows(2).find(|w| gap_s(w) > LOST_S) {
        let known = started > 0 || lost[0] > 0.0;
        return PathCoverage {
            until_s: if known { lost[0] + SPARSE_S } else { -1.0 },
            warning: Some(format!(
                "nothing says where the grip was from {:.2} s to {:.2} s of {duration_s:.2} s: what was seen since is not used",
                lost[0], lost[1]
            )),
        };
    }
    let widest = times_s.windows(2).max_by(|a, b| gap_s(a).total_cmp(&gap_s(b))).filter(|w| gap_s(w) > SPARSE_S);
    let warning = widest.map(|w| {
        format!(
            "there is no pose of the grip from {:.2} s to {:.2} s: its path is taken for straight there",
            w[0], w[1]
        )
    });
    PathCoverage { until_s: f64::INFINITY, warning }
}

/// What to say of a track that has `got` of the `room` frames that its time has room for, where the model looks at `frames`.
pub(super) fn frame_warning(got: usize, room: usize, frames: usize) -> Option<String> {
    if (got as f64) < MOST_FRAMES * room as f64 {
        return Some(format!(
            "only {got} of {room} frames show all four keypoints: the object was hidden or out of the picture, or images were lost"
        ));
    }
    ((got as f64) < FEW_FRAMES * frames as f64)
        .then(|| format!("the track has {got} frames, and the model looks at {frames}: there is little to infer from"))
}

/// What to say where the shape at the start comes from frames at these times, s.
pub(super) fn start_warning([first_s, second_s]: [f64; 2]) -> Option<String> {
    (first_s > SPARSE_S || second_s - first_s > SPARSE_S).then(|| {
        format!(
            "shape and velocity at the start come from frames at {first_s:.2} s and {second_s:.2} s: no nearer ones show the object"
        )
    })
}
