//! Networks, their gradients, their training and their warm start.
//!
//! Finite differences are taken of a loss whose forward pass is in single precision. The loss is good to about 1e-6 and the
//! step is at least 2e-3 times the parameters' size: a derivative has an error of about 3e-4. The bound is 2 % of the norm of
//! each kind's gradient. A missing or doubled term is off by tens of percent.

use super::*;
use crate::embedding::{Embedding, Fourier, TrackInput};
use crate::settings::Schedule;
use catenary_core::track::End;
use catenary_core::{Frame, Track, seed};
use std::ops::{ControlFlow, Range};

const FRAMES: usize = 3;

/// Tracks that depend on theta, with channels that vary; every third one ends a frame early.
fn samples(n: usize, dimension: usize) -> Samples {
    let mut rng = seed::rng(41, 0);
    let mut samples = Samples::new(FRAMES, dimension);
    for i in 0..n {
        let theta: Vec<f64> = (0..dimension).map(|_| rng.random()).collect();
        let frames = if i % 3 == 2 { FRAMES - 1 } else { FRAMES };
        let frame = |f: usize, rng: &mut rand_chacha::ChaCha8Rng| Frame {
            time_s: f as f64,
            dlo: std::array::from_fn(|k| {
                let noise: [f64; 2] = std::array::from_fn(|_| 0.1 * rng.sample::<f64, _>(StandardNormal));
                [0.4 * theta[k % dimension] + noise[0], 0.3 * k as f64 - 0.5 + 0.1 * f as f64 * theta[0] + noise[1]]
            }),
            target: [0.1, 0.2],
            eef: [0.4 + 0.1 * rng.random::<f64>(), 0.3, 0.0],
            action: [0.0; 2],
            wrench: None,
        };
        let track = Track { frames: (0..frames).map(|f| frame(f, &mut rng)).collect(), end: End::Complete };
        samples.push(&TrackInput::new(&track, FRAMES).unwrap(), &theta);
    }
    samples
}

fn shape(samples: &Samples, projection: Option<usize>, fourier: Fourier) -> Shape {
    Shape {
        frames: FRAMES,
        plain: 0,
        channels: samples.varying_channels(),
        embedding: Embedding { frequencies: 5, fourier },
        projection,
        hidden: vec![7, 6],
        skip: true,
        head: MixtureHead { components: 2, dimension: samples.dimension() },
    }
}

/// Network whose dense parameters all differ from their initial values, including zeros.
fn network(samples: &Samples, weights: &[f64], projection: Option<usize>, fourier: Fourier) -> Network {
    let mut rng = seed::rng(42, 0);
    let mut network = Network::new(shape(samples, projection, fourier), 1.0, samples, weights, &mut rng);
    let dense = network.shape().embedding.parameter_count();
    for p in &mut network.parameters_mut()[dense..] {
        *p += 0.1 * rng.sample::<f32, _>(StandardNormal);
    }
    network
}

/// Kinds of parameters with their indices.
fn kinds(shape: &Shape) -> Vec<(String, Range<usize>)> {
    let m = shape.embedding.frequencies;
    let embedding = shape.embedding.parameter_count();
    let mut kinds = vec![("frequencies".to_owned(), 0..2 * m), ("scales".to_owned(), embedding - 2..embedding)];
    if shape.embedding.fourier == Fourier::CosOnly {
        kinds.push(("phases".to_owned(), 2 * m..3 * m));
    }
    for (layer, ((_, outputs), (weights, biases))) in shape.layers().into_iter().zip(shape.offsets()).enumerate() {
        kinds.push((format!("weights of layer {layer}"), weights..biases));
        kinds.push((format!("biases of layer {layer}"), biases..biases + outputs));
    }
    // Derivatives with respect to the head's biases equal those with respect to its raw outputs.
    let head = shape.parameter_count() - shape.skip_count() - shape.head.outputs();
    let [means, diagonals, belows] = shape.head.offsets();
    let ends = [0, means, diagonals, belows, shape.head.outputs()];
    for (name, at) in ["logits", "means", "diagonals", "below the diagonals"].into_iter().zip(ends.windows(2)) {
        kinds.push((format!("head: {name}"), head + at[0]..head + at[1]));
    }
    kinds.push(("linear path".to_owned(), shape.parameter_count() - shape.skip_count()..shape.parameter_count()));
    kinds
}

#[test]
fn the_gradient_of_every_kind_of_parameter_is_that_of_finite_differences() {
    let samples = samples(30, 2);
    let weights: Vec<f64> = (0..30).map(|i| 0.5 + 0.05 * f64::from(i)).collect();
    for (projection, fourier) in [(None, Fourier::CosOnly), (Some(4), Fourier::CosOnly), (Some(4), Fourier::CosSin)] {
        let network = network(&samples, &weights, projection, fourier);
        let mut work = Activations::default();
        let mut gradient = vec![0.0; network.parameters().len()];
        let x = network.inputs(&samples);
        let (_, by_input) = network.loss_and_gradient(&x, samples.thetas(), &weights, &mut work, &mut gradient);
        network.embedding_gradient(&samples, by_input, &mut gradient);
        let mut loss = |i: usize, step: f32| {
            let mut moved = network.clone();
            moved.parameters_mut()[i] += step;
            let x = moved.inputs(&samples);
            let mut unused = vec![0.0; moved.parameters().len()];
            moved.loss_and_gradient(&x, samples.thetas(), &weights, &mut work, &mut unused).0
        };
        for (kind, range) in kinds(network.shape()) {
            let (mut off, mut size) = (0.0, 0.0);
            for i in range {
                let step = 4e-3_f32;
                let difference = (loss(i, step) - loss(i, -step)) / (2.0 * f64::from(step));
                off += (difference - f64::from(gradient[i])).powi(2);
                size += difference.powi(2);
            }
            let (off, size) = (off.sqrt(), size.sqrt());
            assert!(size > 1e-3, "{projection:?}, {fourier:?}: the loss hardly sees the {kind}: {size:.2e}");
            assert!(off <= 0.02 * size, "{projection:?}, {fourier:?}, {kind}: off by {off:.2e} of {size:.2e}");
        }
    }
}

#[test]
fn the_losses_of_training_and_of_watching_differ_by_the_volume_of_whitening() {
    let samples = samples(12, 2);
    let network = network(&samples, &[1.0; 12], Some(4), Fourier::CosOnly);
    let (x, mut work) = (network.inputs(&samples), Activations::default());
    let mut gradient = vec![0.0; network.parameters().len()];
    let whitened = network.loss_and_gradient(&x, samples.thetas(), &[1.0; 12], &mut work, &mut gradient).0;
    let unit = network.loss(&x, samples.thetas(), &[1.0; 12], &mut work);
    assert!((unit - whitened - network.standard().log_scale()).abs() < 1e-9, "{unit}, {whitened}");
    // Unit coordinates are those of the posterior's mixture.
    let mut density = 0.0;
    for i in 0..12 {
        let (w, m, c) = network.mixture_parts(&samples.gather(&[i]));
        density += catenary_core::Mixture::new(&w, m, c).unwrap().log_density(samples.theta(i)) / 12.0;
    }
    assert!((unit + density).abs() < 1e-4, "{unit} against {density}");
}

#[test]
fn inputs_are_centred_and_scaled_frame_by_frame() {
    let samples = samples(60, 2);
    let weights: Vec<f64> = (0..60).map(|i| 1.0 + f64::from(i % 4)).collect();
    let fresh = Network::new(shape(&samples, None, Fourier::CosOnly), 1.0, &samples, &weights, &mut seed::rng(43, 0));
    let columns = fresh.columns(&samples);
    let width = fresh.shape().columns();
    for column in 0..FRAMES * width {
        let frame = column / width;
        let (mut total, mut sum, mut squares) = (0.0, 0.0, 0.0);
        let presence = fresh.standard.presence == Some(column % width);
        for i in (0..60).filter(|i| presence || samples.present(i * FRAMES + frame)) {
            let v = f64::from(columns[i * FRAMES * width + column]);
            total += weights[i];
            sum += weights[i] * v;
            squares += weights[i] * v * v;
        }
        let (mean, variance) = (sum / total, squares / total);
        // A channel that is constant over all tracks is switched off.
        let channel = (column % width).checked_sub(5).map(|c| fresh.shape().channels[c]);
        let varies = matches!(channel, None | Some(0)) || presence && frame == FRAMES - 1;
        let expected = if varies { 1.0 } else { 0.0 };
        assert!(mean.abs() < 1e-4 && (variance - expected).abs() < 1e-3, "column {column}: {mean}, {variance}");
    }
    for j in 0..2 {
        let v: Vec<f64> = (0..60).map(|i| fresh.standard().whiten(samples.theta(i))[j]).collect();
        let total: f64 = weights.iter().sum();
        let mean = v.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / total;
        let variance = v.iter().zip(&weights).map(|(v, w)| v * v * w).sum::<f64>() / total;
        assert!(mean.abs() < 1e-9 && (variance - 1.0).abs() < 1e-9, "theta {j}: {mean}, {variance}");
    }
}

#[test]
fn keypoints_keep_their_aspect_ratio() {
    let samples = samples(40, 2);
    let fresh = network(&samples, &[1.0; 40], None, Fourier::CosOnly);
    let (raw, scaled) = (samples.points(), fresh.standard.points(&samples));
    let gap = |points: &[f32], axis: usize| points[axis] - points[6 + axis];
    let ratio = [0, 1].map(|axis| gap(&scaled, axis) / gap(raw, axis));
    assert!((ratio[0] / ratio[1] - 1.0).abs() < 1e-4 && ratio[0] > 0.0, "{ratio:?}");
}

#[test]
fn an_absent_frame_enters_only_by_its_presence() {
    let samples = samples(30, 2);
    let network = network(&samples, &[1.0; 30], None, Fourier::CosOnly);
    let width = network.shape().columns();
    let absent = (FRAMES - 1) * width;
    let presence = network.standard.presence.unwrap();
    let (short, whole) = (samples.gather(&[2]), samples.gather(&[1]));
    assert!(!short.present(FRAMES - 1) && whole.present(FRAMES - 1));
    let (of_short, of_whole) = (network.columns(&short), network.columns(&whole));
    assert!(of_short[absent..].iter().enumerate().all(|(c, v)| c == presence || *v == 0.0), "{of_short:?}");
    // A third of the tracks are short: (0 - 2/3) and (1 - 2/3) over sqrt(2/9).
    let seen = [&of_short, &of_whole].map(|columns| columns[absent + presence]);
    assert!((seen[0] + 2.0_f32.sqrt()).abs() < 1e-4 && (seen[1] - 0.5_f32.sqrt()).abs() < 1e-4, "{seen:?}");
    assert!(of_short[..absent].iter().any(|v| *v != 0.0));
    // An absent frame contributes nothing to the embedding's gradient.
    let mut by_column = vec![1.0; FRAMES * width];
    network.standard.scale_gradient(&short, &mut by_column);
    assert!(by_column[absent..].iter().all(|v| *v == 0.0));
}

#[test]
fn constant_channels_do_not_enter_the_network() {
    // The first two tracks are complete and differ in the end effector's x. A short one is padded with zeros.
    assert_eq!(samples(2, 2).varying_channels(), vec![0]);
    assert_eq!(samples(30, 2).varying_channels(), vec![0, 1, 5, 6, crate::embedding::input::PRESENCE]);
}

fn schedule() -> Schedule {
    Schedule { max_epochs: 15, patience_epochs: 15, batch_size: 10, ..crate::Settings::default().schedule }
}

fn trained(schedule: &Schedule, stream: u64) -> (Network, Result<Trained, TrainingError>, Vec<Epoch>) {
    let samples = samples(100, 2);
    let (training, held_out): (Vec<usize>, Vec<usize>) = (0..100).partition(|i| i % 5 != 0);
    let mut rng = seed::rng(44, stream);
    let weights = [1.0; 100];
    let mut network = Network::new(shape(&samples, Some(6), Fourier::CosOnly), 1.0, &samples, &weights, &mut rng);
    let mut heard = Vec::new();
    let mut listen = |epoch| {
        heard.extend(epoch);
        ControlFlow::Continue(())
    };
    let outcome = train(&mut network, &samples, &training, &held_out, &weights, schedule, &mut rng, &mut listen);
    (network, outcome, heard)
}

#[test]
fn training_keeps_the_parameters_of_the_best_pass() {
    let greedy = Schedule { learning_rate: 1e-2, weight_decay: 0.0, max_epochs: 60, patience_epochs: 60, ..schedule() };
    let (network, outcome, heard) = trained(&greedy, 0);
    let outcome = outcome.unwrap();
    let best = heard.iter().map(|e| e.held_out_loss).fold(f64::INFINITY, f64::min);
    assert_eq!((outcome.epochs, outcome.held_out_loss), (heard.len(), best));
    assert!(heard[heard.len() - 1].held_out_loss > best + 0.1, "the last pass is the best: {heard:?}");
    assert!(best < heard[0].held_out_loss - 0.1, "hardly learnt: {heard:?}");
    let samples = samples(100, 2);
    let held_out = samples.gather(&(0..20).map(|i| 5 * i).collect::<Vec<_>>());
    let x = network.inputs(&held_out);
    let loss = network.loss(&x, held_out.thetas(), &[1.0; 20], &mut Activations::default());
    assert_eq!(loss, best);
}

#[test]
fn patience_ends_training_and_a_frozen_embedding_stays() {
    let hasty = Schedule { learning_rate: 1e-30, patience_epochs: 2, max_epochs: 50, ..schedule() };
    let (_, outcome, _) = trained(&hasty, 0);
    assert_eq!(outcome.unwrap().epochs, 2);
    let count = shape(&samples(3, 2), None, Fourier::CosOnly).embedding.parameter_count();
    let frozen = trained(&Schedule { train_embedding: false, ..schedule() }, 0).0;
    let free = trained(&schedule(), 0).0;
    let start = trained(&Schedule { max_epochs: 0, ..schedule() }, 0).0;
    assert_eq!(frozen.parameters()[..count], start.parameters()[..count]);
    assert_ne!(frozen.parameters()[count..], start.parameters()[count..]);
    assert_ne!(free.parameters()[..count], start.parameters()[..count]);
}

#[test]
fn a_loss_that_is_not_finite_is_a_clear_error() {
    let wild = Schedule { learning_rate: 1e30, max_gradient_norm: 1e30, weight_decay: 0.0, ..schedule() };
    let error = trained(&wild, 0).1.unwrap_err();
    let TrainingError::NotFinite { epoch: 1, .. } = error else { panic!("{error:?}") };
    let words = error.to_string();
    assert!(words.starts_with("training failed in epoch 1: the "), "{words}");
    assert!(words.contains("expected a finite number; a lower learning rate or gradient norm may help"), "{words}");
}

#[test]
fn a_restarted_network_is_the_same_function_in_other_coordinates() {
    let all = samples(60, 2);
    // Thetas in a corner of the prior have other centres and scales. Some tracks are short.
    let corner: Vec<usize> = (0..60).filter(|&i| all.theta(i).iter().all(|u| *u > 0.4)).collect();
    assert!(corner.iter().any(|i| i % 3 == 2) && corner.iter().any(|i| i % 3 != 2));
    let part = all.gather(&corner);
    let weights: Vec<f64> = (0..part.len()).map(|i| 1.0 + (i % 3) as f64).collect();
    // 45 components cover all of the columns' variance.
    for projection in [None, Some(45)] {
        let mut before = network(&all, &[1.0; 60], projection, Fourier::CosOnly);
        // Diagonals at which the bend is strong.
        let biases = before.shape.parameter_count() - before.shape.skip_count() - before.shape.head.outputs();
        let [_, diagonals, belows] = before.shape.head.offsets();
        before.parameters[biases + diagonals..biases + belows].iter_mut().for_each(|p| *p += 3.0);
        let after = before.restarted(&part, &weights, &mut seed::rng(45, 0));
        assert_ne!(before.standard().theta(), after.standard().theta());
        let mut worst = [0.0f64; 3];
        for &i in &corner {
            let batch = all.gather(&[i]);
            let ((w, m, c), (v, n, d)) = (before.mixture_parts(&batch), after.mixture_parts(&batch));
            for k in 0..w.len() {
                worst[0] = worst[0].max((w[k] - v[k]).abs());
                worst[1] = worst[1].max((&m[k] - &n[k]).amax());
                worst[2] = worst[2].max((&c[k] - &d[k]).amax() / c[k].amax());
            }
        }
        // Single precision. Covariances are exact at the mean diagonals, and elsewhere up to the curvature of the bend.
        assert!(worst[0] < 1e-3 && worst[1] < 1e-3 && worst[2] < 0.08, "{projection:?}: {worst:?}");
    }
}

#[test]
fn networks_survive_json_to_the_bit_and_parts_that_do_not_fit_are_detected() {
    let samples = samples(20, 2);
    let whole = network(&samples, &[1.0; 20], Some(6), Fourier::CosSin);
    let text = serde_json::to_string(&whole).unwrap();
    assert_eq!(serde_json::from_str::<Network>(&text).unwrap(), whole);
    assert!(whole.is_whole());
    type Change = fn(&mut Network);
    let spoilt: [Change; 4] = [
        |n| n.parameters.truncate(7),
        |n| n.shape.hidden = vec![7, 5],
        |n| n.projection = None,
        |n| n.standard.columns.centre.truncate(7),
    ];
    for (case, change) in spoilt.into_iter().enumerate() {
        let mut network = whole.clone();
        change(&mut network);
        assert!(!network.is_whole(), "case {case}");
    }
    type Spoil = fn(&mut Network) -> &mut f32;
    assert!(whole.is_finite());
    let infinite: [Spoil; 2] = [|n| &mut n.parameters[3], |n| n.projection.as_mut().unwrap().entry_mut(3)];
    for (case, entry) in infinite.into_iter().enumerate() {
        let mut network = whole.clone();
        *entry(&mut network) = f32::NAN;
        assert!(network.is_whole() && !network.is_finite(), "case {case}");
    }
    let odd = text.replacen("\"parameters\":\"", "\"parameters\":\"AAAA", 1);
    assert!(serde_json::from_str::<Network>(&odd).unwrap_err().to_string().contains("numbers of 4 bytes"));
}
