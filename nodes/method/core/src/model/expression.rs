//! Effects that a model file states as expressions.

use super::error::ModelError;
use crate::Prior;
use serde::{Deserialize, Serialize};

/// Effect that a model file states as an expression of place, time and motion. Inference, the effect finder and the simulator
/// treat it as one of the library: its magnitude multiplies the expression, and is zero where nothing gives a value.
///
/// One or more of the expressions are given. Variables: `s`, the place as a fraction of the length from the grip; `t`, the time
/// since the start in s; and those of the field. The simulator reads the text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expression {
    /// Name with the unit of the magnitude, as the rest of the file writes it.
    pub name: String,
    /// Name in sentences; none: the name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Unit of the magnitude; "1" for a coefficient.
    #[serde(default = "one")]
    pub unit: String,
    /// Force along x per length in N/m, of `s`, `t`, `x`, `z` (m), `vx`, `vz`, `speed` (m/s) and `angle` (rad from +x,
    /// counter-clockwise).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_x_n_m: Option<String>,
    /// Force along z per length in N/m, of the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_z_n_m: Option<String>,
    /// Couple per length in N m/m, counter-clockwise, of the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub couple_n_m_m: Option<String>,
    /// Bending moment in N m that resists a growing curvature, of `s`, `t`, `curvature` (1/m, less that of rest) and
    /// `curvature_rate` (1/(m s)).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment_n_m: Option<String>,
    /// Prior of the magnitude, given that the effect is present.
    pub prior: Prior,
    /// Further numbers that the expressions name, such as a frequency or a place. They do nothing without the magnitude.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub companions: Vec<Companion>,
}

/// Number that the expressions of an effect name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Companion {
    /// Name with unit.
    pub name: String,
    /// Unit; "1" for a ratio.
    #[serde(default = "one")]
    pub unit: String,
    /// Prior. Its median stands where nothing gives a value.
    pub prior: Prior,
}

fn one() -> String {
    "1".to_owned()
}

impl Expression {
    /// Returns the expressions with the names of their fields.
    pub fn texts(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let fields = [
            ("force_x_n_m", &self.force_x_n_m),
            ("force_z_n_m", &self.force_z_n_m),
            ("couple_n_m_m", &self.couple_n_m_m),
            ("moment_n_m", &self.moment_n_m),
        ];
        fields.into_iter().filter_map(|(field, text)| Some((field, text.as_deref()?)))
    }
}

/// Checks a model's expressions as far as their texts need not be read.
pub(super) fn check(expressions: &[Expression]) -> Result<(), ModelError> {
    let mut seen: Vec<&str> = Vec::new();
    for effect in expressions {
        let path = format!("expressions.{}", effect.name);
        if effect.texts().next().is_none() {
            let expected = "an expression: force_x_n_m, force_z_n_m, couple_n_m_m or moment_n_m";
            return Err(ModelError::value(path, expected, "none"));
        }
        let companions = effect.companions.iter().map(|c| (format!("{path}.companions.{}", c.name), &c.name, &c.prior));
        for (path, name, prior) in [(path.clone(), &effect.name, &effect.prior)].into_iter().chain(companions) {
            if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                let expected = "a name of letters, digits and underscores";
                return Err(ModelError::value(path, expected, format!("`{name}`")));
            }
            if seen.contains(&name.as_str()) {
                return Err(ModelError::value(path, "each name once among expressions", format!("`{name}` once more")));
            }
            seen.push(name);
            prior.check().map_err(|what| ModelError::text(format!("{path}.prior"), what))?;
        }
    }
    Ok(())
}
