//! Draws of the exact posterior of a fit, with the simulator itself as the likelihood.
//!
//! Local minima of the cost give the first proposal; adaptive importance sampling mends it, and moves of an ensemble of
//! walkers take out what is left of its errors. All densities are in normal scores, see [`Scores`].

mod ensemble;
mod gaussians;
mod importance;
mod proposal;
mod scores;

pub use gaussians::gaussians_of;
pub use importance::Budget;
pub use scores::Scores;

use crate::error::FitError;
use crate::fitting::{Fit, OnRound, Problem, noise_inflation};
use catenary_core::seed;

/// Random streams of the steps.
const STREAM: u64 = 40;

/// Draws of a posterior with an account of how they were made.
#[derive(Debug, Clone)]
pub struct Draws {
    /// Points in unit coordinates, one number a column of the unknowns.
    pub points: Vec<Vec<f64>>,
    /// Effective sample size of the importance sampling.
    pub effective: f64,
    /// Share of the walkers' moves that were accepted.
    pub acceptance: f64,
    /// Greatest change of a coordinate's mean over the last block of moves, in its standard deviations.
    pub drift: f64,
    /// Number of simulated points.
    pub simulations: usize,
}

/// Draws of the posterior of `problem`, given the modes of its cost ([`modes`](crate::fitting::modes)). If the lowest one leaves
/// more than the stated noise, the likelihood has the noise that it leaves ([`noise_inflation`]).
///
/// # Errors
/// [`FitError::NoFit`] if no draw could be simulated, [`FitError::Cancelled`] if `on_round` breaks.
pub fn draws(
    problem: &Problem<'_>,
    modes: &[Fit],
    budget: Budget,
    seed: u64,
    on_round: OnRound<'_>,
) -> Result<Draws, FitError> {
    let inflation = modes.first().map_or(1.0, noise_inflation);
    let scores = Scores::of(problem, inflation);
    let inflated: Vec<Fit> = modes.iter().map(|mode| mode.clone().at_noise(inflation)).collect();
    let first = proposal::Proposal::of_modes(&inflated).ok_or_else(|| FitError::NoFit("no mode was found".into()))?;
    let sample = importance::sample(&scores, first, budget, &mut seed::rng(seed, STREAM + 1), on_round)?;
    let moved = ensemble::moved(&scores, &sample, budget, &mut seed::rng(seed, STREAM + 2), on_round)?;
    Ok(Draws {
        points: moved.walkers.iter().map(Scores::to_unit).collect(),
        effective: sample.effective,
        acceptance: moved.acceptance,
        drift: moved.drift,
        simulations: scores.simulations(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::modes;
    use crate::settings::Settings;
    use crate::toy::twisted::Mirrored;
    use crate::toy::{self, Toy};
    use std::ops::ControlFlow;

    #[test]
    fn a_posterior_of_two_modes_keeps_both() {
        let toy = Toy { gain: 0.3 };
        let mirrored = Mirrored { toy: Toy { gain: 0.3 }, at: 0.25 };
        let episodes = [toy::episode(&toy, [0.265, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &mirrored, 40);
        let mut go_on = || ControlFlow::Continue(());
        let settings = Settings { draws: 100, ..Settings::default() };
        let modes = modes(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let found = draws(&problem, &modes, Budget::default(), 3, &mut go_on).unwrap();
        let short = found.points.iter().filter(|u| problem.unknowns.values(u, 0)[0] < 0.25).count();
        let share = short as f64 / found.points.len() as f64;
        assert!((share - 0.5).abs() < 0.1, "{share}");
        assert!(found.effective > 100.0 && found.acceptance > 0.1, "{} {}", found.effective, found.acceptance);
        let mixture = gaussians_of(&found.points, 0).unwrap();
        let at = |length: f64| {
            let u = problem.unknowns.list()[0].prior.to_unit(length);
            mixture.log_density(&[u, found.points[0][1]])
        };
        assert!(at(0.25) < at(0.265) - 3.0 && at(0.25) < at(0.235) - 3.0, "{} {} {}", at(0.235), at(0.25), at(0.265));
    }
}
