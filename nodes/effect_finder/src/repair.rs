//! The model with effects more.

use crate::candidate::Candidate;
use crate::hypothesis::Hypothesis;
use catenary_core::{Model, ModelError, Parameter, ParameterSpace, Prior};

/// How many standard deviations about the value found the prior in the repaired model holds at least.
const MARGIN: f64 = 4.0;

/// `model` with the hypothesis's effects among the parameters that it infers, each under its own prior, opened where the value
/// found lies near or beyond its edge. What the model had fixed of them goes.
///
/// # Errors
/// [`ModelError`] where the result is no model.
pub fn repaired(model: &Model, found: &Hypothesis) -> Result<Model, ModelError> {
    let magnitudes: Vec<(f64, f64)> = (0..found.candidates.len()).map(|i| found.magnitude(i)).collect();
    with_effects(model, &found.candidates, &magnitudes)
}

/// `model` with effects whose values and standard deviations are given.
fn with_effects(model: &Model, candidates: &[Candidate], magnitudes: &[(f64, f64)]) -> Result<Model, ModelError> {
    let mut parameters = model.theta.parameters().to_vec();
    let mut repaired = model.clone();
    for (candidate, (value, sd)) in candidates.iter().zip(magnitudes) {
        parameters.push(Parameter { name: candidate.name.clone(), prior: prior(candidate, *value, *sd) });
        repaired.parameters.remove(&candidate.name);
    }
    repaired.theta = ParameterSpace::new(parameters).map_err(|e| ModelError::text("theta", e))?;
    Ok(repaired)
}

fn prior(candidate: &Candidate, value: f64, sd: f64) -> Prior {
    let margin = MARGIN * sd.min((value - candidate.base).abs());
    let (from, to) = (value - margin, value + margin);
    let (low, high) = candidate.prior.bounds();
    let (low, high) = (candidate.base + low, candidate.base + high);
    let [least, greatest] = candidate.range;
    match candidate.prior {
        // A logarithm has no place for what may be zero or less: half the value found is near enough.
        Prior::LogUniform { .. } if candidate.base == 0.0 => {
            Prior::LogUniform { low: low.min(0.5 * value.max(0.1 * low)), high: high.max(to).min(greatest) }
        }
        _ => Prior::Uniform { low: low.min(from).max(least), high: high.max(to).min(greatest) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    #[test]
    fn the_effect_is_inferred_from_then_on() {
        let prior = Prior::Uniform { low: -0.02, high: 0.02 };
        let candidate = Candidate {
            name: "table_height_m".into(),
            title: String::new(),
            prior,
            range: [-10.0, 10.0],
            base: 0.0,
            odds: 1.0,
        };
        let repaired = with_effects(&model(), &[candidate], &[(0.03, 0.001)]).unwrap();
        assert!(!repaired.parameters.contains_key("table_height_m"), "it was fixed before");
        let last = repaired.theta.parameters().last().unwrap();
        assert_eq!(last.name, "table_height_m");
        let (low, high) = last.prior.bounds();
        assert!(low == -0.02 && (high - 0.034).abs() < 1e-12, "{low} to {high}");
        let text = include_str!("../../../launch_configs/models/soft_bar.yaml");
        let written = repaired.rewrite(text).unwrap();
        assert!(written.contains("# A soft silicone bar"), "the user's words stay");
        assert_eq!(Model::from_yaml(&written).unwrap(), repaired);
    }

    #[test]
    fn a_positive_effect_keeps_its_logarithm() {
        let own = Prior::LogUniform { low: 1e-3, high: 0.3 };
        let drag = Candidate {
            name: "linear_drag_n_s_m2".into(),
            title: String::new(),
            prior: own.clone(),
            range: [0.0, 1e3],
            base: 0.0,
            odds: 1.0,
        };
        let of = |value, sd| prior(&drag, value, sd);
        assert_eq!(of(0.05, 0.01), own);
        let Prior::LogUniform { low, high } = of(0.4, 0.02) else { panic!("a logarithm") };
        assert!(low == 1e-3 && (high - 0.48).abs() < 1e-12, "{low} to {high}");
    }
}
