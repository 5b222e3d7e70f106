//! Update step of PPO's actor (forward, backward, Adam), and the policy's forward pass for twelve environments.

use catenary_core::seed;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ppo_trainer::adam::Adam;
use ppo_trainer::network::Network;
use rand::RngExt;
use std::hint::black_box;

/// Layer sizes of the actor: 12 observations, two hidden layers, two actions.
const SIZES: [usize; 4] = [12, 64, 64, 2];
/// Number of environments in the presets.
const ENVIRONMENTS: usize = 12;

fn inputs(batch: usize) -> Vec<f32> {
    let mut rng = seed::rng(1, 0);
    (0..batch * SIZES[0]).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn network() -> Network {
    Network::new(&SIZES, 0.01, &mut seed::rng(2, 0))
}

fn step(network: &mut Network, adam: &mut Adam, x: &[f32], batch: usize) -> f32 {
    let d_output: Vec<f32> = network.forward(x, batch).iter().map(|v| v - 0.1).collect();
    network.backward(&d_output, batch);
    let blocks = network.mlp.layers_mut().iter_mut().zip(&network.gradients);
    let mut blocks: Vec<(&mut [f32], &[f32])> =
        blocks.flat_map(|(l, g)| [(&mut l.weight[..], &g.weight[..]), (&mut l.bias[..], &g.bias[..])]).collect();
    adam.step(&mut blocks, 1e-3, 0.5)
}

fn update(c: &mut Criterion) {
    let mut group = c.benchmark_group("update");
    for batch in [16, 64, 128] {
        let (mut network, mut adam, x) = (network(), Adam::default(), inputs(batch));
        group.throughput(Throughput::Elements(batch as u64));
        group.bench_function(format!("batch {batch}"), |b| {
            b.iter(|| step(&mut network, &mut adam, black_box(&x), batch));
        });
    }
    group.finish();
}

fn forward(c: &mut Criterion) {
    let (mut network, x) = (network(), inputs(ENVIRONMENTS));
    c.bench_function("forward of 12 environments", |b| b.iter(|| network.forward(black_box(&x), ENVIRONMENTS)[0]));
}

criterion_group!(benches, update, forward);
criterion_main!(benches);
