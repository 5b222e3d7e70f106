//! Held values: frames that repeat an earlier frame instead of showing the object at their own time.
//!
//! A tracker that loses the object, a camera that is slower than its publisher, and a fit that is updated only after a
//! large motion all publish their last value again. A held value is no observation at its time: the object has moved on,
//! and the error of the first reading comes again in every repetition, where a simulator draws a new one for each frame.
//! A repetition alone proves nothing, as an object at rest repeats its place. A run of repetitions counts as held if the
//! motion around it contradicts it.

use super::KEYPOINTS;
use super::chain::Plausible;
use crate::grip::POSE_LEVER_M;
use crate::{Camera, GripPose, GripTrajectory, Keypoints};

/// Greatest difference in m between coordinates of equal values: the rounding of point, hand and pitch in tables with six
/// decimals, in both frames that are compared.
const EQUAL_M: f64 = 5e-6;
/// Motion of the hand in m beyond which a shape that stays equal counts as held: twenty times [`EQUAL_M`]. Grips that are
/// meant to stand still drift and jitter by millimetres, and a soft object answers each jolt by a part of it.
const HAND_MOVES_M: f64 = 1e-4;
/// Share of repeated frames of an object at rest above which a warning is given. A few equal frames are normal with
/// coordinates in whole pixels.
pub const MANY_STILL: f64 = 0.2;

/// Run of frames with one value: the frame that has it first, and its repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repeats {
    /// Index of the frame that has the value first.
    pub first: usize,
    /// Index of the last frame that repeats it.
    pub last: usize,
    /// True if the motion of hand or object contradicts the repetitions; false if both may rest.
    pub is_held: bool,
}

impl Repeats {
    /// Number of repetitions.
    pub fn count(&self) -> usize {
        self.last - self.first
    }
}

/// Frame of an object in a hand, in the plane of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedFrame {
    /// Time in s.
    pub time_s: f64,
    /// Four keypoints (x, z) in m.
    pub points_m: [[f64; 2]; 4],
    /// Pose of the hand at that time.
    pub grip: GripPose,
}

impl PlacedFrame {
    /// Keypoints in the frame of the hand, which stands upright at pitch 0.
    fn in_hand(&self) -> [[f64; 2]; 4] {
        let (sine, cosine) = self.grip.pitch_rad.sin_cos();
        self.points_m.map(|[x, z]| {
            let (x, z) = (x - self.grip.x_m, z - self.grip.z_m);
            // A positive pitch turns a hanging object towards -x; this turns it back.
            [cosine * x - sine * z, sine * x + cosine * z]
        })
    }

    /// Distance in m that the hand moved, with its rotation at a lever.
    fn hand_moved_m(&self, other: &Self) -> f64 {
        let (a, b) = (&self.grip, &other.grip);
        (a.x_m - b.x_m).hypot(a.z_m - b.z_m).hypot(POSE_LEVER_M * (a.pitch_rad - b.pitch_rad))
    }
}

fn are_equal(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> bool {
    a.as_flattened().iter().zip(b.as_flattened()).all(|(a, b)| (a - b).abs() <= EQUAL_M)
}

/// Side of a pixel of the mask in m, in the middle of the view. Coordinates in whole pixels repeat themselves while an
/// object moves by less. None if the camera does not see the plane.
pub fn pixel_m(camera: &Camera) -> Option<f64> {
    let middle_px = crate::camera::HALF_MASK_PX;
    let [a, b] = [middle_px, middle_px + 1.0].map(|u| camera.plane_from_mask([u, middle_px]));
    let (a, b) = (a?, b?);
    Some((a[0] - b[0]).hypot(a[1] - b[1]))
}

/// Finds the runs of frames that repeat a value, in the plane or in the frame of the hand: a fit of the shape relative to
/// the hand repeats the shape alone. `pixel_m` is the resolution in m of the points.
///
/// A run is held
/// - if the hand moves by more than a pixel, and the points do not move at all,
/// - if the hand moves by more than [`HAND_MOVES_M`], and the object keeps its shape as if it were rigid and without
///   weight,
/// - if a keypoint moves by more than a pixel into the run, and on in the same direction out of it. At a turning point it
///   comes back, and two frames may be equal.
pub fn repeats(frames: &[PlacedFrame], pixel_m: f64) -> Vec<Repeats> {
    let mut runs = Vec::new();
    let mut first = 0;
    while first < frames.len() {
        let start = &frames[first];
        let in_hand = start.in_hand();
        let in_plane = |f: &PlacedFrame| are_equal(&f.points_m, &start.points_m);
        let is_repeat = |f: &&PlacedFrame| in_plane(f) || are_equal(&f.in_hand(), &in_hand);
        let last = first + frames[first + 1..].iter().take_while(is_repeat).count();
        if last > first {
            let run = &frames[first..=last];
            let moved_m = run.iter().map(|f| f.hand_moved_m(start)).fold(0.0, f64::max);
            let least_m = if run.iter().all(in_plane) { pixel_m } else { HAND_MOVES_M };
            let passes = || {
                let before = first.checked_sub(1).map(|i| &frames[i]);
                before.zip(frames.get(last + 1)).is_some_and(|(a, b)| passes(a, start, b, pixel_m))
            };
            runs.push(Repeats { first, last, is_held: moved_m > least_m || passes() });
        }
        first = last + 1;
    }
    runs
}

/// True if a keypoint moves by more than `least_m` into the value `held`, and by more than that out of it without turning
/// back.
fn passes(before: &PlacedFrame, held: &PlacedFrame, after: &PlacedFrame, least_m: f64) -> bool {
    (0..4).any(|k| {
        let step = |a: &PlacedFrame, b: &PlacedFrame| [0, 1].map(|i| b.points_m[k][i] - a.points_m[k][i]);
        let (into, out) = (step(before, held), step(held, after));
        into[0].hypot(into[1]) > least_m && out[0].hypot(out[1]) > least_m && into[0] * out[0] + into[1] * out[1] > 0.0
    })
}

/// Leaves out the frames that hold an earlier value, and keeps those of an object that may be at rest. `samples` can follow
/// one another.
///
/// # Errors
/// A sentence if all frames hold one value.
pub(crate) fn without_held(
    samples: &[(f64, Keypoints)],
    camera: &Camera,
    hand: &GripTrajectory,
) -> Result<Plausible<Keypoints>, String> {
    let placed = |(time_s, k): &(f64, Keypoints)| {
        let [a, b, c, d] = k.dlo_scaled().map(|p| camera.plane_from_scaled(p));
        Some(PlacedFrame { time_s: *time_s, points_m: [a?, b?, c?, d?], grip: hand.at(*time_s) })
    };
    let (frames, pixel_m) = (samples.iter().map(placed).collect::<Option<Vec<_>>>(), pixel_m(camera));
    // Keypoints that the camera cannot place were left out before.
    let (Some(frames), Some(pixel_m)) = (frames, pixel_m) else {
        return Ok(Plausible { kept: samples.to_vec(), warnings: Vec::new() });
    };
    let runs = repeats(&frames, pixel_m);
    let (held, still): (Vec<Repeats>, Vec<Repeats>) = runs.iter().partition(|r| r.is_held);
    if held.first().is_some_and(|r| r.count() + 1 == samples.len()) {
        return Err(format!(
            "{KEYPOINTS}: all {} frames repeat the first one while the hand moves: expected keypoints that follow the object; the tracker holds its last value",
            samples.len()
        ));
    }
    let mut flags = vec![true; samples.len()];
    held.iter().for_each(|r| flags[r.first + 1..=r.last].fill(false));
    let words = |runs: &[Repeats]| words(runs, &frames);
    let mut warnings = Vec::new();
    warnings.extend(words(&held).map(|said| {
        format!(
            "{KEYPOINTS}: {said} while hand or object move: left out, as a held value is no observation at its time"
        )
    }));
    let resting: usize = still.iter().map(Repeats::count).sum();
    if resting as f64 > MANY_STILL * samples.len() as f64 {
        warnings.extend(words(&still).map(|said| {
            format!("{KEYPOINTS}: {said} while the hand is at rest: kept, as the object may be at rest, too; if the tracker had lost it, shorten the recording")
        }));
    }
    Ok(Plausible { kept: super::chain::kept(samples, &flags), warnings })
}

/// Share of the frames that repeat an earlier one, and the longest run with its times; none without runs.
fn words(runs: &[Repeats], frames: &[PlacedFrame]) -> Option<String> {
    let longest = runs.iter().max_by_key(|r| r.count())?;
    let count: usize = runs.iter().map(Repeats::count).sum();
    Some(format!(
        "{count} of {} frames ({:.0} %) repeat the frame before them, the longest run {} from {:.2} s to {:.2} s,",
        frames.len(),
        100.0 * count as f64 / frames.len() as f64,
        longest.count(),
        frames[longest.first + 1].time_s,
        frames[longest.last].time_s
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Plane;

    /// Shows 1.28 m on 256 pixels: a pixel is 5 mm.
    const CAMERA: Camera =
        Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 1.28, roll_rad: 0.0, distortion_k1: 0.0 });
    const RATE_HZ: f64 = 30.0;

    /// Frame of an object that hangs from `hand` and is bent by `angle_rad`, with coordinates rounded to `step_m`.
    fn frame(i: usize, hand: GripPose, angle_rad: f64, step_m: f64) -> PlacedFrame {
        let round = |v: f64| if step_m > 0.0 { (v / step_m).round() * step_m } else { v };
        let point = |k: f64| {
            let angle = angle_rad * k - hand.pitch_rad;
            [round(hand.x_m + 0.1 * k * angle.sin()), round(hand.z_m - 0.1 * k * angle.cos())]
        };
        PlacedFrame { time_s: i as f64 / RATE_HZ, points_m: [1.0, 2.0, 3.0, 4.0].map(point), grip: hand }
    }

    fn hand(x_m: f64) -> GripPose {
        GripPose { x_m, z_m: 0.3, pitch_rad: 0.0 }
    }

    /// Angle in rad of a swing of 1 Hz.
    fn swing(i: usize) -> f64 {
        0.2 * (std::f64::consts::TAU * i as f64 / RATE_HZ).cos()
    }

    /// Frames kept and warnings, if the reader sees these frames.
    fn outcome(frames: &[PlacedFrame]) -> Result<(Vec<usize>, Vec<String>), String> {
        let keypoints = |f: &PlacedFrame| Keypoints {
            dlo_px: f.points_m.map(|[x, z]| CAMERA.mask_from_world([x, 0.0, z]).unwrap()),
            target_px: None,
            scores: [1.0; 4],
            target_score: 0.0,
            image_width_px: 256,
            image_height_px: 256,
        };
        let samples: Vec<(f64, Keypoints)> = frames.iter().map(|f| (f.time_s, keypoints(f))).collect();
        let times_s = frames.iter().map(|f| f.time_s).collect();
        let hand = GripTrajectory::new(times_s, frames.iter().map(|f| f.grip).collect()).unwrap();
        let found = without_held(&samples, &CAMERA, &hand)?;
        let index = |(time_s, _): &(f64, Keypoints)| (time_s * RATE_HZ).round() as usize;
        Ok((found.kept.iter().map(index).collect(), found.warnings))
    }

    #[test]
    fn frames_of_a_slow_camera_that_come_twice_are_left_out() {
        let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, hand(0.0), swing(i - i % 2), 0.0)).collect();
        let (kept, warnings) = outcome(&frames).unwrap();
        // Repetitions near the turning points remain: the object stands there for a moment.
        let repeated = kept.iter().filter(|i| *i % 2 == 1).count();
        assert!((0..60).step_by(2).all(|i| kept.contains(&i)) && repeated <= 10, "{kept:?}");
        assert!(warnings.len() == 1 && warnings[0].contains("repeat the frame before them"), "{warnings:?}");
        assert!(warnings[0].contains("left out, as a held value is no observation at its time"), "{warnings:?}");
    }

    #[test]
    fn points_that_stay_while_the_hand_leaves_are_held() {
        let path = |i: usize| hand(if i < 40 { 0.0 } else { 0.004 * (i - 40) as f64 });
        let frozen = |i: usize| PlacedFrame { grip: path(i), ..frame(i, hand(0.0), swing(i.min(35)), 0.0) };
        let (kept, warnings) = outcome(&(0..60).map(frozen).collect::<Vec<_>>()).unwrap();
        assert_eq!(kept, (0..=35).collect::<Vec<_>>());
        assert!(
            warnings[0].contains("24 of 60 frames (40 %)")
                && warnings[0].contains("longest run 24 from 1.20 s to 1.97 s"),
            "{warnings:?}"
        );
        let all = |i: usize| PlacedFrame { grip: hand(0.004 * i as f64), ..frame(i, hand(0.0), 0.1, 0.0) };
        let refused = outcome(&(0..60).map(all).collect::<Vec<_>>()).unwrap_err();
        assert!(refused.contains("all 60 frames repeat the first one while the hand moves"), "{refused}");
    }

    #[test]
    fn a_shape_that_follows_a_jittering_hand_as_if_rigid_is_held() {
        // A hand that is meant to stand still jitters by half a millimetre and a milliradian, in tables of six decimals.
        let jitter = |i: usize| [0.0005, -0.0003, 0.0001, -0.0005, 0.0004][i % 5];
        let path = |i: usize| GripPose { x_m: jitter(i), z_m: 0.3, pitch_rad: 2.0 * jitter(i + 2) };
        let of = |held: &dyn Fn(usize) -> usize| {
            let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, path(i), swing(held(i)), 1e-6)).collect();
            outcome(&frames).unwrap()
        };
        assert_eq!(of(&|i| i).1, [] as [String; 0]);
        let (kept, warnings) = of(&|i| if (10..19).contains(&i) { 10 } else { i.min(40) });
        assert_eq!(kept, (0..=10).chain(19..=40).collect::<Vec<_>>());
        assert!(
            warnings[0].contains("27 of 60 frames (45 %)")
                && warnings[0].contains("longest run 19 from 1.37 s to 1.97 s"),
            "{warnings:?}"
        );
    }

    #[test]
    fn an_object_at_rest_in_a_hand_at_rest_is_kept_to_the_last_frame() {
        // At rest for 10 of 60 frames, then for 30 of 60.
        let (kept, warnings) =
            outcome(&(0..60).map(|i| frame(i, hand(0.0), swing(i.saturating_sub(10)), 0.0)).collect::<Vec<_>>())
                .unwrap();
        assert_eq!((kept.len(), warnings), (60, vec![]));
        let still = |i: usize| frame(i, hand(0.0), swing(i.saturating_sub(30)), 0.0);
        let (kept, warnings) = outcome(&(0..60).map(still).collect::<Vec<_>>()).unwrap();
        assert_eq!(kept.len(), 60);
        assert!(warnings[0].contains("30 of 60 frames (50 %)") && warnings[0].contains("kept"), "{warnings:?}");
    }

    #[test]
    fn equal_frames_in_whole_pixels_at_a_turning_point_are_no_held_values() {
        // Frames half a period before and after a turning point have equal pixels, and their neighbours are pixels away.
        let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, hand(0.0), 4.0 * swing(2 * i + 1), 0.005)).collect();
        assert!(repeats(&frames, 0.005).iter().any(|r| r.count() == 1), "the swing has turning points");
        assert_eq!(outcome(&frames).unwrap(), ((0..60).collect(), vec![]));
    }
}
