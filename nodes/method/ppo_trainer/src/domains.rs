//! Domains: the parameters that the environments simulate.

use catenary_core::mixture::MixtureError;
use catenary_core::{ParameterSpace, Posterior, seed};

/// Number of prior draws, of which each reset picks one.
const PRIOR_DRAWS: usize = 1024;

/// Distribution of the environments' parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum Domains {
    /// A new draw from the prior at each reset.
    Prior(ParameterSpace),
    /// Low-variance samples of a posterior, one for each environment.
    Mixture(Posterior),
    /// One value for all environments.
    Point(Vec<f64>),
}

impl Domains {
    /// Thetas with which `environments` environments are opened. If there are as many rows as environments, each environment
    /// keeps its own row. If there are more, each reset draws one of them.
    ///
    /// # Errors
    /// [`MixtureError`] if the posterior cannot be sampled within the prior's support.
    pub fn rows(&self, environments: usize, domain_seed: u64) -> Result<Vec<Vec<f64>>, MixtureError> {
        match self {
            Domains::Prior(space) => {
                let mut rng = seed::rng(domain_seed, 0);
                // At least one row more than environments: the number of rows tells the pool to draw at each reset.
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
    fn a_prior_has_more_rows_than_environments_and_other_domains_have_as_many() {
        let p = Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 1.0, high: 2.0 } };
        let space = ParameterSpace::new(vec![p]).unwrap();
        assert!(Domains::Prior(space.clone()).rows(12, 1).unwrap().len() > 12);
        let posterior = Domains::Mixture(Posterior::prior(space)).rows(12, 1).unwrap();
        assert!(posterior.len() == 12 && posterior.iter().all(|t| (1.0..=2.0).contains(&t[0])));
        assert_eq!(Domains::Point(vec![1.5]).rows(3, 1).unwrap(), vec![vec![1.5]; 3]);
    }
}
