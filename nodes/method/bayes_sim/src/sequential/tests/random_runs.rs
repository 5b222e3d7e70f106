//! Inferences with random settings. Each must give finite marginals.

use super::linear_gaussian::{FRAMES, LinearGaussian};
use super::*;
use crate::settings::Schedule;
use rand::seq::IndexedRandom;

const RUNS: u64 = 200;

/// Random small settings, including bad learning rates and decays.
fn settings(rng: &mut rand_chacha::ChaCha8Rng, seed: u64) -> Settings {
    let proposals = [
        ProposalKind::Truncated { tail: 10f64.powf(rng.random_range(-5.0..-0.5)), least_shrink: 0.25 },
        ProposalKind::Posterior { prior_share: rng.random_range(0.01..0.9) },
    ];
    let fourier = [Fourier::CosOnly, Fourier::CosSin];
    Settings {
        iterations: rng.random_range(2..6),
        simulations: rng.random_range(10..60),
        proposal: *proposals.choose(rng).unwrap(),
        embedding: Embedding { frequencies: rng.random_range(1..12), fourier: *fourier.choose(rng).unwrap() },
        length_scale: 10f64.powf(rng.random_range(-2.0..2.0)),
        projection: [None, Some(rng.random_range(1..20))].choose(rng).copied().flatten(),
        hidden: vec![rng.random_range(1..20); rng.random_range(1..4)],
        skip: rng.random(),
        components: rng.random_range(1..9),
        ensemble: rng.random_range(1..4),
        warm_start: rng.random(),
        schedule: Schedule {
            learning_rate: 10f64.powf(rng.random_range(-6.0..-0.5)),
            weight_decay: [0.0, 10f64.powf(rng.random_range(-3.0..0.3))].choose(rng).copied().unwrap_or(0.0),
            train_embedding: rng.random(),
            batch_size: rng.random_range(1..80),
            max_epochs: rng.random_range(1..8),
            ..Settings::default().schedule
        },
        seed,
        ..Settings::default()
    }
}

/// Runs an inference with random settings. The error describes the run. It is returned if the inference fails, a number is
/// not finite, or a standard deviation is not positive.
fn fault(number: u64) -> Result<(), String> {
    let mut rng = seed::rng(91, number);
    let settings = settings(&mut rng, number);
    // From tracks that determine theta to tracks that are nothing but noise.
    let noise = 10f64.powf(rng.random_range(-6.0..1.0));
    let mirrored = [0.0, 0.3][number as usize % 2];
    let toy = LinearGaussian { dimension: rng.random_range(1..5), noise, mirrored, rigid: false };
    let space = toy.space();
    let observed = toy.track(&space.sample_prior(&mut rng), number);
    let words = |why: &dyn std::fmt::Display| format!("run {number}: {why}; {settings:?}");
    let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).map_err(|e| words(&e))?;
    let (last, posterior) = run(&mut sequential, &toy, settings.iterations).map_err(|e| words(&e))?;
    let marginals = posterior.marginals().map_err(|e| words(&e))?;
    let of = |m: &catenary_core::posterior::Marginal| [m.mean, m.sd, m.q05, m.median, m.q95];
    let numbers: Vec<f64> = marginals.iter().flat_map(of).chain([last.loss]).collect();
    let is_whole = numbers.iter().all(|v| v.is_finite()) && marginals.iter().all(|m| m.sd > 0.0);
    if is_whole { Ok(()) } else { Err(words(&format!("{numbers:?}"))) }
}

#[test]
fn two_hundred_random_runs_give_finite_marginals() {
    let faults: Vec<String> = (0..RUNS).filter_map(|i| fault(i).err()).collect();
    assert!(faults.is_empty(), "{} of {RUNS}: {faults:#?}", faults.len());
}
