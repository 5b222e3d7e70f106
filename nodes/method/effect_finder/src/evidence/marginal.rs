//! Marginal likelihoods of candidate models by Laplace's approximation, without and with each tried discrepancy.
//!
//! The profile cost (the cost with all other unknowns at their best) is quadratic in the magnitudes of the effects. Its
//! likelihood is integrated over the priors of the magnitudes by quadrature. The posterior volume of the other unknowns
//! is about the same with and without the effects, and cancels. It differs between discrepancies, and is counted there.
//!
//! The companions of an effect are unknowns that the model without it lacks, so that their posterior volume does not cancel: at
//! each magnitude it counts as a share of their prior volume.

use super::discrepancy::{Discrepancy, Whitening};
use catenary_core::Prior;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::ops::Range;
use track_fit::data::{Candidate, MeasuredEpisode};
use track_fit::fitting::{Fit, Laplace, PRIOR_PRECISION, is_bound_active};

/// Quadrature nodes over each magnitude at quantiles of its prior, and as many around its best value, for one, two, and
/// three or more magnitudes. The cost grows with the power of the number of magnitudes; a test compares with closed
/// forms.
const NODES: [usize; 3] = [800, 80, 24];
/// Reach of the nodes around the best value, in standard deviations.
const REACH: f64 = 8.0;

/// Quadratic profile cost of some coordinates u: cost + 2 slope (u - at) + (u - at)' precision (u - at).
#[derive(Debug, Clone)]
pub struct Quadratic {
    at: DVector<f64>,
    cost: f64,
    slope: DVector<f64>,
    precision: DMatrix<f64>,
    /// Log of the posterior volume of the companions with the coordinates fixed, as a share of their prior volume.
    log_volume: f64,
}

/// Columns of the companions of `candidates`, which precede the candidates in a fit of `columns` columns.
pub(super) fn companions_of(candidates: &[Candidate], columns: usize) -> Range<usize> {
    let to = columns - candidates.len();
    to - candidates.iter().map(|c| c.companions.len()).sum::<usize>()..to
}

impl Quadratic {
    /// Profile cost of the candidates' magnitudes, the last coordinates of a fit; none if the Gauss-Newton matrix is not
    /// positive definite. Companions stay within about the width of their priors.
    pub fn of(fit: &Fit, candidates: &[Candidate]) -> Option<Self> {
        let (columns, count) = (fit.point.len(), candidates.len());
        let first = columns - count;
        let companions = companions_of(candidates, columns);
        let likelihood = Laplace::of_likelihood(fit, companions.clone())?;
        let log_volume = log_volume(&likelihood, companions, columns)?;
        // The slope vanishes at an inner minimum; only at an active bound does the cost fall beyond the best fit.
        let covariance = likelihood.covariance(first..columns);
        let gradient = fit.gradient();
        let slope = |i: usize| {
            if is_bound_active(fit.point[first + i], gradient[first + i]) { gradient[first + i] } else { 0.0 }
        };
        Some(Self {
            at: DVector::from_column_slice(&fit.point[first..]),
            cost: fit.cost,
            slope: DVector::from_fn(count, |i, _| slope(i)),
            precision: covariance.cholesky()?.inverse(),
            log_volume,
        })
    }

    /// Standard deviation of coordinate `i`, the others free.
    pub fn sd(&self, i: usize) -> f64 {
        self.precision.clone().cholesky().map_or(f64::INFINITY, |c| c.inverse()[(i, i)].sqrt())
    }

    /// Quadratic of the other coordinates with the first one at `u`.
    fn with_first(&self, u: f64) -> Self {
        let rest = self.at.len() - 1;
        let d = u - self.at[0];
        Self {
            at: self.at.rows(1, rest).into_owned(),
            cost: self.cost + 2.0 * self.slope[0] * d + self.precision[(0, 0)] * d * d,
            slope: self.slope.rows(1, rest) + d * self.precision.view((1, 0), (rest, 1)).column(0),
            precision: self.precision.view((1, 1), (rest, rest)).into_owned(),
            log_volume: self.log_volume,
        }
    }

    /// Minimum of the first coordinate, the others free, and its standard deviation.
    fn first(&self) -> (f64, f64) {
        match self.precision.clone().cholesky() {
            Some(c) => (self.at[0] - c.solve(&self.slope)[0], self.sd(0)),
            None => (self.at[0], f64::INFINITY),
        }
    }
}

/// Log of the Gaussian volume of the `companions` of a `likelihood` with all later columns fixed and all others free, as a share
/// of the volume of their priors, the unit cube. No direction counts as longer than the cube. Zero without companions.
fn log_volume(likelihood: &Laplace, companions: Range<usize>, columns: usize) -> Option<f64> {
    if companions.is_empty() {
        return Some(0.0);
    }
    let count = companions.len();
    let joint = likelihood.covariance(companions.start..columns).cholesky()?.inverse();
    let mut own = joint.view((0, 0), (count, count)).into_owned();
    // The likelihood alone, without the priors that keep the profile within them.
    (0..count).for_each(|i| own[(i, i)] -= PRIOR_PRECISION);
    let log_length = |precision: &f64| (0.5 * (TAU / precision).ln()).min(0.0);
    Some(own.symmetric_eigenvalues().iter().filter(|precision| **precision > 0.0).map(log_length).sum())
}

/// Log Bayes factor of the model with `candidates`: the log integral of prior times likelihood over their magnitudes and
/// companions, less the log likelihood at a cost of `base`. The coordinates of `cost` are in the order of `candidates`.
pub fn log_bayes_factor(candidates: &[Candidate], cost: &Quadratic, base: f64) -> f64 {
    cost.log_volume + integral(candidates, cost, base, NODES[candidates.len().clamp(1, NODES.len()) - 1])
}

fn integral(candidates: &[Candidate], cost: &Quadratic, base: f64, nodes: usize) -> f64 {
    // With all magnitudes fixed the likelihood ratio remains.
    let Some((candidate, rest)) = candidates.split_first() else { return -0.5 * (cost.cost - base) };
    // The prior holds a sign's ends, its quantiles, and nodes around the best value: a likelihood much narrower than
    // the prior would fall between quantiles.
    let search = candidate.search();
    let (least, sd) = cost.first();
    let (low, high) = candidate.prior.bounds();
    let side = |sign: &f64| {
        let ends = [low, high].map(|v| candidate.base + sign * v);
        let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let quantile = |i: usize| candidate.base + sign * candidate.prior.from_unit((i as f64 + 0.5) / nodes as f64);
        let about = |i: usize| search.from_unit(least + REACH * (2.0 * i as f64 / nodes as f64 - 1.0) * sd);
        let mut values: Vec<f64> = (0..nodes).map(quantile).chain((0..=nodes).map(about)).chain(ends).collect();
        // Nodes without prior density have no weight, and no logarithm.
        values.retain(|v| (from..=to).contains(v) && candidate.density(*v) > 0.0);
        values.sort_by(f64::total_cmp);
        let log_weight =
            |v: &f64| candidate.density(*v).ln() + integral(rest, &cost.with_first(search.to_unit(*v)), base, nodes);
        log_area(&values, &values.iter().map(log_weight).collect::<Vec<f64>>())
    };
    let sides: Vec<f64> = candidate.signs().iter().map(side).collect();
    log_sum_exp(&sides)
}

/// Log area under a curve by trapezoids. `logs` are the log heights at the increasing `places`.
fn log_area(places: &[f64], logs: &[f64]) -> f64 {
    let greatest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !greatest.is_finite() || places.len() < 2 {
        return f64::NEG_INFINITY;
    }
    // Heights relative to the greatest one do not underflow.
    let height = |i: usize| (logs[i] - greatest).exp();
    let area = |i: usize| 0.5 * (height(i) + height(i + 1)) * (places[i + 1] - places[i]);
    greatest + (0..places.len() - 1).map(area).sum::<f64>().ln()
}

/// Log evidences of a model over the evidence of the present model without discrepancy.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Log evidence without discrepancy.
    pub alone: f64,
    /// Log evidence with each discrepancy, in the order of [`Baseline::discrepancies`].
    pub with: Vec<f64>,
}

impl Evidence {
    /// Log evidence averaged over the discrepancies, which are equally likely a priori.
    pub fn with_any(&self) -> f64 {
        log_sum_exp(&self.with) - (self.with.len() as f64).ln()
    }

    /// Index of the most likely discrepancy.
    pub fn likeliest(&self) -> Option<usize> {
        (0..self.with.len()).max_by(|a, b| self.with[*a].total_cmp(&self.with[*b]))
    }
}

/// Baseline of all comparisons: the present model's best fit under each discrepancy.
pub struct Baseline {
    /// Tried discrepancies.
    pub discrepancies: Vec<Discrepancy>,
    whitenings: Vec<Whitening>,
    /// Cost of the best fit without discrepancy, and with each one.
    costs: (f64, Vec<f64>),
    evidence: Evidence,
}

impl Baseline {
    /// Baseline of the present model's best fit; none if a matrix is not positive definite.
    pub fn new(episodes: &[MeasuredEpisode], fit: &Fit) -> Option<Self> {
        let discrepancies = Discrepancy::all();
        let whitenings: Vec<Whitening> =
            discrepancies.iter().map(|d| Whitening::new(episodes, *d)).collect::<Option<_>>()?;
        let volume = |fit: &Fit| Some(-0.5 * Laplace::of(fit)?.log_determinant());
        let own = volume(fit)?;
        let (mut costs, mut with) = (Vec::new(), Vec::new());
        for whitening in &whitenings {
            let seen = whitening.of(fit).linear_minimum();
            // Unlike between effects, the volume of the other unknowns differs between discrepancies.
            with.push(-0.5 * (seen.cost - fit.cost + whitening.log_determinant()) + volume(&seen)? - own);
            costs.push(seen.cost);
        }
        Some(Self { discrepancies, whitenings, costs: (fit.cost, costs), evidence: Evidence { alone: 0.0, with } })
    }

    /// Evidence of the present model.
    pub fn evidence(&self) -> &Evidence {
        &self.evidence
    }

    /// Whitenings of the tried discrepancies, in their order.
    pub fn whitenings(&self) -> &[Whitening] {
        &self.whitenings
    }

    /// Whitening of discrepancy number `index`.
    pub fn whitening(&self, place: usize) -> &Whitening {
        &self.whitenings[place]
    }

    /// Evidence of the model with `candidates`, the last coordinates of its best fit.
    pub fn of(&self, candidates: &[Candidate], fit: &Fit) -> Option<Evidence> {
        let factor = |fit: &Fit, base: f64| Some(log_bayes_factor(candidates, &Quadratic::of(fit, candidates)?, base));
        let alone = factor(fit, self.costs.0)?;
        let mut with = Vec::new();
        for ((whitening, cost), base) in self.whitenings.iter().zip(&self.costs.1).zip(&self.evidence.with) {
            with.push(base + factor(&whitening.of(fit).linear_minimum(), *cost)?);
        }
        Some(Evidence { alone, with })
    }
}

/// Standard deviation of a candidate's magnitude. Its search prior is uniform, so that the map from coordinates is
/// linear.
pub fn sd_of(candidate: &Candidate, cost: &Quadratic, place: usize) -> f64 {
    let (low, high) = Prior::bounds(&candidate.search());
    cost.sd(place) * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use track_fit::toy::{self, Toy};

    fn candidate(prior: Prior) -> Candidate {
        let range = [if prior.bounds().0 < 0.0 { -10.0 } else { 0.0 }, 10.0];
        Candidate { name: "x".into(), title: "x".into(), prior, range, base: 0.0, odds: 1.0, companions: Vec::new() }
    }

    fn parabola(at: f64, cost: f64, slope: f64, sd: f64) -> Quadratic {
        Quadratic {
            at: DVector::from_element(1, at),
            cost,
            slope: DVector::from_element(1, slope),
            precision: DMatrix::from_element(1, 1, sd.powi(-2)),
            log_volume: 0.0,
        }
    }

    /// Under a uniform prior much wider than the likelihood, the evidence is sqrt(2 pi) sd / width at the peak.
    #[test]
    fn a_sharp_peak_under_a_flat_prior_gives_the_closed_form() {
        let c = candidate(Prior::Uniform { low: -1.0, high: 1.0 });
        // The search range has a width of 6, so that a standard deviation of 0.02 is 0.02 / 6 of it.
        let cost = parabola(c.search().to_unit(0.4), 100.0, 0.0, 0.02 / 6.0);
        let expected = 0.5 * (140.0 - 100.0) + ((2.0 * std::f64::consts::PI).sqrt() * 0.02 / 2.0).ln();
        let got = log_bayes_factor(&[c], &cost, 140.0);
        assert!((got - expected).abs() < 1e-4, "{got} for {expected}");
    }

    /// In two coordinates the evidence is 2 pi sqrt(det covariance) / area at the peak.
    #[test]
    fn a_sharp_peak_of_two_magnitudes_gives_the_closed_form() {
        let c = candidate(Prior::Uniform { low: -1.0, high: 1.0 });
        let covariance = DMatrix::from_row_slice(2, 2, &[4e-6, 5e-6, 5e-6, 9e-6]);
        let cost = Quadratic {
            at: DVector::from_vec(vec![c.search().to_unit(0.4), c.search().to_unit(-0.2)]),
            cost: 100.0,
            slope: DVector::zeros(2),
            precision: covariance.clone().try_inverse().unwrap(),
            log_volume: 0.0,
        };
        let area_of_peak = 2.0 * std::f64::consts::PI * covariance.determinant().sqrt() * 36.0;
        let expected = 0.5 * (140.0 - 100.0) + (area_of_peak / 4.0).ln();
        let got = log_bayes_factor(&[c.clone(), c], &cost, 140.0);
        assert!((got - expected).abs() < 2e-3, "{got} for {expected}");
    }

    /// Fit of one companion and one magnitude, after an unknown of the model, to data with these standard deviations of
    /// independent sums of both.
    fn group_fit(known: [f64; 2], correlation: f64) -> (Candidate, Fit) {
        let companion = track_fit::data::Companion {
            name: "place".into(),
            title: "place".into(),
            prior: Prior::LogUniform { low: 1.0, high: 100.0 },
        };
        let flat = candidate(Prior::Uniform { low: -1.0, high: 1.0 });
        let group = Candidate { companions: vec![companion], ..flat };
        let mut jacobian = DMatrix::zeros(3, 3);
        (jacobian[(0, 0)], jacobian[(1, 1)], jacobian[(2, 2)]) = (100.0, known[0], known[1]);
        jacobian[(1, 2)] = correlation * known[1];
        let point = vec![0.5, 0.4, group.search().to_unit(0.4)];
        let fit = Fit { point, cost: 100.0, residuals: DVector::zeros(3), jacobian, tracks: Vec::new() };
        (group, fit)
    }

    /// A companion that the data determine costs sqrt(2 pi) times its standard deviation in the prior's coordinates, and one
    /// that they do not determine costs nothing.
    #[test]
    fn companions_cost_the_share_of_their_prior_that_the_data_leave() {
        let factor = |known: f64, correlation: f64| {
            let (group, fit) = group_fit([known, 500.0], correlation);
            let group = [group];
            log_bayes_factor(&group, &Quadratic::of(&fit, &group).unwrap(), 140.0)
        };
        // The search range of the magnitude is 6 wide, and the prior 2.
        let alone = 0.5 * 40.0 + (TAU.sqrt() / 500.0 * 6.0 / 2.0).ln();
        assert!((factor(0.0, 0.0) - alone).abs() < 1e-3, "{} for {alone}", factor(0.0, 0.0));
        let known = alone + (TAU.sqrt() / 200.0).ln();
        assert!((factor(200.0, 0.0) - known).abs() < 1e-3, "{} for {known}", factor(200.0, 0.0));
        // The volume is that at each magnitude, wherever the companion lies there.
        let correlated = factor(200.0, 1.5);
        assert!((correlated - known).abs() < 1e-2, "{correlated} for {known}");
    }

    #[test]
    fn an_undetermined_companion_widens_a_magnitude_by_its_prior_alone() {
        let (group, mut fit) = group_fit([0.0, 500.0], 0.0);
        // The data determine the sum of both coordinates.
        fit.jacobian[(2, 1)] = 500.0;
        let sd = Quadratic::of(&fit, &[group]).unwrap().sd(0);
        assert!((sd - 12f64.sqrt().recip()).abs() < 1e-2, "{sd}");
    }

    #[test]
    fn an_effect_that_does_nothing_is_as_likely_as_none() {
        let c = candidate(Prior::LogUniform { low: 1e-3, high: 1.0 });
        let got = log_bayes_factor(&[c], &parabola(0.0, 50.0, 0.0, 1e6), 50.0);
        assert!(got.abs() < 1e-3, "{got}");
    }

    #[test]
    fn data_against_an_effect_lower_its_evidence() {
        let c = candidate(Prior::LogUniform { low: 1e-3, high: 1.0 });
        // At zero the cost rises with the magnitude.
        let got = log_bayes_factor(&[c], &parabola(0.0, 50.0, 30.0, 0.01), 50.0);
        assert!((-20.0..-0.3).contains(&got), "{got}");
    }

    fn baseline(shift: impl Fn(&track_fit::data::Channel) -> f64) -> Baseline {
        let episode = toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        let channels = episode.channels(0);
        let mut rng = catenary_core::seed::rng(51, 0);
        let noise = DVector::from_fn(channels.len(), |_, _| -> f64 {
            rand_distr::Distribution::sample(&rand_distr::StandardNormal, &mut rng)
        });
        let residuals = noise + DVector::from_iterator(channels.len(), channels.iter().map(shift));
        let jacobian = DMatrix::from_fn(channels.len(), 2, |i, j| 30.0 * ((i + 3 * j) as f64).sin());
        let fit = Fit { point: vec![0.5; 2], cost: residuals.norm_squared(), residuals, jacobian, tracks: Vec::new() };
        Baseline::new(&[episode], &fit.linear_minimum()).unwrap()
    }

    #[test]
    fn noise_disfavours_a_discrepancy_and_a_slow_error_favours_one() {
        let white = baseline(|_| 0.0);
        assert!(white.evidence().with_any() < -1.0, "{:?}", white.evidence());
        let slow = baseline(|c| 5.0 * (2.0 * c.time_s).sin());
        let evidence = slow.evidence();
        assert!(evidence.with_any() > 50.0, "{evidence:?}");
        let best = slow.discrepancies[evidence.likeliest().unwrap()];
        assert!((2.0..=8.0).contains(&best.sd) && best.time_s > 0.1, "{best:?}");
    }
}
