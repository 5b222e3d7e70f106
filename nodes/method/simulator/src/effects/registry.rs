//! Registry of effects.

use super::effect::Effect;
use super::expression::ExpressionError;
use super::{
    arm_delay, arm_lag, arm_standing_error, axial_law, axial_stiffness, camera_offset_x, camera_offset_z, camera_scale,
    camera_tilt, creep, delta_anchor, density, dropped_frames, exposure, expression, frame_delay, gravity_tilt,
    grip_angle, grip_compliance, grip_slip, kelvin_voigt, keypoint_bias, keypoint_noise, lens_distortion, linear_drag,
    overhang, quadratic_drag, rest_bend, rest_curvature, rest_curvature_gradient, rolling_shutter, start_offset,
    start_velocity, stiffness_gradient, strand_friction, table_adhesion, table_friction, table_height, templates,
    tip_load, tip_mass, unlisted, wrench_bias, wrench_delay,
};
use catenary_core::Model;
use catenary_core::model::Expression;
use std::sync::{Arc, LazyLock};

/// Former effects, with what replaced them. Their names stay refused, so that no old file is read with another meaning.
const REPLACED: [(&str, &str); 1] = [(
    "strand_friction",
    "strand_friction_rad with its companions strand_slip_turn_rad and strand_slip_spread, another law whose numbers must be found anew",
)];

/// Returns the former name as an effect that is no more, with the names and the meaning of what replaced it.
pub fn replaced(name: &str) -> Option<(&'static str, &'static str)> {
    REPLACED.into_iter().find(|(former, _)| *former == name)
}

/// Ordered list of effects with unique names.
#[derive(Clone)]
pub struct Registry {
    effects: Vec<Arc<dyn Effect>>,
    /// Expressions whose effects are in the list.
    expressions: Vec<Expression>,
}

impl Registry {
    /// Returns the effects of this crate that searches offer, with their companions.
    pub fn shipped() -> &'static Registry {
        static SHIPPED: LazyLock<Registry> = LazyLock::new(|| {
            let [bias_x, bias_z, bias_y] = wrench_bias::WrenchBias::all();
            let effects: Vec<Arc<dyn Effect>> = vec![
                // material
                Arc::new(kelvin_voigt::KelvinVoigt),
                Arc::new(creep::Creep),
                Arc::new(rest_curvature::RestCurvature),
                Arc::new(rest_curvature_gradient::RestCurvatureGradient),
                Arc::new(rest_bend::place()),
                Arc::new(rest_bend::RestBend),
                Arc::new(stiffness_gradient::StiffnessGradient),
                Arc::new(strand_friction::slip_turn()),
                Arc::new(strand_friction::slip_spread()),
                Arc::new(strand_friction::StrandFriction),
                Arc::new(axial_law::AxialLawChange),
                Arc::new(axial_stiffness::AxialStiffness),
                Arc::new(density::Density),
                // forces
                Arc::new(tip_mass::TipMass),
                Arc::new(tip_load::offset()),
                Arc::new(tip_load::gyration_radius()),
                Arc::new(tip_load::TipLoad),
                Arc::new(linear_drag::LinearDrag),
                Arc::new(quadratic_drag::QuadraticDrag),
                Arc::new(gravity_tilt::GravityTilt),
                Arc::new(table_friction::TableFriction),
                Arc::new(table_adhesion::TableAdhesion),
                Arc::new(table_height::TableHeight),
                // boundary
                Arc::new(grip_angle::GripAngle),
                Arc::new(grip_compliance::GripCompliance),
                Arc::new(grip_slip::GripSlip),
                Arc::new(overhang::Overhang),
                Arc::new(start_offset::StartOffset),
                Arc::new(start_velocity::StartVelocity),
                // actuation
                Arc::new(arm_delay::ArmDelay),
                Arc::new(arm_lag::ArmLag),
                Arc::new(arm_standing_error::ArmStandingError),
                Arc::new(delta_anchor::DeltaAnchorChange),
                // observation
                Arc::new(camera_offset_x::CameraOffsetX),
                Arc::new(camera_offset_z::CameraOffsetZ),
                Arc::new(camera_tilt::CameraTilt),
                Arc::new(camera_scale::CameraScale),
                Arc::new(lens_distortion::LensDistortion),
                Arc::new(frame_delay::FrameDelay),
                Arc::new(exposure::Exposure),
                Arc::new(rolling_shutter::RollingShutter),
                Arc::new(dropped_frames::DroppedFrames),
                Arc::new(keypoint_bias::KeypointBias),
                Arc::new(keypoint_noise::KeypointNoise),
                Arc::new(bias_x),
                Arc::new(bias_z),
                Arc::new(bias_y),
                Arc::new(wrench_delay::WrenchDelay),
            ];
            Registry { effects, expressions: Vec::new() }
        });
        &SHIPPED
    }

    /// Returns the effects that searches offer, and the templates of what may be missing beside them.
    pub fn with_templates() -> Registry {
        Self::shipped().with_all(templates::all())
    }

    /// Returns the templates in this list, without their companions.
    pub fn templates(&self) -> impl Iterator<Item = &dyn Effect> {
        self.effects().filter(|effect| templates::is_template(effect.about().name))
    }

    /// Returns the effects that searches offer, and the unlisted ones of blind tests.
    pub fn with_unlisted() -> Registry {
        Self::shipped().with_all(unlisted::all())
    }

    /// Returns all effects of this crate, which simulations may have: with templates and unlisted effects.
    pub fn complete() -> Registry {
        Self::with_templates().with_all(unlisted::all())
    }

    fn with_all(&self, more: Vec<Arc<dyn Effect>>) -> Registry {
        more.into_iter().fold(self.clone(), |registry, effect| registry.with(effect))
    }

    /// Returns this list with the effects that a model file states as expressions.
    ///
    /// # Errors
    /// [`ExpressionError`] of the first expression that makes no effect.
    pub fn with_expressions(&self, model: &Model) -> Result<Registry, ExpressionError> {
        // A list that has them already stays.
        if self.expressions == model.expressions {
            return Ok(self.clone());
        }
        let mut effects = self.effects.clone();
        // A simulation may have templates and unlisted effects beside those that a search offers.
        let every = Self::complete();
        effects.extend(expression::all(&model.expressions, |name| {
            self.find(name).is_some() || every.find(name).is_some()
        })?);
        Ok(Registry { effects, expressions: model.expressions.clone() })
    }

    /// Returns this list with one more effect.
    ///
    /// # Panics
    /// Panics if the name is taken.
    pub fn with(&self, effect: Arc<dyn Effect>) -> Registry {
        let name = effect.about().name;
        assert!(self.find(name).is_none(), "effect `{name}` is in the registry already");
        let mut effects = self.effects.clone();
        effects.push(effect);
        Registry { effects, ..self.clone() }
    }

    /// Returns the effects in the order in which they act.
    pub fn effects(&self) -> impl Iterator<Item = &dyn Effect> {
        self.effects.iter().map(AsRef::as_ref)
    }

    /// Returns whether the named effect does nothing alone, and only sets where, how fast, from which size on or in which shape
    /// others act.
    pub fn is_companion(&self, name: &str) -> bool {
        self.effects().any(|effect| effect.companions().contains(&name))
    }

    /// Returns the effect with a name.
    pub fn find(&self, name: &str) -> Option<&dyn Effect> {
        self.effects().find(|e| e.about().name == name)
    }
}

impl std::fmt::Debug for Registry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.effects().map(|e| e.about().name)).finish()
    }
}
