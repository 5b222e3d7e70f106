//! Check of a proposal: recordings of its motions are simulated with noise, and fitted.

use super::planner::Planner;
use catenary_core::seed;
use catenary_core::statistics::Z_90;
use serde::Serialize;
use std::ops::ControlFlow;
use track_fit::FitError;
use track_fit::data::MeasuredEpisode;
use track_fit::design::Motion;
use track_fit::fitting::{Laplace, Problem, best_fit};

/// Random stream of the noise.
const STREAM: u64 = 2601;
/// Most rounds of a fit.
const ROUNDS: usize = 60;

/// Result of the check.
#[derive(Debug, Default, Serialize)]
pub struct Check {
    /// Number of fitted values.
    pub values: usize,
    /// Number of these whose 90 % interval about the best fit holds the truth.
    pub held: usize,
}

impl Check {
    /// Result in words.
    pub fn words(&self) -> String {
        format!(
            "checked on simulated recordings: {} of {} intervals of 90 % about the best fits hold the truth",
            self.held, self.values
        )
    }
}

/// Simulates recordings of the motions at each of these values, and fits them from the whole prior.
///
/// # Errors
/// [`FitError::Cancelled`] after Ctrl-C; a value at which the motions cannot be simulated is left out.
pub fn run(
    planner: &Planner<'_>,
    motions: &[&Motion],
    thetas: &[Vec<f64>],
    on_share: &mut dyn FnMut(f64),
) -> Result<Check, FitError> {
    let paths: Vec<_> = motions.iter().map(|m| &m.path).collect();
    let planned = planner.episodes(&paths);
    let mut check = Check::default();
    for (number, theta) in thetas.iter().enumerate() {
        let truth = Problem::of(planner.model, &planned, planner.simulator, ROUNDS);
        let point = truth.unknowns.point_at(theta);
        let Ok(mut tracks) = truth.tracks(&[point.as_slice()]) else { continue };
        let mut rng = seed::rng(seed::derive(planner.settings.seed, STREAM), number as u64);
        let pairs = planned.iter().zip(tracks.remove(0));
        // The noise is drawn at the frames of the noiseless track.
        let measured: Vec<MeasuredEpisode> = pairs
            .map(|(episode, track)| {
                let seen = episode.with_measured(track.clone());
                let noisy = seen.measure(&track, &mut rng);
                seen.with_measured(noisy)
            })
            .collect();
        let problem = Problem::of(planner.model, &measured, planner.simulator, ROUNDS);
        let mut on_round = || planner.go_on();
        match best_fit(&problem, Vec::new(), &planner.settings, &mut on_round) {
            Ok(fit) => {
                let Some(posterior) = Laplace::of(&fit) else { continue };
                for column in 0..problem.unknowns.theta() {
                    let (sd, gap) = (posterior.sd(column), fit.point[column] - point[column]);
                    check.values += 1;
                    check.held += usize::from(gap.abs() <= Z_90 * sd);
                }
            }
            Err(FitError::NoFit(_)) => continue,
            Err(error) => return Err(error),
        }
        on_share((number + 1) as f64 / thetas.len() as f64);
        if let ControlFlow::Break(()) = planner.go_on() {
            return Err(FitError::Cancelled);
        }
    }
    Ok(check)
}
