//! The physical parameters that a model may name, and the beam that they make.

use crate::beam::{BeamError, BeamParameters, Table};
use catenary_core::Model;
use std::collections::BTreeMap;
use thiserror::Error;

/// A physical parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhysicalParameter {
    /// Name with unit, as model files write it.
    pub name: &'static str,
    /// What it does.
    pub description: &'static str,
    /// Value where a model does not name it; none: it must be named, or its absence means something.
    pub default: Option<f64>,
    /// Least and greatest value that makes sense.
    pub range: [f64; 2],
}

const fn parameter(
    name: &'static str,
    default: Option<f64>,
    range: [f64; 2],
    description: &'static str,
) -> PhysicalParameter {
    PhysicalParameter { name, description, default, range }
}

/// Every parameter that a model may fix, infer or draw.
pub const CATALOGUE: &[PhysicalParameter] = &[
    parameter("length_m", None, [0.01, 10.0], "length at rest from the grip to the tip"),
    parameter(
        "youngs_modulus_pa",
        None,
        [1.0, 1e12],
        "Young's modulus; gives axial, shear and bending stiffness of a solid section",
    ),
    parameter(
        "bending_stiffness_n_m2",
        None,
        [1e-9, 1e4],
        "bending stiffness EI, instead of Young's modulus; needs axial_stiffness_n",
    ),
    parameter("axial_stiffness_n", None, [1e-3, 1e9], "axial stiffness EA, where EI is given"),
    parameter("poisson_ratio", Some(0.45), [0.0, 0.5], "Poisson's ratio, for the shear stiffness"),
    parameter("density_kg_m3", None, [1.0, 1e5], "density"),
    parameter(
        "kelvin_voigt_time_s",
        Some(0.0),
        [0.0, 10.0],
        "Kelvin-Voigt retardation time: larger damps bending and stretching more",
    ),
    parameter(
        "sticking_stiffness_n_m2",
        Some(0.0),
        [0.0, 1e4],
        "bending stiffness beside EI while the strands of a cable stick to one another",
    ),
    parameter(
        "slip_moment_n_m",
        Some(0.0),
        [0.0, 1e3],
        "moment at which the strands of a cable slip: larger damps large motions more and lets small ones slip less",
    ),
    parameter("linear_drag_n_s_m2", Some(0.0), [0.0, 1e3], "linear air drag, force per length and speed"),
    parameter("quadratic_drag_n_s2_m3", Some(0.0), [0.0, 1e3], "quadratic air drag across the centre line"),
    parameter(
        "rest_curvature_per_m",
        Some(0.0),
        [-100.0, 100.0],
        "curvature of the unloaded centre line, counter-clockwise",
    ),
    parameter("tip_mass_kg", Some(0.0), [0.0, 100.0], "point mass at the tip"),
    parameter("overhang_m", Some(0.0), [0.0, 1.0], "length that sticks out behind the grip"),
    parameter(
        "grip_angle_offset_rad",
        Some(0.0),
        [-1.6, 1.6],
        "angle by which the object is held askew, counter-clockwise",
    ),
    parameter(
        "gravity_tilt_rad",
        Some(0.0),
        [-0.5, 0.5],
        "tilt of the whole set-up: gravity turns counter-clockwise by it",
    ),
    parameter("table_height_m", None, [-10.0, 10.0], "height of the table; without it there is no table"),
    parameter("table_friction", Some(0.5), [0.0, 5.0], "Coulomb coefficient of friction on the table"),
];

/// Why a model makes no beam.
#[derive(Debug, Error, PartialEq)]
pub enum ParameterError {
    /// A name that nothing reads.
    #[error("model parameter `{name}`: unknown; known are {known}")]
    Unknown {
        /// The name.
        name: String,
        /// All names.
        known: String,
    },
    /// A value outside the range that makes sense.
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
    /// A parameter that must be named.
    #[error("model parameter `{0}`: expected a value, in parameters, theta or effects")]
    Missing(&'static str),
    /// Two ways of saying the stiffness, or half of one.
    #[error("model parameters: expected youngs_modulus_pa, or bending_stiffness_n_m2 with axial_stiffness_n, got {0}")]
    Stiffness(&'static str),
    /// A combination that the beam refuses.
    #[error(transparent)]
    Beam(#[from] BeamError),
}

/// Values of physical parameters by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Values(BTreeMap<&'static str, f64>);

impl Values {
    /// The model's fixed values, then `theta` in the model's order, then further values by name, which win.
    pub fn resolve<'a>(
        model: &Model,
        theta: &[f64],
        further: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> Result<Self, ParameterError> {
        let mut values = Self::default();
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

    fn set(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        let known = CATALOGUE.iter().find(|p| p.name == name).ok_or_else(|| ParameterError::Unknown {
            name: name.to_owned(),
            known: CATALOGUE.iter().map(|p| p.name).collect::<Vec<_>>().join(", "),
        })?;
        let [low, high] = known.range;
        if !(low..=high).contains(&value) {
            return Err(ParameterError::Range { name: known.name, low, high, got: value });
        }
        self.0.insert(known.name, value);
        Ok(())
    }

    /// The value of a parameter: given, or its default.
    pub fn get(&self, name: &'static str) -> Option<f64> {
        let default = || CATALOGUE.iter().find(|p| p.name == name).and_then(|p| p.default);
        self.0.get(name).copied().or_else(default)
    }

    fn need(&self, name: &'static str) -> Result<f64, ParameterError> {
        self.get(name).ok_or(ParameterError::Missing(name))
    }

    /// The beam that the values make of the model's object.
    pub fn beam(&self, model: &Model) -> Result<BeamParameters, ParameterError> {
        let object = &model.object;
        let overhang_m = self.need("overhang_m")?;
        let length_m = self.need("length_m")? + overhang_m;
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
        let tilt = self.need("gravity_tilt_rad")?;
        let gravity = base.gravity_m_s2[1];
        let beam = BeamParameters {
            axial_law: object.axial_law,
            kelvin_voigt_time_s: self.need("kelvin_voigt_time_s")?,
            sticking_stiffness_n_m2: self.need("sticking_stiffness_n_m2")?,
            slip_moment_n_m: self.need("slip_moment_n_m")?,
            linear_drag_n_s_m2: self.need("linear_drag_n_s_m2")?,
            quadratic_drag_n_s2_m3: self.need("quadratic_drag_n_s2_m3")?,
            rest_curvature_per_m: self.need("rest_curvature_per_m")?,
            tip_mass_kg: self.need("tip_mass_kg")?,
            gravity_m_s2: [-gravity * tilt.sin(), gravity * tilt.cos()],
            overhang_m,
            table: self.get("table_height_m").map(|h| Table::new(h, self.get("table_friction").unwrap_or_default())),
            ..base
        };
        beam.check()?;
        Ok(beam)
    }

    /// Angle in rad of the clamped tangent at pitch 0.
    pub fn grip_angle_rad(&self, model: &Model) -> f64 {
        model.object.grip_angle_rad + self.get("grip_angle_offset_rad").unwrap_or_default()
    }
}

/// Checks that a model names parameters that exist and make a beam, with theta and effects at the middle of their ranges.
pub fn check(model: &Model) -> Result<(), ParameterError> {
    let middle: Vec<f64> = model.theta.parameters().iter().map(|p| p.prior.from_unit(0.5)).collect();
    let effects = model.effects.iter().map(|e| (e.name.as_str(), e.distribution.from_unit(0.5)));
    Values::resolve(model, &middle, effects)?.beam(model).map(|_| ())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub fn soft_bar() -> Model {
        Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    pub fn cable() -> Model {
        Model::from_yaml(include_str!("../../../launch_configs/models/measured_cable.yaml")).unwrap()
    }

    #[test]
    fn shipped_models_make_beams() {
        assert_eq!(check(&soft_bar()), Ok(()));
        assert_eq!(check(&cable()), Ok(()));
        let values = Values::resolve(&cable(), &[0.1, 0.02, 1.5, 0.5, 0.05], []).unwrap();
        let beam = values.beam(&cable()).unwrap();
        assert_eq!(
            (beam.bending_stiffness_n_m2, beam.kelvin_voigt_time_s, beam.rest_curvature_per_m),
            (0.1, 0.02, 1.5)
        );
        assert!((beam.mass_kg() - 0.45).abs() < 1e-3, "{}", beam.mass_kg());
    }

    #[test]
    fn mistakes_name_the_parameter() {
        let model = soft_bar();
        let values = |name, value| Values::resolve(&model, &[0.25, 1e4], [(name, value)]);
        assert!(values("youngs_modulus", 1.0).unwrap_err().to_string().contains("`youngs_modulus`: unknown"));
        assert!(values("table_friction", -1.0).unwrap_err().to_string().contains("table_friction"));
        assert!(values("length_m", f64::NAN).is_err());
        let both = values("bending_stiffness_n_m2", 0.1).unwrap().beam(&model);
        assert_eq!(both, Err(ParameterError::Stiffness("both")));
        let mut short = model.clone();
        short.parameters.remove("density_kg_m3");
        assert_eq!(check(&short), Err(ParameterError::Missing("density_kg_m3")));
    }
}
