//! Proposal distribution of thetas and importance weights of its draws.

use super::region::{MOST_DRAWS, Region};
use crate::error::InferenceError;
use crate::settings::ProposalKind;
use crate::unit_map::UnitMap;
use catenary_core::Mixture;
use catenary_core::mixture::{MixtureError, in_unit_cube};
use rand::{Rng, RngExt};

/// Number of mixture draws for the mass inside of the unit cube.
const MASS_DRAWS: usize = 20_000;

/// Distribution over unit coordinates. Its density is zero outside of the unit cube.
#[derive(Debug, Clone)]
pub enum Proposal {
    /// Prior.
    Prior,
    /// Prior restricted to a region.
    Region(Box<Region>),
    /// Truncated mixture with a share of the prior.
    Mixture {
        /// Mixture before truncation.
        mixture: Box<Mixture>,
        /// Mass of the mixture inside of the unit cube.
        inside: f64,
        /// Share of the draws that come from the prior.
        prior_share: f64,
    },
}

/// Proposal of an iteration with the number of its draws.
#[derive(Debug, Clone)]
pub struct Drawn {
    proposal: Proposal,
    /// Number of draws, including those with unusable tracks.
    count: usize,
    /// Map from the unit coordinates of the newest support to those of the proposal; none if the support has not moved since.
    to_own: Option<UnitMap>,
}

impl Drawn {
    /// Proposal over the unit coordinates of the newest support, from which `count` thetas were drawn.
    pub fn new(proposal: Proposal, count: usize) -> Self {
        Self { proposal, count, to_own: None }
    }

    /// Follows a move of the support, whose new unit coordinates are the image of the old ones under `map`.
    pub(super) fn follow(&mut self, map: &UnitMap) {
        let back = map.inverse();
        self.to_own = Some(self.to_own.as_ref().map_or_else(|| back.clone(), |to_own| back.then(to_own)));
    }

    /// Proposal over its own unit coordinates.
    pub fn proposal(&self) -> &Proposal {
        &self.proposal
    }

    /// Number of draws.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Density at `u` in the unit coordinates of the newest support.
    pub fn density(&self, u: &[f64]) -> f64 {
        match &self.to_own {
            None => self.proposal.density(u),
            Some(_) if !in_unit_cube(u) => 0.0,
            Some(map) => self.proposal.density(&map.apply(u)) * map.volume(),
        }
    }

    /// Returns true if networks train on a track simulated at `u` while this is the newest proposal.
    pub fn covers(&self, u: &[f64]) -> bool {
        match &self.to_own {
            None => self.proposal.covers(u),
            Some(map) => self.proposal.covers(&map.apply(u)),
        }
    }

    /// Volume of the proposal's support in the unit coordinates of the newest support.
    pub fn volume(&self) -> f64 {
        // The whole prior for proposals that cover it with some density everywhere.
        let volume = if let Proposal::Region(region) = &self.proposal { region.volume() } else { 1.0 };
        (volume / self.to_own.as_ref().map_or(1.0, UnitMap::volume)).min(1.0)
    }
}

impl Proposal {
    /// Proposal of `kind` for the posterior `mixture`. The previous proposal `last` is kept if the mixture has no mass inside
    /// of the prior's support: networks trained on few tracks may extrapolate so far.
    ///
    /// # Errors
    /// [`InferenceError::Posterior`] with the number of the iteration if the mixture cannot be sampled.
    pub fn next<R: Rng>(
        kind: ProposalKind,
        mixture: &Mixture,
        last: &Drawn,
        iteration: usize,
        rng: &mut R,
    ) -> Result<Self, InferenceError> {
        // A proposal over an earlier support is not kept: it may reach out of the newest one.
        let kept = || if last.to_own.is_none() { last.proposal.clone() } else { Proposal::Prior };
        match kind {
            ProposalKind::Truncated { tail, least_shrink } => {
                match Region::new(mixture, tail, least_shrink * last.volume(), rng) {
                    Err(MixtureError::OutsideSupport) => Ok(kept()),
                    Err(reason) => Err(InferenceError::Posterior { iteration, reason }),
                    Ok(region) => Ok(Proposal::Region(Box::new(region))),
                }
            }
            ProposalKind::Posterior { prior_share } => {
                let inside = 1.0 - mixture.mass_outside(MASS_DRAWS, rng);
                if inside <= 0.0 {
                    return Ok(kept());
                }
                Ok(Proposal::Mixture { mixture: Box::new(mixture.clone()), inside, prior_share })
            }
        }
    }

    /// Density at `u` in unit coordinates.
    pub fn density(&self, u: &[f64]) -> f64 {
        if !in_unit_cube(u) {
            return 0.0;
        }
        match self {
            Proposal::Prior => 1.0,
            Proposal::Region(region) if region.contains(u) => 1.0 / region.volume(),
            Proposal::Region(_) => 0.0,
            Proposal::Mixture { mixture, inside, prior_share } => {
                // The mass is an estimate: at least one draw counts as inside.
                prior_share + (1.0 - prior_share) * mixture.log_density(u).exp() / inside.max(1.0 / MASS_DRAWS as f64)
            }
        }
    }

    /// Returns true if networks train on a track simulated at `u` while this is the newest proposal.
    pub fn covers(&self, u: &[f64]) -> bool {
        match self {
            Proposal::Region(region) => region.contains(u),
            // A track of an earlier support may lie outside of the newest one.
            _ => in_unit_cube(u),
        }
    }

    /// Draws one theta in unit coordinates.
    ///
    /// # Errors
    /// [`InferenceError::EmptyRegion`] or [`InferenceError::Posterior`] with the number of the iteration.
    pub fn sample<R: Rng>(&self, dimension: usize, iteration: usize, rng: &mut R) -> Result<Vec<f64>, InferenceError> {
        let prior = |rng: &mut R| (0..dimension).map(|_| rng.random::<f64>()).collect();
        match self {
            Proposal::Prior => Ok(prior(rng)),
            Proposal::Region(region) => {
                region.sample(rng).ok_or(InferenceError::EmptyRegion { iteration, draws: MOST_DRAWS })
            }
            Proposal::Mixture { mixture, prior_share, .. } => {
                if rng.random::<f64>() < *prior_share {
                    return Ok(prior(rng));
                }
                mixture.sample_truncated(rng).map_err(|reason| InferenceError::Posterior { iteration, reason })
            }
        }
    }
}

/// Importance weights of the draws `theta` from several proposals: the ratio of the prior to the mixture of all proposals, by
/// the balance heuristic (Veach and Guibas 1995). The numbers of draws include those with unusable tracks: usability depends
/// on theta and not on the proposal.
pub fn balance_weights<'a>(theta: impl Iterator<Item = &'a [f64]>, proposals: &[Drawn]) -> Vec<f64> {
    let total: usize = proposals.iter().map(Drawn::count).sum();
    theta
        .map(|u| {
            let density: f64 = proposals.iter().map(|p| p.count as f64 * p.density(u)).sum();
            total as f64 / density
        })
        .collect()
}

/// Kish's effective sample size `(sum w)^2 / sum w^2`; 0 for no weights.
pub fn effective_sample_size(weights: &[f64]) -> f64 {
    let sum: f64 = weights.iter().sum();
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, ParameterSpace, Prior, seed};
    use nalgebra::{DMatrix, DVector};

    fn posterior() -> Mixture {
        let round = |v| DMatrix::from_diagonal_element(2, 2, v);
        let means = [[0.3, 0.35], [0.6, 0.45]].map(|m| DVector::from_row_slice(&m));
        Mixture::new(&[0.6, 0.4], means.to_vec(), vec![round(0.01), round(0.02)]).unwrap()
    }

    fn next(kind: ProposalKind, stream: u64) -> Proposal {
        Proposal::next(kind, &posterior(), &Drawn::new(Proposal::Prior, 1), 2, &mut seed::rng(61, stream)).unwrap()
    }

    /// Prior, region and mixture, with different numbers of draws.
    fn proposals() -> Vec<Drawn> {
        vec![
            Drawn::new(Proposal::Prior, 2_000),
            Drawn::new(next(ProposalKind::Truncated { tail: 0.1, least_shrink: 1e-6 }, 0), 3_000),
            Drawn::new(next(ProposalKind::Posterior { prior_share: 0.1 }, 1), 5_000),
        ]
    }

    /// Draws from all proposals that `usable` accepts.
    fn draws(proposals: &[Drawn], usable: &dyn Fn(&[f64]) -> bool, stream: u64) -> Vec<Vec<f64>> {
        let mut rng = seed::rng(62, stream);
        let all = proposals.iter().flat_map(|p| std::iter::repeat_n(p.proposal(), p.count()));
        all.map(|p| p.sample(2, 2, &mut rng).unwrap()).filter(|u| usable(u)).collect()
    }

    /// Weighted mean of `f` and its standard error by the delta method.
    fn estimate(draws: &[Vec<f64>], weights: &[f64], f: &dyn Fn(&[f64]) -> f64) -> (f64, f64) {
        let total: f64 = weights.iter().sum();
        let mean = draws.iter().zip(weights).map(|(u, w)| w * f(u)).sum::<f64>() / total;
        let squares: f64 = draws.iter().zip(weights).map(|(u, w)| (w * (f(u) - mean)).powi(2)).sum();
        (mean, squares.sqrt() / total)
    }

    /// Two parameters, each uniform from zero to `high`.
    fn space(high: f64) -> ParameterSpace {
        let named = |name: &str| Parameter { name: name.into(), prior: Prior::Uniform { low: 0.0, high } };
        ParameterSpace::new(vec![named("x"), named("y")]).unwrap()
    }

    #[test]
    fn weights_turn_draws_over_an_earlier_support_into_the_newest_prior() {
        let mut proposals = proposals();
        let map = UnitMap::new(&space(1.0), &space(1.6));
        let moved: Vec<Vec<f64>> = draws(&proposals, &|_| true, 3).iter().map(|u| map.apply(u)).collect();
        proposals.iter_mut().for_each(|p| p.follow(&map));
        // Draws from the newest prior, too: earlier ones leave the new ground empty.
        let mut all = draws(&[Drawn::new(Proposal::Prior, 4_000)], &|_| true, 4);
        all.extend(moved);
        proposals.push(Drawn::new(Proposal::Prior, 4_000));
        let weights = balance_weights(all.iter().map(Vec::as_slice), &proposals);
        for axis in 0..2 {
            let (value, error) = estimate(&all, &weights, &|u| u[axis]);
            assert!((value - 0.5).abs() < 4.0 * error + 0.003, "axis {axis}: {value} +- {error}");
        }
        // Twice moved, and back.
        let density = proposals[1].density(&[0.2, 0.22]);
        assert!(density > 0.0 && proposals[1].density(&[0.9, 0.9]) == 0.0);
        proposals[1].follow(&map.inverse());
        let own = proposals[1].proposal().density(&map.inverse().apply(&[0.2, 0.22]));
        assert!((proposals[1].density(&map.inverse().apply(&[0.2, 0.22])) - own).abs() < 1e-9 * own);
        assert!((density - own / map.volume()).abs() < 1e-9 * own, "{density}, {own}");
    }

    #[test]
    fn every_density_integrates_to_one() {
        let at = |i: usize| (i as f64 + 0.5) / 400.0;
        for proposal in proposals() {
            let sum: f64 = (0..160_000).map(|i| proposal.density(&[at(i / 400), at(i % 400)]) / 160_000.0).sum();
            // A region's volume and a mixture's mass inside are estimates: 4 x 1.3 % and 4 x 0.2 %.
            assert!((sum - 1.0).abs() < 0.055, "{sum}: {proposal:?}");
            assert_eq!(proposal.density(&[1.2, 0.5]), 0.0);
        }
    }

    #[test]
    fn balance_weights_turn_draws_of_all_proposals_into_the_prior() {
        let proposals = proposals();
        let draws = draws(&proposals, &|_| true, 0);
        let weights = balance_weights(draws.iter().map(Vec::as_slice), &proposals);
        // The mean weight estimates one.
        let mean = weights.iter().sum::<f64>() / weights.len() as f64;
        assert!((mean - 1.0).abs() < 0.06, "{mean}");
        type Function<'a> = &'a dyn Fn(&[f64]) -> f64;
        let expectations: [(&str, f64, Function<'_>); 4] = [
            ("mean of x", 0.5, &|u| u[0]),
            ("mean of y", 0.5, &|u| u[1]),
            ("second moment of x", 1.0 / 3.0, &|u| u[0] * u[0]),
            ("moment of x and y", 0.25, &|u| u[0] * u[1]),
        ];
        for (what, exact, f) in expectations {
            let (value, error) = estimate(&draws, &weights, f);
            // Four standard errors, and the 1 % of the region's volume: one wrong seed in 4,000 for all of them.
            assert!((value - exact).abs() < 4.0 * error + 0.003, "{what}: {value} +- {error}, exact {exact}");
            let plain = estimate(&draws, &vec![1.0; draws.len()], f).0;
            assert!((plain - exact).abs() > 8.0 * error, "{what}: no weights would do too: {plain}");
        }
    }

    #[test]
    fn unusable_draws_count_in_the_weights_of_the_others() {
        // The half nearer to the mixture's first component is usable: the prior loses half of its draws, the region fewer.
        let usable = |u: &[f64]| u[0] < 0.5;
        let proposals = proposals();
        let draws = draws(&proposals, &usable, 1);
        let weights = balance_weights(draws.iter().map(Vec::as_slice), &proposals);
        let (value, error) = estimate(&draws, &weights, &|u| u[0]);
        assert!((value - 0.25).abs() < 4.0 * error + 0.003, "{value} +- {error}");
    }

    #[test]
    fn weights_of_one_proposal_are_equal_within_a_region() {
        let region = next(ProposalKind::Truncated { tail: 0.1, least_shrink: 1e-6 }, 0);
        assert!(region.covers(&[0.3, 0.35]) && !region.covers(&[0.01, 0.99]) && !region.covers(&[1.2, 0.45]));
        assert!(next(ProposalKind::Posterior { prior_share: 0.1 }, 1).covers(&[0.01, 0.99]));
        let both = [Proposal::Prior, region].map(|p| Drawn::new(p, 100));
        let inside = [[0.3, 0.35], [0.32, 0.3], [0.6, 0.45]];
        let weights = balance_weights(inside.iter().map(<[f64; 2]>::as_slice), &both);
        assert!(weights.iter().all(|w| *w == weights[0]), "{weights:?}");
        assert!((effective_sample_size(&weights) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_share_of_the_prior_bounds_the_weights() {
        let prior_share = 0.1;
        let only = [Drawn::new(next(ProposalKind::Posterior { prior_share }, 1), 1_000)];
        let draws = draws(&only, &|_| true, 2);
        let weights = balance_weights(draws.iter().map(Vec::as_slice), &only);
        let greatest = weights.iter().copied().fold(0.0, f64::max);
        assert!(greatest <= 1.0 / prior_share && greatest > 5.0, "{greatest}");
    }

    #[test]
    fn effective_sample_size_is_kishs() {
        assert_eq!(effective_sample_size(&[0.25; 8]), 8.0);
        assert_eq!(effective_sample_size(&[5.0, 0.0, 0.0]), 1.0);
        assert_eq!(effective_sample_size(&[3.0, 1.0]), 1.6);
        assert_eq!(effective_sample_size(&[]), 0.0);
    }

    #[test]
    fn a_mixture_outside_of_the_support_keeps_the_last_proposal() {
        let far = DMatrix::from_diagonal_element(2, 2, 1e-4);
        let outside = Mixture::new(&[1.0], vec![DVector::from_element(2, 9.0)], vec![far]).unwrap();
        let kinds =
            [ProposalKind::Truncated { tail: 1e-3, least_shrink: 0.25 }, ProposalKind::Posterior { prior_share: 0.2 }];
        for kind in kinds {
            let mut rng = seed::rng(59, 0);
            let prior = Drawn::new(Proposal::Prior, 100);
            let first = Proposal::next(kind, &outside, &prior, 2, &mut rng).unwrap();
            assert!(matches!(first, Proposal::Prior), "{first:?}");
            let narrow = Proposal::next(kind, &posterior(), &prior, 2, &mut rng).unwrap();
            let mut last = Drawn::new(narrow.clone(), 100);
            let next = Proposal::next(kind, &outside, &last, 3, &mut rng).unwrap();
            let at = |p: &Proposal| [[0.3, 0.35], [0.99, 0.01]].map(|u| p.density(&u));
            assert_eq!(at(&next), at(&narrow));
            // A proposal over an earlier support may reach out of the newest one.
            last.follow(&UnitMap::new(&space(1.0), &space(2.0)));
            assert!(matches!(Proposal::next(kind, &outside, &last, 3, &mut rng).unwrap(), Proposal::Prior));
        }
    }
}
