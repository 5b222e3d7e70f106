//! Physical parameters, their priors, and the unit coordinates in which inference works.

mod prior;

pub use prior::{Prior, Weighted};

use rand::{Rng, RngExt};
use serde::{Deserialize, Deserializer, Serialize, de};
use thiserror::Error;

/// Most parameters of a space. It bounds the memory that a damaged file can claim.
const MOST_PARAMETERS: usize = 256;

/// Inferred parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Name with its unit, such as `length_m` or `youngs_modulus_pa`.
    pub name: String,
    /// Prior distribution. Its bounds are the support.
    pub prior: Prior,
}

/// Space of the D inferred parameters theta, in order.
///
/// Unit coordinate `i` of a theta is the prior's cumulative distribution function of parameter `i`. The prior is
/// therefore uniform on the unit cube.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct ParameterSpace {
    parameters: Vec<Parameter>,
}

/// Reads the parameters and checks them as [`ParameterSpace::new`] does.
impl<'de> Deserialize<'de> for ParameterSpace {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::new(Vec::deserialize(deserializer)?).map_err(de::Error::custom)
    }
}

/// Reason for which a list of parameters or a theta is refused.
#[derive(Debug, Error, PartialEq)]
pub enum ParameterError {
    /// Prior whose numbers make no distribution.
    #[error("theta `{name}`: {what}")]
    Prior {
        /// Name of the parameter.
        name: String,
        /// Expectation and given value.
        what: String,
    },
    /// Name that is listed twice.
    #[error("theta `{0}` is listed twice")]
    Duplicate(String),
    /// More parameters than any model has.
    #[error("theta: expected at most {MOST_PARAMETERS} parameters, got {0}")]
    Many(usize),
    /// Theta of the wrong length.
    #[error("expected {expected} values of theta ({names}), got {got}")]
    Length {
        /// Expected length.
        expected: usize,
        /// Given length.
        got: usize,
        /// Names of the parameters.
        names: String,
    },
}

/// Reads parameters without a check, for a model: its own check names line and field.
///
/// # Errors
/// Errors of the format.
pub(crate) fn unchecked<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ParameterSpace, D::Error> {
    Ok(ParameterSpace { parameters: Vec::deserialize(deserializer)? })
}

impl ParameterSpace {
    /// Builds a space from parameters in order.
    ///
    /// # Errors
    /// [`ParameterError`] if a prior makes no distribution, a name comes twice, or there are more than 256 parameters.
    pub fn new(parameters: Vec<Parameter>) -> Result<Self, ParameterError> {
        if parameters.len() > MOST_PARAMETERS {
            return Err(ParameterError::Many(parameters.len()));
        }
        for (i, p) in parameters.iter().enumerate() {
            p.prior.check().map_err(|what| ParameterError::Prior { name: p.name.clone(), what })?;
            if parameters[..i].iter().any(|other| other.name == p.name) {
                return Err(ParameterError::Duplicate(p.name.clone()));
            }
        }
        Ok(Self { parameters })
    }

    /// Parameters in order.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Number D of parameters.
    pub fn dimension(&self) -> usize {
        self.parameters.len()
    }

    /// Index of the parameter called `name`.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|p| p.name == name)
    }

    /// True if `other` has the same parameters in the same order, with priors that are equal up to their bounds.
    pub fn equals_up_to_bounds(&self, other: &Self) -> bool {
        let pairs = || self.parameters.iter().zip(&other.parameters);
        self.dimension() == other.dimension()
            && pairs().all(|(a, b)| a.name == b.name && a.prior.equals_up_to_bounds(&b.prior))
    }

    /// Converts `theta` (length D) to unit coordinates (length D).
    pub fn to_unit(&self, theta: &[f64]) -> Vec<f64> {
        self.parameters.iter().zip(theta).map(|(p, &v)| p.prior.to_unit(v)).collect()
    }

    /// Converts unit coordinates `u` (length D) to a theta (length D).
    pub fn from_unit(&self, u: &[f64]) -> Vec<f64> {
        self.parameters.iter().zip(u).map(|(p, &u)| p.prior.from_unit(u)).collect()
    }

    /// Draws one theta (length D) from the prior.
    pub fn sample_prior<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        self.parameters.iter().map(|p| p.prior.from_unit(rng.random::<f64>())).collect()
    }

    /// Parameters whose values in `theta` (length D) lie outside the support of their priors: name, value and prior.
    pub fn outside<'a>(&'a self, theta: &'a [f64]) -> impl Iterator<Item = (&'a str, f64, &'a Prior)> {
        let given = self.parameters.iter().zip(theta);
        // `holds` and not the bounds: the support of a mixture has gaps.
        given.filter(|(p, value)| !p.prior.holds(**value)).map(|(p, value)| (p.name.as_str(), *value, &p.prior))
    }

    /// Splits a row-major N x D matrix of thetas into its N rows.
    ///
    /// # Errors
    /// [`ParameterError::Length`] if the length is not a multiple of D.
    pub fn rows(&self, flat: &[f64]) -> Result<Vec<Vec<f64>>, ParameterError> {
        let d = self.dimension();
        if d == 0 || !flat.len().is_multiple_of(d) {
            let names: Vec<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
            return Err(ParameterError::Length { expected: d, got: flat.len(), names: names.join(", ") });
        }
        Ok(flat.chunks_exact(d).map(<[f64]>::to_vec).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn space() -> ParameterSpace {
        ParameterSpace::new(vec![
            Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 0.195, high: 0.305 } },
            Parameter { name: "youngs_modulus_pa".into(), prior: Prior::LogUniform { low: 1e3, high: 5e4 } },
        ])
        .unwrap()
    }

    proptest! {
        #[test]
        fn unit_coordinates_round_trip(u in 0.0f64..1.0, v in 0.0f64..1.0) {
            let s = space();
            let back = s.to_unit(&s.from_unit(&[u, v]));
            prop_assert!((back[0] - u).abs() < 1e-12 && (back[1] - v).abs() < 1e-12);
        }
    }

    #[test]
    fn spaces_that_differ_by_bounds_are_told_from_other_spaces() {
        let wide = |name: &str| {
            let mut parameters = space().parameters().to_vec();
            parameters[1] = Parameter { name: name.into(), prior: Prior::LogUniform { low: 1e3, high: 2e5 } };
            ParameterSpace::new(parameters).unwrap()
        };
        assert!(space().equals_up_to_bounds(&wide("youngs_modulus_pa")) && space() != wide("youngs_modulus_pa"));
        assert!(!space().equals_up_to_bounds(&wide("bending_stiffness_n_m2")));
        let shorter = ParameterSpace::new(space().parameters()[..1].to_vec()).unwrap();
        assert!(!space().equals_up_to_bounds(&shorter));
    }

    #[test]
    fn values_outside_their_priors_are_found() {
        let s = space();
        assert_eq!(s.outside(&[0.25, 1e4]).count(), 0);
        assert_eq!(s.outside(&[0.195, 5e4]).count(), 0, "the edges belong to the support");
        let outside: Vec<(&str, f64)> = s.outside(&[0.31, 10.0]).map(|(name, value, _)| (name, value)).collect();
        assert_eq!(outside, [("length_m", 0.31), ("youngs_modulus_pa", 10.0)]);
    }

    #[test]
    fn bad_priors_and_names_are_named_in_the_error() {
        let p = |name: &str, prior| Parameter { name: name.into(), prior };
        let e = ParameterSpace::new(vec![p("a", Prior::LogUniform { low: 0.0, high: 1.0 })]).unwrap_err();
        assert_eq!(e.to_string(), "theta `a`: log_uniform needs low > 0, got 0");
        let u = Prior::Uniform { low: 0.0, high: 1.0 };
        assert_eq!(
            ParameterSpace::new(vec![p("a", u.clone()), p("a", u)]).unwrap_err(),
            ParameterError::Duplicate("a".into())
        );
        assert!(ParameterSpace::new(vec![p("a", Prior::Uniform { low: 1.0, high: f64::NAN })]).is_err());
    }
}
