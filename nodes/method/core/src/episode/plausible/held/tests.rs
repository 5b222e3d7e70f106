//! Tests of frames that hold an earlier value, and of frames of an object at rest.

use super::*;
use crate::GripPose;
use crate::camera::Plane;

/// Shows 1.28 m on 256 pixels: a pixel is 5 mm.
const CAMERA: Camera = Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 1.28, roll_rad: 0.0, distortion_k1: 0.0 });
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
    let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, hand(0.0), swing(i - i % 2 + 1), 0.0)).collect();
    let (kept, warnings) = outcome(&frames).unwrap();
    // Repetitions near the turning points remain: the object stands there for a moment.
    let repeated = kept.iter().filter(|i| *i % 2 == 1).count();
    // Frame 30 has the place of the frame before, on the other side of a turning point.
    let is_kept = |i: usize| i == 30 || kept.contains(&i);
    assert!((0..60).step_by(2).all(is_kept) && repeated <= 10, "{kept:?}");
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
        warnings[0].contains("24 of 60 frames (40 %)") && warnings[0].contains("longest run 24 from 1.20 s to 1.97 s"),
        "{warnings:?}"
    );
    assert_eq!(warnings.len(), 1, "no keypoint is named alone: {warnings:?}");
    let all = |i: usize| PlacedFrame { grip: hand(0.004 * i as f64), ..frame(i, hand(0.0), 0.1, 0.0) };
    let refused = outcome(&(0..60).map(all).collect::<Vec<_>>()).unwrap_err();
    assert!(refused.contains("59 of 60 frames (98 %) repeat the frame before them"), "{refused}");
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
        warnings[0].contains("27 of 60 frames (45 %)") && warnings[0].contains("longest run 19 from 1.37 s to 1.97 s"),
        "{warnings:?}"
    );
}

#[test]
fn an_object_at_rest_in_a_hand_at_rest_is_kept_to_the_last_frame() {
    // At rest for 30 of 60 frames before it is let go, and throughout; in full digits and in whole millimetres.
    let (released, rest) = (|i: usize| swing(i.saturating_sub(30)), |_: usize| 0.2);
    let paths: [&dyn Fn(usize) -> f64; 2] = [&released, &rest];
    for (path, step_m) in paths.into_iter().flat_map(|path| [0.0, 1e-4, 1e-3].map(|step_m| (path, step_m))) {
        let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, hand(0.0), path(i), step_m)).collect();
        assert_eq!(outcome(&frames).unwrap(), ((0..60).collect(), vec![]), "{step_m}");
    }
}

#[test]
fn a_swing_that_decays_below_the_rounding_is_kept() {
    for step_m in [1e-6, 1e-3, 5e-3] {
        let path = |i: usize| swing(i) * (-0.1 * i as f64).exp();
        let frames: Vec<PlacedFrame> = (0..150).map(|i| frame(i, hand(0.0), path(i), step_m)).collect();
        assert_eq!(outcome(&frames).unwrap(), ((0..150).collect(), vec![]), "{step_m}");
    }
}

#[test]
fn a_stiff_object_that_moves_and_stops_with_its_hand_is_kept() {
    // The hand moves by 8 mm in a frame of each five, and the object is carried along in whole millimetres.
    let stop_and_go = |i: usize| hand(0.008 * (i / 5) as f64);
    let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, stop_and_go(i), 0.1, 1e-3)).collect();
    assert_eq!(outcome(&frames).unwrap(), ((0..60).collect(), vec![]));
}

#[test]
fn a_soft_object_at_rest_is_kept_as_its_hand_starts() {
    // Steps in mm as a tracker saw them: the first pixels that change move all keypoints a little, and then the far ones wait.
    let hand_mm = [7.6, 3.5, 4.8, 5.8, 3.9, 3.5, 4.2];
    let points_mm = [
        [6.0, 3.4, 6.5, 6.1, 6.6, 6.0, 6.6],
        [4.0, 0.2, 0.8, 3.5, 5.9, 7.3, 6.6],
        [2.4, 0.1, 0.5, 1.5, 4.2, 0.4, 5.9],
        [0.8, 0.05, 0.2, 0.5, 4.7, 0.2, 5.3],
    ];
    let gone_m = |steps: &[f64], i: usize| 1e-3 * steps.iter().take(i.saturating_sub(19)).sum::<f64>();
    let at = |i: usize, hand_moves: bool| {
        let mut frame = frame(i, hand(0.0), 0.0, 0.0);
        frame.grip.x_m = if hand_moves { gone_m(&hand_mm, i) } else { 0.0 };
        (0..4).for_each(|k| frame.points_m[k][0] += gone_m(&points_mm[k], i));
        frame
    };
    let of = |hand_moves| outcome(&(0..27).map(|i| at(i, hand_moves)).collect::<Vec<_>>()).unwrap();
    assert_eq!(of(true), ((0..27).collect(), vec![]));
    // Jump of the same size in a hand that stays at rest: the values were held.
    assert!(of(false).1[0].contains("19 of 27 frames (70 %)"));
}

#[test]
fn values_that_are_held_at_the_start_or_at_the_end_are_left_out() {
    for step_m in [0.0, 1e-3] {
        let of = |held: &dyn Fn(usize) -> usize| {
            let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, hand(0.0), swing(held(i) + 4), step_m)).collect();
            outcome(&frames).unwrap()
        };
        let (kept, warnings) = of(&|i| if i < 12 { 0 } else { i });
        assert_eq!(kept, [0].into_iter().chain(12..60).collect::<Vec<_>>(), "{warnings:?}");
        assert!(warnings[0].contains("longest run 11 from 0.03 s to 0.37 s"), "{warnings:?}");
        let (kept, warnings) = of(&|i| i.min(48));
        assert_eq!(kept, (0..=48).collect::<Vec<_>>(), "{warnings:?}");
        // A frame at the turning point: the object would swing back.
        let (kept, warnings) = of(&|i| i.min(41));
        assert_eq!(kept, (0..=41).collect::<Vec<_>>(), "{warnings:?}");
    }
}

#[test]
fn a_keypoint_that_stays_while_the_object_bends_is_named() {
    for k in 0..4 {
        let held = |i: usize| {
            let mut frame = frame(i, hand(0.0), swing(i), 0.0);
            if (20..32).contains(&i) {
                frame.points_m[k] = self::frame(20, hand(0.0), swing(20), 0.0).points_m[k];
            }
            frame
        };
        let (kept, warnings) = outcome(&(0..60).map(held).collect::<Vec<_>>()).unwrap();
        assert_eq!(kept, (0..=20).chain(32..60).collect::<Vec<_>>(), "{warnings:?}");
        let named =
            format!("/dlo/keypoints: 11 of 60 frames (18 %) repeat dlo_u[{k}], dlo_v[{k}] of the frame before them");
        assert!(warnings.len() == 1 && warnings[0].starts_with(&named), "{warnings:?}");
    }
    let throughout = |i: usize| {
        let mut frame = frame(i, hand(0.0), swing(i), 0.0);
        frame.points_m[1] = [0.01, 0.1];
        frame
    };
    let refused = outcome(&(0..60).map(throughout).collect::<Vec<_>>()).unwrap_err();
    assert!(refused.contains("59 of 60 frames (98 %) repeat dlo_u[1], dlo_v[1]"), "{refused}");
}

#[test]
fn equal_frames_in_whole_pixels_at_a_turning_point_are_no_held_values() {
    // Frames half a period before and after a turning point have equal pixels, and their neighbours are pixels away.
    let frames: Vec<PlacedFrame> = (0..60).map(|i| frame(i, hand(0.0), 4.0 * swing(2 * i + 1), 0.005)).collect();
    assert!(frames.windows(2).any(|w| w[0].points_m == w[1].points_m), "the swing has turning points");
    assert_eq!(outcome(&frames).unwrap(), ((0..60).collect(), vec![]));
}
