//! Draws of the exact posterior of a fit, with the simulator itself as the likelihood.
//!
//! An ensemble of walkers is annealed from the priors to the posterior, and then moved until it has settled. Local minima of the
//! cost have a part in the moves. All densities are in normal scores, see [`Scores`].

mod annealing;
mod ensemble;
mod gaussians;
mod proposal;
mod scores;

pub use gaussians::gaussians_of;
pub use scores::Scores;

use crate::error::FitError;
use crate::fitting::{Fit, OnRound, Problem, noise_inflation};
use catenary_core::seed;

/// Random stream.
const STREAM: u64 = 40;

/// Sizes of a sampling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Walkers of the ensemble.
    pub walkers: usize,
    /// Moves of each walker in a block at the posterior.
    pub block: usize,
    /// Most blocks.
    pub blocks: usize,
}

impl Default for Budget {
    fn default() -> Self {
        Self { walkers: 256, block: 8, blocks: 6 }
    }
}

/// Draws of a posterior with an account of how they were made.
#[derive(Debug, Clone)]
pub struct Draws {
    /// Points in unit coordinates, one number a column of the unknowns.
    pub points: Vec<Vec<f64>>,
    /// Point with the greatest likelihood that a walker met.
    pub best: Vec<f64>,
    /// Variance of the likelihood's noise in variances of the stated noise.
    pub inflation: f64,
    /// Steps in which the likelihood's power grew from 0 to 1.
    pub steps: usize,
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
    let mut rng = seed::rng(seed, STREAM);
    let (ensemble, steps) = annealing::annealed(&scores, budget.walkers, &first, &mut rng, on_round)?;
    let moved = ensemble.settle(&scores, budget, &mut rng, on_round)?;
    Ok(Draws {
        points: moved.walkers.iter().map(Scores::to_unit).collect(),
        best: Scores::to_unit(&moved.best),
        inflation,
        steps,
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
        assert!(found.steps > 2 && found.acceptance > 0.1, "{} {}", found.steps, found.acceptance);
        let mixture = gaussians_of(&found.points, 0).unwrap();
        let at = |length: f64| {
            let u = problem.unknowns.list()[0].prior.to_unit(length);
            mixture.log_density(&[u, found.points[0][1]])
        };
        assert!(at(0.25) < at(0.265) - 3.0 && at(0.25) < at(0.235) - 3.0, "{} {} {}", at(0.235), at(0.25), at(0.265));
    }
}
