//! Prior distributions of one parameter.

use serde::{Deserialize, Serialize};
use std::f64::consts::{SQRT_2, TAU};
use std::fmt;

/// Number of bisections of a quantile. 80 halvings of the bounds exceed the 52 bits of a double's fraction.
const HALVINGS: usize = 80;
/// Least mass of a Gaussian inside its bounds. Below it the bounds are taken for a mistake.
const LEAST_INSIDE: f64 = 1e-6;
/// Most parts of a mixture. It bounds the memory and the time that a damaged file can claim.
const MOST_PARTS: usize = 1000;

/// Prior distribution of one parameter. Every prior has bounds; values outside them are impossible, whatever the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Prior {
    /// Uniform on `[low, high]`, in the parameter's own unit.
    Uniform {
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// Uniform in the logarithm on `[low, high]`; both bounds positive.
    LogUniform {
        /// Lower bound, above zero.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// Gaussian truncated to `[low, high]`, in the parameter's own unit.
    Normal {
        /// Mean of the Gaussian before its truncation.
        mean: f64,
        /// Standard deviation of the Gaussian before its truncation, above zero.
        sd: f64,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// Mixture of priors with weights.
    Mixture(Vec<Weighted>),
}

/// Component of a mixture of priors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weighted {
    /// Weight relative to the other components, above zero.
    pub weight: f64,
    /// Prior of the component, which must not be a mixture.
    pub prior: Prior,
}

impl Prior {
    /// Bounds `(low, high)` of the support, in the parameter's unit. The support of a mixture may have gaps.
    pub fn bounds(&self) -> (f64, f64) {
        match self {
            Prior::Uniform { low, high } | Prior::LogUniform { low, high } | Prior::Normal { low, high, .. } => {
                (*low, *high)
            }
            Prior::Mixture(parts) => parts.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), part| {
                let (l, h) = part.prior.bounds();
                (low.min(l), high.max(h))
            }),
        }
    }

    /// True if `value` lies in the support. The support of a mixture may have gaps.
    pub fn holds(&self, value: f64) -> bool {
        match self {
            Prior::Mixture(parts) => parts.iter().any(|part| part.prior.holds(value)),
            _ => (self.bounds().0..=self.bounds().1).contains(&value),
        }
    }

    /// Prior of the same family with other bounds. None for a mixture, whose bounds belong to its parts.
    pub fn with_bounds(&self, low: f64, high: f64) -> Option<Prior> {
        match *self {
            Prior::Uniform { .. } => Some(Prior::Uniform { low, high }),
            Prior::LogUniform { .. } => Some(Prior::LogUniform { low, high }),
            Prior::Normal { mean, sd, .. } => Some(Prior::Normal { mean, sd, low, high }),
            Prior::Mixture(_) => None,
        }
    }

    /// True if the two priors are equal up to their bounds.
    pub fn equals_up_to_bounds(&self, other: &Prior) -> bool {
        let (low, high) = self.bounds();
        self == other || other.with_bounds(low, high).as_ref() == Some(self)
    }

    /// Cumulative distribution function: the unit coordinate of `value`. It continues outside `[0, 1]` for values
    /// outside the support, so a search can be led back.
    pub fn to_unit(&self, value: f64) -> f64 {
        let (low, high) = self.bounds();
        match self {
            Prior::Uniform { .. } => (value - low) / (high - low),
            Prior::LogUniform { .. } => (value / low).ln() / (high / low).ln(),
            _ if value < low => (value - low) / (high - low),
            _ if value > high => 1.0 + (value - high) / (high - low),
            Prior::Normal { mean, sd, .. } => {
                let z = |v: f64| (v - mean) / sd;
                gaussian_mass(z(low), z(value)) / gaussian_mass(z(low), z(high))
            }
            Prior::Mixture(parts) => {
                let total: f64 = parts.iter().map(|p| p.weight).sum();
                parts.iter().map(|p| p.weight * p.prior.to_unit(value).clamp(0.0, 1.0)).sum::<f64>() / total
            }
        }
    }

    /// Quantile function: the value at unit coordinate `u`. It inverts [`Prior::to_unit`], also outside `[0, 1]`.
    pub fn from_unit(&self, u: f64) -> f64 {
        let (low, high) = self.bounds();
        match self {
            Prior::Uniform { .. } => low + u * (high - low),
            Prior::LogUniform { .. } => low * (u * (high / low).ln()).exp(),
            _ if u <= 0.0 => low + u * (high - low),
            _ if u >= 1.0 => high + (u - 1.0) * (high - low),
            Prior::Normal { .. } | Prior::Mixture(_) => {
                let halve = |(low, high): (f64, f64), _| {
                    let middle = 0.5 * (low + high);
                    if self.to_unit(middle) < u { (middle, high) } else { (low, middle) }
                };
                let (low, high) = (0..HALVINGS).fold((low, high), halve);
                0.5 * (low + high)
            }
        }
    }

    /// Density at `value`, per unit of the parameter.
    pub fn density(&self, value: f64) -> f64 {
        let (low, high) = self.bounds();
        match self {
            _ if !(low..=high).contains(&value) => 0.0,
            Prior::Uniform { .. } => 1.0 / (high - low),
            Prior::LogUniform { .. } => 1.0 / (value * (high / low).ln()),
            Prior::Normal { mean, sd, .. } => {
                let z = |v: f64| (v - mean) / sd;
                (-0.5 * z(value).powi(2)).exp() / (TAU.sqrt() * sd * gaussian_mass(z(low), z(high)))
            }
            Prior::Mixture(parts) => {
                let total: f64 = parts.iter().map(|p| p.weight).sum();
                parts.iter().map(|p| p.weight * p.prior.density(value)).sum::<f64>() / total
            }
        }
    }

    /// Derivative of the value with respect to its unit coordinate, at `value`: 1 over the density. Values outside the
    /// bounds take the density at the nearest bound.
    pub fn slope(&self, value: f64) -> f64 {
        match self {
            Prior::Uniform { low, high } => high - low,
            Prior::LogUniform { low, high } => value * (high / low).ln(),
            Prior::Normal { .. } | Prior::Mixture(_) => {
                let (low, high) = self.bounds();
                1.0 / self.density(value.clamp(low, high))
            }
        }
    }

    /// Rejects numbers that are not finite, bounds out of order, bounds of a log-uniform prior that are not positive,
    /// Gaussians with no mass inside their bounds, empty mixtures, and mixtures of mixtures.
    ///
    /// # Errors
    /// A sentence with expectation and given value.
    pub fn check(&self) -> Result<(), String> {
        if let Prior::Mixture(parts) = self {
            return check_parts(parts);
        }
        let (low, high) = self.bounds();
        // The range, too: values are computed from it.
        if !((high - low).is_finite() && low < high) {
            return Err(format!("expected finite low < high, got low {low:?}, high {high:?}"));
        }
        match self {
            Prior::LogUniform { .. } if low <= 0.0 => Err(format!("log_uniform needs low > 0, got {low}")),
            Prior::LogUniform { .. } if !(high / low).is_finite() => {
                Err(format!("log_uniform needs a finite high / low, got low {low:?}, high {high:?}"))
            }
            Prior::Normal { mean, sd, .. } => {
                if !(mean.is_finite() && sd.is_finite() && *sd > 0.0) {
                    return Err(format!("normal needs a finite mean and sd > 0, got mean {mean}, sd {sd}"));
                }
                let inside = gaussian_mass((low - mean) / sd, (high - mean) / sd);
                if inside < LEAST_INSIDE {
                    return Err(format!(
                        "normal of mean {mean}, sd {sd}: expected bounds that hold some of it, got low {low}, high {high}"
                    ));
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

fn check_parts(parts: &[Weighted]) -> Result<(), String> {
    if parts.is_empty() {
        return Err("mixture: expected at least one part, got none".into());
    }
    if parts.len() > MOST_PARTS {
        return Err(format!("mixture: expected at most {MOST_PARTS} parts, got {}", parts.len()));
    }
    for (i, part) in parts.iter().enumerate() {
        if !(part.weight.is_finite() && part.weight > 0.0) {
            return Err(format!("mixture part {i}: expected a weight > 0, got {}", part.weight));
        }
        if matches!(part.prior, Prior::Mixture(_)) {
            return Err(format!("mixture part {i}: expected uniform, log_uniform or normal, got a mixture"));
        }
        part.prior.check().map_err(|what| format!("mixture part {i}: {what}"))?;
    }
    Ok(())
}

impl fmt::Display for Prior {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Prior::Uniform { low, high } => write!(f, "uniform {low} to {high}"),
            Prior::LogUniform { low, high } => write!(f, "log-uniform {low} to {high}"),
            Prior::Normal { mean, sd, low, high } => write!(f, "normal {mean} +- {sd} within {low} to {high}"),
            Prior::Mixture(parts) => {
                for (i, part) in parts.iter().enumerate() {
                    write!(f, "{}{} x {}", if i == 0 { "" } else { " + " }, part.weight, part.prior)?;
                }
                Ok(())
            }
        }
    }
}

/// Mass of the standard normal distribution between `a` and `b`, with full relative precision in both tails.
fn gaussian_mass(a: f64, b: f64) -> f64 {
    let above = |z: f64| 0.5 * libm::erfc(z / SQRT_2);
    // The smaller tail is subtracted: 1 - erfc would lose the digits of a mass far from the middle.
    if a > 0.0 { above(a) - above(b) } else { above(-b) - above(-a) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn normal(mean: f64, sd: f64, low: f64, high: f64) -> Prior {
        Prior::Normal { mean, sd, low, high }
    }

    fn mixture(parts: &[(f64, Prior)]) -> Prior {
        Prior::Mixture(parts.iter().map(|(weight, prior)| Weighted { weight: *weight, prior: prior.clone() }).collect())
    }

    fn all() -> Vec<Prior> {
        vec![
            Prior::Uniform { low: -2.0, high: 3.0 },
            Prior::LogUniform { low: 1e-3, high: 5.0 },
            normal(0.25, 0.01, 0.2, 0.3),
            normal(5.0, 1.0, 7.0, 9.0),
            normal(5.0, 1.0, 1.0, 3.0),
            mixture(&[(3.0, normal(1.0, 0.2, 0.0, 2.0)), (1.0, Prior::LogUniform { low: 1.5, high: 4.0 })]),
            mixture(&[(1.0, Prior::Uniform { low: 0.0, high: 1.0 }), (1.0, Prior::Uniform { low: 2.0, high: 3.0 })]),
        ]
    }

    #[test]
    fn the_gap_of_a_mixture_is_outside_of_it() {
        let gap =
            mixture(&[(1.0, Prior::Uniform { low: 0.0, high: 1.0 }), (1.0, Prior::Uniform { low: 2.0, high: 3.0 })]);
        let held: Vec<bool> = [-0.1, 0.0, 1.5, 2.5, 3.1, f64::NAN].map(|value| gap.holds(value)).to_vec();
        assert_eq!(held, [false, true, false, true, false, false]);
    }

    #[test]
    fn other_bounds_change_nothing_else() {
        let wide = normal(0.25, 0.01, 0.2, 0.35);
        assert_eq!(normal(0.25, 0.01, 0.2, 0.3).with_bounds(0.2, 0.35), Some(wide.clone()));
        assert!(normal(0.25, 0.01, 0.2, 0.3).equals_up_to_bounds(&wide));
        assert!(!normal(0.25, 0.02, 0.2, 0.3).equals_up_to_bounds(&wide), "another standard deviation");
        let uniform = Prior::Uniform { low: 1.0, high: 2.0 };
        assert!(!uniform.equals_up_to_bounds(&Prior::LogUniform { low: 1.0, high: 2.0 }));
        let parts = mixture(&[(1.0, uniform.clone())]);
        assert!(parts.with_bounds(0.0, 3.0).is_none() && parts.equals_up_to_bounds(&parts));
        assert!(!parts.equals_up_to_bounds(&uniform));
    }

    proptest! {
        #[test]
        fn quantiles_invert_the_distribution_function(u in 0.0f64..1.0) {
            for prior in all() {
                let value = prior.from_unit(u);
                let (low, high) = prior.bounds();
                prop_assert!((low..=high).contains(&value), "{prior}: {value}");
                prop_assert!((prior.to_unit(value) - u).abs() < 1e-12, "{prior}: {u} comes back as {}", prior.to_unit(value));
            }
        }

        #[test]
        fn values_outside_the_support_come_back_too(beyond in 0.001f64..1.0) {
            for prior in all().into_iter().skip(2) {
                for u in [-beyond, 1.0 + beyond] {
                    prop_assert!((prior.to_unit(prior.from_unit(u)) - u).abs() < 1e-12, "{prior} at {u}");
                }
            }
        }
    }

    #[test]
    fn the_density_is_the_derivative_of_the_distribution_function() {
        for prior in all() {
            let (low, high) = prior.bounds();
            let step = 1e-6 * (high - low);
            for i in 1..40 {
                // The offset 0.123 keeps the values off the edges of the components, at which the density jumps.
                let value = low + (high - low) * (f64::from(i) + 0.123) / 40.5;
                let slope = (prior.to_unit(value + step) - prior.to_unit(value - step)) / (2.0 * step);
                let density = prior.density(value);
                assert!((slope - density).abs() < 1e-5 * (1.0 + density), "{prior} at {value}: {slope}, {density}");
                assert!((prior.slope(value) * density - 1.0).abs() < 1e-12 || density == 0.0, "{prior} at {value}");
            }
            assert_eq!((prior.density(low - 1.0), prior.density(high + 1.0)), (0.0, 0.0), "{prior}");
        }
    }

    #[test]
    fn a_normal_has_the_quantiles_of_the_tables() {
        let wide = normal(10.0, 2.0, -10.0, 30.0);
        for (u, z) in [(0.5, 0.0), (0.841_344_746_068_543, 1.0), (0.025, -1.959_963_984_540_054)] {
            assert!((wide.from_unit(u) - (10.0 + 2.0 * z)).abs() < 1e-9, "{u}: {}", wide.from_unit(u));
        }
        // Far out in the tail, a truncated Gaussian is close to an exponential distribution of rate z: its median lies
        // ln 2 / z beyond the bound.
        let tail = normal(0.0, 1.0, 4.9, 5.9);
        assert!((tail.from_unit(0.5) - 4.9 - std::f64::consts::LN_2 / 4.9).abs() < 0.01, "{}", tail.from_unit(0.5));
    }

    #[test]
    fn bad_numbers_are_named() {
        let uniform = Prior::Uniform { low: 0.0, high: 1.0 };
        let cases = [
            (normal(0.0, 0.0, -1.0, 1.0), "sd > 0, got mean 0, sd 0"),
            (normal(f64::NAN, 1.0, -1.0, 1.0), "finite mean"),
            (normal(0.0, 1.0, 9.0, 10.0), "got low 9, high 10"),
            (normal(0.0, 1.0, 1.0, 0.0), "low < high"),
            (mixture(&[]), "at least one part, got none"),
            (mixture(&[(0.0, uniform.clone())]), "part 0: expected a weight > 0, got 0"),
            (mixture(&[(1.0, uniform.clone()), (1.0, mixture(&[(1.0, uniform.clone())]))]), "part 1: expected uniform"),
            (mixture(&[(1.0, Prior::LogUniform { low: 0.0, high: 1.0 })]), "part 0: log_uniform needs low > 0"),
        ];
        for (prior, words) in cases {
            let said = prior.check().unwrap_err();
            assert!(said.contains(words), "{prior}: {said}");
        }
        all().iter().for_each(|p| p.check().unwrap());
    }

    #[test]
    fn priors_are_written_in_yaml_as_they_are_called() {
        let text = "mixture: [{weight: 2, prior: {normal: {mean: 1, sd: 0.5, low: 0, high: 2}}}, {weight: 1, prior: {uniform: {low: 3, high: 4}}}]";
        let read: Prior = serde_saphyr::from_str(text).unwrap();
        assert_eq!(read.to_string(), "2 x normal 1 +- 0.5 within 0 to 2 + 1 x uniform 3 to 4");
    }
}
