//! Design of recordings: which motions of the hand determine the parameters of a model.
//!
//! A motion is simulated at some values of the parameters, and its sensitivities give the information that a recording of it would
//! hold (Fisher's matrix, what is drawn for each episode marginalised). Informations of several recordings add up; with the prior
//! they give the intervals that a posterior would have, to first order (Chaloner and Verdinelli 1995, "Bayesian experimental
//! design").

mod motions;

pub use motions::{Motion, motions};

use crate::data::{MeasuredEpisode, Scope};
use crate::error::FitError;
use crate::fitting::{Fit, OnRound, PRIOR_PRECISION, Problem, Start};
use catenary_core::statistics::{Z_90, median_high};
use nalgebra::DMatrix;

/// Width of the 90 % interval of a parameter, as a share of that of its prior, at which recordings have determined it.
pub const DETERMINED: f64 = 0.25;

/// Information that a recording of one motion holds about the shared parameters, in unit coordinates.
#[derive(Debug, Clone)]
pub struct Information {
    measured: DMatrix<f64>,
    prior: DMatrix<f64>,
}

impl Information {
    /// Information of the single episode of `problem` at `point`, in unit coordinates; none if the point cannot be simulated.
    ///
    /// # Errors
    /// [`FitError::Cancelled`] if `on_round` breaks.
    pub fn at(problem: &Problem<'_>, point: &[f64], on_round: OnRound<'_>) -> Result<Option<Self>, FitError> {
        let Ok(mut tracks) = problem.tracks(&[point]) else { return Ok(None) };
        let tracks = tracks.remove(0);
        let episodes: Vec<MeasuredEpisode> =
            problem.episodes.iter().zip(&tracks).map(|(e, track)| e.with_measured(track.clone())).collect();
        let seen = Problem { episodes: &episodes, unknowns: problem.unknowns.clone(), ..*problem };
        match seen.linearise(vec![Start { point: point.to_vec(), tracks }], on_round) {
            Ok(fits) => Ok(fits.into_iter().flatten().next().and_then(|start| Self::of(&seen, &start.fit))),
            Err(FitError::NoFit(_)) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Information of a linearisation; none if nothing determines what is drawn for the episode.
    fn of(problem: &Problem<'_>, fit: &Fit) -> Option<Self> {
        let unknowns = &problem.unknowns;
        let shared = unknowns.theta();
        let of_episode = unknowns.columns() - shared;
        let measured = problem.channels().len();
        let jacobian = fit.jacobian.rows(0, measured);
        let mut whole = jacobian.transpose() * jacobian;
        let mut prior = DMatrix::zeros(shared, shared);
        let is_gaussian = |column: usize| unknowns.at(column).is_some_and(|u| u.gaussian.is_some());
        for column in 0..unknowns.columns() {
            // The rows below the measured ones are those of Gaussian priors.
            let slope = fit.jacobian.rows(measured, fit.jacobian.nrows() - measured).column(column).norm_squared();
            let own = if is_gaussian(column) { slope } else { PRIOR_PRECISION };
            match unknowns.scope_of(column) {
                Scope::Shared => prior[(column, column)] = own,
                Scope::PerEpisode => whole[(column, column)] += own,
            }
        }
        let about = whole.view((0, 0), (shared, shared)).into_owned();
        if of_episode == 0 {
            return Some(Self { measured: about, prior });
        }
        let cross = whole.view((0, shared), (shared, of_episode));
        let nuisance = whole.view((shared, shared), (of_episode, of_episode)).into_owned().cholesky()?;
        Some(Self { measured: about - cross * nuisance.solve(&cross.transpose()), prior })
    }

    /// Standard deviations of the parameters, in unit coordinates, after recordings of these informations.
    fn sds(all: &[&Information]) -> Option<Vec<f64>> {
        let mut sum = all.first()?.prior.clone();
        all.iter().for_each(|one| sum += &one.measured);
        let covariance = sum.cholesky()?.inverse();
        Some((0..covariance.nrows()).map(|i| covariance[(i, i)].sqrt()).collect())
    }

    /// Standard deviations of the prior.
    fn prior_sds(&self) -> Vec<f64> {
        (0..self.prior.nrows()).map(|i| self.prior[(i, i)].sqrt().recip()).collect()
    }
}

/// Recordings that are proposed.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Indices of the motions.
    pub motions: Vec<usize>,
    /// Width of the interval of each parameter as a share of that of its prior: the median over the tried values.
    pub shares: Vec<f64>,
}

impl Proposal {
    /// Number of parameters that the recordings determine.
    pub fn determined(&self) -> usize {
        self.shares.iter().filter(|share| **share <= DETERMINED).count()
    }
}

/// Proposes two motions: those that determine the most parameters, and among them the shortest; then those with the narrowest
/// intervals. `found` holds for each motion its information at each of the tried values, none where it cannot be simulated, and
/// `durations_s` the length of each motion. None if no pair can be simulated.
pub fn propose(found: &[Vec<Option<Information>>], durations_s: &[f64]) -> Option<Proposal> {
    let of_pair = |i: usize, j: usize| -> Option<Proposal> {
        let mut of_parameters: Vec<Vec<f64>> = Vec::new();
        for (a, b) in found[i].iter().zip(&found[j]) {
            let (Some(a), Some(b)) = (a, b) else { continue };
            let sds = Information::sds(&[a, b])?;
            of_parameters.resize(sds.len(), Vec::new());
            let shares = sds.iter().zip(a.prior_sds()).map(|(sd, prior)| sd / prior);
            of_parameters.iter_mut().zip(shares).for_each(|(all, share)| all.push(share));
        }
        let shares = of_parameters.into_iter().map(|mut all| median_high(&mut all)).collect::<Option<Vec<f64>>>()?;
        (!shares.is_empty()).then_some(Proposal { motions: vec![i, j], shares })
    };
    let duration = |p: &Proposal| p.motions.iter().map(|i| durations_s[*i]).sum::<f64>();
    let width = |p: &Proposal| p.shares.iter().map(|share| share.ln()).sum::<f64>();
    let pairs = (0..found.len()).flat_map(|i| (i..found.len()).map(move |j| (i, j)));
    pairs.filter_map(|(i, j)| of_pair(i, j)).min_by(|a, b| {
        let by_count = b.determined().cmp(&a.determined());
        by_count.then(duration(a).total_cmp(&duration(b))).then(width(a).total_cmp(&width(b)))
    })
}

/// Half widths of the 90 % intervals, in unit coordinates, that recordings with these informations promise.
pub fn promised(all: &[&Information]) -> Option<Vec<f64>> {
    Some(Information::sds(all)?.into_iter().map(|sd| Z_90 * sd).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};
    use std::ops::ControlFlow;

    fn information(diagonal: [f64; 2]) -> Information {
        let of = |values: [f64; 2]| DMatrix::from_diagonal(&nalgebra::DVector::from_row_slice(&values));
        Information { measured: of(diagonal), prior: of([PRIOR_PRECISION; 2]) }
    }

    /// The toy is linear: its information is that of a regression.
    #[test]
    fn the_information_is_that_of_the_sensitivities() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let mut go_on = || ControlFlow::Continue(());
        let found = Information::at(&problem, &[0.4, 0.6], &mut go_on).unwrap().unwrap();
        let start = Start { point: vec![0.4, 0.6], tracks: problem.measured() };
        let fit = problem.linearise(vec![start], &mut go_on).unwrap().remove(0).unwrap().fit;
        assert!((found.measured.clone() - fit.curvature()).norm() < 1e-6 * fit.curvature().norm());
        let twice = Information::sds(&[&found, &found]).unwrap();
        let once = Information::sds(&[&found]).unwrap();
        assert!(twice.iter().zip(&once).all(|(two, one)| two < one), "{twice:?}, {once:?}");
    }

    #[test]
    fn the_shortest_pair_that_determines_all_is_proposed() {
        // Each motion tells one parameter, the last one both, but takes long.
        let all = [[1e4, 0.0], [0.0, 1e4], [1e4, 1e4]].map(|d| vec![Some(information(d)); 3]);
        let proposal = propose(&all, &[2.0, 3.0, 9.0]).unwrap();
        assert_eq!((proposal.motions.as_slice(), proposal.determined()), ([0, 1].as_slice(), 2));
        let proposal = propose(&all, &[2.0, 30.0, 9.0]).unwrap();
        assert_eq!(proposal.motions, [0, 2]);
        // A motion that determines nothing, and one that cannot be simulated.
        let none = [vec![Some(information([0.0; 2]))], vec![None]];
        let proposal = propose(&none, &[1.0, 1.0]).unwrap();
        assert_eq!((proposal.motions.as_slice(), proposal.determined()), ([0, 0].as_slice(), 0));
        assert_eq!(propose(&none[1..], &[1.0]), None);
    }
}
