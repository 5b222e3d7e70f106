//! Evolution strategy with covariance matrix adaptation (CMA-ES), after Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772.
//!
//! The crate `cmaes` brings second versions of nalgebra and rand, and a thread pool beside that of the simulator.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Normal distribution of candidates, which moves towards those with the least losses. Names are those of the tutorial.
#[derive(Debug, Clone)]
pub struct Evolution {
    mean: DVector<f64>,
    sigma: f64,
    covariance: DMatrix<f64>,
    /// Eigenvectors of the covariance, and square roots of its eigenvalues.
    axes: DMatrix<f64>,
    scales: DVector<f64>,
    path_c: DVector<f64>,
    path_sigma: DVector<f64>,
    generation: u32,
    weights: Vec<f64>,
}

/// Most candidates of a generation that count, and all of them.
fn sizes(dimension: usize) -> [usize; 2] {
    let all = 4 + (3.0 * (dimension as f64).ln()).floor() as usize;
    [all / 2, all]
}

impl Evolution {
    /// Distribution with this mean and the standard deviation `sigma` along every axis.
    pub fn new(mean: Vec<f64>, sigma: f64) -> Self {
        let n = mean.len();
        let [best, _] = sizes(n);
        let raw: Vec<f64> = (1..=best).map(|i| (best as f64 + 0.5).ln() - (i as f64).ln()).collect();
        let sum: f64 = raw.iter().sum();
        Self {
            mean: DVector::from_vec(mean),
            sigma,
            covariance: DMatrix::identity(n, n),
            axes: DMatrix::identity(n, n),
            scales: DVector::from_element(n, 1.0),
            path_c: DVector::zeros(n),
            path_sigma: DVector::zeros(n),
            generation: 0,
            weights: raw.into_iter().map(|w| w / sum).collect(),
        }
    }

    /// Draws the candidates of a generation.
    pub fn draw(&self, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let [_, all] = sizes(self.mean.len());
        let mut candidate = || {
            let z = DVector::from_fn(self.mean.len(), |_, _| rng.sample::<f64, _>(StandardNormal));
            let step = &self.axes * z.component_mul(&self.scales);
            (&self.mean + self.sigma * step).as_slice().to_vec()
        };
        (0..all).map(|_| candidate()).collect()
    }

    /// Moves the distribution by the losses of the candidates that [`Self::draw`] gave.
    pub fn learn(&mut self, candidates: &[Vec<f64>], losses: &[f64]) {
        let n = self.mean.len() as f64;
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|&a, &b| losses[a].total_cmp(&losses[b]));
        let effective = 1.0 / self.weights.iter().map(|w| w * w).sum::<f64>();
        let c_sigma = (effective + 2.0) / (n + effective + 5.0);
        let damping = 1.0 + 2.0 * (((effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        let c_c = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n);
        let c_1 = 2.0 / ((n + 1.3).powi(2) + effective);
        let c_mu = (1.0 - c_1).min(2.0 * (effective - 2.0 + 1.0 / effective) / ((n + 2.0).powi(2) + effective));
        let expected_norm = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
        self.generation += 1;

        let steps: Vec<DVector<f64>> = (order.iter().take(self.weights.len()))
            .map(|&i| (DVector::from_column_slice(&candidates[i]) - &self.mean) / self.sigma)
            .collect();
        let mut step = DVector::zeros(self.mean.len());
        steps.iter().zip(&self.weights).for_each(|(s, w)| step += *w * s);
        self.mean += self.sigma * &step;

        let whitened = &self.axes * (self.axes.transpose() * &step).component_div(&self.scales);
        self.path_sigma *= 1.0 - c_sigma;
        self.path_sigma += (c_sigma * (2.0 - c_sigma) * effective).sqrt() * whitened;
        let norm = self.path_sigma.norm();
        let settled = (1.0 - (1.0 - c_sigma).powi(2 * self.generation as i32)).sqrt();
        // A long path of the step size stops the update of the covariance: it would stretch along the path.
        let is_moving = norm / settled < (1.4 + 2.0 / (n + 1.0)) * expected_norm;
        self.path_c *= 1.0 - c_c;
        if is_moving {
            self.path_c += (c_c * (2.0 - c_c) * effective).sqrt() * &step;
        }
        let lost = if is_moving { 0.0 } else { c_c * (2.0 - c_c) };
        self.covariance *= 1.0 - c_1 - c_mu + c_1 * lost;
        self.covariance += c_1 * &self.path_c * self.path_c.transpose();
        steps.iter().zip(&self.weights).for_each(|(s, w)| self.covariance += c_mu * *w * s * s.transpose());
        self.sigma *= ((c_sigma / damping) * (norm / expected_norm - 1.0)).exp();
        let eigen = SymmetricEigen::new(self.covariance.clone());
        self.scales = eigen.eigenvalues.map(|v| v.max(1e-20).sqrt());
        self.axes = eigen.eigenvectors;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    /// Least loss after some generations from (2, ..., 2).
    fn least(dimension: usize, generations: usize, loss: impl Fn(&[f64]) -> f64) -> f64 {
        let mut evolution = Evolution::new(vec![2.0; dimension], 0.5);
        let mut rng = seed::rng(1, 0);
        for _ in 0..generations {
            let candidates = evolution.draw(&mut rng);
            let losses: Vec<f64> = candidates.iter().map(|c| loss(c)).collect();
            evolution.learn(&candidates, &losses);
        }
        loss(evolution.mean.as_slice())
    }

    #[test]
    fn finds_the_minimum_of_a_long_valley_and_of_a_bent_one() {
        // Axes of lengths 1 to 1000.
        let ellipsoid = |x: &[f64]| x.iter().enumerate().map(|(i, v)| 10f64.powf(6.0 * i as f64 / 9.0) * v * v).sum();
        assert!(least(10, 700, ellipsoid) < 1e-8);
        let rosenbrock =
            |x: &[f64]| x.windows(2).map(|p| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2)).sum();
        assert!(least(6, 800, rosenbrock) < 1e-8);
    }
}
