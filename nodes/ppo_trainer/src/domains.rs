//! Which parameters the environments simulate.

use catenary_core::mixture::MixtureError;
use catenary_core::{ParameterSpace, Posterior, seed};

/// Draws of the prior from which each reset takes one.
const PRIOR_DRAWS: usize = 1024;

/// A distribution over the environments' parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum Domains {
    /// Drawn anew from the prior at each reset.
    Prior(ParameterSpace),
    /// One low-variance sample of a posterior for each environment.
    Mixture(Posterior),
    /// One value for all.
    Point(Vec<f64>),
}

impl Domains {
    /// Thetas to open `environments` environments with: as many rows as environments, of which each keeps its own, or more,
    /// of which one is drawn at each reset.
    pub fn rows(&self, environments: usize, domain_seed: u64) -> Result<Vec<Vec<f64>>, MixtureError> {
        match self {
            Domains::Prior(space) => {
                let mut rng = seed::rng(domain_seed, 0);
                Ok((0..PRIOR_DRAWS.max(environments + 1)).map(|_| space.sample_prior(&mut rng)).collect())
            }
            Domains::Mixture(posterior) => posterior.sample_low_variance(environments, domain_seed),
            Domains::Point(theta) => Ok(vec![theta.clone(); environments]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, Prior};

    #[test]
    fn rows_are_as_many_as_their_meaning_asks_for() {
        let p = Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 1.0, high: 2.0 } };
        let space = ParameterSpace::new(vec![p]).unwrap();
        assert!(Domains::Prior(space.clone()).rows(12, 1).unwrap().len() > 12);
        let posterior = Domains::Mixture(Posterior::prior(space)).rows(12, 1).unwrap();
        assert!(posterior.len() == 12 && posterior.iter().all(|t| (1.0..=2.0).contains(&t[0])));
        assert_eq!(Domains::Point(vec![1.5]).rows(3, 1).unwrap(), vec![vec![1.5]; 3]);
    }
}
