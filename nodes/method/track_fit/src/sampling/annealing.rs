//! Annealing of an ensemble from the priors to the posterior (sequential Monte Carlo: Neal 2001; Del Moral, Doucet and Jasra
//! 2006). The likelihood's power grows from 0 to 1 in steps; after each step the walkers are resampled and moved. Walkers meet
//! the cost while it is still flat, so that no minimum catches them that has no part in the posterior.

use super::ensemble::{Ensemble, resampled};
use super::proposal::Proposal;
use super::scores::Scores;
use crate::error::FitError;
use crate::fitting::OnRound;
use catenary_core::mixture::log_sum_exp;
use nalgebra::DVector;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// Effective sample size after a step of the power, as a share of the walkers: 1 / (sum of the squared weights).
const KEPT: f64 = 0.5;
/// Moves of each walker after a step, and most moves while few are accepted.
const MOVES: usize = 3;
const MOST_MOVES: usize = 5;
/// Share of accepted moves under which more follow.
const FEW: f64 = 0.15;
/// Most steps of the power. Sharp posteriors of a dozen unknowns need twelve.
const MOST_STEPS: usize = 60;
/// Halvings that find the next power.
const HALVINGS: usize = 40;

/// Ensemble of `count` walkers at the posterior, and the number of steps that led there. `modes` is a proposal around known
/// modes, which has a part in the moves.
pub fn annealed(
    scores: &Scores<'_>,
    count: usize,
    modes: &Proposal,
    rng: &mut impl Rng,
    on_round: OnRound<'_>,
) -> Result<(Ensemble, usize), FitError> {
    let d = modes.dimension();
    let draw = |rng: &mut _| DVector::from_fn(d, |_, _| -> f64 { StandardNormal.sample(rng) });
    let walkers: Vec<DVector<f64>> = (0..count).map(|_| draw(rng)).collect();
    let likelihoods = scores.log_likelihoods(&walkers, None, on_round)?;
    let first = (0..count).max_by(|a, b| likelihoods[*a].total_cmp(&likelihoods[*b])).unwrap_or(0);
    let best = (walkers[first].clone(), likelihoods[first]);
    let mut ensemble = Ensemble { walkers, likelihoods, proposal: modes.clone(), power: 0.0, best };
    if !log_sum_exp(&ensemble.likelihoods).is_finite() {
        return Err(FitError::NoFit("no draw of the priors could be simulated".into()));
    }
    for step in 1..=MOST_STEPS {
        let power = next_power(&ensemble.likelihoods, ensemble.power);
        let by = power - ensemble.power;
        let weights = weighed(&ensemble.likelihoods, by).0;
        let chosen = resampled(&weights, count, rng);
        ensemble.walkers = chosen.iter().map(|i| ensemble.walkers[*i].clone()).collect();
        ensemble.likelihoods = chosen.iter().map(|i| ensemble.likelihoods[*i]).collect();
        ensemble.power = power;
        ensemble.learn(modes);
        for moves in 1..=MOST_MOVES {
            let accepted = ensemble.step(scores, rng, on_round)?;
            if moves >= MOVES && f64::from(accepted) >= FEW * count as f64 {
                break;
            }
        }
        if power >= 1.0 {
            return Ok((ensemble, step));
        }
    }
    Err(FitError::NoFit(format!("the likelihood's power reached {} in {MOST_STEPS} steps", ensemble.power)))
}

/// Greatest power up to 1 at which [`KEPT`] of the walkers count.
fn next_power(likelihoods: &[f64], power: f64) -> f64 {
    let least = KEPT * likelihoods.len() as f64;
    if weighed(likelihoods, 1.0 - power).1 >= least {
        return 1.0;
    }
    // At the first step the walkers that cannot be simulated do not count at all, so that the least number may never be reached.
    let (mut low, mut high) = (0.0, 1.0 - power);
    let most = weighed(likelihoods, 1e-12).1;
    let least = least.min(0.9 * most);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if weighed(likelihoods, middle).1 >= least { low = middle } else { high = middle }
    }
    power + high
}

/// Weights of the walkers if the power grows by `by`, and their effective number.
fn weighed(likelihoods: &[f64], by: f64) -> (Vec<f64>, f64) {
    let scaled: Vec<f64> = likelihoods.iter().map(|l| by * l).collect();
    let total = log_sum_exp(&scaled);
    let weights: Vec<f64> = scaled.iter().map(|l| (l - total).exp()).collect();
    let effective = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
    (weights, effective)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_power_grows_as_far_as_half_of_the_walkers_count() {
        let likelihoods: Vec<f64> = (0..200).map(|i| -f64::from(i)).collect();
        let first = next_power(&likelihoods, 0.0);
        assert!((weighed(&likelihoods, first).1 - 100.0).abs() < 1.0 && first < 0.1, "{first}");
        assert_eq!(next_power(&[-1.0, -1.1, -0.9], 0.3), 1.0);
        // Three walkers in four cannot be simulated.
        let few: Vec<f64> = (0..200).map(|i| if i % 4 == 0 { -f64::from(i) } else { f64::NEG_INFINITY }).collect();
        let power = next_power(&few, 0.0);
        assert!(power > 0.0 && weighed(&few, power).1 > 40.0, "{power}");
    }
}
