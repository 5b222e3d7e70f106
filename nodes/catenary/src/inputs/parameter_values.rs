//! Checks of parameter and effect values from the command line. An impossible value is an error; a value outside the
//! model's distribution is a warning.

use crate::terminal::output;
use anyhow::{Context, Result, bail, ensure};
use catenary_core::spelling::did_you_mean;
use catenary_core::{Model, Prior};
use catenary_simulator::Registry;
use catenary_simulator::parameters::range_of;

/// Index in theta of the parameter in `--theta NAME=VALUE`.
pub fn place_of(name: &str, value: f64, model: &Model) -> Result<usize> {
    let registry = Registry::shipped().with_expressions(model)?;
    let names: Vec<&str> = model.theta.parameters().iter().map(|p| p.name.as_str()).collect();
    let place = model.theta.index_of(name).with_context(|| {
        let hint = did_you_mean(name, names.iter().copied());
        format!("--theta {name}: expected one of {} of model `{}`{hint}", names.join(", "), model.name)
    })?;
    check("--theta", name, value, Some(&model.theta.parameters()[place].prior), &registry)?;
    Ok(place)
}

/// Theta of `--theta NAME=VALUE` for each of its parameters.
pub fn whole_theta(given: &[(String, f64)], model: &Model) -> Result<Vec<f64>> {
    let mut theta = vec![f64::NAN; model.theta.dimension()];
    for (name, value) in given {
        theta[place_of(name, *value, model)?] = *value;
    }
    let missing = model.theta.parameters().iter().zip(&theta).find(|(_, value)| value.is_nan());
    match missing {
        Some((parameter, _)) => {
            bail!("--theta: expected a value of every inferred parameter, got none of {}", parameter.name)
        }
        None => Ok(theta),
    }
}

/// Checks `--effect NAME=VALUE`: the name must be a parameter, or an effect of `registry` or of the model, that the
/// model does not infer.
pub fn check_effect(name: &str, value: f64, model: &Model, registry: &Registry) -> Result<()> {
    let is_inferred = model.theta.index_of(name).is_some();
    ensure!(!is_inferred, "--effect {name}: it is inferred: expected --theta {name}={value}");
    let drawn = model.effects.iter().find(|effect| effect.name == name);
    check("--effect", name, value, drawn.map(|effect| &effect.distribution), &registry.with_expressions(model)?)
}

fn check(option: &str, name: &str, value: f64, prior: Option<&Prior>, registry: &Registry) -> Result<()> {
    let [low, high] = range_of(registry, name).with_context(|| option.to_owned())?;
    ensure!((low..=high).contains(&value), "{option} {name}: expected {low} to {high}, got {value}");
    // A cell outside the prior is a legitimate experiment on robustness.
    if let Some(prior) = prior.filter(|prior| !prior.holds(value)) {
        output::warn(&format!(
            "{option} {name}={value} lies outside its prior in the model, {prior}: inference cannot find it"
        ));
    }
    Ok(())
}
