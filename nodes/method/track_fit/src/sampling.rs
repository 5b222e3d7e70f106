//! Draws of the exact posterior of a fit, with the simulator itself as the likelihood.
//!
//! An ensemble of walkers is annealed from the priors to the posterior, and then moved until it has settled. Local minima of the
//! cost have a part in the moves. All densities are in normal scores, see `scores`.

mod annealing;
mod budget;
mod ensemble;
mod gaussians;
mod moments;
mod proposal;
mod scores;

pub use budget::Budget;
pub use gaussians::gaussians_of;

use crate::error::FitError;
use crate::fitting::{Fit, OnRound, Problem, noise_inflation};
use catenary_core::seed;
use scores::Scores;

/// Random stream.
const STREAM: u64 = 40;

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
    /// Share of the walkers' moves in the last block that were accepted.
    pub acceptance: f64,
    /// Greatest change of a coordinate's mean over the last block of moves, in its standard deviations.
    pub drift: f64,
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
    let measured = problem.channels().len();
    let inflated: Vec<Fit> = modes.iter().map(|mode| mode.clone().at_noise(inflation, measured)).collect();
    let first = proposal::Proposal::of_modes(&inflated).ok_or_else(|| FitError::NoFit("no mode was found".into()))?;
    let mut rng = seed::rng(seed, STREAM);
    let (ensemble, steps) = annealing::annealed(&scores, budget.walkers, &first, &mut rng, on_round)?;
    let moved = ensemble.settle(&scores, (budget, &first), &mut rng, on_round)?;
    Ok(Draws {
        points: moved.walkers.iter().map(Scores::to_unit).collect(),
        best: Scores::to_unit(&moved.best),
        inflation,
        steps,
        acceptance: moved.acceptance,
        drift: moved.drift,
    })
}

#[cfg(test)]
mod tests {
    use super::annealing::annealed;
    use super::ensemble::{Ensemble, Moved};
    use super::proposal::Proposal;
    use super::*;
    use crate::fitting::{Start, modes};
    use crate::settings::Settings;
    use crate::toy::twisted::Mirrored;
    use crate::toy::{self, Toy};
    use nalgebra::DVector;
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

    /// Walkers end at the exact posterior, whether they are annealed from the priors or start wrong.
    #[test]
    fn walkers_end_at_the_exact_posterior() {
        let toy = Toy { gain: 0.02 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let scores = Scores::of(&problem, 1.0);
        let mut go_on = || ControlFlow::Continue(());
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
        let modes = Proposal::of_modes(&[fit]).unwrap();
        let mut rng = seed::rng(3, 0);
        let (right, steps) = annealed(&scores, 256, &modes, &mut rng, &mut go_on).unwrap();
        assert!((2..20).contains(&steps), "{steps}");
        let walkers: Vec<DVector<f64>> = (0..256).map(|_| modes.draw(&mut rng) * 0.3).collect();
        let likelihoods = scores.log_likelihoods(&walkers, None, &mut go_on).unwrap();
        let best = (walkers[0].clone(), likelihoods[0]);
        let wrong = Ensemble { walkers, likelihoods, proposal: modes.clone(), power: 1.0, best };
        for ensemble in [right, wrong] {
            let budget = Budget { blocks: 4, ..Budget::default() };
            let moved = ensemble.settle(&scores, (budget, &modes), &mut rng, &mut go_on).unwrap();
            is_exact(&problem, &moved);
        }
    }

    /// Compares the walkers with the posterior on a grid.
    fn is_exact(problem: &Problem<'_>, moved: &Moved) {
        let at = |i: u32| 0.005 + 0.01 * f64::from(i);
        let grid: Vec<Vec<f64>> = (0..100).flat_map(|i| (0..100).map(move |j| vec![at(i), at(j)])).collect();
        let costs = problem.costs(&grid, &problem.measured());
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = costs.iter().map(|c| (-0.5 * (c - least)).exp()).collect();
        let total: f64 = weights.iter().sum();
        for i in 0..2 {
            let exact: f64 = grid.iter().zip(&weights).map(|(u, w)| u[i] * w / total).sum();
            let square: f64 = grid.iter().zip(&weights).map(|(u, w)| (u[i] - exact).powi(2) * w / total).sum();
            let units: Vec<f64> = moved.walkers.iter().map(|z| Scores::to_unit(z)[i]).collect();
            let mean = units.iter().sum::<f64>() / units.len() as f64;
            let spread = (units.iter().map(|u| (u - mean).powi(2)).sum::<f64>() / units.len() as f64).sqrt();
            let sd = square.sqrt();
            // 256 walkers at four times; the mean of 256 scatters by 0.06 standard deviations.
            assert!(
                (mean - exact).abs() < 0.2 * sd && (spread / sd - 1.0).abs() < 0.15,
                "{mean} {exact}, {spread} {sd}"
            );
        }
        assert!(moved.acceptance > 0.15, "{}", moved.acceptance);
    }
}
