//! Trade-offs: pairs of values that the data determine only together.

use crate::evidence::Hypothesis;
use serde::{Deserialize, Serialize};
use track_fit::data::Scope;
use track_fit::fitting::Laplace;

/// Least correlation of an effect's trade-off. At sqrt(1 - r^2) = 1/2, knowing one value halves the uncertainty of the other.
const LEAST_CORRELATION: f64 = 0.866;
/// Correlation of two parameters above which the data determine little more than a combination of both. Their best
/// combination is then known at least five times as well as either.
const PARAMETERS_CORRELATION: f64 = 0.98;
/// Largest exponent of a combination. With a larger one, the second parameter is known far better than the first.
const MOST_EXPONENT: f64 = 4.0;
/// Relative standard deviation from which a value counts as hardly determined.
const HARDLY: f64 = 0.1;

/// Two unknowns that make up for each other: an effect and another unknown, or two parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TradeOff {
    /// Effect, and parameter or other effect; or two parameters.
    pub between: [String; 2],
    /// Correlation of both in unit coordinates, which are logarithms for log-uniform priors, all other unknowns free.
    pub correlation: f64,
    /// Combination of two parameters that the data determine instead of either. None for effects, for parameters that may be
    /// zero or negative, and if only a combination with a large exponent is determined.
    #[serde(default)]
    pub combination: Option<Combination>,
}

/// Quotient or product A B^e of two positive parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Combination {
    /// Exponent e of the second parameter, to one decimal: -1 for a quotient, 1 for a product.
    pub exponent: f64,
    /// Relative standard deviation of the combination.
    pub relative_sd: f64,
    /// Relative standard deviations of both parameters.
    pub alone: [f64; 2],
}

impl TradeOff {
    /// Share of the uncertainty of one value that knowing the other would remove.
    pub fn worth(&self) -> f64 {
        1.0 - (1.0 - self.correlation.powi(2)).max(0.0).sqrt()
    }

    /// Sentence on the combination of two parameters that the data determine, by their names: "determine A / B to 2.0 %, and hardly either (A to 40 %, B to
    /// 38 %)". None without a combination.
    pub fn determined(&self, [a, b]: [&str; 2]) -> Option<String> {
        let Combination { exponent, relative_sd, alone } = self.combination.as_ref()?;
        let sign = if *exponent < 0.0 { "/" } else { "x" };
        let power = if exponent.abs() == 1.0 { String::new() } else { format!("^{}", exponent.abs()) };
        let either = if alone.iter().all(|sd| *sd >= HARDLY) { "hardly either" } else { "either less well" };
        let [all, first, second] = [*relative_sd, alone[0], alone[1]].map(|sd| percent(100.0 * sd));
        Some(format!("determine {a} {sign} {b}{power} to {all} %, and {either} ({a} to {first} %, {b} to {second} %)"))
    }
}

/// Number of percent with two figures below 10.
fn percent(value: f64) -> String {
    let digits = usize::from(value < 9.95);
    format!("{value:.digits$}")
}

/// Trade-offs of the model's effects at its fit, the strongest first, then those between its parameters; none if the
/// Gauss-Newton matrix is not positive definite. The spread between conditions does not count, because it is no doubt about
/// these data.
pub fn trade_offs(found: &Hypothesis) -> Vec<TradeOff> {
    let Some(posterior) = Laplace::of(&found.fit) else { return Vec::new() };
    let correlations = posterior.correlations(0..found.unknowns.columns());
    let list = found.unknowns.list();
    // The numbers of an effect belong together, so that they trade off with others alone.
    let group = |i: usize| list[i].companion_of.as_deref().or(list[i].candidate.as_ref().map(|c| c.name.as_str()));
    let effects = (0..list.len()).filter(|i| group(*i).is_some());
    let is_other = |effect: usize, i: usize| list[i].scope == Scope::Shared && group(i) != group(effect);
    let others = |effect: usize| (0..effect).filter(move |i| is_other(effect, *i)).map(move |i| (effect, i));
    let mut all: Vec<TradeOff> = effects
        .flat_map(others)
        .map(|(effect, other)| {
            let [e, o] = [effect, other].map(|i| found.unknowns.column(i, 0));
            let between = [list[effect].name.clone(), list[other].name.clone()];
            TradeOff { between, correlation: correlations[(e, o)], combination: None }
        })
        .filter(|t| t.correlation.abs() >= LEAST_CORRELATION)
        .collect();
    let strongest_first = |a: &TradeOff, b: &TradeOff| b.correlation.abs().total_cmp(&a.correlation.abs());
    all.sort_by(strongest_first);
    let theta = found.unknowns.theta();
    let pairs = (0..theta).flat_map(|i| (0..i).map(move |j| (j, i)));
    let correlation = |(j, i): (usize, usize)| correlations[(found.unknowns.column(j, 0), found.unknowns.column(i, 0))];
    let close = pairs.filter(|pair| correlation(*pair).abs() > PARAMETERS_CORRELATION);
    let mut parameters: Vec<TradeOff> =
        close.map(|pair| between_parameters(found, &posterior, pair, correlation(pair))).collect();
    parameters.sort_by(strongest_first);
    all.extend(parameters);
    all
}

/// Trade-off of two parameters: in their order in the model, or the one with the larger relative standard deviation first if
/// their combination has an exponent above 1.
fn between_parameters(
    found: &Hypothesis,
    posterior: &Laplace,
    (one, other): (usize, usize),
    correlation: f64,
) -> TradeOff {
    let list = found.unknowns.list();
    // Standard deviation of the logarithm, to first order; none for a value that may be zero or negative.
    let relative_sd = |i: usize| {
        let (column, prior) = (found.unknowns.column(i, 0), &list[i].prior);
        let value = prior.from_unit(found.fit.point[column]);
        (prior.bounds().0 > 0.0).then(|| posterior.sd(column) * found.unknowns.slope(i, value) / value)
    };
    let sds = relative_sd(one).zip(relative_sd(other));
    let to_one_decimal = |ratio: f64| (10.0 * ratio).round() / 10.0;
    let is_other_first = sds.is_some_and(|(a, b)| to_one_decimal(b / a) > 1.0);
    let [first, second] = if is_other_first { [other, one] } else { [one, other] };
    let combination = sds.and_then(|(a, b)| {
        let [a, b] = if is_other_first { [b, a] } else { [a, b] };
        // Along the ridge of the posterior, A B^e is constant.
        let exponent = -correlation.signum() * to_one_decimal(a / b);
        let variance = a * a + (exponent * b).powi(2) + 2.0 * exponent * correlation * a * b;
        // Rounding may carry a variance below zero.
        let relative_sd = variance.max(0.0).sqrt();
        (exponent.abs() <= MOST_EXPONENT).then_some(Combination { exponent, relative_sd, alone: [a, b] })
    });
    TradeOff { between: [first, second].map(|i| list[i].name.clone()), correlation, combination }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Effort, Evidence};
    use catenary_core::{Model, Prior};
    use nalgebra::{DMatrix, DVector};
    use track_fit::data::{Candidate, Companion, Unknowns};
    use track_fit::fitting::{FidelityCorrection, Fit};
    use track_fit::toy;

    /// Model with two effects. The first changes the data like `alike` times the stiffness and the episode's own
    /// unknown.
    fn found(alike: f64, spread: Vec<f64>) -> Hypothesis {
        let model = Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let prior = Prior::Uniform { low: -0.02, high: 0.02 };
        let candidate = |name: &str| Candidate {
            name: name.into(),
            title: String::new(),
            prior: prior.clone(),
            range: [-1.0, 1.0],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        };
        let candidates = ["tip_mass_kg", "table_height_m"].map(candidate).to_vec();
        let unknowns = candidates.iter().fold(Unknowns::of(&model, 1), |u, c| u.with(c));
        let n = unknowns.columns();
        assert!(n > 4, "something is drawn for each episode");
        let mut jacobian: DMatrix<f64> = 300.0 * DMatrix::identity(n, n);
        (jacobian[(1, n - 2)], jacobian[(2, n - 2)]) = (300.0 * alike, 300.0 * alike);
        let fit = Fit { point: vec![0.5; n], cost: 0.0, residuals: DVector::zeros(n), jacobian, tracks: Vec::new() };
        let evidence = Evidence { alone: 0.0, with: Vec::new() };
        let (correction, effort) = (FidelityCorrection::Untried, Effort::Searched);
        Hypothesis { candidates, unknowns, episodes: None, correction, fit, evidence, effort, spread }
    }

    #[test]
    fn an_effect_trades_off_with_a_correlated_parameter() {
        // With columns e_1 and e_n + a (e_1 + e_2), the correlation is -a / sqrt(1 + a^2).
        let [one] = trade_offs(&found(3.0, Vec::new())).try_into().unwrap();
        assert_eq!(one.between, ["tip_mass_kg", "youngs_modulus_pa"]);
        assert!((one.correlation + 3.0 / 10f64.sqrt()).abs() < 1e-3, "{one:?}");
        assert!((one.worth() - (1.0 - 0.1f64.sqrt())).abs() < 1e-3, "{one:?}");
        assert_eq!(
            trade_offs(&found(3.0, vec![0.2, 0.0])),
            [one],
            "conditions that differ are no doubt about these data"
        );
        assert_eq!(trade_offs(&found(1.0, Vec::new())), []);
    }

    /// A companion trades off with unknowns outside its group, and not within it.
    #[test]
    fn the_numbers_of_a_group_trade_off_with_others_alone() {
        let plain = found(0.0, Vec::new());
        let companion =
            Companion { name: "place".into(), title: String::new(), prior: Prior::Uniform { low: 0.0, high: 1.0 } };
        let mut candidates = plain.candidates.clone();
        candidates[0].companions = vec![companion];
        let unknowns = candidates.iter().fold(Unknowns::of(&toy::model(), 1), |u, c| u.with(c));
        let names = ["length_m", "youngs_modulus_pa", "place", "tip_mass_kg", "table_height_m"];
        assert_eq!(unknowns.names(), names);
        let between = |one: usize, other: usize| {
            let mut jacobian: DMatrix<f64> = 300.0 * DMatrix::identity(5, 5);
            jacobian[(one, other)] = 3000.0;
            let fit =
                Fit { point: vec![0.5; 5], cost: 0.0, residuals: DVector::zeros(5), jacobian, tracks: Vec::new() };
            let (unknowns, candidates) = (unknowns.clone(), candidates.clone());
            let all = trade_offs(&Hypothesis { unknowns, candidates, fit, ..found(0.0, Vec::new()) });
            all.into_iter().map(|t| t.between).collect::<Vec<_>>()
        };
        assert_eq!(between(2, 3), [[""; 2]; 0]);
        assert_eq!(between(2, 1), [["place", "youngs_modulus_pa"]]);
        assert_eq!(between(2, 4), [["table_height_m", "place"]]);
    }

    /// Model whose data determine only the sum of the coordinates of its two parameters, the second times `weight`.
    fn of_two(priors: [Prior; 2], weight: f64, known: f64) -> Hypothesis {
        let mut model = track_fit::toy::model();
        let mut parameters = model.theta.parameters().to_vec();
        parameters.iter_mut().zip(priors).for_each(|(parameter, prior)| parameter.prior = prior);
        model.theta = catenary_core::ParameterSpace::new(parameters).unwrap();
        let jacobian = DMatrix::from_row_slice(1, 2, &[known, known * weight]);
        let fit = Fit { point: vec![0.5; 2], cost: 0.0, residuals: DVector::zeros(1), jacobian, tracks: Vec::new() };
        Hypothesis { candidates: Vec::new(), unknowns: Unknowns::of(&model, 1), fit, ..found(0.0, Vec::new()) }
    }

    #[test]
    fn parameters_that_the_data_determine_only_together_are_told_as_a_combination() {
        let log = |low: f64, high: f64| Prior::LogUniform { low, high };
        let told = |priors: [Prior; 2], weight: f64, known: f64| {
            let all = trade_offs(&of_two(priors, weight, known));
            all.iter().map(|t| (t.clone(), t.determined(["A", "B"]))).next()
        };
        let width = 3f64.ln();
        let (ratio, words) = told([log(0.1, 0.3), log(1e3, 3e3)], -1.0, 400.0).unwrap();
        assert_eq!(ratio.between, ["length_m", "youngs_modulus_pa"]);
        let found = ratio.combination.unwrap();
        // The difference of the coordinates has the standard deviation 1 / 400, and their sum that of the prior.
        let [sd, alone] = [width / 400.0, width / 24f64.sqrt()];
        assert!(found.exponent == -1.0 && (found.relative_sd / sd - 1.0).abs() < 1e-2, "{found:?} {sd}");
        assert!(found.alone.iter().all(|one| (one / alone - 1.0).abs() < 1e-2), "{found:?} {alone}");
        assert_eq!(words.unwrap(), "determine A / B to 0.3 %, and hardly either (A to 22 %, B to 22 %)");
        let (_, words) = told([log(0.1, 0.3), log(1e3, 3e3)], 1.0, 400.0).unwrap();
        assert!(words.unwrap().starts_with("determine A x B to 0.3 %"));
        // The logarithm of the second parameter covers twice the width, so that it is the first of the combination.
        let (power, words) = told([log(0.1, 0.3), log(1e3, 9e3)], 1.0, 400.0).unwrap();
        assert_eq!(power.between, ["youngs_modulus_pa", "length_m"]);
        assert!(words.unwrap().starts_with("determine A x B^2 to "));
        let narrow = told([log(0.25, 0.26), log(1e4, 1.04e4)], -1.0, 400.0).unwrap().1.unwrap();
        assert!(narrow.contains("and either less well (A to 0.8 %"), "{narrow}");
        let uniform = [Prior::Uniform { low: 0.2, high: 0.3 }, log(1e4, 1.5e4)];
        assert!(told(uniform, -1.0, 400.0).unwrap().1.is_some_and(|words| words.starts_with("determine A / B to ")));
        let signed = told([Prior::Uniform { low: -0.1, high: 0.3 }, log(1e3, 3e3)], -1.0, 400.0).unwrap();
        assert_eq!((signed.0.combination, signed.1), (None, None), "a ratio of a value that may be zero");
        assert_eq!(told([log(0.1, 0.3), log(1e3, 3e8)], 1.0, 400.0).unwrap().0.combination, None, "a large exponent");
        assert_eq!(told([log(0.1, 0.3), log(1e3, 3e3)], -1.0, 20.0), None, "a correlation of 0.97");
    }
}
