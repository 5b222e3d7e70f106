//! Moves of an ensemble of walkers that leave the posterior unchanged.
//!
//! Half of the walkers move at a time. A walker moves along the difference of two walkers of the other half (ter Braak
//! 2006; Nelson, Ford and Payne 2014), or to a draw of a proposal, and Metropolis and Hastings' rule accepts the move. The
//! proposal was fitted to the walkers themselves, so that the second kind is exact only for many of them.

use super::budget::Budget;
use super::proposal::Proposal;
use super::scores::Scores;
use crate::error::FitError;
use crate::fitting::OnRound;
use catenary_core::mixture::pick;
use nalgebra::DVector;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

/// Share of the moves that are draws of the proposal.
const INDEPENDENT: f64 = 0.5;
/// Share of the known modes in a proposal.
const OF_MODES: f64 = 0.1;
/// Standard deviation of the logarithm of a difference's scale.
const SPREAD: f64 = 0.5;
/// Share of the differences that are taken whole, so that walkers change between modes.
const WHOLE: f64 = 0.1;
/// Standard deviation of the noise of a move, as a share of the length of its difference.
const NOISE: f64 = 1e-3;
/// Least length that a difference is taken for, in scores: copies of a walker must part.
const LEAST_LENGTH: f64 = 1e-3;
/// Greatest change of a mean over a block, in standard deviations, of walkers that have settled. The change of 256
/// independent walkers scatters by 0.09.
const SETTLED: f64 = 0.25;
/// States of a block that are kept.
const STATES: usize = 4;

/// Walkers with their likelihoods.
pub struct Ensemble {
    /// Scores of the walkers.
    pub walkers: Vec<DVector<f64>>,
    /// Log likelihoods there, up to a constant.
    pub likelihoods: Vec<f64>,
    /// Proposal of independent moves.
    pub proposal: Proposal,
    /// Power of the likelihood in the distribution that the moves leave unchanged.
    pub power: f64,
    /// Scores with the greatest likelihood so far, and that.
    pub best: (DVector<f64>, f64),
}

/// Walkers after their last moves.
pub struct Moved {
    /// Scores of the walkers at several moves of the last block.
    pub walkers: Vec<DVector<f64>>,
    /// Share of accepted moves in the last block.
    pub acceptance: f64,
    /// Greatest change of a mean over the last block, in standard deviations.
    pub drift: f64,
    /// Scores with the greatest likelihood of all.
    pub best: DVector<f64>,
}

impl Ensemble {
    /// Fits the proposal to the walkers, beside `modes`.
    pub fn learn(&mut self, modes: &Proposal) {
        if let Some(learnt) = learnt(&self.walkers, modes) {
            self.proposal = learnt;
        }
    }

    /// Moves the walkers until they have settled.
    pub fn settle(
        mut self,
        scores: &Scores<'_>,
        (budget, modes): (Budget, &Proposal),
        rng: &mut impl Rng,
        on_round: OnRound<'_>,
    ) -> Result<Moved, FitError> {
        let (mut accepted, mut tried, mut drift) = (0, 0, f64::INFINITY);
        let mut kept = Vec::new();
        for block in 0..budget.blocks.max(1) {
            let before = self.walkers.clone();
            (accepted, tried) = (0, 0);
            kept.clear();
            for step in 0..budget.block {
                accepted += self.step(scores, rng, on_round)?;
                tried += self.walkers.len();
                if (budget.block - 1 - step).is_multiple_of((budget.block / STATES).max(1)) {
                    kept.extend(self.walkers.iter().cloned());
                }
            }
            drift = change(&before, &self.walkers);
            // The first block forgets copies that the last resampling made.
            if block > 0 && drift < SETTLED {
                break;
            }
            self.proposal = learnt(&kept, modes).unwrap_or(self.proposal);
        }
        // The states of a walker follow each other: they depend on one another, and halves of the list do not share walkers.
        let count = self.walkers.len();
        let by_walker = (0..count).flat_map(|walker| kept.iter().skip(walker).step_by(count).cloned()).collect();
        Ok(Moved { walkers: by_walker, acceptance: f64::from(accepted) / tried as f64, drift, best: self.best.0 })
    }

    /// Moves each walker once; returns the number of accepted moves.
    pub fn step(&mut self, scores: &Scores<'_>, rng: &mut impl Rng, on_round: OnRound<'_>) -> Result<u32, FitError> {
        let half = self.walkers.len() / 2;
        let prior = |z: &DVector<f64>| -0.5 * z.norm_squared();
        let mut accepted = 0;
        for moving in [0..half, half..self.walkers.len()] {
            let others: Vec<usize> = (0..self.walkers.len()).filter(|i| !moving.contains(i)).collect();
            let (mut trials, mut limits) = (Vec::new(), Vec::new());
            for i in moving.clone() {
                let (trial, log_ratio) = self.trial(i, &others, rng);
                // Drawn before the simulation, which may end once the trial is sure to be refused.
                let log_u = rng.random::<f64>().max(f64::MIN_POSITIVE).ln();
                let gained = prior(&self.walkers[i]) - prior(&trial);
                limits.push(self.likelihoods[i] + (gained + log_u - log_ratio) / self.power);
                trials.push(trial);
            }
            let found = scores.log_likelihoods(&trials, Some(&limits), on_round)?;
            for (((i, trial), limit), likelihood) in moving.zip(trials).zip(limits).zip(found) {
                if likelihood > limit {
                    if likelihood > self.best.1 {
                        self.best = (trial.clone(), likelihood);
                    }
                    (self.walkers[i], self.likelihoods[i]) = (trial, likelihood);
                    accepted += 1;
                }
            }
        }
        Ok(accepted)
    }

    /// Trial of walker `i` with the logarithm of the ratio of the proposal's densities, here over there.
    fn trial(&self, i: usize, others: &[usize], rng: &mut impl Rng) -> (DVector<f64>, f64) {
        let here = &self.walkers[i];
        if rng.random::<f64>() < INDEPENDENT {
            let there = self.proposal.draw(rng);
            let log_ratio = self.proposal.log_density(here) - self.proposal.log_density(&there);
            return (there, log_ratio);
        }
        let d = here.len() as f64;
        let mut pick = || &self.walkers[others[rng.random_range(0..others.len())]];
        let difference = pick() - pick();
        let gamma = if rng.random::<f64>() < WHOLE {
            1.0
        } else {
            // A scale that changes from move to move lets walkers of a bent density find short moves, too.
            let spread: f64 = StandardNormal.sample(rng);
            2.38 / (2.0 * d).sqrt() * (SPREAD * spread).exp()
        };
        let noise = NOISE * difference.norm().max(LEAST_LENGTH) / d.sqrt();
        let jitter = DVector::from_fn(here.len(), |_, _| -> f64 { StandardNormal.sample(rng) });
        (here + difference * gamma + jitter * noise, 0.0)
    }
}

/// Proposal that is fitted to states of walkers, beside `modes`; none if the states lie in a plane.
fn learnt(states: &[DVector<f64>], modes: &Proposal) -> Option<Proposal> {
    Some(Proposal::of_draws(states)?.with(modes, OF_MODES))
}

/// Indices of `count` draws by systematic resampling.
pub fn resampled(weights: &[f64], count: usize, rng: &mut impl Rng) -> Vec<usize> {
    let offset: f64 = rng.random();
    (0..count).map(|i| pick(weights, (i as f64 + offset) / count as f64)).collect()
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
    use super::*;
    use catenary_core::seed;

    #[test]
    fn resampling_follows_the_weights() {
        let chosen = resampled(&[0.5, 0.0, 0.25, 0.25], 400, &mut seed::rng(1, 0));
        let count = |i: usize| chosen.iter().filter(|c| **c == i).count() as i32;
        assert_eq!(count(1), 0);
        assert!((count(0) - 200).abs() <= 1 && (count(2) - 100).abs() <= 1, "{} {}", count(0), count(2));
    }
}
