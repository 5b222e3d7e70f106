//! What thetas are drawn from, with its density.

use super::region::{MOST_DRAWS, Region};
use crate::error::InferenceError;
use crate::settings::ProposalKind;
use catenary_core::Mixture;
use catenary_core::mixture::in_unit_cube;
use rand::{Rng, RngExt};

/// Mixture draws behind the mass inside the unit cube.
const MASS_DRAWS: usize = 20_000;

/// A distribution over unit coordinates, zero outside the unit cube.
#[derive(Debug, Clone)]
pub enum Proposal {
    /// The prior.
    Prior,
    /// The prior restricted to a region.
    Region(Box<Region>),
    /// A truncated mixture and a share of the prior.
    Mixture {
        /// The mixture.
        mixture: Box<Mixture>,
        /// Its mass inside the unit cube.
        inside: f64,
        /// Share of the prior.
        prior_share: f64,
    },
}

impl Proposal {
    /// The proposal of `kind` for the posterior `mixture`; `last` is the proposal before.
    pub fn next<R: Rng>(
        kind: ProposalKind,
        mixture: &Mixture,
        last: &Proposal,
        iteration: usize,
        rng: &mut R,
    ) -> Result<Self, InferenceError> {
        match kind {
            ProposalKind::Truncated { tail, least_shrink } => {
                let volume = if let Proposal::Region(region) = last { region.volume() } else { 1.0 };
                let region = Region::new(mixture, tail, least_shrink * volume, rng)
                    .map_err(|source| InferenceError::Posterior { iteration, source })?;
                Ok(Proposal::Region(Box::new(region)))
            }
            ProposalKind::Posterior { prior_share } => {
                let inside = 1.0 - mixture.mass_outside(MASS_DRAWS, rng);
                Ok(Proposal::Mixture { mixture: Box::new(mixture.clone()), inside, prior_share })
            }
        }
    }

    /// Density at `u`.
    pub fn density(&self, u: &[f64]) -> f64 {
        if !in_unit_cube(u) {
            return 0.0;
        }
        match self {
            Proposal::Prior => 1.0,
            Proposal::Region(region) if region.contains(u) => 1.0 / region.volume(),
            Proposal::Region(_) => 0.0,
            Proposal::Mixture { mixture, inside, prior_share } => {
                prior_share + (1.0 - prior_share) * mixture.log_density(u).exp() / inside.max(1.0 / MASS_DRAWS as f64)
            }
        }
    }

    /// Whether networks should look at a track from `u` while this is the newest proposal.
    pub fn covers(&self, u: &[f64]) -> bool {
        match self {
            Proposal::Region(region) => region.contains(u),
            _ => true,
        }
    }

    /// One draw.
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
                mixture.sample_truncated(rng).map_err(|source| InferenceError::Posterior { iteration, source })
            }
        }
    }
}

/// Importance weights of draws `theta` that came from several proposals: prior over the mixture of all of them, by the
/// balance heuristic (Veach and Guibas 1995). `proposals` are (proposal, number of its usable draws).
pub fn balance_weights<'a>(theta: impl Iterator<Item = &'a [f64]>, proposals: &[(Proposal, usize)]) -> Vec<f64> {
    let total: usize = proposals.iter().map(|(_, n)| n).sum();
    theta
        .map(|u| {
            let density: f64 = proposals.iter().map(|(p, n)| *n as f64 * p.density(u)).sum();
            total as f64 / density
        })
        .collect()
}

/// Kish's effective sample size, `(sum w)^2 / sum w^2`.
pub fn effective_sample_size(weights: &[f64]) -> f64 {
    let sum: f64 = weights.iter().sum();
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}
