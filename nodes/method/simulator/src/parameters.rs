//! Physical parameters and effects that a model may name, and the episode settings that they make.

use crate::beam::{BeamError, BeamParameters, StartChange, Table, Terms};
use crate::effects::{ExpressionError, Registry, check_names, replaced};
use crate::episode_model::{ArmSettings, CameraSettings, Companions, EpisodeModel, StrandSlip, WrenchSettings};
use catenary_core::Model;
use catenary_core::spelling::did_you_mean;
use std::collections::BTreeMap;
use thiserror::Error;

/// Physical parameter of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhysicalParameter {
    /// Name with unit, as model files write it.
    pub name: &'static str,
    /// Name in a sentence.
    pub title: &'static str,
    /// Unit; 1 for a ratio or a coefficient.
    pub unit: &'static str,
    /// Meaning.
    pub description: &'static str,
    /// Value if a model does not name it; none means that it must be named, or that its absence has a meaning.
    pub default: Option<f64>,
    /// Smallest and largest sensible value.
    pub range: [f64; 2],
}

const fn parameter(
    name: &'static str,
    [title, unit]: [&'static str; 2],
    default: Option<f64>,
    range: [f64; 2],
    description: &'static str,
) -> PhysicalParameter {
    PhysicalParameter { name, title, unit, description, default, range }
}

/// All parameters that a model may fix, infer or draw.
// The ranges exclude typing errors and values at which the beam cannot be solved; they are no prior.
pub const CATALOGUE: &[PhysicalParameter] = &[
    parameter("length_m", ["length", "m"], None, [0.01, 10.0], "length at rest from the grip to the tip"),
    parameter(
        "youngs_modulus_pa",
        ["Young's modulus", "Pa"],
        None,
        // The softest gels have some ten Pa; soft bars in kPa lie below.
        [10.0, 1e12],
        "Young's modulus; gives axial, shear and bending stiffness of a solid section",
    ),
    parameter(
        "bending_stiffness_n_m2",
        ["bending stiffness", "N m^2"],
        None,
        [1e-9, 1e4],
        "bending stiffness EI, instead of Young's modulus; needs axial_stiffness_n",
    ),
    parameter("axial_stiffness_n", ["axial stiffness", "N"], None, [1e-3, 1e9], "axial stiffness EA, if EI is given"),
    parameter(
        "poisson_ratio",
        ["Poisson's ratio", "1"],
        Some(0.45),
        [0.0, 0.5],
        "Poisson's ratio, for the shear stiffness",
    ),
    // Foams begin at about 6 kg/m^3. Silicone, rubber and plastics in g/cm^3 lie below; metals in g/cm^3 do not.
    parameter("density_kg_m3", ["density", "kg/m^3"], None, [5.0, 3e4], "density"),
    parameter(
        "sticking_stiffness_n_m2",
        ["sticking stiffness", "N m^2"],
        Some(0.0),
        [0.0, 1e4],
        "bending stiffness in addition to EI while the strands of a cable stick to one another",
    ),
    parameter(
        "slip_moment_n_m",
        ["slip moment", "N m"],
        Some(0.0),
        [0.0, 1e3],
        "moment at which the strands of a cable slip: larger damps large motions more and lets small ones slip less",
    ),
    parameter(
        "slip_spread_ratio",
        ["spread of the slip", "1"],
        Some(1.0),
        [1.0, 1e4],
        "greatest over least curvature at which strands slip, one layer after the other; 1: all at once",
    ),
    parameter("creep_time_s", ["creep time", "s"], Some(2.0), [1e-2, 1e5], "time constant of creep"),
    parameter(
        "table_height_m",
        ["table height", "m"],
        None,
        [-2.0, 2.0],
        "height of the table; without it there is no table",
    ),
    parameter(
        "table_friction",
        ["table friction", "1"],
        Some(0.5),
        [0.0, 5.0],
        "Coulomb coefficient of friction on the table",
    ),
];

/// Error of a model that makes no beam.
#[derive(Debug, Error, PartialEq)]
pub enum ParameterError {
    /// Unknown name.
    #[error("model parameter `{name}`: unknown; parameters are {parameters}; effects are {effects}{hint}")]
    Unknown {
        /// The name.
        name: String,
        /// Names of the parameters.
        parameters: String,
        /// Names of the effects.
        effects: String,
        /// Suggestion of a similar name, with a leading separator; empty if none is similar.
        hint: String,
    },
    /// Value outside the sensible range.
    #[error("model parameter `{name}`: expected {low} to {high}, got {got}")]
    Range {
        /// The name.
        name: &'static str,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
        /// The value.
        got: f64,
    },
    /// Missing parameter.
    #[error("model parameter `{0}`: expected a value, in parameters, theta or effects")]
    Missing(&'static str),
    /// Stiffness given in two ways, or half of one.
    #[error("model parameters: expected youngs_modulus_pa, or bending_stiffness_n_m2 with axial_stiffness_n, got {0}")]
    Stiffness(&'static str),
    /// Prior or distribution that exceeds the sensible range.
    #[error("model parameter `{name}`: expected a distribution within {low} to {high}, got {from} to {to}")]
    Support {
        /// The name.
        name: String,
        /// Least value that makes sense.
        low: f64,
        /// Greatest value that makes sense.
        high: f64,
        /// Least value of the distribution.
        from: f64,
        /// Greatest value of the distribution.
        to: f64,
    },
    /// Strands that stick but never slip, or slip but never stick.
    #[error("model parameters: sticking_stiffness_n_m2 and slip_moment_n_m act together: expected both or neither")]
    Strands,
    /// Effect without anything to act on.
    #[error("effect `{name}`: expected {needs}")]
    Effect {
        /// Name of the effect.
        name: &'static str,
        /// Model that it needs, and what came instead.
        needs: &'static str,
    },
    /// Effect that another one has replaced.
    #[error("effect `{name}`: it is no more: expected {by}")]
    Replaced {
        /// Former name.
        name: &'static str,
        /// Names and meaning of what replaced it.
        by: &'static str,
    },
    /// Effect of the model file whose expressions cannot be read.
    #[error(transparent)]
    Expression(#[from] ExpressionError),
    /// Combination that the beam refuses.
    #[error(transparent)]
    Beam(#[from] BeamError),
}

/// Values of parameters and effects by name.
#[derive(Debug, Clone)]
pub struct Values<'r> {
    registry: &'r Registry,
    given: BTreeMap<&'static str, f64>,
}

/// Returns name and range of a parameter or an effect.
pub(crate) fn known(registry: &Registry, name: &str) -> Result<(&'static str, [f64; 2]), ParameterError> {
    let parameter = CATALOGUE.iter().find(|p| p.name == name).map(|p| (p.name, p.range));
    let effect = || registry.find(name).map(|e| (e.about().name, e.about().range));
    parameter.or_else(effect).ok_or_else(|| {
        if let Some((name, by)) = replaced(name) {
            return ParameterError::Replaced { name, by };
        }
        let parameters: Vec<&str> = CATALOGUE.iter().map(|p| p.name).collect();
        let effects: Vec<&str> = registry.effects().map(|e| e.about().name).collect();
        ParameterError::Unknown {
            name: name.to_owned(),
            hint: did_you_mean(name, parameters.iter().chain(&effects).copied()),
            parameters: parameters.join(", "),
            effects: effects.join(", "),
        }
    })
}

/// Returns the smallest and largest sensible value of a parameter or of an effect of `registry`.
///
/// # Errors
/// [`ParameterError::Unknown`].
pub fn range_of(registry: &Registry, name: &str) -> Result<[f64; 2], ParameterError> {
    known(registry, name).map(|(_, range)| range)
}

impl<'r> Values<'r> {
    /// Resolves the model's fixed values, then `theta` in the model's order, then further values by name. Later values
    /// override earlier ones.
    pub fn resolve<'a>(
        registry: &'r Registry,
        model: &Model,
        theta: &[f64],
        further: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> Result<Self, ParameterError> {
        let mut values = Self { registry, given: BTreeMap::new() };
        for (name, value) in &model.parameters {
            values.set(name, *value)?;
        }
        for (p, value) in model.theta.parameters().iter().zip(theta) {
            values.set(&p.name, *value)?;
        }
        for (name, value) in further {
            values.set(name, value)?;
        }
        Ok(values)
    }

    /// Resolves the medians of theta's priors and of the effects' distributions.
    pub fn middle(registry: &'r Registry, model: &Model) -> Result<Self, ParameterError> {
        let theta: Vec<f64> = model.theta.parameters().iter().map(|p| p.prior.from_unit(0.5)).collect();
        let effects = model.effects.iter().map(|e| (e.name.as_str(), e.distribution.from_unit(0.5)));
        Self::resolve(registry, model, &theta, effects)
    }

    fn set(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        let (name, [low, high]) = known(self.registry, name)?;
        if !(low..=high).contains(&value) {
            return Err(ParameterError::Range { name, low, high, got: value });
        }
        self.given.insert(name, value);
        Ok(())
    }

    /// Returns the given value of a parameter, or its default.
    fn get(&self, name: &'static str) -> Option<f64> {
        let default = || CATALOGUE.iter().find(|p| p.name == name).and_then(|p| p.default);
        self.given.get(name).copied().or_else(default)
    }

    /// Returns the value of a parameter or of an effect; an absent effect has [`crate::effects::Effect::if_absent`]. None if
    /// nothing gives a value.
    pub fn value(&self, name: &str) -> Option<f64> {
        let (name, _) = known(self.registry, name).ok()?;
        self.get(name).or_else(|| self.registry.find(name).map(|effect| effect.if_absent()))
    }

    fn need(&self, name: &'static str) -> Result<f64, ParameterError> {
        self.get(name).ok_or(ParameterError::Missing(name))
    }

    /// Makes the episode settings of the model: the base, then the effects in the registry's order.
    pub fn episode_model(&self, model: &Model) -> Result<EpisodeModel, ParameterError> {
        let mut episode_model = EpisodeModel {
            beam: self.beam(model)?,
            terms: Terms::default(),
            start: StartChange::default(),
            grip_angle_rad: model.object.grip_angle_rad,
            arm: ArmSettings::new(model.arm.law, model.delta_anchor()),
            camera: CameraSettings::new(model.camera.view, model.camera.keypoint_noise_px),
            wrench: model.observation.wrench.map(|noise| WrenchSettings::new(noise.sds())),
            strand_slip: StrandSlip::default(),
            rest_bend_place: Companions::default().place,
            expression_numbers: BTreeMap::new(),
            templates: Companions::default(),
            unlisted: Companions::default(),
        };
        for effect in self.registry.effects() {
            let name = effect.about().name;
            if let Some(magnitude) = self.given.get(name) {
                effect.apply(*magnitude, &mut episode_model).map_err(|needs| ParameterError::Effect { name, needs })?;
            }
        }
        episode_model.beam.check()?;
        Ok(episode_model)
    }

    /// Makes the beam without effects.
    fn beam(&self, model: &Model) -> Result<BeamParameters, ParameterError> {
        let object = &model.object;
        let length_m = self.need("length_m")?;
        let (density, poisson) = (self.need("density_kg_m3")?, self.need("poisson_ratio")?);
        let stiffness =
            (self.get("youngs_modulus_pa"), self.get("bending_stiffness_n_m2"), self.get("axial_stiffness_n"));
        let base = match stiffness {
            (Some(e), None, None) => BeamParameters::from_youngs_modulus(length_m, object.section, density, e, poisson),
            (None, Some(ei), Some(ea)) => {
                BeamParameters::from_bending_stiffness(length_m, object.section, density, ei, ea, poisson)
            }
            (None, None, None) => return Err(ParameterError::Stiffness("neither")),
            (Some(_), _, _) => return Err(ParameterError::Stiffness("both")),
            (None, _, _) => return Err(ParameterError::Stiffness("one of the two")),
        };
        let strands = [self.need("sticking_stiffness_n_m2")?, self.need("slip_moment_n_m")?];
        // Stiffness without a slip moment never slips, and a slip moment without stiffness never acts.
        if (strands[0] > 0.0) != (strands[1] > 0.0) {
            return Err(ParameterError::Strands);
        }
        Ok(BeamParameters {
            axial_law: object.axial_law,
            sticking_stiffness_n_m2: strands[0],
            slip_moment_n_m: strands[1],
            slip_spread_ratio: self.need("slip_spread_ratio")?,
            creep_time_s: self.need("creep_time_s")?,
            table: self.get("table_height_m").map(|h| Table::new(h, self.get("table_friction").unwrap_or_default())),
            ..base
        })
    }
}

/// Checks that a model names existing parameters and effects, that their distributions lie within the sensible ranges,
/// and that their medians make an object.
///
/// # Errors
/// [`ParameterError`] of the first problem.
pub fn check(model: &Model) -> Result<(), ParameterError> {
    check_with(model, Registry::shipped())
}

/// Checks as [`check`] does, with the effects of another registry.
///
/// # Errors
/// [`ParameterError`] of the first problem.
pub fn check_with(model: &Model, registry: &Registry) -> Result<(), ParameterError> {
    check_names(&model.expressions, |name| CATALOGUE.iter().any(|p| p.name == name))?;
    let registry = &registry.with_expressions(model)?;
    let theta = model.theta.parameters().iter().map(|p| (&p.name, &p.prior));
    for (name, prior) in theta.chain(model.effects.iter().map(|e| (&e.name, &e.distribution))) {
        let (_, [low, high]) = known(registry, name)?;
        let (from, to) = prior.bounds();
        if from < low || to > high {
            return Err(ParameterError::Support { name: name.clone(), low, high, from, to });
        }
    }
    Values::middle(registry, model)?.episode_model(model).map(|_| ())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub fn soft_bar() -> Model {
        Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    pub fn cable() -> Model {
        Model::from_yaml(include_str!("../../../../launch_configs/models/measured_cable.yaml")).unwrap()
    }

    #[test]
    fn shipped_models_make_beams() {
        assert_eq!(check(&soft_bar()), Ok(()));
        assert_eq!(check(&cable()), Ok(()));
        let values =
            Values::resolve(Registry::shipped(), &cable(), &[0.1, 0.02, 1.5, 0.5, 0.05, 1.0, 0.0], []).unwrap();
        let beam = values.episode_model(&cable()).unwrap().beam;
        assert_eq!(
            (beam.bending_stiffness_n_m2, beam.kelvin_voigt_time_s, beam.rest_curvature_per_m),
            (0.1, 0.02, 1.5)
        );
        assert!((beam.mass_kg() - 0.45).abs() < 1e-3, "{}", beam.mass_kg());
    }

    #[test]
    fn mistakes_name_the_parameter() {
        let model = soft_bar();
        let values = |name, value| Values::resolve(Registry::shipped(), &model, &[0.25, 1e4], [(name, value)]);
        assert!(values("youngs_modulus", 1.0).unwrap_err().to_string().contains("`youngs_modulus`: unknown"));
        assert!(values("table_friction", -1.0).unwrap_err().to_string().contains("table_friction"));
        assert!(values("length_m", f64::NAN).is_err());
        let both = values("bending_stiffness_n_m2", 0.1).unwrap().episode_model(&model);
        assert_eq!(both.err(), Some(ParameterError::Stiffness("both")));
        let strands = values("sticking_stiffness_n_m2", 0.1).unwrap().episode_model(&model);
        assert_eq!(strands.err(), Some(ParameterError::Strands));
        let no_table = Values::resolve(
            Registry::shipped(),
            &cable(),
            &[0.1, 0.02, 1.5, 0.5, 0.05, 1.0, 0.0],
            [("table_height_change_m", 0.01)],
        );
        let error = no_table.unwrap().episode_model(&cable()).unwrap_err().to_string();
        assert!(error.contains("table_height_change_m") && error.contains("table_height_m"), "{error}");
        let mut wide = model.clone();
        wide.effects[0].distribution = catenary_core::Prior::Uniform { low: -0.1, high: 0.1 };
        assert!(check(&wide).unwrap_err().to_string().contains("-0.1 to 0.1"));
        let mut short = model.clone();
        short.parameters.remove("density_kg_m3");
        assert_eq!(check(&short), Err(ParameterError::Missing("density_kg_m3")));
    }
}
