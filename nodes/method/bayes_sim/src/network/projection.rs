//! Leading principal components of the columns, whitened except for the weakest.

use super::packed;
use catenary_core::matrix::{Transpose, gemm};
use nalgebra::{DMatrix, SymmetricEigen};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Number of rounds of the subspace iteration.
const ROUNDS: usize = 4;
/// Share of the first component's standard deviation below which a component is rounding noise.
const LEAST_SHARE: f64 = 1e-4;
/// Share of the first component's standard deviation below which a component is not scaled to unit variance. Amplified a
/// hundredfold, weak components change with every step of the embedding, and the dense layers learn nothing else.
const WHITE_SHARE: f64 = 0.1;

/// Linear map from W columns to P components.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Projection {
    columns: usize,
    components: usize,
    /// Matrix of the map, P x W, row-major.
    #[serde(with = "packed")]
    matrix: Vec<f32>,
}

impl Projection {
    /// Fits the map to the `components` leading principal components of `x` (centred rows of equal width with `weights`) by
    /// randomised subspace iteration (Halko, Martinsson and Tropp 2011). Each component is scaled to unit variance. One weaker
    /// than a tenth of the first is scaled as if it were that strong.
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
        let greatest = order.first().map_or(0.0, |&i| eigen.eigenvalues[i].max(0.0)).sqrt();
        let mut matrix = vec![0.0; components * columns];
        for (row, &i) in matrix.chunks_exact_mut(columns).zip(&order) {
            let spread = eigen.eigenvalues[i].max(0.0).sqrt();
            if spread > LEAST_SHARE * greatest {
                let direction = &basis * eigen.eigenvectors.column(i) / spread.max(WHITE_SHARE * greatest);
                row.iter_mut().zip(direction.iter()).for_each(|(slot, v)| *slot = *v as f32);
            }
        }
        Self { columns, components, matrix }
    }

    /// W and P, numbers of columns and of components.
    pub fn shape(&self) -> (usize, usize) {
        (self.columns, self.components)
    }

    /// Returns true if the matrix has the length that the shape requires.
    pub(super) fn is_whole(&self) -> bool {
        self.matrix.len() == self.columns * self.components
    }

    /// Returns true if every entry is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.matrix.iter().all(|v| v.is_finite())
    }

    /// Entry `i` of the matrix, for tests that spoil it.
    #[cfg(test)]
    pub(super) fn entry_mut(&mut self, i: usize) -> &mut f32 {
        &mut self.matrix[i]
    }

    /// B x P derivatives with respect to the components from B x W derivatives with respect to the columns, for columns in the
    /// span of the components. The rows of the map are orthogonal, so that its pseudo-inverse is its transpose over the squared
    /// lengths.
    pub fn apply_inverse_transposed(&self, by_column: &[f32]) -> Vec<f32> {
        let mut out = self.apply(by_column);
        let squares: Vec<f32> =
            self.matrix.chunks_exact(self.columns).map(|row| row.iter().map(|v| v * v).sum()).collect();
        for row in out.chunks_exact_mut(self.components) {
            row.iter_mut().zip(&squares).for_each(|(v, s)| *v = if *s > 0.0 { *v / s } else { 0.0 });
        }
        out
    }

    /// B x P components of `x` (B x W).
    pub fn apply(&self, x: &[f32]) -> Vec<f32> {
        let rows = x.len() / self.columns;
        let mut out = vec![0.0; rows * self.components];
        let shape = (rows, self.columns, self.components);
        gemm(shape, 1.0, x, Transpose::No, &self.matrix, Transpose::Yes, 0.0, &mut out);
        out
    }

    /// B x W derivatives with respect to the columns from B x P derivatives with respect to the components.
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

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    const ROWS: usize = 4_000;
    const WIDTH: usize = 12;
    const SPREADS: [f64; 3] = [5.0, 2.0, 1.0];
    /// Standard deviation of the other directions.
    const REST: f64 = 0.1;

    /// Orthonormal directions (columns), and Gaussian rows with [`SPREADS`] along the first three of them.
    fn data() -> (DMatrix<f64>, Vec<f32>) {
        let mut rng = seed::rng(31, 0);
        let directions = DMatrix::from_fn(WIDTH, WIDTH, |_, _| rng.sample::<f64, _>(StandardNormal)).qr().q();
        let mut x = Vec::with_capacity(ROWS * WIDTH);
        for _ in 0..ROWS {
            let mut row = DMatrix::zeros(WIDTH, 1);
            for (i, direction) in directions.column_iter().enumerate() {
                row += direction * (SPREADS.get(i).unwrap_or(&REST) * rng.sample::<f64, _>(StandardNormal));
            }
            x.extend(row.iter().map(|v| *v as f32));
        }
        (directions, x)
    }

    /// Row p of the map, in double precision.
    fn row(projection: &Projection, p: usize) -> Vec<f64> {
        projection.matrix[p * WIDTH..(p + 1) * WIDTH].iter().map(|v| f64::from(*v)).collect()
    }

    #[test]
    fn finds_the_leading_directions_in_order_and_whitens_them() {
        let (directions, x) = data();
        let projection = Projection::fit(&x, &[1.0; ROWS], 3, &mut seed::rng(32, 0));
        for (p, spread) in SPREADS.into_iter().enumerate() {
            let row = row(&projection, p);
            let length = row.iter().map(|v| v * v).sum::<f64>().sqrt();
            let cosine = directions.column(p).iter().zip(&row).map(|(d, r)| d * r).sum::<f64>() / length;
            // Sampling turns neighbouring directions by about 1/sqrt(N) times 5 * 2 / (25 - 4): 0.008 rad, and a
            // spread is off by 1/sqrt(2 N) = 1.1 %.
            assert!(cosine.abs() > 0.999, "component {p}: cosine {cosine}");
            assert!((length * spread - 1.0).abs() < 0.05, "component {p}: {length} for a spread of {spread}");
        }
        // The fourth component is a fiftieth of the first and scaled as if it were a tenth.
        let weak = row(&Projection::fit(&x, &[1.0; ROWS], 4, &mut seed::rng(32, 0)), 3);
        let length = weak.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!((length * WHITE_SHARE * SPREADS[0] - 1.0).abs() < 0.05, "{length} for a spread of {REST}");
        let out = projection.apply(&x);
        for (p, q) in (0..9).map(|i| (i / 3, i % 3)) {
            let moment = out.chunks_exact(3).map(|r| f64::from(r[p] * r[q])).sum::<f64>() / ROWS as f64;
            assert!((moment - f64::from(u8::from(p == q))).abs() < 2e-3, "second moment {p}, {q}: {moment}");
        }
    }

    #[test]
    fn weights_count_as_repeated_rows() {
        let (_, x) = data();
        let part = &x[..40 * WIDTH];
        let twice: Vec<f32> =
            part.chunks_exact(WIDTH).enumerate().flat_map(|(i, r)| r.repeat(if i % 2 == 0 { 3 } else { 1 })).collect();
        let weights: Vec<f64> = (0..40).map(|i| if i % 2 == 0 { 3.0 } else { 1.0 }).collect();
        let weighted = Projection::fit(part, &weights, 2, &mut seed::rng(33, 0));
        let repeated = Projection::fit(&twice, &[1.0; 80], 2, &mut seed::rng(33, 0));
        let plain = Projection::fit(part, &[1.0; 40], 2, &mut seed::rng(33, 0));
        let gap = |a: &Projection, b: &Projection| {
            let pairs = a.apply(part).into_iter().zip(b.apply(part)).collect::<Vec<_>>();
            // The sign of a component is arbitrary.
            let of =
                |s: f32, p: usize| pairs.iter().skip(p).step_by(2).map(|(a, b)| (a - s * b).abs()).fold(0.0, f32::max);
            (0..2).map(|p| of(1.0, p).min(of(-1.0, p))).fold(0.0, f32::max)
        };
        assert!(gap(&weighted, &repeated) < 1e-3, "{}", gap(&weighted, &repeated));
        assert!(gap(&weighted, &plain) > 0.05, "{}", gap(&weighted, &plain));
    }

    #[test]
    fn components_beyond_the_rank_are_zero() {
        // Two directions only, and more components than rows or directions.
        let x: Vec<f32> = (0..6).flat_map(|i| [i as f32 - 2.5, 2.0 * (i % 2) as f32 - 1.0, 0.0, 0.0]).collect();
        let projection = Projection::fit(&x, &[1.0; 6], 5, &mut seed::rng(34, 0));
        let out = projection.apply(&x);
        assert!(out.chunks_exact(5).all(|r| r[2..].iter().all(|v| *v == 0.0)), "{out:?}");
        let unit = out.chunks_exact(5).map(|r| r[1] * r[1]).sum::<f32>() / 6.0;
        assert!((unit - 1.0).abs() < 1e-4, "{unit}");
    }

    #[test]
    fn the_transposed_map_is_the_adjoint() {
        let (_, x) = data();
        let projection = Projection::fit(&x, &[1.0; ROWS], 3, &mut seed::rng(35, 0));
        let (x, by) = (&x[..2 * WIDTH], [0.3, -1.0, 2.0, 0.1, 0.7, -0.4]);
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let (left, right) = (dot(&projection.apply(x), &by), dot(x, &projection.apply_transposed(&by)));
        assert!((left - right).abs() < 1e-4 * left.abs().max(1.0), "{left} against {right}");
    }
}
