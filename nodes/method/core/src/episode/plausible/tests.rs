//! Tests of samples that are left out, and of samples that must be kept.

use super::chain::longest_chain;
use super::hand::{PANDA_M_S, PANDA_M_S2, PANDA_RAD_S};
use super::*;
use crate::{Camera, GripPose, Keypoints};

#[test]
fn the_longest_chain_finds_faults_at_either_end_in_a_row_and_one_by_one() {
    let follows = |a: &(f64, f64), b: &(f64, f64)| (a.1 - b.1).abs() < 1.5;
    let chain = |samples: &[f64]| {
        let timed: Vec<(f64, f64)> = samples.iter().enumerate().map(|(i, s)| (i as f64, *s)).collect();
        let flags = longest_chain(&timed, 0.0, follows);
        samples.iter().zip(flags).filter(|(_, f)| *f).map(|(s, _)| *s).collect::<Vec<_>>()
    };
    assert_eq!(chain(&[]), [] as [f64; 0]);
    assert_eq!(chain(&[9.0, 1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
    assert_eq!(chain(&[1.0, 2.0, 3.0, 9.0]), [1.0, 2.0, 3.0]);
    assert_eq!(chain(&[1.0, 9.0, 2.0, 90.0, 3.0, 30.0, 4.0]), [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(chain(&[1.0, 2.0, 9.0, 9.0, 9.0, 2.0, 3.0]), [1.0, 2.0, 2.0, 3.0]);
    assert_eq!(chain(&[9.0, 9.0, 1.0, 2.0, 1.0]), [1.0, 2.0, 1.0]);
}

/// Poses of a hand that swings at the limits of speed and acceleration for 6 s, with a fault in z at one sample.
fn swinging(rate_hz: f64, fault: (usize, f64)) -> Vec<(f64, MeasuredPose)> {
    let frequency = PANDA_M_S2 / PANDA_M_S;
    let pose = |i: usize| {
        let time_s = i as f64 / rate_hz;
        let x_m = 0.4 + PANDA_M_S / frequency * (frequency * time_s).sin();
        let pitch_rad = PANDA_RAD_S / 10.0 * (10.0 * time_s).cos();
        let z_m = 0.4 + if i == fault.0 { fault.1 } else { 0.0 };
        (time_s, GripPose { x_m, z_m, pitch_rad }.into())
    };
    (0..(6.0 * rate_hz) as usize).map(pose).collect()
}

#[test]
fn a_single_fault_is_left_out_at_any_rate_and_a_fast_swing_is_not() {
    for rate_hz in [10.0, 30.0, 200.0] {
        let of = |samples: &[(f64, MeasuredPose)]| poses(samples, &HandLimits::default(), 0).unwrap();
        assert_eq!(of(&swinging(rate_hz, (0, 0.0))).warnings, [] as [String; 0], "{rate_hz}");
        for fault in [0.3, -0.3, 1.0] {
            let found = of(&swinging(rate_hz, (25, fault)));
            let times = swinging(rate_hz, (0, 0.0)).into_iter().map(|s| s.0).enumerate().filter(|(i, _)| *i != 25);
            assert_eq!(
                found.kept.iter().map(|s| s.0).collect::<Vec<_>>(),
                times.map(|(_, t)| t).collect::<Vec<_>>(),
                "{rate_hz} {fault}"
            );
            assert!(found.warnings[0].contains("1 of") && found.warnings[0].contains(" m from the pose"));
        }
    }
    // A step of an ideal arm does not come back, so it is no spike.
    let step =
        |i: usize| (0.1 * i as f64, GripPose { x_m: if i < 20 { 0.3 } else { 0.6 }, ..GripPose::default() }.into());
    let steps: Vec<(f64, MeasuredPose)> = (0..40).map(step).collect();
    assert_eq!(poses(&steps, &HandLimits::default(), 0).unwrap().kept.len(), 40);
    let mut turned = swinging(10.0, (0, 0.0));
    turned[25].1.grip.pitch_rad += 0.5;
    let found = poses(&turned, &HandLimits::default(), 0).unwrap();
    assert!(found.kept.len() == 59 && found.warnings[0].contains("turned by"), "{:?}", found.warnings);
}

#[test]
fn keypoints_that_jump_once_are_left_out_at_any_rate_and_a_whipping_end_is_not() {
    let camera =
        Camera::Plane(crate::camera::Plane { centre_m: [0.0, 0.0], side_m: 2.0, roll_rad: 0.0, distortion_k1: 0.0 });
    // The free end swings at 2 m/s on a circle of 0.1 m. The image shows 2 m on 1000 px.
    let frame = |rate_hz: f64, jump_px: f64, wrong: &dyn Fn(usize) -> bool, i: usize| {
        let time_s = i as f64 / rate_hz;
        let (sine, cosine) = (20.0 * time_s).sin_cos();
        let shift = if wrong(i) { jump_px } else { 0.0 };
        let dlo_px =
            [[300.0, 300.0], [400.0, 350.0], [500.0, 400.0], [600.0 + 50.0 * sine + shift, 500.0 + 50.0 * cosine]];
        let side = 1000;
        let k = Keypoints {
            dlo_px,
            target_px: None,
            scores: [1.0; 4],
            target_score: 0.0,
            image_width_px: side,
            image_height_px: side,
        };
        (time_s, k)
    };
    for rate_hz in [15.0, 30.0, 200.0] {
        let of = |jump_px: f64, wrong: &dyn Fn(usize) -> bool| {
            let frames: Vec<(f64, Keypoints)> = (0..100).map(|i| frame(rate_hz, jump_px, wrong, i)).collect();
            keypoints(&frames, &camera, 0)
        };
        assert_eq!(of(0.0, &|_| false).unwrap().warnings, [] as [String; 0], "{rate_hz}");
        let found = of(250.0, &|i| i == 40).unwrap();
        assert!(
            found.kept.len() == 99 && found.warnings[0].contains("1 of 100 frames"),
            "{rate_hz}: {:?}",
            found.warnings
        );
        let refused = of(1e5, &|i| i % 4 == 3).unwrap_err();
        assert!(refused.contains("25 of 100 frames contradict the others"), "{refused}");
    }
}

#[test]
fn stamps_are_written_with_their_sign_and_all_digits() {
    assert_eq!([1_500_000_000, -1, 0].map(seconds), ["1.500000000", "-0.000000001", "0.000000000"]);
}
