//! Proposal distribution: a mixture of multivariate t distributions in normal scores.

use super::moments::moments;
use super::scores::Scores;
use crate::fitting::Fit;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{Rng, RngExt};
use rand_distr::{ChiSquared, Distribution, StandardNormal};
use statrs::function::gamma::ln_gamma;
use std::f64::consts::PI;

/// Degrees of freedom: tails that are heavier than those of a posterior, and finite variances.
const FREEDOM: f64 = 5.0;
/// Rounds of the search for the mode in scores under the linearised model.
const ROUNDS: usize = 20;
/// Rounds of an expectation-maximisation.
const EM_ROUNDS: usize = 20;
/// Splits of all components of a proposal that is fitted to draws.
const SPLITS: usize = 2;
/// Least standard deviation of a component in scores. Below it a density is as good as a point.
const LEAST_SD: f64 = 1e-5;

/// Mixture of multivariate t distributions.
#[derive(Debug, Clone)]
pub struct Proposal {
    log_weights: Vec<f64>,
    components: Vec<Component>,
}

#[derive(Debug, Clone)]
struct Component {
    mean: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    log_norm: f64,
}

impl Component {
    /// Component with this mean and scale matrix; none if the matrix is not positive definite.
    fn new(mean: DVector<f64>, mut scale: DMatrix<f64>) -> Option<Self> {
        let d = mean.len() as f64;
        (0..mean.len()).for_each(|i| scale[(i, i)] += LEAST_SD * LEAST_SD);
        let factor = scale.cholesky()?;
        let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        let log_norm =
            ln_gamma(0.5 * (FREEDOM + d)) - ln_gamma(0.5 * FREEDOM) - 0.5 * (d * (FREEDOM * PI).ln() + log_det);
        log_norm.is_finite().then_some(Self { mean, factor, log_norm })
    }

    fn squared_distance(&self, z: &DVector<f64>) -> f64 {
        let mut away = z - &self.mean;
        // A Cholesky factor has no zeros on its diagonal.
        self.factor.l_dirty().solve_lower_triangular_mut(&mut away);
        away.norm_squared()
    }

    fn log_density(&self, z: &DVector<f64>) -> f64 {
        let d = self.mean.len() as f64;
        self.log_norm - 0.5 * (FREEDOM + d) * (self.squared_distance(z) / FREEDOM).ln_1p()
    }

    fn draw(&self, rng: &mut impl Rng) -> DVector<f64> {
        let normal = DVector::from_fn(self.mean.len(), |_, _| -> f64 { StandardNormal.sample(rng) });
        let squares = ChiSquared::new(FREEDOM).expect("a positive number of degrees").sample(rng);
        &self.mean + self.factor.l() * normal * (FREEDOM / squares).sqrt()
    }
}

impl Proposal {
    /// Laplace approximation in scores around each mode; weights are the modes' evidence. None without a usable mode.
    pub fn of_modes(modes: &[Fit]) -> Option<Self> {
        let (mut log_weights, mut components) = (Vec::new(), Vec::new());
        for mode in modes {
            let Some((mean, precision, log_density)) = linear_mode(mode) else { continue };
            let Some(factor) = precision.cholesky() else { continue };
            let half_log_det = factor.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
            let Some(component) = Component::new(mean, factor.inverse()) else { continue };
            log_weights.push(log_density - half_log_det);
            components.push(component);
        }
        let total = log_sum_exp(&log_weights);
        log_weights.iter_mut().for_each(|w| *w -= total);
        // Laplace's evidence is rough: no mode gets less than a twentieth of an even share.
        let least = (0.05 / components.len().max(1) as f64).ln();
        log_weights.iter_mut().for_each(|w| *w = w.max(least));
        (!components.is_empty()).then(|| Self { log_weights, components }.normalised())
    }

    /// Proposal of at most four components that is fitted to draws; none if the draws lie in a plane.
    pub fn of_draws(draws: &[DVector<f64>]) -> Option<Self> {
        let (mean, covariance) = moments(draws)?;
        let mut own = Self { log_weights: vec![0.0], components: vec![Component::new(mean, covariance)?] };
        for _ in 0..SPLITS {
            // Copies of one draw count once.
            own = own.split().fitted(draws, 0.5 * draws.len() as f64)?;
        }
        Some(own)
    }

    /// Number of coordinates.
    pub fn dimension(&self) -> usize {
        self.components[0].mean.len()
    }

    /// Proposal fitted to draws by expectation-maximisation, from this one on; components that no draw supports
    /// are dropped. `effective` is the effective number of the draws: with few, covariances are drawn towards the
    /// common one.
    fn fitted(&self, draws: &[DVector<f64>], effective: f64) -> Option<Self> {
        let (d, weight) = (self.dimension(), 1.0 / draws.len() as f64);
        let mut own = self.clone();
        for _ in 0..EM_ROUNDS {
            let k = own.components.len();
            // Shares of the components in each draw, and the t distribution's own weight of it.
            let (mut sums, mut means) = (vec![0.0; k], vec![DVector::zeros(d); k]);
            let mut parts = Vec::with_capacity(draws.len());
            for z in draws {
                let logs: Vec<f64> =
                    own.log_weights.iter().zip(&own.components).map(|(w, c)| w + c.log_density(z)).collect();
                let total = log_sum_exp(&logs);
                let part: Vec<[f64; 2]> = logs
                    .iter()
                    .zip(&own.components)
                    .map(|(log, c)| {
                        let share = weight * (log - total).exp();
                        [share, share * (FREEDOM + d as f64) / (FREEDOM + c.squared_distance(z))]
                    })
                    .collect();
                parts.push(part);
            }
            let mut tails = vec![0.0; k];
            for (z, part) in draws.iter().zip(&parts) {
                for (i, [share, tail]) in part.iter().enumerate() {
                    (sums[i], tails[i]) = (sums[i] + share, tails[i] + tail);
                    means[i].axpy(*tail, z, 1.0);
                }
            }
            let mut scales = vec![DMatrix::zeros(d, d); k];
            (0..k).filter(|&i| tails[i] > 0.0).for_each(|i| means[i] /= tails[i]);
            for (z, part) in draws.iter().zip(&parts) {
                for (i, [_, tail]) in part.iter().enumerate() {
                    let away = z - &means[i];
                    scales[i].ger(*tail, &away, &away, 1.0);
                }
            }
            let common = scales.iter().fold(DMatrix::zeros(d, d), |sum, s| sum + s);
            let mut next = Self { log_weights: Vec::new(), components: Vec::new() };
            for (i, (mean, scale)) in means.into_iter().zip(scales).enumerate() {
                let number = effective * sums[i];
                // Fewer than one draw says nothing of a component.
                if number < 1.0 {
                    continue;
                }
                let towards = d as f64 / effective;
                let component = Component::new(mean, (scale + &common * towards) / (sums[i] + towards))?;
                next.log_weights.push(sums[i].ln());
                next.components.push(component);
            }
            if next.components.is_empty() {
                return None;
            }
            own = next.normalised();
        }
        Some(own)
    }

    /// Mixture of this proposal and another one with this share.
    #[must_use]
    pub fn with(&self, other: &Self, share: f64) -> Self {
        let scaled = |of: &Self, share: f64| of.log_weights.iter().map(|w| w + share.ln()).collect::<Vec<_>>();
        Self {
            log_weights: [scaled(self, 1.0 - share), scaled(other, share)].concat(),
            components: [self.components.clone(), other.components.clone()].concat(),
        }
    }

    /// This proposal with each component split in two along its widest axis, so that a fit may follow a bent density.
    #[must_use]
    fn split(&self) -> Self {
        let halves = |(log_weight, c): (&f64, &Component)| {
            let scale = c.factor.l() * c.factor.l().transpose();
            let eigen = scale.symmetric_eigen();
            let (at, greatest) = eigen.eigenvalues.argmax();
            let by = eigen.eigenvectors.column(at) * (0.5 * greatest.sqrt());
            [-1.0, 1.0].map(|side| (log_weight - 2f64.ln(), Component { mean: &c.mean + &by * side, ..c.clone() }))
        };
        let (log_weights, components) = self.log_weights.iter().zip(&self.components).flat_map(halves).unzip();
        Self { log_weights, components }
    }

    /// Log density at the scores.
    pub fn log_density(&self, z: &DVector<f64>) -> f64 {
        let logs: Vec<f64> = self.log_weights.iter().zip(&self.components).map(|(w, c)| w + c.log_density(z)).collect();
        log_sum_exp(&logs)
    }

    /// Draw of scores.
    pub fn draw(&self, rng: &mut impl Rng) -> DVector<f64> {
        let mut left: f64 = rng.random();
        for (weight, component) in self.log_weights.iter().zip(&self.components) {
            left -= weight.exp();
            if left < 0.0 {
                return component.draw(rng);
            }
        }
        // The weights sum to 1 up to rounding.
        self.components[self.components.len() - 1].draw(rng)
    }

    fn normalised(mut self) -> Self {
        let total = log_sum_exp(&self.log_weights);
        self.log_weights.iter_mut().for_each(|w| *w -= total);
        self
    }
}

/// Mode in scores of the linearised model around a fit, with its precision and log density.
fn linear_mode(fit: &Fit) -> Option<(DVector<f64>, DMatrix<f64>, f64)> {
    let about = DVector::from_column_slice(&fit.point);
    let density = |z: &DVector<f64>| {
        let step = DVector::from_vec(Scores::to_unit(z)) - &about;
        let residuals = &fit.residuals - &fit.jacobian * step;
        (-0.5 * (residuals.norm_squared() + z.norm_squared()), residuals)
    };
    let precision = |z: &DVector<f64>| {
        let mut scaled = fit.jacobian.clone();
        let slopes = Scores::slopes(z);
        scaled.column_iter_mut().zip(slopes.iter()).for_each(|(mut column, slope)| column *= *slope);
        let d = z.len();
        (scaled.transpose() * &scaled + DMatrix::identity(d, d), scaled)
    };
    let mut z = Scores::from_unit(&fit.point);
    let (mut best, mut residuals) = density(&z);
    for _ in 0..ROUNDS {
        let (matrix, scaled) = precision(&z);
        let step = matrix.cholesky()?.solve(&(scaled.transpose() * &residuals - &z));
        // Halving keeps a step from running past the mode where the scores are far from linear.
        let tried = (0..8).map(|i| &z + &step * 0.5f64.powi(i)).map(|z| (density(&z), z));
        let Some(((value, new), at)) = tried.into_iter().find(|((value, _), _)| *value > best) else { break };
        let is_done = value - best < 1e-6;
        (z, best, residuals) = (at, value, new);
        if is_done {
            break;
        }
    }
    let matrix = precision(&z).0;
    best.is_finite().then_some((z, matrix, best))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    fn fit(point: Vec<f64>, jacobian: DMatrix<f64>) -> Fit {
        let residuals = DVector::zeros(jacobian.nrows());
        Fit { point, cost: 0.0, residuals, jacobian, tracks: Vec::new() }
    }

    #[test]
    fn a_proposal_of_a_sharp_mode_is_its_gaussian() {
        let sharp = fit(vec![0.5, 0.5], DMatrix::from_row_slice(2, 2, &[100.0, 0.0, 80.0, 60.0]));
        let proposal = Proposal::of_modes(&[sharp]).unwrap();
        let mut rng = seed::rng(1, 0);
        let draws: Vec<Vec<f64>> = (0..20_000).map(|_| Scores::to_unit(&proposal.draw(&mut rng))).collect();
        // Variance of the second coordinate: 16400 / (16400 * 3600 - 4800^2). A t distribution of 5 degrees of freedom is
        // wider by sqrt(5 / 3).
        let sd = (draws.iter().map(|u| (u[1] - 0.5).powi(2)).sum::<f64>() / draws.len() as f64).sqrt();
        assert!((sd / (16_400.0 / 36e6 * 5.0 / 3.0f64).sqrt() - 1.0).abs() < 0.05, "{sd}");
    }

    #[test]
    fn the_density_of_a_mixture_integrates_to_one() {
        let modes = [0.2, 0.8].map(|u| fit(vec![u], DMatrix::from_element(1, 1, 20.0)));
        let proposal = Proposal::of_modes(&modes).unwrap();
        let whole: f64 = (-100_000..100_000)
            .map(|i| proposal.log_density(&DVector::from_element(1, 1e-3 * f64::from(i))).exp() * 1e-3)
            .sum();
        assert!((whole - 1.0).abs() < 1e-4, "{whole}");
    }

    #[test]
    fn a_fit_to_draws_finds_two_far_groups() {
        let modes = [0.45, 0.55].map(|u| fit(vec![u], DMatrix::from_element(1, 1, 5.0)));
        let (first, mut rng) = (Proposal::of_modes(&modes).unwrap(), seed::rng(2, 0));
        let draws: Vec<DVector<f64>> = (0..400)
            .map(|i| {
                let normal: f64 = StandardNormal.sample(&mut rng);
                DVector::from_element(1, 0.1 * normal + if i % 4 == 0 { 2.0 } else { -2.0 })
            })
            .collect();
        let fitted = first.fitted(&draws, 400.0).unwrap();
        let at = |z: f64| fitted.log_density(&DVector::from_element(1, z));
        assert!(((at(-2.0) - at(2.0)).exp() - 3.0).abs() < 0.7, "{} {}", at(-2.0), at(2.0));
        assert!(at(0.0) < at(2.0) - 4.0);
    }
}
