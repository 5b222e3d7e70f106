//! Coverage of an episode by poses and frames, and the warnings about gaps and about tracks that tell little.

use super::order::order_from;
use crate::camera::HALF_MASK_PX;
use crate::statistics::mean;
use crate::{Camera, Frame, Model};

/// Longest time between two poses in s that is interpolated without a warning. An arm accelerates by 3 m/s^2 at most
/// (0.5 m/s within its time constant of 0.16 s). That bends the path by 3 m/s^2 (0.1 s)^2 / 8 = 4 mm, about the
/// uncertainty of the camera's position.
const SPARSE_S: f64 = 0.1;
/// Longest time without a pose in s that a simulation is driven across: one step of a policy.
const LOST_S: f64 = 0.5;
/// Share of the possible frames of an episode below which a warning is given: fewer are not a few lost images.
const MOST_FRAMES: f64 = 0.9;
/// Number of frames below which a warning is given.
const FEWEST_FRAMES: usize = 10;
/// Standard gravity in m/s^2.
const GRAVITY_M_S2: f64 = 9.81;

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

/// Warning about a track with `got` frames, if its time has room for `room`.
pub(super) fn frame_warning(got: usize, room: usize) -> Option<String> {
    ((got as f64) < MOST_FRAMES * room as f64).then(|| {
        format!(
            "only {got} of {room} frames show all four keypoints: the object was hidden or out of the picture, or images were lost"
        )
    })
}

/// Warning about a track that holds little to infer from: few frames, less than a swing, or no motion above the noise. A
/// track that ends before the model's last frame holds as much as its own frames say.
pub(super) fn few_warning(frames: &[Frame], model: &Model) -> Option<String> {
    let (first, last) = (frames.first()?, frames.last()?);
    let duration_s = last.time_s - first.time_s;
    let few = (frames.len() < FEWEST_FRAMES).then(|| {
        format!("the track has {} frames, fewer than {FEWEST_FRAMES}: the noise of single frames decides", frames.len())
    });
    let short = || {
        let swing_s = swing_s(first, &model.camera.view)?;
        (duration_s < swing_s).then(|| {
            format!(
                "the track lasts {duration_s:.2} s, less than a free swing of an object of its length ({swing_s:.2} s): damping and stiffness show in the swing"
            )
        })
    };
    let still = || {
        let (moved_px, noise_px) = (motion_px(frames), model.camera.keypoint_noise_px);
        (moved_px < noise_px).then(|| {
            format!(
                "the object moves by {moved_px:.2} px (rms of its middle, in the mask), less than the noise of a keypoint ({noise_px:.2} px): only its shape at rest can be inferred"
            )
        })
    };
    // One reason is enough: a track of few frames is short and moves little, too.
    few.or_else(short).or_else(still).map(|reason| format!("{reason}; expect a posterior near the prior"))
}

/// Period in s of small swings of a limp object that hangs from the grip, by the length to its last keypoint: a stiff rod
/// with a free hinge, 2 pi sqrt(2 L / (3 g)). Stiffness shortens it. None if the camera cannot place a keypoint.
fn swing_s(frame: &Frame, camera: &Camera) -> Option<f64> {
    let [a, b, c, d] = frame.dlo.map(|p| camera.plane_from_scaled(p));
    let grip_m = [frame.eef[0], frame.eef[1]];
    let points_m = order_from(grip_m, [a?, b?, c?, d?]);
    let path: Vec<[f64; 2]> = std::iter::once(grip_m).chain(points_m).collect();
    let length_m: f64 = path.windows(2).map(|w| (w[0][0] - w[1][0]).hypot(w[0][1] - w[1][1])).sum();
    Some(std::f64::consts::TAU * (2.0 * length_m / (3.0 * GRAVITY_M_S2)).sqrt())
}

/// Root mean square distance in mask pixels of the middle of the four keypoints from its mean. It does not depend on
/// their order.
fn motion_px(frames: &[Frame]) -> f64 {
    let middle = |f: &Frame| [0, 1].map(|i| HALF_MASK_PX * f.dlo.iter().map(|p| p[i]).sum::<f64>() / 4.0);
    let variance = |axis: usize| {
        let values: Vec<f64> = frames.iter().map(|f| middle(f)[axis]).collect();
        let mean = mean(&values);
        values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64
    };
    (variance(0) + variance(1)).sqrt()
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
