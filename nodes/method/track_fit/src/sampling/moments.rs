//! Moments of draws.

use nalgebra::{DMatrix, DVector};

/// Mean and covariance of draws; none without any.
pub fn moments(draws: &[DVector<f64>]) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let (n, d) = (draws.len() as f64, draws.first()?.len());
    let mean = draws.iter().fold(DVector::zeros(d), |sum, x| sum + x) / n;
    let squares = draws.iter().fold(DMatrix::zeros(d, d), |sum, x| sum + (x - &mean) * (x - &mean).transpose());
    Some((mean, squares / n))
}
