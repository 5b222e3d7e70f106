use super::*;
use crate::toy;
use catenary_core::camera::HALF_MASK_PX;
use catenary_core::episode::MeasuredTrack;
use catenary_core::track::End;
use catenary_core::{Frame, KeypointOrder, Track, seed};
use rand_distr::{Distribution, StandardNormal};

/// Deflections of the keypoints in the first two modes of a clamped beam, relative to the largest.
const MODES: [[f64; 4]; 2] = [[0.05, 0.25, 0.6, 1.0], [0.4, 0.9, 0.3, -1.0]];
const SEEDS: u64 = 200;

/// Noise of a track: standard deviation in px, and the time in s of its exponential correlation.
#[derive(Clone, Copy)]
struct Noise {
    px: f64,
    time_s: f64,
}

const fn white(px: f64) -> Noise {
    Noise { px, time_s: 0.0 }
}

/// Keypoints in px of a bar that swings by `px` at the tip, at `hz` in its first mode and six times as fast in its second.
fn swing(time_s: f64, px: f64, hz: f64) -> [[f64; 2]; 4] {
    let at = |mode: usize, hz: f64| {
        (-0.5 * time_s).exp() * (std::f64::consts::TAU * hz * time_s).cos() * px / [1.0, 20.0][mode]
    };
    std::array::from_fn(|k| {
        let x = MODES[0][k] * at(0, hz) + MODES[1][k] * at(1, 6.0 * hz);
        [x, 20.0 * (k as f64 + 1.0) - x * x / 200.0]
    })
}

/// Track of `count` frames at `rate_hz` of a bar that swings by `swing_px` at 1 Hz.
fn track(count: usize, rate_hz: f64, swing_px: f64, noise: Noise, number: u64) -> Track {
    let mut rng = seed::rng(91, number);
    let times: Vec<f64> = (0..count).map(|i| i as f64 / rate_hz).collect();
    let mut errors = [[0.0_f64; 2]; 4];
    let frame = |(i, time_s): (usize, &f64)| {
        let kept = if noise.time_s > 0.0 { (-1.0 / (rate_hz * noise.time_s)).exp() } else { 0.0 };
        let kept = if i == 0 { 0.0 } else { kept };
        for e in errors.iter_mut().flatten() {
            let new: f64 = StandardNormal.sample(&mut rng);
            *e = kept * *e + (1.0 - kept * kept).sqrt() * noise.px * new;
        }
        let places = swing(*time_s, swing_px, 1.0);
        let dlo = std::array::from_fn(|k| std::array::from_fn(|i| (places[k][i] + errors[k][i]) / HALF_MASK_PX));
        Frame { time_s: *time_s, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None }
    };
    Track { frames: times.iter().enumerate().map(frame).collect(), end: End::Complete }
}

fn estimated(track: &Track) -> NoiseEstimate {
    noise_of(&[Series::of(track, KeypointOrder::Along)], 0.0).unwrap()
}

/// Upper end of the interval of 95 % in px.
fn high(track: &Track) -> f64 {
    estimated(track).high(Z_95) * HALF_MASK_PX
}

/// Number of seeds for which `holds` does.
fn count(holds: impl Fn(u64) -> bool) -> usize {
    (0..SEEDS).filter(|seed| holds(*seed)).count()
}

/// Judgement of a stated noise by one track.
fn judged(track: &Track, stated_px: f64) -> KeypointNoise {
    let mut model = toy::model();
    model.camera.keypoint_noise_px = stated_px;
    let measured = MeasuredTrack { track: track.clone(), ..toy::measured(&toy::Toy { gain: 0.0 }, [0.25, 2e4], &[]) };
    KeypointNoise::stated(&model).by_recordings(&[measured], KeypointOrder::Along)
}

/// 200 seeds: with 95 % of them expected, fewer than 180 happen by chance once in a thousand.
#[test]
fn the_interval_of_white_noise_covers_it_beside_motion() {
    for px in [0.2, 0.7, 2.0] {
        for (frames, rate_hz) in [(31, 20.0), (60, 30.0), (120, 60.0)] {
            let covered = count(|seed| {
                let e = estimated(&track(frames, rate_hz, 30.0, white(px), seed));
                (e.low(Z_95) * HALF_MASK_PX..=e.high(Z_95) * HALF_MASK_PX).contains(&px)
            });
            assert!(covered >= 180, "{px} px, {frames} frames at {rate_hz} Hz: {covered}");
        }
    }
    // The interval has two ends where the frames are fast for the motion, and is narrow.
    let two_ended = count(|seed| {
        let e = estimated(&track(120, 60.0, 30.0, white(0.7), seed));
        e.is_white() && e.high(Z_95) < 1.3 * e.low(Z_95)
    });
    assert!(two_ended >= 190, "{two_ended}");
}

#[test]
fn a_stated_noise_that_is_right_stands() {
    for (frames, rate_hz) in [(5, 4.0), (17, 4.0), (31, 20.0), (60, 30.0)] {
        for swing_px in [0.0, 30.0] {
            let changed = |noise: Noise| {
                count(|seed| {
                    let judged = judged(&track(frames, rate_hz, swing_px, noise, seed), noise.px);
                    judged.is_overruled() || (noise.time_s == 0.0 && judged.is_unknown)
                })
            };
            // Correlated noise hides in its differences, but is not taken for less white noise.
            let slow = Noise { px: 0.7, time_s: 0.3 };
            let both = [white(0.7), slow].map(changed);
            assert!(both.iter().all(|n| *n <= 1), "{frames} frames at {rate_hz} Hz, swing of {swing_px} px: {both:?}");
        }
    }
}

#[test]
fn a_stated_noise_that_is_too_large_or_too_small_is_overruled() {
    for (times, least) in [(3.0, 150), (10.0, 150), (1.0 / 3.0, 150)] {
        let right = count(|seed| {
            let judged = judged(&track(60, 30.0, 20.0, white(1.0), seed), times);
            judged.is_overruled() && !judged.is_unknown && (judged.used_px - 1.0).abs() < 0.35
        });
        assert!(right >= least, "stated {times} times: {right}");
    }
    // A swing of 1 Hz is too fast for four frames a second: nothing shows that it is no noise.
    assert_eq!(count(|seed| judged(&track(17, 4.0, 30.0, white(0.2), seed), 0.2).is_overruled()), 0);
}

#[test]
fn correlated_and_smoothed_noise_is_not_known() {
    let slow = track(60, 30.0, 30.0, Noise { px: 0.7, time_s: 0.3 }, 1);
    assert!(!estimated(&slow).is_white() && high(&slow) < 0.3, "{:?}", estimated(&slow));
    let doubt = judged(&slow, 0.7);
    assert!(doubt.is_unknown && doubt.used_px == 0.7 && doubt.interval_px.unwrap()[0] == 0.0, "{doubt:?}");
    // A tracker that takes the mean of three frames.
    let mut smooth = track(60, 30.0, 0.0, white(0.7), 1);
    let raw = smooth.clone();
    for (i, frame) in smooth.frames.iter_mut().enumerate().skip(2) {
        let mean = |k: usize, axis: usize| raw.frames[i - 2..=i].iter().map(|f| f.dlo[k][axis]).sum::<f64>() / 3.0;
        frame.dlo = std::array::from_fn(|k| [mean(k, 0), mean(k, 1)]);
    }
    smooth.frames.drain(..2);
    assert!(!judged(&smooth, 0.7 / 3f64.sqrt()).is_overruled(), "{:?}", estimated(&smooth));
}

#[test]
fn repeated_frames_are_no_evidence() {
    let mut held = track(120, 30.0, 20.0, white(0.7), 2);
    let whole = high(&held);
    for i in 1..held.frames.len() {
        // Five of eight frames repeat the one before, as in a recording of a cable; the last forty are frozen.
        if !matches!(i % 8, 0 | 3 | 6) || i >= 80 {
            held.frames[i].dlo = held.frames[i - 1].dlo;
        }
    }
    assert!(high(&held) > 0.7 && high(&held) > whole, "{} {whole}", high(&held));
    // One keypoint is held throughout.
    let mut one = track(120, 30.0, 20.0, white(0.7), 2);
    let first = one.frames[0].dlo[1];
    one.frames.iter_mut().for_each(|f| f.dlo[1] = first);
    assert!((high(&one) / whole - 1.0).abs() < 0.1, "{} {whole}", high(&one));
    one.frames.iter_mut().for_each(|f| f.dlo = [first; 4]);
    assert_eq!(noise_of(&[Series::of(&one, KeypointOrder::Along)], 0.0), None);
}

#[test]
fn rounded_coordinates_show_their_rounding_alone() {
    let rounded = |px: f64| {
        let mut track = track(60, 30.0, 10.0, white(px), 3);
        track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut().flatten()).for_each(|v| {
            *v = (*v * HALF_MASK_PX).round() / HALF_MASK_PX;
        });
        track
    };
    assert!(estimated(&rounded(0.05)).is_rounded && judged(&rounded(0.05), 3.0).is_unknown);
    let fine = estimated(&rounded(0.7));
    // Rounding to whole pixels adds 1 / 12 to the variance.
    let expected = 0.49_f64 + 1.0 / 12.0;
    assert!(!fine.is_rounded && fine.high(Z_95) * HALF_MASK_PX > expected.sqrt(), "{fine:?}");
}

#[test]
fn impacts_flips_and_missing_frames_do_not_change_the_noise() {
    let clean = track(120, 60.0, 20.0, white(0.7), 4);
    let mut spoilt = clean.clone();
    for i in [20, 55, 90] {
        spoilt.frames[i].dlo[2][0] += 30.0 / HALF_MASK_PX;
        spoilt.frames[i + 10].dlo.reverse();
    }
    let mut number = 0;
    spoilt.frames.retain(|_| {
        number += 1;
        number % 7 != 0
    });
    let [clean, spoilt] = [&clean, &spoilt].map(estimated);
    assert!((spoilt.sd / clean.sd - 1.0).abs() < 0.15 && spoilt.is_white(), "{clean:?} {spoilt:?}");
}

#[test]
fn a_short_recording_bounds_little() {
    let of = |frames| noise_of(&[Series::of(&track(frames, 20.0, 0.0, white(0.7), 5), KeypointOrder::Along)], 0.0);
    assert!(of(2).is_none());
    let five = of(5).unwrap();
    assert!(five.high(Z_95) > 1.3 * five.sd, "{five:?}");
}

#[test]
fn keypoints_of_a_curve_with_two_coefficients_do_not_err_independently() {
    let mut bound = track(120, 30.0, 0.0, white(0.7), 6);
    for frame in &mut bound.frames {
        let [a, b] = [frame.dlo[0][0], frame.dlo[1][0]];
        frame.dlo = std::array::from_fn(|k| [0.2 * k as f64 + a * k as f64, b * (k * k) as f64]);
    }
    let (bound, free) = (estimated(&bound), estimated(&track(120, 30.0, 0.0, white(0.7), 6)));
    assert!(bound.independent < 0.3 && free.independent > 0.9, "{} {}", bound.independent, free.independent);
    assert!(bound.effective < 0.4 * free.effective, "{} {}", bound.effective, free.effective);
}
