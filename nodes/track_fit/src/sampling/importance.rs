//! Adaptive importance sampling (Cornuet, Marin, Mira and Robert 2012): all draws of all rounds are weighed by the mixture
//! of all proposals so far, and the next proposal is fitted to them.

use super::proposal::Proposal;
use super::scores::Scores;
use crate::error::FitError;
use crate::fitting::OnRound;
use catenary_core::mixture::log_sum_exp;
use nalgebra::DVector;
use rand::Rng;

/// Sizes of the steps of a sampling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Draws of each round of importance sampling.
    pub round: usize,
    /// Most rounds.
    pub rounds: usize,
    /// Effective sample size that ends the rounds.
    pub effective: usize,
    /// Walkers of the ensemble.
    pub walkers: usize,
    /// Moves of each walker in a block.
    pub block: usize,
    /// Most blocks.
    pub blocks: usize,
}

impl Default for Budget {
    fn default() -> Self {
        Self { round: 256, rounds: 10, effective: 400, walkers: 256, block: 8, blocks: 6 }
    }
}

/// Share of the first proposal in the later ones: what a fit to few draws loses stays reachable.
const FIRST: f64 = 0.1;
/// Most components of a proposal.
const MOST_COMPONENTS: usize = 8;
/// Effective draws for each coordinate that a fit needs at least. With fewer, the weights are tempered for the fit.
const FOR_FIT: f64 = 4.0;

/// Weighted draws.
pub struct Sample {
    /// Scores of the draws.
    pub draws: Vec<DVector<f64>>,
    /// Log densities of the posterior there, up to a constant.
    pub densities: Vec<f64>,
    /// Weights, which sum to 1.
    pub weights: Vec<f64>,
    /// Effective sample size of the weights.
    pub effective: f64,
    /// Last proposal.
    pub proposal: Proposal,
}

impl Sample {
    /// Weights, tempered until at least `least` draws count. Walkers that start too wide settle faster than walkers that
    /// start at the same few draws.
    pub fn starts(&self, least: f64) -> Vec<f64> {
        let logs: Vec<f64> = self.weights.iter().map(|w| w.max(f64::MIN_POSITIVE).ln()).collect();
        tempered(&logs, least).0
    }
}

/// Weighted draws of the posterior, from the proposal `first` on.
pub fn sample(
    scores: &Scores<'_>,
    first: Proposal,
    budget: Budget,
    rng: &mut impl Rng,
    on_round: OnRound<'_>,
) -> Result<Sample, FitError> {
    let mut proposals = vec![first.clone()];
    let (mut draws, mut densities): (Vec<DVector<f64>>, Vec<f64>) = (Vec::new(), Vec::new());
    // Densities of all draws under all proposals, a row a draw.
    let mut proposed: Vec<Vec<f64>> = Vec::new();
    loop {
        let newest = proposals.last().unwrap_or(&first).clone();
        let new: Vec<DVector<f64>> = (0..budget.round).map(|_| newest.draw(rng)).collect();
        densities.extend(scores.log_densities(&new, None, on_round)?);
        // The older draws need the newest proposal, and the new ones all.
        proposed.iter_mut().zip(&draws).for_each(|(row, z)| row.push(newest.log_density(z)));
        proposed.extend(new.iter().map(|z| proposals.iter().map(|p| p.log_density(z)).collect::<Vec<f64>>()));
        draws.extend(new);
        let log_weights: Vec<f64> =
            densities.iter().zip(&proposed).map(|(density, row)| density - log_sum_exp(row)).collect();
        let (weights, effective) = weighed(&log_weights, 1.0);
        let is_last = proposals.len() >= budget.rounds || effective >= budget.effective as f64;
        let d = draws[0].len() as f64;
        let (for_fit, left) = tempered(&log_weights, FOR_FIT * d);
        let from = if newest.len() <= MOST_COMPONENTS / 2 { newest.split() } else { newest.clone() };
        let fitted = from.fitted(&draws, &for_fit, left).map_or(newest, |fitted| fitted.with(&first, FIRST));
        if is_last {
            if !log_sum_exp(&log_weights).is_finite() {
                return Err(FitError::NoFit("no draw around the best fits could be simulated".into()));
            }
            return Ok(Sample { draws, densities, weights, effective, proposal: fitted });
        }
        proposals.push(fitted);
    }
}

/// Normalised weights at an inverse temperature, with their effective sample size.
fn weighed(log_weights: &[f64], inverse_temperature: f64) -> (Vec<f64>, f64) {
    let scaled: Vec<f64> = log_weights.iter().map(|w| inverse_temperature * w).collect();
    let total = log_sum_exp(&scaled);
    let weights: Vec<f64> = scaled.iter().map(|w| (w - total).exp()).collect();
    let effective = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
    (weights, if effective.is_finite() { effective } else { 0.0 })
}

/// Weights at the highest temperature up to 1 at which at least `least` draws count, with their effective number.
fn tempered(log_weights: &[f64], least: f64) -> (Vec<f64>, f64) {
    let cooler = (0..30).map(|i| weighed(log_weights, 0.8f64.powi(i))).find(|(_, effective)| *effective >= least);
    cooler.unwrap_or_else(|| weighed(log_weights, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::{Problem, Start};
    use crate::toy::{self, Toy};
    use catenary_core::seed;
    use std::ops::ControlFlow;

    #[test]
    fn weights_are_tempered_until_enough_draws_count() {
        let logs: Vec<f64> = (0..100).map(|i| -f64::from(i)).collect();
        assert!(weighed(&logs, 1.0).1 < 3.0);
        let (weights, effective) = tempered(&logs, 20.0);
        assert!(effective >= 20.0 && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert_eq!(tempered(&logs, 1.5), weighed(&logs, 1.0));
    }

    /// The evidence of a linear Gaussian model is known, and so is the mean under its posterior.
    #[test]
    fn weighted_draws_have_the_moments_of_the_posterior() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let scores = Scores::of(&problem, 1.0);
        let mut go_on = || ControlFlow::Continue(());
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
        let first = Proposal::of_modes(std::slice::from_ref(&fit)).unwrap();
        let found = sample(&scores, first, Budget::default(), &mut seed::rng(4, 0), &mut go_on).unwrap();
        assert!(found.effective >= 200.0, "{}", found.effective);
        let laplace = crate::fitting::Laplace::of_likelihood(&fit).unwrap();
        let units: Vec<Vec<f64>> = found.draws.iter().map(Scores::to_unit).collect();
        // The length is sharp, so that its posterior is the Gaussian of the linear model.
        let mean: f64 = units.iter().zip(&found.weights).map(|(u, w)| u[0] * w).sum();
        assert!((mean - fit.point[0]).abs() < 0.2 * laplace.sd(0), "{mean} {}", fit.point[0]);
        let squares: f64 = units.iter().zip(&found.weights).map(|(u, w)| (u[0] - mean).powi(2) * w).sum();
        assert!((squares.sqrt() / laplace.sd(0) - 1.0).abs() < 0.15, "{} {}", squares.sqrt(), laplace.sd(0));
    }
}
