//! Reader of model files: parses the text and checks names and values of the physical parameters.

use crate::parameters::{ParameterError, check};
use catenary_core::{Model, ModelError};

/// Reads a model that the simulator can run: its parameters exist, their distributions lie within their ranges, and
/// their medians make a beam.
///
/// # Errors
/// [`ModelError`] naming line and field.
pub fn read(text: &str) -> Result<Model, ModelError> {
    let model = Model::from_yaml(text)?;
    let refuse = |e: ParameterError| error_in(&model, &e).in_text(text);
    check(&model).map_err(refuse)?;
    Ok(model)
}

/// Converts an error to one that names the field of the model file.
fn error_in(model: &Model, error: &ParameterError) -> ModelError {
    match error {
        ParameterError::Unknown { name, parameters, effects, hint } => ModelError::value(
            model.field_of(name),
            format!("a parameter that the simulator has, one of {parameters}, or an effect, one of {effects}"),
            format!("`{name}`{hint}"),
        ),
        ParameterError::Range { name, low, high, got } => {
            ModelError::value(model.field_of(name), format!("values of {low} to {high}"), got)
        }
        ParameterError::Support { name, low, high, from, to } => {
            let beyond = if from < low { from } else { to };
            ModelError::value(model.field_of(name), format!("values of {low} to {high}"), beyond)
        }
        ParameterError::Effect { name, needs } => ModelError::value(model.field_of(name), *needs, "a model without"),
        ParameterError::Expression(e) => ModelError::text(e.field(), e),
        other => ModelError::text("parameters", other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");
    const CABLE: &str = include_str!("../../../../launch_configs/models/measured_cable.yaml");

    fn message(text: &str, old: &str, new: &str) -> String {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        read(&text.replace(old, new)).unwrap_err().to_string()
    }

    #[test]
    fn an_unknown_parameter_is_named_with_the_known_ones() {
        let e = message(SOFT_BAR, "  density_kg_m3", "  densty_kg_m3");
        assert!(
            e.starts_with("line 11, `parameters.densty_kg_m3`: expected a parameter that the simulator has, one of "),
            "{e}"
        );
        assert!(
            e.contains("density_kg_m3, ")
                && e.contains("tip_mass_kg, ")
                && e.ends_with("got `densty_kg_m3`; did you mean `density_kg_m3`?"),
            "{e}"
        );
        let e = message(SOFT_BAR, "name: youngs_modulus_pa", "name: youngs_modulus");
        assert!(
            e.starts_with("line 17, `theta.youngs_modulus`: ") && e.ends_with("did you mean `youngs_modulus_pa`?"),
            "{e}"
        );
        let e = message(SOFT_BAR, "name: table_friction", "name: friction");
        assert!(e.starts_with("line 21, `effects.friction`: "), "{e}");
    }

    #[test]
    fn values_and_priors_outside_their_range_are_named() {
        let e = message(SOFT_BAR, "poisson_ratio: 0.45", "poisson_ratio: 0.55");
        assert_eq!(e, "line 12, `parameters.poisson_ratio`: expected values of 0 to 0.5, got 0.55");
        let e = message(SOFT_BAR, "{low: 0.3, high: 0.6}", "{low: -0.3, high: 1.6}");
        assert_eq!(e, "line 21, `effects.table_friction`: expected values of 0 to 5, got -0.3");
        let e = message(CABLE, "{low: 0.02, high: 0.5}", "{low: 0.02, high: 5.0e+4}");
        assert_eq!(e, "line 16, `theta.bending_stiffness_n_m2`: expected values of 0.000000001 to 10000, got 50000");
    }

    #[test]
    fn missing_parameters_are_named() {
        let e = message(SOFT_BAR, "  density_kg_m3: 1055.0           # 47.47 g for 200 mm\n", "");
        assert_eq!(
            e,
            "line 10, `parameters`: model parameter `density_kg_m3`: expected a value, in parameters, theta or effects"
        );
        let e = message(SOFT_BAR, "  poisson_ratio: 0.45\n", "  axial_stiffness_n: 3.0\n");
        assert!(e.starts_with("line 10, `parameters`: model parameters: expected youngs_modulus_pa, or"), "{e}");
    }
}
