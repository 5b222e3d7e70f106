//! Evidence of linear models of a residual: what a model would gain if changes in certain directions were added to it.
//!
//! Near a fit the change of the data by a small addition is linear in its sizes w: r = T w + P v + e, with the columns T of
//! the addition, the derivatives P by the unknowns of the fit, and the error e, which is noise and a discrepancy. With
//! normal priors of w and v the evidence has a closed form (Rasmussen and Williams 2006, "Gaussian Processes for Machine
//! Learning", section 2.7). In contrast to a full fit, hundreds of models cost a matrix product.

use super::discrepancy::Whitening;
use crate::fitting::{Fit, is_bound_active};
use catenary_core::mixture::log_sum_exp;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::f64::consts::FRAC_1_SQRT_2;

/// Tried standard deviations of the sizes, as shares of the columns' own scales.
const SHARES: [f64; 7] = [0.005, 0.015, 0.05, 0.15, 0.5, 1.5, 5.0];
/// Precision of a unit coordinate of the fit: that of a uniform distribution on 0 to 1.
const PRIOR_PRECISION: f64 = 12.0;

/// Linear model: the columns that act, with the relative standard deviation of each size.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearModel {
    /// Indices of the columns.
    pub columns: Vec<usize>,
    /// Standard deviation of each size, relative to the others.
    pub relative: Vec<f64>,
    /// True if the only size cannot be negative.
    pub is_positive: bool,
}

/// Linear model after the data.
#[derive(Debug, Clone, PartialEq)]
pub struct WeighedModel {
    /// Gain in log evidence over the model without the addition.
    pub gain: f64,
    /// Sizes at the likeliest discrepancy and scale, in the columns' own scales.
    pub sizes: DVector<f64>,
    /// Standard deviations of the sizes.
    pub sds: DVector<f64>,
}

/// Residual of a fit and columns, whitened with one discrepancy, orthogonal to the unknowns of the fit.
struct Projected {
    /// Log probability of the discrepancy and evidence of the fit with it.
    log: f64,
    /// Products of the columns with each other.
    products: DMatrix<f64>,
    /// Products of the columns with the residual.
    pulls: DVector<f64>,
}

/// Weighs `models` of the residual of `fit`, whose `columns` are changes of the simulated values in standard deviations of
/// the noise, with the rows of the residual. `logs` are the log probabilities of the fit without a discrepancy and with each
/// of the `whitenings`. None if a matrix is not positive definite.
pub fn weigh(
    fit: &Fit,
    columns: &DMatrix<f64>,
    models: &[LinearModel],
    logs: [f64; 2],
    with: &[f64],
    whitenings: &[Whitening],
) -> Option<Vec<WeighedModel>> {
    let [alone, share] = logs;
    let each = share - (with.len() as f64).ln();
    let unknowns = free_columns(fit);
    let mut all = vec![Projected::new(fit, &unknowns, columns, None, alone)?];
    for (whitening, log) in whitenings.iter().zip(with) {
        all.push(Projected::new(fit, &unknowns, columns, Some(whitening), each + log)?);
    }
    let before = log_sum_exp(&all.iter().map(|p| p.log).collect::<Vec<_>>());
    models.iter().map(|model| model.weighed(&all, before)).collect()
}

/// Derivatives by the unknowns that can move: none at an active bound.
fn free_columns(fit: &Fit) -> DMatrix<f64> {
    let gradient = fit.gradient();
    let free: Vec<usize> = (0..fit.point.len()).filter(|&i| !is_bound_active(fit.point[i], gradient[i])).collect();
    fit.jacobian.select_columns(&free)
}

impl Projected {
    fn new(
        fit: &Fit,
        unknowns: &DMatrix<f64>,
        columns: &DMatrix<f64>,
        whitening: Option<&Whitening>,
        log: f64,
    ) -> Option<Self> {
        let (p, t) = (unknowns.ncols(), columns.ncols());
        let mut rows = DMatrix::zeros(fit.residuals.len(), p + t + 1);
        rows.columns_mut(0, p).copy_from(unknowns);
        rows.columns_mut(p, t).copy_from(columns);
        rows.set_column(p + t, &fit.residuals);
        if let Some(whitening) = whitening {
            whitening.apply(&mut rows);
        }
        let mut products = rows.tr_mul(&rows);
        (0..p).for_each(|i| products[(i, i)] += PRIOR_PRECISION);
        let own = products.view((0, 0), (p, p)).into_owned().cholesky()?;
        let across = products.view((0, p), (p, t + 1)).into_owned();
        let left = products.view((p, p), (t + 1, t + 1)) - across.tr_mul(&own.solve(&across));
        Some(Self { log, products: left.view((0, 0), (t, t)).into_owned(), pulls: left.column(t).rows(0, t).into() })
    }
}

/// Posterior of the sizes of a model with one discrepancy and one scale.
struct Posterior {
    gain: f64,
    sizes: DVector<f64>,
    precision: Cholesky<f64, Dyn>,
}

impl LinearModel {
    fn weighed(&self, all: &[Projected], before: f64) -> Option<WeighedModel> {
        let posteriors = all.iter().map(|projected| {
            let (products, pulls) = (self.of(&projected.products), self.pulled(&projected.pulls));
            let one = |share: &f64| {
                let posterior = self.posterior(&products, &pulls, *share)?;
                Some((projected.log + posterior.gain - (SHARES.len() as f64).ln(), posterior))
            };
            SHARES.iter().map(one).collect::<Option<Vec<_>>>()
        });
        let posteriors: Vec<_> = posteriors.collect::<Option<Vec<_>>>()?.into_iter().flatten().collect();
        let logs: Vec<f64> = posteriors.iter().map(|(log, _)| *log).collect();
        let (_, best) = posteriors.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let sds = best.precision.inverse().diagonal().map(f64::sqrt);
        Some(WeighedModel { gain: log_sum_exp(&logs) - before, sizes: best.sizes, sds })
    }

    fn of(&self, products: &DMatrix<f64>) -> DMatrix<f64> {
        let n = self.columns.len();
        DMatrix::from_fn(n, n, |i, j| products[(self.columns[i], self.columns[j])])
    }

    fn pulled(&self, pulls: &DVector<f64>) -> DVector<f64> {
        DVector::from_iterator(self.columns.len(), self.columns.iter().map(|c| pulls[*c]))
    }

    /// Posterior with a standard deviation of `share` of the columns' scales; none if the matrix is not positive definite.
    fn posterior(&self, products: &DMatrix<f64>, pulls: &DVector<f64>, share: f64) -> Option<Posterior> {
        let sds: Vec<f64> = self.relative.iter().map(|relative| share * relative).collect();
        let n = sds.len();
        let precision = products + DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| sds[i].powi(-2)));
        let precision = precision.cholesky()?;
        let sizes = precision.solve(pulls);
        // log det(1 + K^(1/2) A K^(1/2)) = log det(A + K^-1) + log det K.
        let volume = 2.0 * precision.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>()
            + 2.0 * sds.iter().map(|sd| sd.ln()).sum::<f64>();
        let gain = 0.5 * pulls.dot(&sizes) - 0.5 * volume;
        if !self.is_positive {
            return Some(Posterior { gain, sizes, precision });
        }
        // A half-normal prior has twice the density, and only the positive half of the posterior counts.
        let sd = precision.l_dirty()[(0, 0)].recip();
        let half = libm::erfc(-FRAC_1_SQRT_2 * sizes[0] / sd);
        Some(Posterior { gain: gain + half.max(f64::MIN_POSITIVE).ln(), sizes: sizes.map(|s| s.max(0.0)), precision })
    }
}
