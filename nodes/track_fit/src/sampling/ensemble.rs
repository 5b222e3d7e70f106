//! Moves of an ensemble of walkers that leave the posterior unchanged.
//!
//! Half of the walkers move at a time. A walker moves along the difference of two walkers of the other half (ter Braak
//! 2006; Nelson, Ford and Payne 2014), or to a draw of the proposal, and Metropolis and Hastings' rule accepts the move.

use super::importance::{Budget, Sample};
use super::scores::Scores;
use crate::error::FitError;
use crate::fitting::OnRound;
use nalgebra::DVector;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

/// Share of the moves that are draws of the proposal.
const INDEPENDENT: f64 = 0.3;
/// Standard deviation of the logarithm of a difference's scale.
const SPREAD: f64 = 0.5;
/// Share of the differences that are taken whole, so that walkers change between modes.
const WHOLE: f64 = 0.1;
/// Standard deviation of the noise of a move, as a share of its difference, and its least size in scores.
const NOISE: f64 = 1e-3;
/// Greatest change of a mean over a block, in standard deviations, of walkers that have settled. The change of 256
/// independent walkers scatters by 0.09.
const SETTLED: f64 = 0.25;
/// Walkers for each effective draw among their starts, at most: equal walkers have no differences to move along.
const FEWEST: f64 = 8.0;
/// Log density under the best walker, beside one for each coordinate, at which a walker is lost in a minimum that has no
/// part in the posterior.
const LOST: f64 = 12.0;
/// States of a block that are kept, beside its last.
const KEPT: usize = 4;

/// Walkers after their moves.
pub struct Moved {
    /// Scores of the walkers at several moves of the last block.
    pub walkers: Vec<DVector<f64>>,
    /// Share of accepted moves.
    pub acceptance: f64,
    /// Greatest change of a mean over the last block, in standard deviations.
    pub drift: f64,
}

/// Walkers that start at draws of `sample`, after enough moves to forget its errors.
pub fn moved(
    scores: &Scores<'_>,
    sample: &Sample,
    budget: Budget,
    rng: &mut impl Rng,
    on_round: OnRound<'_>,
) -> Result<Moved, FitError> {
    let starts = sample.starts(budget.walkers as f64 / FEWEST);
    let (mut walkers, mut densities): (Vec<_>, Vec<_>) = resampled(&starts, budget.walkers, rng)
        .into_iter()
        .map(|i| (sample.draws[i].clone(), sample.densities[i]))
        .unzip();
    let (mut accepted, mut tried, mut drift) = (0, 0, f64::INFINITY);
    let mut kept = Vec::new();
    for block in 0..budget.blocks.max(1) {
        let before = walkers.clone();
        kept.clear();
        for step in 0..budget.block {
            accepted += step_of(scores, sample, (&mut walkers, &mut densities), rng, on_round)?;
            tried += walkers.len();
            if (budget.block - 1 - step).is_multiple_of((budget.block / KEPT).max(1)) {
                kept.extend(walkers.iter().cloned());
            }
        }
        drift = change(&before, &walkers);
        let lost = replace_lost(&mut walkers, &mut densities, rng);
        // The first block only forgets the start, and walkers that were put elsewhere have not moved there yet.
        if block > 0 && drift < SETTLED && lost == 0 {
            break;
        }
    }
    Ok(Moved { walkers: kept, acceptance: f64::from(accepted) / tried as f64, drift })
}

/// Puts lost walkers to where others are; returns their number. It breaks the balance of the moves, so that at least one
/// block follows.
fn replace_lost(walkers: &mut [DVector<f64>], densities: &mut [f64], rng: &mut impl Rng) -> usize {
    let best = densities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = best - LOST - walkers[0].len() as f64;
    let (good, lost): (Vec<usize>, Vec<usize>) = (0..walkers.len()).partition(|&i| densities[i] >= least);
    for &i in &lost {
        let other = good[rng.random_range(0..good.len())];
        (walkers[i], densities[i]) = (walkers[other].clone(), densities[other]);
    }
    lost.len()
}

/// One move of each walker; returns the number of accepted moves.
fn step_of(
    scores: &Scores<'_>,
    sample: &Sample,
    (walkers, densities): (&mut [DVector<f64>], &mut [f64]),
    rng: &mut impl Rng,
    on_round: OnRound<'_>,
) -> Result<u32, FitError> {
    let half = walkers.len() / 2;
    let mut accepted = 0;
    for moving in [0..half, half..walkers.len()] {
        let others: Vec<usize> = (0..walkers.len()).filter(|i| !moving.contains(i)).collect();
        let (mut trials, mut limits) = (Vec::new(), Vec::new());
        for i in moving.clone() {
            let (trial, log_ratio) = trial(walkers, i, &others, sample, rng);
            // Drawn before the simulation, which may end once the trial is sure to be refused.
            let log_u = rng.random::<f64>().max(f64::MIN_POSITIVE).ln();
            limits.push(densities[i] + log_u - log_ratio);
            trials.push(trial);
        }
        let found = scores.log_densities(&trials, Some(&limits), on_round)?;
        for (((i, trial), limit), density) in moving.zip(trials).zip(limits).zip(found) {
            if density > limit {
                (walkers[i], densities[i]) = (trial, density);
                accepted += 1;
            }
        }
    }
    Ok(accepted)
}

/// Trial of walker `i` with the logarithm of the ratio of the proposal's densities, back over there.
fn trial(
    walkers: &[DVector<f64>],
    i: usize,
    others: &[usize],
    sample: &Sample,
    rng: &mut impl Rng,
) -> (DVector<f64>, f64) {
    let here = &walkers[i];
    if rng.random::<f64>() < INDEPENDENT {
        let there = sample.proposal.draw(rng);
        let log_ratio = sample.proposal.log_density(here) - sample.proposal.log_density(&there);
        return (there, log_ratio);
    }
    let d = here.len() as f64;
    let mut pick = || &walkers[others[rng.random_range(0..others.len())]];
    let difference = pick() - pick();
    let gamma = if rng.random::<f64>() < WHOLE {
        1.0
    } else {
        // A scale that changes from move to move lets walkers of a bent density find short moves, too.
        let spread: f64 = StandardNormal.sample(rng);
        2.38 / (2.0 * d).sqrt() * (SPREAD * spread).exp()
    };
    let noise = NOISE * difference.norm().max(NOISE) / d.sqrt();
    let jitter = DVector::from_fn(here.len(), |_, _| -> f64 { StandardNormal.sample(rng) });
    (here + difference * gamma + jitter * noise, 0.0)
}

/// Indices of `count` draws by systematic resampling.
fn resampled(weights: &[f64], count: usize, rng: &mut impl Rng) -> Vec<usize> {
    let (mut at, mut sum) = (0, weights[0]);
    let offset: f64 = rng.random();
    (0..count)
        .map(|i| {
            let quantile = (i as f64 + offset) / count as f64;
            while sum < quantile && at + 1 < weights.len() {
                at += 1;
                sum += weights[at];
            }
            at
        })
        .collect()
}

/// Greatest difference of a coordinate's means in two ensembles, in its standard deviations.
fn change(before: &[DVector<f64>], after: &[DVector<f64>]) -> f64 {
    let moments = |of: &[DVector<f64>], i: usize| {
        let n = of.len() as f64;
        let mean = of.iter().map(|z| z[i]).sum::<f64>() / n;
        (mean, of.iter().map(|z| (z[i] - mean).powi(2)).sum::<f64>() / n)
    };
    let of = |i: usize| {
        let ((a, va), (b, vb)) = (moments(before, i), moments(after, i));
        (a - b).abs() / (0.5 * (va + vb)).sqrt().max(f64::MIN_POSITIVE)
    };
    (0..after[0].len()).map(of).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::proposal::Proposal;
    use super::*;
    use crate::fitting::{Problem, Start};
    use crate::toy::{self, Toy};
    use catenary_core::seed;
    use std::ops::ControlFlow;

    #[test]
    fn resampling_follows_the_weights() {
        let chosen = resampled(&[0.5, 0.0, 0.25, 0.25], 400, &mut seed::rng(1, 0));
        let count = |i: usize| chosen.iter().filter(|c| **c == i).count() as i32;
        assert_eq!(count(1), 0);
        assert!((count(0) - 200).abs() <= 1 && (count(2) - 100).abs() <= 1, "{} {}", count(0), count(2));
    }

    #[test]
    fn lost_walkers_are_put_to_others() {
        let mut walkers: Vec<DVector<f64>> = (0..4).map(|i| DVector::from_element(1, f64::from(i))).collect();
        let mut densities = vec![-1.0, -3.0, -40.0, f64::NEG_INFINITY];
        assert_eq!(replace_lost(&mut walkers, &mut densities, &mut seed::rng(2, 0)), 2);
        assert!(walkers[2][0] < 2.0 && walkers[3][0] < 2.0 && densities.iter().all(|d| *d >= -3.0));
    }

    /// Walkers that start wrong end right: the moves leave the posterior unchanged.
    #[test]
    fn moves_forget_a_wrong_start() {
        let toy = Toy { gain: 0.02 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let scores = Scores::of(&problem, 1.0);
        let mut go_on = || ControlFlow::Continue(());
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
        let proposal = Proposal::of_modes(&[fit]).unwrap();
        let mut rng = seed::rng(3, 0);
        let draws: Vec<DVector<f64>> = (0..64).map(|_| proposal.draw(&mut rng) * 0.3).collect();
        let densities = scores.log_densities(&draws, None, &mut go_on).unwrap();
        let sample = Sample { weights: vec![1.0 / 64.0; 64], effective: 64.0, draws, densities, proposal };
        let budget = Budget { blocks: 4, ..Budget::default() };
        let moved = moved(&scores, &sample, budget, &mut rng, &mut go_on).unwrap();
        // The exact posterior on a grid.
        let grid: Vec<Vec<f64>> = (0..100)
            .flat_map(|i| (0..100).map(move |j| vec![i, j]))
            .map(|p| p.iter().map(|i| 0.005 + 0.01 * f64::from(*i)).collect())
            .collect();
        let costs = problem.costs(&grid, &problem.measured());
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = costs.iter().map(|c| (-0.5 * (c - least)).exp()).collect();
        let total: f64 = weights.iter().sum();
        for i in 0..2 {
            let exact: f64 = grid.iter().zip(&weights).map(|(u, w)| u[i] * w / total).sum();
            let sd: f64 =
                grid.iter().zip(&weights).map(|(u, w)| (u[i] - exact).powi(2) * w / total).sum::<f64>().sqrt();
            let units: Vec<f64> = moved.walkers.iter().map(|z| Scores::to_unit(z)[i]).collect();
            let mean = units.iter().sum::<f64>() / units.len() as f64;
            let spread = (units.iter().map(|u| (u - mean).powi(2)).sum::<f64>() / units.len() as f64).sqrt();
            // 256 walkers at four times; the mean of 256 scatters by 0.06 standard deviations.
            assert!(
                (mean - exact).abs() < 0.2 * sd && (spread / sd - 1.0).abs() < 0.15,
                "{mean} {exact}, {spread} {sd}"
            );
        }
        assert!(moved.acceptance > 0.15, "{}", moved.acceptance);
    }
}
