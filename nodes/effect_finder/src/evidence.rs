//! Marginal likelihoods of models with further effects, after Laplace, and under each discrepancy that is tried.
//!
//! Along the magnitudes of the effects the cost of the best fit is taken as a quadratic, and weighed with their priors; the
//! volumes of the other directions are alike with and without the effects, and cancel. Between discrepancies they do not,
//! and are counted.

use crate::candidate::Candidate;
use crate::case::Case;
use crate::discrepancy::{Discrepancy, Whitening};
use crate::fit::{Fit, presses};
use crate::laplace::Laplace;
use catenary_core::Prior;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};

/// Points of the quadrature over each magnitude by quantiles of its prior, and as many about its best value, where one, two,
/// or more magnitudes are integrated over.
const NODES: [usize; 3] = [800, 80, 24];
/// Reach of the nodes about the best value, in standard deviations.
const REACH: f64 = 8.0;

/// The cost of the best fit as a function of some coordinates: cost + 2 slope (u - at) + (u - at) precision (u - at).
#[derive(Debug, Clone)]
pub struct Quadratic {
    at: DVector<f64>,
    cost: f64,
    slope: DVector<f64>,
    precision: DMatrix<f64>,
}

impl Quadratic {
    /// Of the last `count` coordinates of a fit, with all others at their best; none where the curvature is no number.
    pub fn of(fit: &Fit, count: usize) -> Option<Self> {
        let first = fit.point.len() - count;
        let covariance = Laplace::of_likelihood(fit)?.covariance(first..fit.point.len());
        let gradient = fit.gradient();
        let slope =
            |i: usize| if presses(fit.point[first + i], gradient[first + i]) { gradient[first + i] } else { 0.0 };
        Some(Self {
            at: DVector::from_column_slice(&fit.point[first..]),
            cost: fit.cost,
            slope: DVector::from_fn(count, |i, _| slope(i)),
            precision: covariance.cholesky()?.inverse(),
        })
    }

    /// Standard deviation of coordinate `i` with the others free.
    pub fn sd(&self, i: usize) -> f64 {
        self.precision.clone().cholesky().map_or(f64::INFINITY, |c| c.inverse()[(i, i)].sqrt())
    }

    /// The same with the first coordinate at `u`.
    fn with_first(&self, u: f64) -> Self {
        let rest = self.at.len() - 1;
        let d = u - self.at[0];
        Self {
            at: self.at.rows(1, rest).into_owned(),
            cost: self.cost + 2.0 * self.slope[0] * d + self.precision[(0, 0)] * d * d,
            slope: self.slope.rows(1, rest) + d * self.precision.view((1, 0), (rest, 1)).column(0),
            precision: self.precision.view((1, 1), (rest, rest)).into_owned(),
        }
    }

    /// Where the first coordinate's cost is least with the others free, and its standard deviation.
    fn first(&self) -> (f64, f64) {
        match self.precision.clone().cholesky() {
            Some(c) => (self.at[0] - c.solve(&self.slope)[0], self.sd(0)),
            None => (self.at[0], f64::INFINITY),
        }
    }
}

/// Logarithm of the integral of prior times likelihood over the magnitudes of `candidates`, over the likelihood at a cost of
/// `base`. `cost` is one of their coordinates in the order of `candidates`.
pub fn log_bayes_factor(candidates: &[Candidate], cost: &Quadratic, base: f64) -> f64 {
    integral(candidates, cost, base, NODES[candidates.len().clamp(1, NODES.len()) - 1])
}

fn integral(candidates: &[Candidate], cost: &Quadratic, base: f64, nodes: usize) -> f64 {
    let Some((candidate, rest)) = candidates.split_first() else { return -0.5 * (cost.cost - base) };
    let search = candidate.search();
    let (least, sd) = cost.first();
    let (low, high) = candidate.prior.bounds();
    let side = |sign: &f64| {
        let ends = [low, high].map(|v| candidate.base + sign * v);
        let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let quantile = |i: usize| candidate.base + sign * candidate.prior.from_unit((i as f64 + 0.5) / nodes as f64);
        let about = |i: usize| search.from_unit(least + REACH * (2.0 * i as f64 / nodes as f64 - 1.0) * sd);
        let mut values: Vec<f64> = (0..nodes).map(quantile).chain((0..=nodes).map(about)).chain(ends).collect();
        values.retain(|v| (from..=to).contains(v) && candidate.density(*v) > 0.0);
        values.sort_by(f64::total_cmp);
        let log_weight =
            |v: &f64| candidate.density(*v).ln() + integral(rest, &cost.with_first(search.to_unit(*v)), base, nodes);
        log_area(&values, &values.iter().map(log_weight).collect::<Vec<f64>>())
    };
    let sides: Vec<f64> = candidate.signs().iter().map(side).collect();
    log_sum_exp(&sides)
}

/// Logarithm of the area under a curve whose logarithms are given at increasing places, by trapezoids.
fn log_area(places: &[f64], logs: &[f64]) -> f64 {
    let greatest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !greatest.is_finite() || places.len() < 2 {
        return f64::NEG_INFINITY;
    }
    let height = |i: usize| (logs[i] - greatest).exp();
    let area = |i: usize| 0.5 * (height(i) + height(i + 1)) * (places[i + 1] - places[i]);
    greatest + (0..places.len() - 1).map(area).sum::<f64>().ln()
}

/// Log evidences of one model: without discrepancy, and with each that is tried. Over the present model's without.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Without discrepancy.
    pub alone: f64,
    /// With each discrepancy in the order of [`Yardstick::discrepancies`].
    pub with: Vec<f64>,
}

impl Evidence {
    /// The mean over the discrepancies, each as likely beforehand.
    pub fn with_any(&self) -> f64 {
        log_sum_exp(&self.with) - (self.with.len() as f64).ln()
    }

    /// The discrepancy that is most likely, by its place.
    pub fn likeliest(&self) -> Option<usize> {
        (0..self.with.len()).max_by(|a, b| self.with[*a].total_cmp(&self.with[*b]))
    }
}

/// The present model's fit as each discrepancy sees it: what other models are held against.
pub struct Yardstick {
    /// What is tried.
    pub discrepancies: Vec<Discrepancy>,
    whitenings: Vec<Whitening>,
    /// Cost of the best fit without discrepancy, and with each.
    costs: (f64, Vec<f64>),
    evidence: Evidence,
}

impl Yardstick {
    /// That of the present model's best fit; none where a matrix is no positive one.
    pub fn new(cases: &[Case], fit: &Fit) -> Option<Self> {
        let discrepancies = Discrepancy::all();
        let whitenings: Vec<Whitening> =
            discrepancies.iter().map(|d| Whitening::new(cases, *d)).collect::<Option<_>>()?;
        let volume = |fit: &Fit| Some(-0.5 * Laplace::of(fit)?.log_determinant());
        let own = volume(fit)?;
        let (mut costs, mut with) = (Vec::new(), Vec::new());
        for whitening in &whitenings {
            let seen = whitening.of(fit).descended();
            with.push(-0.5 * (seen.cost - fit.cost + whitening.log_determinant()) + volume(&seen)? - own);
            costs.push(seen.cost);
        }
        Some(Self { discrepancies, whitenings, costs: (fit.cost, costs), evidence: Evidence { alone: 0.0, with } })
    }

    /// The present model's own evidence.
    pub fn evidence(&self) -> &Evidence {
        &self.evidence
    }

    /// How a discrepancy sees residuals.
    pub fn whitening(&self, place: usize) -> &Whitening {
        &self.whitenings[place]
    }

    /// Evidence of the model with `candidates`, whose coordinates are the last of its best fit.
    pub fn of(&self, candidates: &[Candidate], fit: &Fit) -> Option<Evidence> {
        let factor =
            |fit: &Fit, base: f64| Some(log_bayes_factor(candidates, &Quadratic::of(fit, candidates.len())?, base));
        let alone = factor(fit, self.costs.0)?;
        let mut with = Vec::new();
        for ((whitening, cost), base) in self.whitenings.iter().zip(&self.costs.1).zip(&self.evidence.with) {
            with.push(base + factor(&whitening.of(fit).descended(), *cost)?);
        }
        Some(Evidence { alone, with })
    }
}

/// The search prior of a candidate maps coordinates to its magnitude linearly.
pub fn sd_of(candidate: &Candidate, cost: &Quadratic, place: usize) -> f64 {
    let (low, high) = Prior::bounds(&candidate.search());
    cost.sd(place) * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};

    fn candidate(prior: Prior) -> Candidate {
        let range = [if prior.bounds().0 < 0.0 { -10.0 } else { 0.0 }, 10.0];
        Candidate { name: "x".into(), title: "x".into(), prior, range, base: 0.0, odds: 1.0 }
    }

    fn parabola(at: f64, cost: f64, slope: f64, sd: f64) -> Quadratic {
        Quadratic {
            at: DVector::from_element(1, at),
            cost,
            slope: DVector::from_element(1, slope),
            precision: DMatrix::from_element(1, 1, sd.powi(-2)),
        }
    }

    /// With a uniform prior much wider than the likelihood, the evidence is sqrt(2 pi) sd / width at the peak.
    #[test]
    fn a_sharp_peak_under_a_flat_prior_gives_the_closed_form() {
        let c = candidate(Prior::Uniform { low: -1.0, high: 1.0 });
        // The search spans 6, so that a standard deviation of 0.02 is 0.02 / 6 of it.
        let cost = parabola(c.search().to_unit(0.4), 100.0, 0.0, 0.02 / 6.0);
        let expected = 0.5 * (140.0 - 100.0) + ((2.0 * std::f64::consts::PI).sqrt() * 0.02 / 2.0).ln();
        let got = log_bayes_factor(&[c], &cost, 140.0);
        assert!((got - expected).abs() < 1e-4, "{got} for {expected}");
    }

    /// In two coordinates it is 2 pi sqrt(det covariance) / area.
    #[test]
    fn a_sharp_peak_of_two_magnitudes_gives_the_closed_form() {
        let c = candidate(Prior::Uniform { low: -1.0, high: 1.0 });
        let covariance = DMatrix::from_row_slice(2, 2, &[4e-6, 5e-6, 5e-6, 9e-6]);
        let cost = Quadratic {
            at: DVector::from_vec(vec![c.search().to_unit(0.4), c.search().to_unit(-0.2)]),
            cost: 100.0,
            slope: DVector::zeros(2),
            precision: covariance.clone().try_inverse().unwrap(),
        };
        let area_of_peak = 2.0 * std::f64::consts::PI * covariance.determinant().sqrt() * 36.0;
        let expected = 0.5 * (140.0 - 100.0) + (area_of_peak / 4.0).ln();
        let got = log_bayes_factor(&[c.clone(), c], &cost, 140.0);
        assert!((got - expected).abs() < 2e-3, "{got} for {expected}");
    }

    #[test]
    fn an_effect_that_does_nothing_is_as_likely_as_none() {
        let c = candidate(Prior::LogUniform { low: 1e-3, high: 1.0 });
        let got = log_bayes_factor(&[c], &parabola(0.0, 50.0, 0.0, 1e6), 50.0);
        assert!(got.abs() < 1e-3, "{got}");
    }

    #[test]
    fn data_that_speak_against_an_effect_lower_its_evidence() {
        let c = candidate(Prior::LogUniform { low: 1e-3, high: 1.0 });
        // At zero the cost rises with the magnitude.
        let got = log_bayes_factor(&[c], &parabola(0.0, 50.0, 30.0, 0.01), 50.0);
        assert!((-20.0..-0.3).contains(&got), "{got}");
    }

    fn yardstick(shift: impl Fn(&crate::case::Channel) -> f64) -> Yardstick {
        let case = toy::case(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        let channels = case.channels(0);
        let mut rng = catenary_core::seed::rng(51, 0);
        let noise = DVector::from_fn(channels.len(), |_, _| -> f64 {
            rand_distr::Distribution::sample(&rand_distr::StandardNormal, &mut rng)
        });
        let residuals = noise + DVector::from_iterator(channels.len(), channels.iter().map(shift));
        let jacobian = DMatrix::from_fn(channels.len(), 2, |i, j| 30.0 * ((i + 3 * j) as f64).sin());
        let fit = Fit { point: vec![0.5; 2], cost: residuals.norm_squared(), residuals, jacobian, tracks: Vec::new() };
        Yardstick::new(&[case], &fit.descended()).unwrap()
    }

    #[test]
    fn noise_speaks_against_a_discrepancy_and_a_slow_error_for_one() {
        let white = yardstick(|_| 0.0);
        assert!(white.evidence().with_any() < -1.0, "{:?}", white.evidence());
        let slow = yardstick(|c| 5.0 * (2.0 * c.time_s + c.frame as f64 * 0.0).sin());
        let evidence = slow.evidence();
        assert!(evidence.with_any() > 50.0, "{evidence:?}");
        let best = slow.discrepancies[evidence.likeliest().unwrap()];
        assert!((2.0..=8.0).contains(&best.sd) && best.time_s > 0.1, "{best:?}");
    }
}
