//! Embedding of frames and its gradient.
//!
//! Finite differences are taken in single precision. A feature is good to about 2e-7, and a loss is a sum of a few hundred of
//! them: a central difference of step 1e-2 has an error of 1e-4 from rounding and of 1e-4 from curvature. The bound is 1 % of
//! the gradient's norm for each kind of parameter. A wrong sign or factor is off by 100 % or more.

use super::input::{CHANNELS, PRESENCE};
use super::*;
use catenary_core::track::End;
use catenary_core::{Frame, Track, seed};
use rand::seq::SliceRandom;

const KINDS: [Fourier; 2] = [Fourier::CosOnly, Fourier::CosSin];

fn points(frames: usize, stream: u64) -> Vec<f32> {
    let mut rng = seed::rng(11, stream);
    (0..frames * POINT_VALUES).map(|_| 2.0 * rng.random::<f32>() - 1.0).collect()
}

fn features(embedding: &Embedding, parameters: &[f32], points: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; points.len() / POINT_VALUES * embedding.features()];
    embedding.forward(parameters, points, &mut out, embedding.features());
    out
}

fn frame(dlo: [[f64; 2]; 4]) -> Frame {
    Frame { time_s: 0.25, dlo, target: [0.1, 0.5], eef: [0.4, 0.3, 0.2], action: [0.01, -0.02], wrench: None }
}

#[test]
fn a_frame_is_the_set_of_its_keypoints_to_rounding() {
    let mut rng = seed::rng(12, 0);
    for fourier in KINDS {
        let embedding = Embedding { frequencies: 200, fourier };
        let parameters = embedding.initial(0.3, &mut rng);
        let straight = points(20, 0);
        let mut shuffled = straight.clone();
        for frame in shuffled.chunks_exact_mut(POINT_VALUES) {
            let mut set: Vec<[f32; 2]> = frame.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
            set.shuffle(&mut rng);
            frame.copy_from_slice(set.as_flattened());
        }
        assert_ne!(straight, shuffled);
        let pairs = features(&embedding, &parameters, &straight);
        let worst = pairs.iter().zip(features(&embedding, &parameters, &shuffled)).map(|(a, b)| (a - b).abs());
        let worst = worst.fold(0.0, f32::max);
        // Rounding of four terms of at most 1/4 each, summed in another order.
        assert!(worst <= 4.0 * f32::EPSILON, "{fourier:?}: {worst:e}");
    }
}

#[test]
fn a_track_input_does_not_depend_on_the_keypoints_order_to_the_bit() {
    let set = [[0.1, 0.4], [-0.2, 0.4], [0.3, -0.9], [0.0, 0.1]];
    let of = |order: [usize; 4]| {
        let track = Track { frames: vec![frame(order.map(|i| set[i]))], end: End::Complete };
        TrackInput::new(&track, 3).unwrap()
    };
    let first = of([0, 1, 2, 3]);
    assert_eq!(first.points[..POINT_VALUES], [0.3, -0.9, 0.0, 0.1, -0.2, 0.4, 0.1, 0.4]);
    for order in [[3, 2, 1, 0], [1, 0, 3, 2], [2, 3, 0, 1]] {
        assert_eq!(of(order), first);
    }
}

#[test]
fn a_short_track_is_padded_with_absent_zeros() {
    let track = Track { frames: vec![frame([[0.5; 2]; 4]); 2], end: End::LeftWorkspace };
    let input = TrackInput::new(&track, 4).unwrap();
    assert_eq!((input.frames(), input.channels.len()), (4, 4 * CHANNELS));
    assert_eq!([0, 1, 2, 3].map(|i| input.present(i)), [true, true, false, false]);
    assert_eq!(input.channels[..CHANNELS], [0.4, 0.3, 0.2, 0.01, -0.02, 0.1, 0.5, 1.0]);
    assert_eq!(input.channels[PRESENCE], 1.0);
    assert!(input.points[2 * POINT_VALUES..].iter().chain(&input.channels[2 * CHANNELS..]).all(|v| *v == 0.0));
}

#[test]
fn an_unusable_track_is_an_error_with_the_reason() {
    let with = |dlo| Track { frames: vec![frame([[0.5; 2]; 4]), frame(dlo)], end: End::Complete };
    let long = TrackInput::new(&with([[0.5; 2]; 4]), 1).unwrap_err();
    assert_eq!(long.to_string(), "track: expected 1 to 1 frames, got 2");
    assert_eq!(TrackInput::new(&Track::default(), 3), Err(InputError::Frames { most: 3, got: 0 }));
    // 1e300 is infinite in single precision.
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        let refused = TrackInput::new(&with([[0.5; 2], [0.5, bad], [0.5; 2], [0.5; 2]]), 2);
        assert_eq!(refused, Err(InputError::NotFinite { frame: 1, time_s: 0.25 }), "{bad}");
    }
}

#[test]
fn the_gradient_is_that_of_finite_differences() {
    const STEP: f32 = 1e-2;
    for fourier in KINDS {
        let m = 12;
        let embedding = Embedding { frequencies: m, fourier };
        let mut rng = seed::rng(13, 0);
        let parameters = embedding.initial(0.7, &mut rng);
        let points = points(6, 1);
        let by_feature: Vec<f32> = (0..6 * embedding.features()).map(|_| rng.sample(StandardNormal)).collect();
        let loss = |parameters: &[f32]| -> f64 {
            let features = features(&embedding, parameters, &points);
            features.iter().zip(&by_feature).map(|(f, g)| f64::from(f * g)).sum()
        };
        let mut gradient = vec![0.0; parameters.len()];
        embedding.backward(&parameters, &points, &by_feature, embedding.features(), &mut gradient);
        let difference: Vec<f64> = (0..parameters.len())
            .map(|i| {
                let at = |step: f32| {
                    let mut moved = parameters.clone();
                    moved[i] += step;
                    loss(&moved)
                };
                (at(STEP) - at(-STEP)) / (2.0 * f64::from(STEP))
            })
            .collect();
        let scale = parameters.len() - 2;
        for (kind, range) in [("x", 0..m), ("y", m..2 * m), ("phases", 2 * m..scale), ("scales", scale..scale + 2)] {
            let norm = |v: &dyn Fn(usize) -> f64| range.clone().map(|i| v(i).powi(2)).sum::<f64>().sqrt();
            let off = norm(&|i| difference[i] - f64::from(gradient[i]));
            let size = norm(&|i| difference[i]);
            assert!(off <= 0.01 * size, "{fourier:?}, {kind}: off by {off:.2e} of {size:.2e}");
        }
    }
}

#[test]
fn features_give_the_gaussian_kernel_of_the_length_scale() {
    let (m, length_scale) = (40_000, 0.5);
    let embedding = Embedding { frequencies: m, fourier: Fourier::CosSin };
    let parameters = embedding.initial(length_scale, &mut seed::rng(14, 0));
    let at = |x: f32, y: f32| features(&embedding, &parameters, &[x, y].repeat(4));
    let origin = at(0.1, 0.2);
    for (dx, dy) in [(0.0, 0.0), (0.3, 0.0), (0.0, 0.5), (0.4, -0.6), (1.0, 0.7)] {
        let other = at(0.1 + dx, 0.2 + dy);
        let kernel = origin.iter().zip(&other).map(|(a, b)| f64::from(a * b)).sum::<f64>() / m as f64;
        let exact = (-f64::from(dx * dx + dy * dy) / (2.0 * length_scale * length_scale)).exp();
        // A cosine's standard deviation is at most 1/sqrt(2): four standard errors, one wrong seed in 3,000.
        let bound = 4.0 * (0.5 / m as f64).sqrt();
        assert!((kernel - exact).abs() < bound, "{dx}, {dy}: {kernel} against {exact}");
    }
}
