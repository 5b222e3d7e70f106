//! Costly steps of an inference: embedding tracks, training steps, and draws for training domains.

use std::hint::black_box;
use std::ops::ControlFlow;

use bayes_sim::Settings;
use bayes_sim::embedding::TrackInput;
use bayes_sim::network::{Network, Samples, Shape, train};
use bayes_sim::settings::Schedule;
use catenary_core::track::End;
use catenary_core::{Frame, Mixture, Parameter, ParameterSpace, Posterior, Prior, Track, seed};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::RngExt;

/// Frames of a track: eight seconds at 4 Hz.
const FRAMES: usize = 33;
/// Tracks of a batch.
const TRACKS: usize = 100;
/// Environments of a training.
const DOMAINS: usize = 12;

/// Random tracks.
fn tracks() -> Samples {
    let mut samples = Samples::new(FRAMES, 2);
    for i in 0..TRACKS as u64 {
        let mut rng = seed::rng(1, i);
        let frames = (0..FRAMES).map(|f| Frame {
            time_s: 0.25 * f as f64,
            dlo: std::array::from_fn(|k| [rng.random::<f64>() - 0.5, 0.4 * k as f64 - 0.6 + 0.1 * rng.random::<f64>()]),
            target: [0.1, 0.5],
            eef: [0.4 + 0.1 * rng.random::<f64>(), 0.3 + 0.1 * rng.random::<f64>(), 0.0],
            action: [0.0; 2],
            wrench: None,
        });
        let track = Track { frames: frames.collect(), end: End::Complete };
        let input = TrackInput::new(&track, FRAMES).expect("the tracks are finite and of that length");
        samples.push(&input, &[rng.random(), rng.random()]);
    }
    samples
}

fn network(settings: &Settings, samples: &Samples) -> Network {
    let shape = Shape::of_samples(samples, settings);
    Network::new(shape, settings.length_scale, samples, &[1.0; TRACKS], &mut seed::rng(2, 0))
}

fn networks(c: &mut Criterion) {
    let samples = tracks();
    for (name, settings) in [("default", Settings::default()), ("paper", Settings::paper())] {
        let network = network(&settings, &samples);
        let mut group = c.benchmark_group(name);
        group.sample_size(10);
        group.throughput(Throughput::Elements(TRACKS as u64));
        group.bench_function("embed 100 tracks", |b| b.iter(|| black_box(network.columns(&samples))));
        // One step on a whole batch, with the loss of one held-out track before and after it.
        let schedule = Schedule { max_epochs: 1, batch_size: TRACKS, ..settings.schedule };
        let indices: Vec<usize> = (0..settings.schedule.batch_size).collect();
        group.throughput(Throughput::Elements(indices.len() as u64));
        group.bench_function("one training step", |b| {
            let mut network = network.clone();
            let mut rng = seed::rng(3, 0);
            b.iter(|| {
                let mut listen = |_| ControlFlow::Continue(());
                train(&mut network, &samples, &indices, &[0], &[1.0; TRACKS], &schedule, &mut rng, &mut listen)
                    .expect("the tracks are fit to learn from")
            });
        });
        group.finish();
    }
}

fn draws(c: &mut Criterion) {
    let samples = tracks();
    let network = network(&Settings::default(), &samples);
    let (weights, means, covariances) = network.mixture_parts(&samples.gather(&[0]));
    let mixture = Mixture::new(&weights, means, covariances).expect("the parts are a mixture's");
    let unit = |name: &str| Parameter { name: name.to_owned(), prior: Prior::Uniform { low: 0.0, high: 1.0 } };
    let parameters = ParameterSpace::new(vec![unit("x"), unit("y")]).expect("the priors are proper");
    let posterior = Posterior { parameters, mixture };
    c.bench_function("12 low-variance draws", |b| b.iter(|| black_box(posterior.sample_low_variance(DOMAINS, 1))));
}

criterion_group!(benches, networks, draws);
criterion_main!(benches);
