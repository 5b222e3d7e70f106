//! Titles and units of parameters and effects, from the simulator's catalogue and its registry of effects.

use super::number;
use catenary_core::{Model, Prior};
use catenary_simulator::Registry;
use catenary_simulator::parameters::CATALOGUE;
use std::collections::BTreeMap;
use std::sync::{PoisonError, RwLock};

/// Titles and units of effects that model files state, by name.
static STATED: RwLock<BTreeMap<String, Quantity>> = RwLock::new(BTreeMap::new());

/// Title and unit of a parameter or an effect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Quantity {
    /// Title within a sentence.
    pub title: String,
    /// Unit of the values in files; "1" for a dimensionless quantity.
    unit: String,
}

/// Unit of displayed values.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    /// Factor from the unit of files to this unit.
    pub factor: f64,
    /// Symbol of the unit; empty for a dimensionless quantity.
    pub unit: String,
}

/// Text with a capital first letter.
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Text with the title of a parameter in place of its name, if it begins with that, as warnings about a parameter do.
pub fn titled(text: &str) -> String {
    let Some((name, rest)) = text.split_once(": ") else { return text.to_owned() };
    match stated(name).is_some()
        || CATALOGUE.iter().any(|p| p.name == name)
        || Registry::complete().find(name).is_some()
    {
        true => format!("{}: {rest}", Quantity::of(name).title),
        false => text.to_owned(),
    }
}

/// Learns titles and units of the effects that `model` states as expressions, for everything that this process prints.
pub fn learn_stated(model: &Model) {
    let mut stated = STATED.write().unwrap_or_else(PoisonError::into_inner);
    for effect in &model.expressions {
        let own = (&effect.name, effect.title.as_ref().unwrap_or(&effect.name), &effect.unit);
        let companions = effect.companions.iter().map(|c| (&c.name, &c.name, &c.unit));
        for (name, title, unit) in std::iter::once(own).chain(companions) {
            stated.insert(name.clone(), Quantity { title: title.clone(), unit: unit.clone() });
        }
    }
}

/// Quantity of an effect that a model of this process states.
fn stated(name: &str) -> Option<Quantity> {
    STATED.read().unwrap_or_else(PoisonError::into_inner).get(name).cloned()
}

impl Quantity {
    /// Quantity called `name` in model files. An unknown name is its own title.
    pub fn of(name: &str) -> Self {
        if let Some(stated) = stated(name) {
            return stated;
        }
        let parameter = CATALOGUE.iter().find(|p| p.name == name).map(|p| (p.title, p.unit));
        let effect = || Registry::complete().find(name).map(|e| (e.about().title, e.about().unit));
        let (title, unit) = parameter.or_else(effect).unwrap_or((name, "1"));
        // An effect that changes a parameter of the model has the parameter's title in the registry.
        let is_change = name.ends_with("_change") || name.contains("_change_");
        let title = if is_change { format!("change of {title}") } else { title.to_owned() };
        Self { title, unit: unit.to_owned() }
    }

    /// Title at the beginning of a sentence.
    pub fn capital(&self) -> String {
        capital(&self.title)
    }

    /// Unit in which values up to `largest` have few digits.
    pub fn scale(&self, largest: f64) -> Scale {
        let size = largest.abs();
        let (factor, unit) = match self.unit.as_str() {
            "1" => (1.0, ""),
            "m" if size < 1.0 => (1e3, "mm"),
            "m/s" if size < 0.1 => (1e3, "mm/s"),
            "kg" if size < 0.1 => (1e3, "g"),
            "s" if size < 1.0 => (1e3, "ms"),
            "Pa" if size >= 1e9 => (1e-9, "GPa"),
            "Pa" if size >= 1e6 => (1e-6, "MPa"),
            "Pa" if size >= 1e3 => (1e-3, "kPa"),
            "rad" => (180.0 / std::f64::consts::PI, "°"),
            other => (1.0, other),
        };
        Scale { factor, unit: unit.replace("^2", "²").replace("^3", "³") }
    }

    /// Value with its interval and unit: "261 mm (254 to 267)".
    pub fn estimate(&self, value: f64, low: f64, high: f64) -> String {
        let scale = self.scale(value.abs().max(0.5 * (low.abs() + high.abs())));
        let [value, low, high] = [value, low, high].map(|v| v * scale.factor);
        let width = high - low;
        let [value, low, high] = [value, low, high].map(|v| number::rounded(v, width));
        format!("{} ({low} to {high})", scale.with_unit(&value))
    }

    /// Value with its standard deviation and unit: "0.23 ± 0.06 kg".
    pub fn spread(&self, value: f64, sd: f64) -> String {
        let scale = self.scale(value.abs().max(sd.abs()));
        let [value, sd] = [value, sd].map(|v| v * scale.factor);
        scale.with_unit(&format!("{} ± {}", number::rounded(value, sd), number::rounded(sd, sd)))
    }

    /// Value with its unit, to a relative precision of a few percent.
    pub fn value(&self, value: f64) -> String {
        self.value_within(value, 0.5 * value.abs())
    }

    /// Value with its unit, to at most three significant digits.
    pub fn brief(&self, value: f64) -> String {
        let scale = self.scale(value);
        scale.with_unit(&number::significant(value * scale.factor, 3))
    }

    /// Value with its unit, to two digits of `width`.
    pub fn value_within(&self, value: f64, width: f64) -> String {
        let scale = self.scale(value);
        scale.with_unit(&number::rounded(value * scale.factor, width * scale.factor))
    }

    /// Prior in words: its support and its kind.
    pub fn prior(&self, prior: &Prior) -> String {
        let (low, high) = prior.bounds();
        let scale = self.scale(low.abs().max(high.abs()));
        let range = |low: f64, high: f64| {
            let digits = |v: f64| number::significant(v * scale.factor, 3);
            scale.with_unit(&format!("{} to {}", digits(low), digits(high)))
        };
        match prior {
            Prior::Uniform { .. } => range(low, high),
            Prior::LogUniform { .. } => format!("{} (logarithmic)", range(low, high)),
            Prior::Normal { mean, sd, .. } => {
                let digits = |v: f64| number::significant(v * scale.factor, 3);
                format!("{} ± {}, {}", digits(*mean), digits(*sd), range(low, high))
            }
            Prior::Mixture(parts) => format!("{}, {} parts", range(low, high), parts.len()),
        }
    }

    /// Title and unit of an axis: "length, mm".
    pub fn axis(&self, scale: &Scale) -> String {
        if scale.unit.is_empty() { self.title.clone() } else { format!("{}, {}", self.title, scale.unit) }
    }
}

impl Scale {
    /// Number followed by the unit.
    pub fn with_unit(&self, number: &str) -> String {
        match self.unit.as_str() {
            "" => number.to_owned(),
            "°" => format!("{number}°"),
            unit => format!("{number} {unit}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_and_effect_has_a_title_without_its_unit() {
        let names = CATALOGUE.iter().map(|p| p.name).chain(Registry::shipped().effects().map(|e| e.about().name));
        for name in names {
            let title = Quantity::of(name).title;
            assert!(!title.is_empty() && !title.contains('_'), "{name}: {title}");
        }
        assert_eq!(Quantity::of("gremlins_per_m").title, "gremlins_per_m");
    }

    #[test]
    fn an_effect_that_a_model_states_has_its_title_and_unit() {
        let stated = "expressions:
  - {name: fence_n_m2, title: fence, unit: N/m^2, force_x_n_m: '-max(0, x - fence_x_m)', prior: {uniform: {low: 0, high: 9}},
     companions: [{name: fence_x_m, unit: m, prior: {uniform: {low: 0, high: 1}}}]}
";
        let model = Model::from_yaml(&format!("{}{stated}", crate::inputs::model_file::SOFT_BAR)).unwrap();
        learn_stated(&model);
        assert_eq!(Quantity::of("fence_n_m2").value(3.0), "3.0 N/m²");
        assert_eq!([Quantity::of("fence_n_m2").title, Quantity::of("fence_x_m").brief(0.05)], ["fence", "50 mm"]);
    }

    #[test]
    fn values_have_units_that_are_easy_to_read() {
        assert_eq!(Quantity::of("length_m").estimate(0.2607, 0.2542, 0.2671), "261 mm (254 to 267)");
        assert_eq!(Quantity::of("youngs_modulus_pa").estimate(12_345.0, 10_200.0, 15_100.0), "12.3 kPa (10.2 to 15.1)");
        assert_eq!(Quantity::of("tip_mass_kg").estimate(0.2271, 0.161, 0.292), "0.23 kg (0.16 to 0.29)");
        assert_eq!(Quantity::of("length_m").brief(0.2624), "262 mm");
        assert_eq!(Quantity::of("youngs_modulus_pa").brief(13_240.0), "13.2 kPa");
        assert_eq!(Quantity::of("poisson_ratio").brief(0.45), "0.45");
        assert_eq!(Quantity::of("tip_mass_kg").value(0.00601), "6.0 g");
        assert_eq!(Quantity::of("camera_tilt_rad").value(0.0360), "2.1°");
        assert_eq!(Quantity::of("quadratic_drag_n_s2_m3").value(0.31), "0.31 N s²/m³");
        let prior = Prior::LogUniform { low: 1e3, high: 5e4 };
        assert_eq!(Quantity::of("youngs_modulus_pa").prior(&prior), "1 to 50 kPa (logarithmic)");
    }
}
