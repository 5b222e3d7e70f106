//! Posterior over theta: a mixture in the unit coordinates of a parameter space.

use crate::mixture::{MixtureError, in_unit_cube};
use crate::statistics::{QuantileMethod, mean, quantile, sd};
use crate::{Mixture, ParameterSpace, seed};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Number of draws behind a summary. The 5 % quantile of a Gaussian then has a standard error of 3 % of its sd.
const SUMMARY_DRAWS: usize = 4_000;

/// Distribution over theta that is zero outside the prior's support.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written")]
pub struct Posterior {
    /// Parameters with their priors.
    pub parameters: ParameterSpace,
    /// Mixture over the unit coordinates. The posterior is its truncation to the unit cube.
    pub mixture: Mixture,
}

/// File format of a posterior.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    parameters: ParameterSpace,
    mixture: Mixture,
}

impl TryFrom<Written> for Posterior {
    type Error = MixtureError;

    fn try_from(Written { parameters, mixture }: Written) -> Result<Self, MixtureError> {
        Self::new(parameters, mixture)
    }
}

/// Summary of one parameter under a posterior, in the parameter's unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Marginal {
    /// Name of the parameter.
    pub name: String,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// 5 % quantile.
    pub q05: f64,
    /// Median.
    pub median: f64,
    /// 95 % quantile.
    pub q95: f64,
}

impl Posterior {
    /// Builds a posterior from parameters and a mixture over their unit coordinates.
    ///
    /// # Errors
    /// [`MixtureError::Shape`] if the mixture has another number of coordinates than there are parameters.
    pub fn new(parameters: ParameterSpace, mixture: Mixture) -> Result<Self, MixtureError> {
        let (expected, got) = (parameters.dimension(), mixture.dimension());
        if expected != got {
            return Err(MixtureError::Shape {
                expected: format!("a coordinate for each of {expected} parameters"),
                got: format!("{got} coordinates"),
            });
        }
        Ok(Self { parameters, mixture })
    }

    /// Prior in the form of a posterior: one component that is far wider than the unit cube, so nearly flat on it.
    pub fn prior(parameters: ParameterSpace) -> Self {
        let d = parameters.dimension();
        // Variance 4: the density falls by 3 % from the middle of the cube to a face.
        let mixture =
            Mixture::new(&[1.0], vec![DVector::from_element(d, 0.5)], vec![DMatrix::from_diagonal_element(d, d, 4.0)])
                .expect("a multiple of the identity is positive definite");
        Self { parameters, mixture }
    }

    /// Draws `n` independent thetas, in the parameters' units.
    pub fn sample(&self, n: usize, seed: u64) -> Result<Vec<Vec<f64>>, MixtureError> {
        let mut rng = seed::rng(seed, 0);
        (0..n).map(|_| Ok(self.parameters.from_unit(&self.mixture.sample_truncated(&mut rng)?))).collect()
    }

    /// Draws `n` thetas with [`Mixture::sample_low_variance`], in the parameters' units.
    pub fn sample_low_variance(&self, n: usize, seed: u64) -> Result<Vec<Vec<f64>>, MixtureError> {
        let draws = self.mixture.sample_low_variance(n, &mut seed::rng(seed, 1))?;
        Ok(draws.iter().map(|u| self.parameters.from_unit(u)).collect())
    }

    /// Log density of the mixture at `theta` in unit coordinates, not normalised for the truncation. It is minus
    /// infinity outside the support.
    pub fn log_density_unit(&self, theta: &[f64]) -> f64 {
        let u = self.parameters.to_unit(theta);
        if in_unit_cube(&u) { self.mixture.log_density(&u) } else { f64::NEG_INFINITY }
    }

    /// Information over the prior, nat: the Kullback-Leibler divergence of the posterior from the prior, whose density is 1 in unit
    /// coordinates. From draws with a fixed seed: the standard error is below 0.03 for two parameters, and larger for a mixture most of which
    /// lies outside the support.
    ///
    /// # Errors
    /// [`MixtureError::OutsideSupport`] if no draw falls inside the support.
    pub fn information_nat(&self) -> Result<f64, MixtureError> {
        let rng = &mut seed::rng(0, 2);
        let log_mass = (1.0 - self.mixture.mass_outside(SUMMARY_DRAWS, rng)).ln();
        let log_density = |_| Ok(self.mixture.log_density(&self.mixture.sample_truncated(rng)?) - log_mass);
        Ok(mean(&(0..SUMMARY_DRAWS).map(log_density).collect::<Result<Vec<f64>, MixtureError>>()?))
    }

    /// Computes mean, standard deviation and quantiles of each parameter from draws with a fixed seed.
    pub fn marginals(&self) -> Result<Vec<Marginal>, MixtureError> {
        let draws = self.sample(SUMMARY_DRAWS, 0)?;
        let summary = |i: usize, name: &str| {
            let mut values: Vec<f64> = draws.iter().map(|t| t[i]).collect();
            values.sort_by(f64::total_cmp);
            let at = |q: f64| quantile(&values, q, QuantileMethod::Nearest);
            Marginal {
                name: name.to_owned(),
                mean: mean(&values),
                sd: sd(&values),
                q05: at(0.05),
                median: at(0.5),
                q95: at(0.95),
            }
        };
        let parameters = self.parameters.parameters();
        Ok(parameters.iter().enumerate().map(|(i, p)| summary(i, &p.name)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Parameter, Prior};

    #[test]
    fn the_prior_as_a_posterior_has_the_priors_quantiles() {
        let p = Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 2.0, high: 4.0 } };
        let prior = Posterior::prior(ParameterSpace::new(vec![p]).unwrap());
        let m = &prior.marginals().unwrap()[0];
        assert!((m.median - 3.0).abs() < 0.05 && (m.q05 - 2.1).abs() < 0.05 && (m.q95 - 3.9).abs() < 0.05, "{m:?}");
        assert_eq!(prior.log_density_unit(&[1.9]), f64::NEG_INFINITY);
        // Four fifths of the mixture lie outside: the standard error is 0.03.
        assert!(prior.information_nat().unwrap().abs() < 0.1);
    }

    #[test]
    fn a_file_of_a_posterior_is_checked_where_it_is_read() {
        let good = r#"{"parameters": [{"name": "length_m", "prior": {"log_uniform": {"low": 1.0, "high": 4.0}}}],
                       "mixture": {"weights": [1.0], "means": [[0.5]], "covariances": [[[0.01]]]}}"#;
        let read = |text: &str| serde_json::from_str::<Posterior>(text).map_err(|e| e.to_string());
        let posterior = read(good).unwrap();
        assert_eq!(read(&serde_json::to_string(&posterior).unwrap()), Ok(posterior));
        for (from, to, words) in [
            ("1.0, \"high", "0, \"high", "theta `length_m`: log_uniform needs low > 0, got 0"),
            ("1.0, \"high", "-1, \"high", "theta `length_m`: log_uniform needs low > 0, got -1"),
            ("1.0, \"high", "1e-320, \"high", "log_uniform needs a finite high / low"),
            ("4.0", "0.5", "expected finite low < high, got low 1.0, high 0.5"),
            ("[[0.5]]", "[[0.5, 0.5]]", "mixture: expected covariances of 2 x 2"),
            ("[[0.5]]", "[[1e31]]", "component 0: expected means within 1e30"),
            ("[[[0.01]]]", "[[[1e61]]]", "variances of at most 1e60, in unit coordinates, got 1e61"),
            ("[[[0.01]]]", "[[[-0.01]]]", "component 0: expected a finite mean and a symmetric positive definite"),
            ("[1.0]", "[-1.0]", "weights must be finite, not negative"),
            ("\"mixture\"", "\"extra\": 1, \"mixture\"", "unknown field `extra`"),
        ] {
            let error = read(&good.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(words), "{to}: {error}");
        }
        let two = good.replace("[[0.5]]", "[[0.5, 0.5]]").replace("[[[0.01]]]", "[[[0.01, 0.0], [0.0, 0.01]]]");
        assert!(read(&two).unwrap_err().contains("expected a coordinate for each of 1 parameters, got 2 coordinates"));
    }

    #[test]
    fn information_is_that_of_a_gaussian_whole_or_cut_in_half() {
        let p = Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 2.0, high: 4.0 } };
        let parameters = ParameterSpace::new(vec![p]).unwrap();
        let at = |mean: f64| {
            let covariance = DMatrix::from_element(1, 1, 0.01_f64.powi(2));
            let mixture = Mixture::new(&[1.0], vec![DVector::from_element(1, mean)], vec![covariance]).unwrap();
            Posterior { parameters: parameters.clone(), mixture }.information_nat().unwrap()
        };
        // Minus the entropy of a Gaussian, 0.5 ln(2 pi e sd^2).
        let exact = -0.5 * (2.0 * std::f64::consts::PI * std::f64::consts::E * 1e-4).ln();
        assert!((at(0.5) - exact).abs() < 0.03, "{} {exact}", at(0.5));
        assert!((at(0.0) - exact - 2.0_f64.ln()).abs() < 0.06, "{} {exact}", at(0.0));
    }
}
