//! Support of the prior that moves between iterations.
//!
//! A support that excludes the truth makes a posterior that piles up at an edge and is falsely certain. A rule moves the
//! edges that physics does not set.

use crate::prior_support::{PriorSupport, SupportRule};
use crate::settings::SettingsError;
use crate::unit_map::UnitMap;
use catenary_core::statistics::{QuantileMethod, quantile};
use catenary_core::{Mixture, Parameter, ParameterSpace, Prior};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Number of draws for the shares and quantiles of a marginal. A share of one half is known to 0.8 %.
pub(crate) const DRAWS: usize = 4_000;
/// Largest share of the support's width that counts as its edge. A network that never saw a theta beyond the edge predicts
/// values slightly inside of it.
const EDGE: f64 = 0.05;
/// Share of the mixture in the edge or beyond above which the posterior presses on the edge: its median lies there. A
/// parameter that the data do not determine has its median in the middle.
const PRESSED: f64 = 0.5;
/// Growth beyond an edge as a share of the width. Smaller needs more moves for a distant truth; larger spends more simulations
/// on the new ground.
const GROWTH: f64 = 0.5;
/// Bound of a move along the mode, as a share of the width: a mixture far from its training data has arbitrary modes.
const LONGEST_MOVE: f64 = 1.0;
/// Inverse of the share of the iterations that must follow a move, to explore the new ground.
const LEAST_LEFT: usize = 3;
/// Share of new ground in the support above which the next thetas come from the whole prior: a network knows nothing of
/// new ground.
pub(super) const MOST_ADDED: f64 = 0.1;

/// Side of a support.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// The lower bound.
    Lower,
    /// The upper bound.
    Upper,
}

impl Side {
    /// Name in a sentence.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Side::Lower => "lower",
            Side::Upper => "upper",
        }
    }
}

/// Move of one parameter's support.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SupportMove {
    /// Number of the iteration after which the support moved, from 1.
    pub iteration: usize,
    /// Name of the parameter.
    pub parameter: String,
    /// Bounds before, in the parameter's unit.
    pub from: [f64; 2],
    /// Bounds after.
    pub to: [f64; 2],
    /// Reason in words.
    pub because: String,
}

/// Largest number of the iteration after which the support may move, of `iterations`.
pub(super) fn last_move(iterations: usize) -> usize {
    iterations - iterations.div_ceil(LEAST_LEFT)
}

/// Mixture with the support of its unit coordinates.
pub(super) struct Placed<'a> {
    pub(super) space: &'a ParameterSpace,
    pub(super) mixture: &'a Mixture,
}

impl Placed<'_> {
    /// Theta at the highest of the components' means, in the parameters' units. It may lie outside of the support.
    fn mode(&self) -> Vec<f64> {
        let means = (0..self.mixture.weights().len()).map(|k| self.mixture.component(k).0.as_slice());
        let density = |u: &&[f64]| self.mixture.log_density(u);
        let highest = means.max_by(|a, b| density(a).total_cmp(&density(b)));
        highest.map_or_else(Vec::new, |u| self.space.from_unit(u))
    }
}

/// Bounds that `rule` wants for a parameter, as unit coordinates of its present prior, with the reason.
type Wanted = Option<([f64; 2], String)>;

/// Moves the support of `newest`, the posterior of iteration `iteration`, by `rule`. `before` is the posterior of the iteration before,
/// none after the first one. `range_of` returns the physical limits of a parameter. A parameter without known limits, with a
/// mixture of priors, or with an edge at its limit keeps its bounds there.
pub(super) fn moved<R: Rng>(
    rule: SupportRule,
    iteration: usize,
    newest: &Placed<'_>,
    before: Option<&Placed<'_>>,
    range_of: &dyn Fn(&str) -> Option<[f64; 2]>,
    rng: &mut R,
) -> (ParameterSpace, Vec<SupportMove>) {
    let draws: Vec<Vec<f64>> = (0..DRAWS).map(|_| newest.mixture.sample(rng)).collect();
    let mode = newest.space.to_unit(&newest.mode());
    // Before the first iteration, the prior's median is the best guess.
    let mode_before = before.map_or_else(|| vec![0.5; mode.len()], |before| newest.space.to_unit(&before.mode()));
    let wanted = |axis: usize| -> Wanted {
        match rule {
            SupportRule::Edge => grown(draws.iter().map(|u| u[axis])),
            SupportRule::Mode => led(mode[axis] - mode_before[axis]),
            SupportRule::Centre => centred(mode[axis]),
        }
    };
    let mut moves = Vec::new();
    let step = |(axis, p): (usize, &Parameter)| {
        let bounds = wanted(axis).and_then(|(bounds, because)| {
            let to = within(&p.prior, bounds, range_of(&p.name)?)?;
            let (low, high) = p.prior.bounds();
            moves.push(SupportMove { iteration, parameter: p.name.clone(), from: [low, high], to, because });
            p.prior.with_bounds(to[0], to[1])
        });
        Parameter { name: p.name.clone(), prior: bounds.unwrap_or_else(|| p.prior.clone()) }
    };
    let parameters = newest.space.parameters().iter().enumerate().map(step).collect();
    match ParameterSpace::new(parameters) {
        Ok(space) if !moves.is_empty() => (space, moves),
        // Bounds that make no prior, such as a Gaussian without mass between them, are as good as none.
        _ => (newest.space.clone(), Vec::new()),
    }
}

/// Bounds that grow beyond an edge on which the marginal `u` presses.
fn grown(u: impl Iterator<Item = f64>) -> Wanted {
    let (side, share) = pressed(u)?;
    let bounds = match side {
        Side::Lower => [-GROWTH, 1.0],
        Side::Upper => [0.0, 1.0 + GROWTH],
    };
    Some((bounds, format!("{:.0} % of the mixture lay at its {} bound or beyond", 100.0 * share, side.name())))
}

/// Side of the edge on which the marginal `u` of a mixture presses, in unit coordinates and not truncated, with the share of
/// the marginal in this edge or beyond. None if it presses on neither.
pub(crate) fn pressed(u: impl Iterator<Item = f64>) -> Option<(Side, f64)> {
    let mut u: Vec<f64> = u.collect();
    u.sort_by(f64::total_cmp);
    let at = |q: f64| quantile(&u, q, QuantileMethod::Linear);
    // Half of the central 68 % is a standard deviation, which outliers of the mixture do not change. A narrow posterior
    // farther from the edge than that does not press.
    let edge = EDGE.min(0.5 * (at(0.84) - at(0.16)));
    let share = |is_in: &dyn Fn(f64) -> bool| u.iter().filter(|u| is_in(**u)).count() as f64 / u.len() as f64;
    let sides = [(Side::Lower, share(&|u| u < edge)), (Side::Upper, share(&|u| u > 1.0 - edge))];
    sides.into_iter().find(|(_, share)| *share > PRESSED)
}

/// Bounds that grow by the distance that the mode moved, on the side to which it moved.
fn led(by: f64) -> Wanted {
    let by = by.clamp(-LONGEST_MOVE, LONGEST_MOVE);
    let because = format!("the mode moved by {by:.2} widths");
    (by != 0.0).then(|| ([by.min(0.0), 1.0 + by.max(0.0)], because))
}

/// Bounds whose middle is the mode.
fn centred(mode: f64) -> Wanted {
    let by = (mode - 0.5).clamp(-LONGEST_MOVE, LONGEST_MOVE);
    let because = format!("the mode lay {by:.2} widths from the middle");
    (by != 0.0).then_some(([by, 1.0 + by], because))
}

/// `wanted` bounds (unit coordinates of `prior`) in the parameter's unit and within `limits`; none if nothing moves.
fn within(prior: &Prior, wanted: [f64; 2], limits: [f64; 2]) -> Option<[f64; 2]> {
    let (low, high) = prior.bounds();
    let is_free = match prior {
        Prior::Uniform { .. } | Prior::LogUniform { .. } => true,
        // The distribution function beyond a bound is unknown until the bound has moved there.
        Prior::Normal { .. } => wanted[0] <= 0.0 && wanted[1] >= 1.0,
        Prior::Mixture(_) => false,
    };
    // Zero and one are the bounds themselves, without rounding.
    let at = |u: f64| {
        if u == 0.0 {
            low
        } else if u == 1.0 {
            high
        } else {
            prior.from_unit(u)
        }
    };
    let to = [at(wanted[0]).max(limits[0]), at(wanted[1]).min(limits[1])];
    (is_free && to != [low, high] && to[0] < to[1]).then_some(to)
}

/// Checks that the support of at least one parameter of `space` can move if `support` asks for it.
///
/// # Errors
/// [`SettingsError`] if all priors are mixtures, whose bounds belong to their parts.
pub(super) fn check(support: PriorSupport, space: &ParameterSpace) -> Result<(), SettingsError> {
    let is_fixed = space.parameters().iter().all(|p| matches!(p.prior, Prior::Mixture(_)));
    match support {
        PriorSupport::Adaptive(_) if is_fixed => Err(SettingsError {
            field: "prior_support",
            expected: "fixed for a model whose priors are all mixtures, which cannot move".into(),
            got: "adaptive".into(),
        }),
        _ => Ok(()),
    }
}

/// Map from the unit coordinates of `from` to those of `to`; none if the two are equal.
pub(super) fn map(from: &ParameterSpace, to: &ParameterSpace) -> Option<UnitMap> {
    (from != to).then(|| UnitMap::new(from, to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use nalgebra::{DMatrix, DVector};

    fn space() -> ParameterSpace {
        let priors = [
            ("length_m", Prior::Uniform { low: 0.2, high: 0.3 }),
            ("youngs_modulus_pa", Prior::LogUniform { low: 1e3, high: 5e4 }),
            ("friction", Prior::Uniform { low: 0.0, high: 0.5 }),
        ];
        let named = |(name, prior): (&str, Prior)| Parameter { name: name.into(), prior };
        ParameterSpace::new(priors.map(named).to_vec()).unwrap()
    }

    /// Physical limits of the parameters of [`space`]. The lower edge of friction is one.
    fn range_of(name: &str) -> Option<[f64; 2]> {
        match name {
            "length_m" => Some([0.01, 0.32]),
            "youngs_modulus_pa" => Some([1.0, 1e12]),
            "friction" => Some([0.0, 5.0]),
            _ => None,
        }
    }

    fn gaussian(mean: [f64; 3], sd: f64) -> Mixture {
        let covariance = DMatrix::from_diagonal_element(3, 3, sd * sd);
        Mixture::new(&[1.0], vec![DVector::from_row_slice(&mean)], vec![covariance]).unwrap()
    }

    fn moves(rule: SupportRule, mean: [f64; 3], sd: f64) -> Vec<SupportMove> {
        let (space, mixture) = (space(), gaussian(mean, sd));
        let newest = Placed { space: &space, mixture: &mixture };
        let (next, moves) = moved(rule, 1, &newest, None, &range_of, &mut seed::rng(1, 0));
        for m in &moves {
            let axis = next.index_of(&m.parameter).unwrap();
            assert_eq!(next.parameters()[axis].prior.bounds(), (m.to[0], m.to[1]));
        }
        assert!(next.equals_up_to_bounds(&space) && (next == space) == moves.is_empty());
        moves
    }

    #[test]
    fn the_support_grows_at_a_free_edge_and_not_at_a_physical_one() {
        let at = |mean: [f64; 3]| moves(SupportRule::Edge, mean, 0.03);
        assert_eq!(at([0.5; 3]), []);
        let lower = at([0.0, -0.1, 0.0]);
        assert_eq!(lower.iter().map(|m| m.parameter.as_str()).collect::<Vec<_>>(), ["length_m", "youngs_modulus_pa"]);
        assert!((lower[0].to[0] - 0.15).abs() < 1e-12 && lower[0].to[1] == 0.3, "{lower:?}");
        // Half of the width in the logarithm.
        assert!((lower[1].to[0] - 1e3 / 50_f64.sqrt()).abs() < 1e-9 && lower[1].to[1] == 5e4, "{lower:?}");
        assert!(lower[0].because.contains("lower bound"), "{lower:?}");
        let upper = at([1.02, 0.5, 0.97]);
        // The physical limit of the length is nearer than half of the width.
        assert_eq!((upper[0].to, upper[1].to), ([0.2, 0.32], [0.0, 0.75]), "{upper:?}");
    }

    #[test]
    fn a_posterior_that_does_not_press_leaves_the_support() {
        // A flat posterior with the largest inflation, and narrow ones that stop short of an edge.
        for (mean, sd) in [([0.5; 3], 0.5), ([0.6, 0.4, 0.5], 0.3), ([0.04, 0.96, 0.5], 0.01)] {
            assert_eq!(moves(SupportRule::Edge, mean, sd), [], "{mean:?} +- {sd}");
        }
    }

    #[test]
    fn the_other_rules_follow_the_mode() {
        let led = moves(SupportRule::Mode, [0.5, 0.7, 0.3], 0.1);
        // Friction cannot fall below zero, towards which its mode moved.
        assert_eq!(led.len(), 1, "{led:?}");
        assert!((led[0].to[1] - 5e4 * 50_f64.powf(0.2)).abs() < 1e-6 * led[0].to[1] && led[0].to[0] == 1e3, "{led:?}");
        let centred = moves(SupportRule::Centre, [0.7, 0.5, 0.3], 0.1);
        let expected = [[0.22, 0.32], [0.0, 0.4]];
        for (m, expected) in centred.iter().zip(expected) {
            assert!((0..2).all(|i| (m.to[i] - expected[i]).abs() < 1e-12), "{centred:?}");
        }
    }

    #[test]
    fn priors_that_cannot_move_stay() {
        let part = |low, high| catenary_core::Weighted { weight: 1.0, prior: Prior::Uniform { low, high } };
        let named = |name: &str, prior| Parameter { name: name.into(), prior };
        let space = ParameterSpace::new(vec![
            named("length_m", Prior::Mixture(vec![part(0.2, 0.25), part(0.27, 0.3)])),
            named("unknown", Prior::Uniform { low: 0.0, high: 1.0 }),
            named("friction", Prior::Normal { mean: 0.2, sd: 0.1, low: 0.0, high: 0.4 }),
        ])
        .unwrap();
        let mixture = gaussian([1.1; 3], 0.05);
        let newest = Placed { space: &space, mixture: &mixture };
        let (next, moves) = moved(SupportRule::Edge, 1, &newest, None, &range_of, &mut seed::rng(1, 0));
        let names: Vec<&str> = moves.iter().map(|m| m.parameter.as_str()).collect();
        assert_eq!((names, moves[0].to[0]), (vec!["friction"], 0.0));
        assert!((moves[0].to[1] - 0.6).abs() < 1e-12, "{moves:?}");
        assert_eq!(next.parameters()[..2], space.parameters()[..2]);
        // Its density inside stays a Gaussian's: a shift would need the distribution function beyond the bound.
        let (_, moves) = moved(SupportRule::Centre, 1, &newest, None, &range_of, &mut seed::rng(1, 0));
        assert_eq!(moves, []);
    }

    #[test]
    fn a_support_that_no_parameter_can_move_is_refused() {
        let part = |low, high| catenary_core::Weighted { weight: 1.0, prior: Prior::Uniform { low, high } };
        let both = Prior::Mixture(vec![part(0.2, 0.25), part(0.27, 0.3)]);
        let of = |priors: Vec<Prior>| {
            let named = |(i, prior)| Parameter { name: format!("theta_{i}"), prior };
            check(
                PriorSupport::ADAPTIVE,
                &ParameterSpace::new(priors.into_iter().enumerate().map(named).collect()).unwrap(),
            )
        };
        let refusal = of(vec![both.clone()]).unwrap_err().to_string();
        assert_eq!(
            refusal,
            "settings: `prior_support`: expected fixed for a model whose priors are all mixtures, which cannot move, got adaptive"
        );
        assert_eq!(of(vec![both, Prior::Uniform { low: 0.0, high: 1.0 }]), Ok(()));
        assert_eq!(check(PriorSupport::Fixed, &space()), Ok(()));
    }

    #[test]
    fn a_third_of_the_iterations_follows_the_last_move() {
        assert_eq!([1, 2, 3, 4, 15].map(last_move), [0, 1, 2, 2, 10]);
    }
}
