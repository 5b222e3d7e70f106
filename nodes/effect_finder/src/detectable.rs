//! How large an effect must be to show.

use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::fit::{Fit, Problem, Start};
use catenary_core::Track;
use catenary_core::simulator::TrackSensitivities;
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
    let tracks = problem.tracks(&[u])?.pop().ok_or_else(|| FinderError::NoFit("no track came".into()))?;
    // What the present model says at the point, with its derivatives; the residuals of its own tracks are none.
    let start = Start { point: u.to_vec(), tracks: tracks.clone() };
    let seen = problem.look(vec![start], &mut || ControlFlow::Continue(()))?;
    let Some(base) = seen.into_iter().flatten().next().map(|s| s.fit) else { return Ok(None) };
    let needed = REJECTED_FROM * (2.0 * base.residuals.len().saturating_sub(u.len()).max(1) as f64).sqrt();
    let worlds = worlds(problem, u, candidate);
    // If the simulator were linear, from here on the effect would show.
    let linear = |measured: &[Track]| {
        let parts = problem.cases.iter().zip(measured).zip(&tracks).map(|((case, measured), own)| {
            let own = TrackSensitivities { track: own.clone(), derivatives: Vec::new(), changes: Vec::new() };
            case.compare(measured, &own).0
        });
        let mut residuals = base.residuals.clone();
        parts.flat_map(|r| r.data.as_vec().clone()).enumerate().for_each(|(i, r)| residuals[i] = r);
        Fit { cost: residuals.norm_squared(), residuals, ..base.clone() }.descended().cost
    };
    let Some(first) = worlds.iter().position(|(_, m)| m.as_ref().is_some_and(|m| linear(m) >= needed)) else {
        return Ok(None);
    };
    let mut before: Option<(f64, Fit)> = None;
    for (magnitude, measured) in worlds.into_iter().skip(first.saturating_sub(1)) {
        let Some(tracks) = measured else { break };
        // The present model's best answer to a data set that has the effect and no noise: near the point, or near the answer
        // to less of the effect, which may have moved far from it.
        let known = std::iter::once(u).chain(before.iter().map(|(_, fit)| fit.point.as_slice()));
        let starts = known.map(|point| Start { point: point.to_vec(), tracks: tracks.clone() }).collect();
        let fits = problem.fit(starts, &mut || ControlFlow::Continue(()))?.into_iter().flatten();
        let Some(fit) = fits.min_by(|a, b| a.cost.total_cmp(&b.cost)) else { break };
        if fit.cost >= needed {
            return Ok(Some(match before {
                Some((smaller, less)) if less.cost > 0.0 => {
                    smaller * (magnitude / smaller).powf((needed / less.cost).ln() / (fit.cost / less.cost).ln())
                }
                _ => magnitude,
            }));
        }
        before = Some((magnitude, fit));
    }
    Ok(None)
}

/// Magnitudes that a search looks at, in increasing order, with the tracks of episodes in which the effect has them; none
/// where it cannot have.
fn worlds(problem: &Problem<'_>, u: &[f64], candidate: &Candidate) -> Vec<(f64, Option<Vec<Track>>)> {
    let with = Problem { unknowns: problem.unknowns.with(candidate), ..*problem };
    let search = candidate.search();
    let most = search.bounds().1 - candidate.base;
    let magnitudes = (0..MAGNITUDES).map(|i| most * LEAST.powf(1.0 - i as f64 / (MAGNITUDES - 1) as f64));
    let point = |magnitude: &f64| {
        let mut point = with.unknowns.point_from(&problem.unknowns, u);
        point[with.unknowns.columns() - 1] = search.to_unit(candidate.base + magnitude).clamp(0.0, 1.0);
        point
    };
    let magnitudes: Vec<f64> = magnitudes.collect();
    let points: Vec<Vec<f64>> = magnitudes.iter().map(point).collect();
    let tracks = with.tracks_each(&points).into_iter().map(Result::ok);
    magnitudes.into_iter().zip(tracks).collect()
}
