//! Repaired model: the present model with the named effects.

use crate::evidence::Hypothesis;
use catenary_core::{Model, ModelError, Parameter, ParameterSpace, Prior};
use track_fit::data::{Candidate, Companion, Scope};
use track_fit::fitting::Laplace;

/// Posterior standard deviation, relative to the width of the prior, above which data add nothing to the prior. A
/// uniform prior itself has 0.29.
const MOST_SHARE: f64 = 0.2;
/// Least reach of the repaired model's prior around the value found, in standard deviations.
const MARGIN: f64 = 4.0;

/// Repaired model: `model` with the effects, each followed by its companions, among its inferred parameters. The posterior becomes the new prior, a
/// Gaussian within the old bounds, for each parameter that the data determine. The spread of an effect between
/// conditions counts. Values that the model had fixed for the effects are removed.
///
/// # Errors
/// [`ModelError`] if the result is not a valid model.
pub fn repaired(model: &Model, found: &Hypothesis, posterior: &Laplace) -> Result<Model, ModelError> {
    let mut parameters = model.theta.parameters().to_vec();
    for (place, candidate) in found.candidates.iter().enumerate() {
        let (value, sd) = found.magnitude(place);
        parameters.push(Parameter { name: candidate.name.clone(), prior: prior(candidate, value, sd) });
        let companion = |c: &Companion| Parameter { name: c.name.clone(), prior: c.prior.clone() };
        parameters.extend(candidate.companions.iter().map(companion));
    }
    let shared = found.unknowns.list().iter().enumerate().filter(|(_, u)| u.scope == Scope::Shared);
    for (i, unknown) in shared {
        let column = found.unknowns.column(i, 0);
        let value = unknown.prior.from_unit(found.fit.point[column]);
        let share = posterior.sd(column);
        let parameter = parameters.iter_mut().find(|p| p.name == unknown.name);
        if let Some(parameter) = parameter.filter(|_| share < MOST_SHARE) {
            let (low, high) = parameter.prior.bounds();
            let sd = share * found.unknowns.slope(i, value);
            parameter.prior = Prior::Normal { mean: value.clamp(low, high), sd, low, high };
        }
    }
    let mut repaired = model.clone();
    found.candidates.iter().for_each(|c| {
        repaired.parameters.remove(&c.name);
    });
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
        // A log-uniform prior cannot hold zero; it reaches down to half the value found.
        Prior::LogUniform { .. } if candidate.base == 0.0 => {
            Prior::LogUniform { low: low.min(0.5 * value.max(0.1 * low)), high: high.max(to).min(greatest) }
        }
        _ => Prior::Uniform { low: low.min(from).max(least), high: high.max(to).min(greatest) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Effort, Evidence};
    use nalgebra::{DMatrix, DVector};
    use track_fit::data::Unknowns;
    use track_fit::fitting::{FidelityCorrection, Fit};
    use track_fit::toy;

    fn model() -> Model {
        Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    #[test]
    fn the_repaired_model_infers_the_effect() {
        let prior = Prior::Uniform { low: -0.02, high: 0.02 };
        let candidate = Candidate {
            name: "table_height_m".into(),
            title: String::new(),
            prior,
            range: [-10.0, 10.0],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        };
        let mut model = model();
        let unknowns = Unknowns::of(&model, 1).with(&candidate);
        let mut point = vec![0.5; unknowns.columns()];
        point[unknowns.columns() - 1] = candidate.search().to_unit(0.03);
        // The first coordinate and the last are known well, the second not at all.
        let mut jacobian = DMatrix::zeros(unknowns.columns(), unknowns.columns());
        (jacobian[(0, 0)], jacobian[(1, unknowns.columns() - 1)]) = (100.0, 120.0);
        let residuals = DVector::zeros(unknowns.columns());
        let fit = Fit { point, cost: 0.0, residuals, jacobian, tracks: Vec::new() };
        let posterior = Laplace::of(&fit).unwrap();
        let evidence = Evidence { alone: 0.0, with: Vec::new() };
        let found = Hypothesis {
            candidates: vec![candidate],
            unknowns,
            episodes: None,
            correction: FidelityCorrection::Untried,
            fit,
            evidence,
            effort: Effort::Searched,
            spread: Vec::new(),
        };
        model.parameters.insert("table_height_m".into(), 0.0);
        let before = model.theta.parameters()[1].clone();
        let mut spread = vec![0.0; found.unknowns.columns()];
        spread[found.column(0)] = 0.03;
        let differing = Hypothesis { spread, ..found.clone() };
        let looser = self::repaired(&model, &differing, &differing.posterior().unwrap()).unwrap();
        let repaired = repaired(&model, &found, &posterior).unwrap();
        assert!(!repaired.parameters.contains_key("table_height_m"), "it was fixed before");
        let [length, stiffness, last] = repaired.theta.parameters() else { panic!("three") };
        assert_eq!((last.name.as_str(), stiffness), ("table_height_m", &before));
        let Prior::Normal { mean, sd, .. } = length.prior else { panic!("{length:?}") };
        assert!((mean - 0.25).abs() < 1e-9 && (sd - 0.0011).abs() < 1e-5, "{mean} {sd}");
        let sd_of = |model: &Model| match model.theta.parameters()[2].prior {
            Prior::Normal { sd, .. } => sd,
            ref other => panic!("{other}"),
        };
        let (own, ratio) = (posterior.sd(found.column(0)), sd_of(&looser) / sd_of(&repaired));
        assert!((ratio - own.hypot(0.03) / own).abs() < 1e-9, "{ratio}");
        let (low, high) = last.prior.bounds();
        assert!(low == -0.02 && (high - 0.034).abs() < 1e-3, "{low} to {high}");
        let text = include_str!("../../../../../launch_configs/models/soft_bar.yaml");
        let written = repaired.rewrite(text).unwrap();
        assert!(written.contains("# A soft silicone bar"), "the user's words stay");
        assert_eq!(Model::from_yaml(&written).unwrap(), repaired);
    }

    #[test]
    fn companions_are_written_with_their_effect_and_have_the_posterior_as_their_prior() {
        let own = Prior::LogUniform { low: 1.0, high: 100.0 };
        let companion = |name: &str| Companion { name: name.into(), title: String::new(), prior: own.clone() };
        let mass = toy::candidate("tip_mass_kg");
        let group = Candidate { companions: ["place", "rate"].map(companion).into(), ..mass };
        let model = toy::model();
        let unknowns = Unknowns::of(&model, 1).with(&group);
        // The first companion is known well, the second not at all.
        let mut jacobian: DMatrix<f64> = 100.0 * DMatrix::identity(5, 5);
        jacobian[(3, 3)] = 0.0;
        let fit = Fit { point: vec![0.5; 5], cost: 0.0, residuals: DVector::zeros(5), jacobian, tracks: Vec::new() };
        let posterior = Laplace::of(&fit).unwrap();
        let found = Hypothesis {
            candidates: vec![group],
            unknowns,
            episodes: None,
            correction: FidelityCorrection::Untried,
            fit,
            evidence: Evidence { alone: 0.0, with: Vec::new() },
            effort: Effort::Searched,
            spread: Vec::new(),
        };
        let repaired = repaired(&model, &found, &posterior).unwrap();
        let [_, _, mass, place, rate] = repaired.theta.parameters() else { panic!("{:?}", repaired.theta) };
        assert_eq!([&mass.name, &place.name, &rate.name], ["tip_mass_kg", "place", "rate"]);
        assert_eq!(rate.prior, own);
        let Prior::Normal { mean, sd, low, high } = place.prior else { panic!("{place:?}") };
        let expected = 10.0 * 100f64.ln() / 10_012f64.sqrt();
        assert!(
            (mean - 10.0).abs() < 1e-9 && (sd / expected - 1.0).abs() < 1e-9 && (low, high) == (1.0, 100.0),
            "{sd}"
        );
    }

    #[test]
    fn a_positive_effect_keeps_its_log_uniform_prior() {
        let own = Prior::LogUniform { low: 1e-3, high: 0.3 };
        let drag = Candidate {
            name: "linear_drag_n_s_m2".into(),
            title: String::new(),
            prior: own.clone(),
            range: [0.0, 1e3],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        };
        let of = |value, sd| prior(&drag, value, sd);
        assert_eq!(of(0.05, 0.01), own);
        let Prior::LogUniform { low, high } = of(0.4, 0.02) else { panic!("a logarithm") };
        assert!(low == 1e-3 && (high - 0.48).abs() < 1e-12, "{low} to {high}");
    }
}
