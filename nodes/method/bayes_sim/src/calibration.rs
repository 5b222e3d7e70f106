//! Calibration of posteriors over many truths drawn from the prior.
//!
//! Each truth gives one number from 0 to 1 for each check. The numbers are uniform if the posteriors are exact.
//!
//! - `ranks`: the share of draws below the truth, parameter by parameter (Talts et al. 2018, simulation-based calibration).
//! - `density`: the share of draws with a higher density: the mass of the highest-density region whose edge is the truth
//!   (Hyndman 1996).
//! - `distance`: the share of draws nearer to a random point than the truth (Lemos et al. 2023, TARP). Only this check
//!   detects posteriors that equal the prior.

use catenary_core::mixture::MixtureError;
use catenary_core::statistics::uniformity;
use catenary_core::{Posterior, seed};
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// Checks of one posterior against its truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Check {
    /// Rank of the truth among the draws, by parameter (D), 0 to 1.
    pub ranks: Vec<f64>,
    /// Share of draws denser than the truth.
    pub density: f64,
    /// Share of draws nearer to a random point than the truth.
    pub distance: f64,
}

impl Check {
    /// Compares `truth` (D, in the parameters' units) with `draws` draws of `posterior`. `seed` determines the draws and the
    /// random point.
    ///
    /// # Errors
    /// [`MixtureError`] if the posterior has no mass inside of the prior's support.
    pub fn new(posterior: &Posterior, truth: &[f64], draws: usize, seed: u64) -> Result<Self, MixtureError> {
        let space = &posterior.parameters;
        let mut rng = seed::rng(seed, 1);
        let drawn: Vec<Vec<f64>> =
            (0..draws).map(|_| posterior.mixture.sample_truncated(&mut rng)).collect::<Result<_, _>>()?;
        let truth = space.to_unit(truth);
        let point: Vec<f64> = truth.iter().map(|_| rng.random()).collect();
        let apart = |u: &[f64]| u.iter().zip(&point).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let dense = |u: &[f64]| posterior.mixture.log_density(u);
        let (far, density) = (apart(&truth), dense(&truth));
        let share = |is_in: &dyn Fn(&[f64]) -> bool| drawn.iter().filter(|u| is_in(u)).count() as f64 / draws as f64;
        Ok(Self {
            ranks: (0..truth.len()).map(|i| share(&|u| u[i] < truth[i])).collect(),
            density: share(&|u| dense(u) > density),
            distance: share(&|u| apart(u) < far),
        })
    }
}

/// Summary of one check over all truths.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the check: a parameter's name, `density` or `distance`.
    pub name: String,
    /// p value of the Kolmogorov-Smirnov test of uniformity.
    pub p_value: f64,
    /// Share of truths within the central intervals (parameters) or regions (the others) of 50 %, 80 %, 90 % and 95 %.
    pub coverage: [f64; LEVELS.len()],
    /// Numbers of the check, sorted.
    pub values: Vec<f64>,
}

/// Nominal levels of [`Summary::coverage`].
pub const LEVELS: [f64; 4] = [0.5, 0.8, 0.9, 0.95];

/// Summaries of all checks: one for each parameter in `names`, one for the density and one for the distance.
pub fn summaries(names: &[&str], checks: &[Check]) -> Vec<Summary> {
    let of = |name: &str, is_rank: bool, value: &dyn Fn(&Check) -> f64| {
        let mut values: Vec<f64> = checks.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        let inside = |level: f64| {
            // A rank is two-sided, about the median; the others grow from the mode or the random point outwards.
            let holds = |v: &&f64| if is_rank { (**v - 0.5).abs() < 0.5 * level } else { **v < level };
            values.iter().filter(holds).count() as f64 / values.len().max(1) as f64
        };
        Summary { name: name.to_owned(), p_value: uniformity(&values), coverage: LEVELS.map(inside), values }
    };
    let ranks = names.iter().enumerate().map(|(i, name)| of(name, true, &|c: &Check| c.ranks[i]));
    ranks.chain([of("density", false, &|c| c.density), of("distance", false, &|c| c.distance)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Mixture, Parameter, ParameterSpace, Prior};
    use nalgebra::{DMatrix, DVector};
    use rand_distr::StandardNormal;

    const SD: f64 = 0.1;

    fn space() -> ParameterSpace {
        let parameter = |name: &str, prior| Parameter { name: name.into(), prior };
        let priors = [Prior::Uniform { low: 2.0, high: 4.0 }, Prior::LogUniform { low: 1.0, high: 100.0 }];
        ParameterSpace::new(["a", "b"].iter().zip(priors).map(|(n, p)| parameter(n, p)).collect()).unwrap()
    }

    /// Checks of 400 truths, each measured once with a noise of `SD` in both coordinates. The posterior assumes `factor` times
    /// that noise, and its mean is off by `shift`.
    fn checks(factor: f64, shift: f64) -> Vec<Summary> {
        let space = space();
        let one = |i: u64| {
            let mut rng = seed::rng(5, i);
            let truth: [f64; 2] = [rng.random(), rng.random()];
            let seen = truth.map(|t| t + shift + SD * rng.sample::<f64, _>(StandardNormal));
            let covariance = DMatrix::from_diagonal_element(2, 2, (factor * SD).powi(2));
            let mixture = Mixture::new(&[1.0], vec![DVector::from_row_slice(&seen)], vec![covariance]).unwrap();
            let posterior = Posterior { parameters: space.clone(), mixture };
            Check::new(&posterior, &space.from_unit(&truth), 500, i).unwrap()
        };
        summaries(&["a", "b"], &(0..400).map(one).collect::<Vec<_>>())
    }

    /// Four tests at the level 1e-3: one seed in 250 would fail.
    #[test]
    fn exact_posteriors_pass_every_check() {
        for s in checks(1.0, 0.0) {
            assert!(s.p_value > 1e-3, "{}: {}", s.name, s.p_value);
            for (level, covered) in LEVELS.iter().zip(s.coverage) {
                let error = (level * (1.0 - level) / 400.0_f64).sqrt();
                assert!((covered - level).abs() < 4.0 * error, "{}: {covered} at {level}", s.name);
            }
        }
    }

    #[test]
    fn posteriors_that_are_too_narrow_too_wide_or_shifted_fail() {
        let of = |factor, shift| checks(factor, shift).into_iter().map(|s| (s.name.clone(), s)).collect::<Vec<_>>();
        let named = |all: &[(String, Summary)], name: &str| all.iter().find(|(n, _)| n == name).unwrap().1.clone();
        let (narrow, wide, off) = (of(0.7, 0.0), of(1.5, 0.0), of(1.0, 0.05));
        for (all, is_narrow) in [(&narrow, true), (&wide, false)] {
            let density = named(all, "density");
            assert!(density.p_value < 1e-4, "{density:?}");
            assert_eq!(density.coverage[2] < 0.9, is_narrow, "{:?}", density.coverage);
        }
        assert!(named(&off, "a").p_value < 1e-4 && named(&off, "b").p_value < 1e-4);
    }
}
