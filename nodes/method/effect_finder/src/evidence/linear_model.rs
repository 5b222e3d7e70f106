//! Evidence of linear models of a residual: what a model would gain if changes in certain directions were added to it.
//!
//! Near a fit the change of the data by a small addition is linear in its sizes w: r = T w + P v + e, with the columns T of
//! the addition, the derivatives P by the unknowns of the fit, and the error e, which is noise and a discrepancy. With
//! normal priors of w and v the evidence has a closed form (Rasmussen and Williams 2006, "Gaussian Processes for Machine
//! Learning", section 2.7). In contrast to a full fit, hundreds of models cost a matrix product.

use super::discrepancy::Whitening;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::f64::consts::FRAC_1_SQRT_2;
use track_fit::fitting::{Fit, PRIOR_PRECISION, is_bound_active};

/// Tried standard deviations of the sizes, as shares of the columns' own scales.
const SHARES: [f64; 7] = [0.005, 0.015, 0.05, 0.15, 0.5, 1.5, 5.0];

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
    /// Sum of squares of the residual.
    left: f64,
    /// Log determinant of the precision of the unknowns.
    log_precision: f64,
}

/// Residual of a fit, ready to weigh models of it.
pub struct Weighing {
    all: Vec<Projected>,
    /// Log evidence of the fit with any discrepancy.
    before: f64,
}

/// Fit of a model whose additions are unknowns of their own: the last columns of the Jacobian.
pub struct Refined<'a> {
    /// The fit.
    pub fit: &'a Fit,
    /// Number of the sizes, which come before the companion.
    pub sizes: usize,
    /// Number of coordinates of the companion behind them: 0 or 1.
    pub companions: usize,
    /// Widths of the sizes' search ranges, and the sizes, both relative to the largest ones of the priors.
    pub scales: Vec<[f64; 2]>,
}

impl Weighing {
    /// Weighing of models of the residual of `fit`, whose `columns` are changes of the simulated values in standard deviations
    /// of the noise, with the rows of the residual. `log_alone` and `logs` are the log probabilities of the fit without a
    /// discrepancy and with each of the `whitenings`. None if a matrix is not positive definite.
    pub fn new(
        fit: &Fit,
        columns: &DMatrix<f64>,
        log_alone: f64,
        logs: &[f64],
        whitenings: &[Whitening],
    ) -> Option<Self> {
        let unknowns = fit.jacobian.select_columns(&free_columns(fit));
        let projected = |whitening, log| Projected::new(&fit.residuals, &unknowns, columns, whitening, log);
        let with = whitenings.iter().zip(logs).map(|(whitening, log)| projected(Some(whitening), *log));
        let all = std::iter::once(projected(None, log_alone)).chain(with).collect::<Option<Vec<_>>>()?;
        let before = log_sum_exp(&all.iter().map(|p| p.log).collect::<Vec<_>>());
        Some(Self { all, before })
    }

    /// Models after the data; none if a matrix is not positive definite.
    pub fn weigh(&self, models: &[LinearModel]) -> Option<Vec<WeighedModel>> {
        models.iter().map(|model| model.weighed(&self.all, self.before)).collect()
    }

    /// Gain in log evidence by additions that were fitted, by Laplace's approximation at the fit. `whitenings` are those of
    /// the weighing. None if a matrix is not positive definite.
    pub fn gain_of(&self, refined: &Refined<'_>, whitenings: &[Whitening]) -> Option<f64> {
        let Refined { fit, sizes, companions, scales } = refined;
        let first = fit.point.len() - sizes - companions;
        let mut columns = fit.jacobian.columns(first, *sizes).into_owned();
        let mut residuals = fit.residuals.clone();
        for (mut column, [width, size]) in columns.column_iter_mut().zip(scales) {
            column.scale_mut(width.recip());
            // Residual of the same linear model without the addition.
            residuals.axpy(*size, &column, 1.0);
        }
        let free: Vec<usize> = free_columns(fit).into_iter().filter(|i| !(first..first + sizes).contains(i)).collect();
        let unknowns = fit.jacobian.select_columns(&free);
        let model = LinearModel { columns: (0..*sizes).collect(), relative: vec![1.0; *sizes], is_positive: false };
        let mut logs = Vec::new();
        for (i, own) in self.all.iter().enumerate() {
            let whitening = i.checked_sub(1).map(|i| &whitenings[i]);
            let there = Projected::new(&residuals, &unknowns, &columns, whitening, own.log)?;
            // The companion has one coordinate more, whose prior has the precision of a unit coordinate.
            let volume = there.log_precision - own.log_precision - *companions as f64 * PRIOR_PRECISION.ln();
            for share in SHARES {
                let posterior = model.posterior(&there.products, &there.pulls, share)?;
                logs.push(own.log + posterior.gain - 0.5 * (there.left - own.left + volume));
            }
        }
        Some(log_sum_exp(&logs) - (SHARES.len() as f64).ln() - self.before)
    }
}

/// Unknowns that can move: none at an active bound.
fn free_columns(fit: &Fit) -> Vec<usize> {
    let gradient = fit.gradient();
    (0..fit.point.len()).filter(|&i| !is_bound_active(fit.point[i], gradient[i])).collect()
}

impl Projected {
    fn new(
        residuals: &DVector<f64>,
        unknowns: &DMatrix<f64>,
        columns: &DMatrix<f64>,
        whitening: Option<&Whitening>,
        log: f64,
    ) -> Option<Self> {
        let (p, t) = (unknowns.ncols(), columns.ncols());
        let mut rows = DMatrix::zeros(residuals.len(), p + t + 1);
        rows.columns_mut(0, p).copy_from(unknowns);
        rows.columns_mut(p, t).copy_from(columns);
        rows.set_column(p + t, residuals);
        if let Some(whitening) = whitening {
            whitening.apply(&mut rows);
        }
        let mut products = rows.tr_mul(&rows);
        (0..p).for_each(|i| products[(i, i)] += PRIOR_PRECISION);
        let own = products.view((0, 0), (p, p)).into_owned().cholesky()?;
        let across = products.view((0, p), (p, t + 1)).into_owned();
        let rest = products.view((p, p), (t + 1, t + 1)) - across.tr_mul(&own.solve(&across));
        Some(Self {
            log,
            products: rest.view((0, 0), (t, t)).into_owned(),
            pulls: rest.column(t).rows(0, t).into(),
            left: rest[(t, t)],
            log_precision: 2.0 * own.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>(),
        })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Discrepancy;
    use track_fit::toy::{self, Toy};

    /// Log density of `r` under a normal distribution of mean zero.
    fn log_density(r: &DVector<f64>, covariance: DMatrix<f64>) -> f64 {
        let factor = covariance.cholesky().unwrap();
        let log_determinant = 2.0 * factor.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        -0.5 * (r.dot(&factor.solve(r)) + log_determinant)
    }

    fn waves(rows: usize, columns: usize, rate: f64) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |i, j| (rate * (i * (j + 2)) as f64 + j as f64).sin())
    }

    fn model(columns: &[usize], is_positive: bool) -> LinearModel {
        LinearModel { columns: columns.to_vec(), relative: vec![1.0; columns.len()], is_positive }
    }

    struct Case {
        fit: Fit,
        columns: DMatrix<f64>,
        whitenings: Vec<Whitening>,
    }

    impl Case {
        /// Two unknowns and three columns; the residual has `size` of the second one.
        fn new(size: f64) -> Self {
            let episode = [toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
            let rows = episode[0].channels(0).len();
            let columns = waves(rows, 3, 0.37);
            let residuals = size * columns.column(1) + waves(rows, 1, 0.11).column(0);
            let cost = residuals.norm_squared();
            let (point, jacobian) = (vec![0.5; 2], 8.0 * waves(rows, 2, 0.23));
            let fit = Fit { point, cost, residuals, jacobian, tracks: Vec::new() };
            let whitenings = vec![Whitening::new(&episode, Discrepancy { sd: 1.5, time_s: 0.4 }).unwrap()];
            Self { fit, columns, whitenings }
        }

        fn weighing(&self, share: f64) -> Weighing {
            Weighing::new(&self.fit, &self.columns, (1.0 - share).ln(), &[share.ln()], &self.whitenings).unwrap()
        }

        fn gain(&self, models: &[LinearModel], share: f64) -> Vec<f64> {
            self.weighing(share).weigh(models).unwrap().into_iter().map(|w| w.gain).collect()
        }
    }

    #[test]
    fn without_a_discrepancy_the_gain_is_that_of_the_whole_covariance() {
        let case = Case::new(0.4);
        let n = case.fit.residuals.len();
        let own = DMatrix::identity(n, n) + &case.fit.jacobian * case.fit.jacobian.transpose() / PRIOR_PRECISION;
        let before = log_density(&case.fit.residuals, own.clone());
        for chosen in [vec![1], vec![0, 2], vec![0, 1, 2]] {
            let t = case.columns.select_columns(&chosen);
            let with = |share: &f64| log_density(&case.fit.residuals, &own + share * share * &t * t.transpose());
            let logs: Vec<f64> = SHARES.iter().map(with).collect();
            let expected = log_sum_exp(&logs) - (SHARES.len() as f64).ln() - before;
            let [got] = case.gain(&[model(&chosen, false)], 1e-12)[..] else { panic!("one model") };
            assert!((got - expected).abs() < 1e-6 * expected.abs().max(1.0), "{chosen:?}: {got} for {expected}");
        }
    }

    #[test]
    fn the_acting_column_gains_most_with_its_sign_and_less_beside_a_discrepancy() {
        let models = [0, 1, 2].map(|column| model(&[column], false));
        let case = Case::new(0.8);
        let alone = case.gain(&models, 1e-12);
        assert!(alone[1] > 5.0 && alone[0] < 1.0 && alone[2] < 1.0, "{alone:?}");
        let positive = model(&[1], true);
        // A prior of one sign has twice the density there, and none on the other side.
        let [gained] = case.gain(std::slice::from_ref(&positive), 1e-12)[..] else { panic!("one model") };
        assert!((gained - alone[1] - 2f64.ln()).abs() < 0.1, "{gained} {}", alone[1]);
        let [lost] = Case::new(-0.8).gain(&[positive], 1e-12)[..] else { panic!("one model") };
        assert!(lost < 0.0, "{lost}");
        let beside = case.gain(&models, 0.9999);
        assert!(beside[1] < alone[1], "{beside:?} {alone:?}");
    }

    /// The fit of a linear addition has the evidence of the linear model, wherever it is linearised.
    #[test]
    fn a_fitted_addition_gains_as_much_as_the_linear_one() {
        let case = Case::new(0.4);
        let [width, size] = [4.0, 0.25];
        let column = case.columns.column(1);
        let refined = Fit {
            point: vec![0.5; 3],
            residuals: &case.fit.residuals - size * column,
            jacobian: case.fit.jacobian.clone().insert_column(2, 0.0),
            ..case.fit.clone()
        };
        let mut refined = Fit { cost: refined.residuals.norm_squared(), ..refined };
        refined.jacobian.set_column(2, &(width * column));
        let asked = Refined { fit: &refined, sizes: 1, companions: 0, scales: vec![[width, size]] };
        let got = case.weighing(0.2).gain_of(&asked, &case.whitenings).unwrap();
        let [expected] = case.gain(&[model(&[1], false)], 0.2)[..] else { panic!("one model") };
        assert!((got - expected).abs() < 1e-6 * expected, "{got} for {expected}");
        // An undetermined companion costs nothing.
        let mut more = Fit { point: vec![0.5; 4], ..refined.clone() };
        more.jacobian = more.jacobian.insert_column(3, 0.0);
        let asked = Refined { fit: &more, companions: 1, ..asked };
        let same = case.weighing(0.2).gain_of(&asked, &case.whitenings).unwrap();
        assert!((same - got).abs() < 1e-6 * expected, "{same} for {got}");
    }

    #[test]
    fn a_column_of_zeros_gains_nothing() {
        let mut case = Case::new(0.4);
        case.columns.column_mut(2).fill(0.0);
        let [gain] = case.gain(&[model(&[2], false)], 0.2)[..] else { panic!("one model") };
        assert!(gain.abs() < 1e-9, "{gain}");
    }
}
