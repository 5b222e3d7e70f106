//! The leading principal components of the columns, whitened.

use catenary_core::matrix::{Transpose, gemm};
use nalgebra::{DMatrix, SymmetricEigen};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Rounds of the subspace iteration.
const ROUNDS: usize = 4;
/// Share of the greatest component's standard deviation under which a component counts as noise of the arithmetic.
const LEAST_SHARE: f64 = 1e-4;

/// A linear map from W columns to P components.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    columns: usize,
    components: usize,
    /// P x W, row-major.
    matrix: Vec<f32>,
}

impl Projection {
    /// The map to the `components` leading principal components of `x` (rows of equal width, centred, weighted by
    /// `weights`), each scaled to unit variance; by randomised subspace iteration (Halko, Martinsson and Tropp 2011).
    pub fn fit<R: Rng>(x: &[f32], weights: &[f64], components: usize, rng: &mut R) -> Self {
        let rows = weights.len();
        let columns = x.len() / rows;
        let total: f64 = weights.iter().sum();
        let mut scaled = x.to_vec();
        for (row, weight) in scaled.chunks_exact_mut(columns).zip(weights) {
            let factor = (weight / total).sqrt() as f32;
            row.iter_mut().for_each(|v| *v *= factor);
        }
        let rank = components.min(columns).min(rows);
        let mut basis = DMatrix::from_fn(columns, rank, |_, _| rng.sample::<f64, _>(StandardNormal)).qr().q();
        for _ in 0..ROUNDS {
            let image = product(&scaled, Transpose::No, &basis, (rows, columns, rank));
            let back = DMatrix::from_row_slice(rows, rank, &image);
            let power = product(&scaled, Transpose::Yes, &back, (columns, rows, rank));
            basis = DMatrix::from_row_slice(columns, rank, &power).qr().q();
        }
        let image = product(&scaled, Transpose::No, &basis, (rows, columns, rank));
        let image = DMatrix::from_row_slice(rows, rank, &image);
        let eigen = SymmetricEigen::new(image.transpose() * &image);
        let mut order: Vec<usize> = (0..rank).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let least = order.first().map_or(0.0, |&i| eigen.eigenvalues[i].max(0.0)) * LEAST_SHARE * LEAST_SHARE;
        let mut matrix = vec![0.0; components * columns];
        for (row, &i) in matrix.chunks_exact_mut(columns).zip(&order) {
            let variance = eigen.eigenvalues[i];
            if variance > least {
                let direction = &basis * eigen.eigenvectors.column(i) / variance.sqrt();
                row.iter_mut().zip(direction.iter()).for_each(|(slot, v)| *slot = *v as f32);
            }
        }
        Self { columns, components, matrix }
    }

    /// B x P components of `x` (B x W).
    pub fn apply(&self, x: &[f32]) -> Vec<f32> {
        let rows = x.len() / self.columns;
        let mut out = vec![0.0; rows * self.components];
        let shape = (rows, self.columns, self.components);
        gemm(shape, 1.0, x, Transpose::No, &self.matrix, Transpose::Yes, 0.0, &mut out);
        out
    }

    /// B x W derivatives by the columns from B x P derivatives by the components.
    pub fn apply_transposed(&self, by_component: &[f32]) -> Vec<f32> {
        let rows = by_component.len() / self.components;
        let mut out = vec![0.0; rows * self.columns];
        let shape = (rows, self.components, self.columns);
        gemm(shape, 1.0, by_component, Transpose::No, &self.matrix, Transpose::No, 0.0, &mut out);
        out
    }
}

/// `op(a) * b`, row-major, of `shape` (rows, inner, columns).
fn product(a: &[f32], op: Transpose, b: &DMatrix<f64>, shape: (usize, usize, usize)) -> Vec<f64> {
    let b: Vec<f32> = b.transpose().iter().map(|v| *v as f32).collect();
    let mut out = vec![0.0; shape.0 * shape.2];
    gemm(shape, 1.0, a, op, &b, Transpose::No, 0.0, &mut out);
    out.into_iter().map(f64::from).collect()
}
