//! How large an effect must be to show.

use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::fit::{Problem, Start};
use std::ops::ControlFlow;

/// Quantile of the normal distribution at which a test of 5 % rejects.
const REJECTED_FROM: f64 = 1.645;
/// Magnitudes that are looked at, from the first to the last evenly in the logarithm.
const MAGNITUDES: usize = 24;
/// The least of them, over the greatest that a search looks at.
const LEAST: f64 = 1e-4;

/// The magnitude of `candidate` from which the present model, whatever values its unknowns take, is rejected at 5 % in one of
/// two data sets as those of `problem`, in which the unknowns have the values of the point `u`. None where the
/// effect stays smaller than that up to the greatest magnitude that a search looks at, or cannot act.
///
/// The sum of squares of N coordinates with d fitted unknowns has the standard deviation sqrt(2 (N - d)); an effect that adds
/// 1.645 of them moves its median to where the test rejects.
///
/// # Errors
/// [`FinderError::NoFit`] where the present model cannot be simulated at `u`.
pub fn detectable_size(problem: &Problem<'_>, u: &[f64], candidate: &Candidate) -> Result<Option<f64>, FinderError> {
    let unknowns = problem.unknowns.with(candidate);
    let with = Problem { unknowns, ..*problem };
    let column = with.unknowns.columns() - 1;
    let search = candidate.search();
    let most = search.bounds().1 - candidate.base;
    let magnitude = |i: usize| most * LEAST.powf(1.0 - i as f64 / (MAGNITUDES - 1) as f64);
    let mut squares = Vec::new();
    for i in 0..MAGNITUDES {
        let mut point = with.unknowns.point_from(&problem.unknowns, u);
        point[column] = search.to_unit(candidate.base + magnitude(i)).clamp(0.0, 1.0);
        let Ok(mut sets) = with.tracks(&[point.as_slice()]) else { break };
        let Some(measured) = sets.pop() else { break };
        // The present model's best answer to a data set that has the effect and no noise.
        let start = Start { point: u.to_vec(), tracks: measured };
        let seen = problem.look(vec![start], &mut || ControlFlow::Continue(()))?;
        let Some(fit) = seen.into_iter().flatten().next().map(|s| s.fit.descended()) else { break };
        let coordinates = fit.residuals.len().saturating_sub(fit.point.len()).max(1) as f64;
        squares.push(fit.cost);
        let needed = REJECTED_FROM * (2.0 * coordinates).sqrt();
        if fit.cost >= needed {
            let Some(before) = i.checked_sub(1).map(|j| squares[j]).filter(|b| *b > 0.0) else {
                return Ok(Some(magnitude(i)));
            };
            let share = (needed / before).ln() / (fit.cost / before).ln();
            return Ok(Some(magnitude(i - 1) * (magnitude(i) / magnitude(i - 1)).powf(share)));
        }
    }
    Ok(None)
}
