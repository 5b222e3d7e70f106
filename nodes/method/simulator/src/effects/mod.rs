//! Effects: ways in which reality may differ from the base simulator, one per file.
//!
//! An effect has one magnitude. At zero it changes no bit of a track. A model may fix an effect (`parameters`), infer
//! it (`theta`) or draw it anew for each episode (`effects`). Any number of effects act together, in the registry's
//! order.
//!
//! Some effects need further numbers, their companions: where, how fast or from which size on they act. A companion is an
//! effect of its own in model files, it does nothing alone, and it precedes its effects in the registry. An effect and its
//! companions are a group: a search offers and names it once, and estimates each of its numbers.
//!
//! A new effect is a file here that implements [`Effect`], and a line in [`Registry::shipped`]. Nothing else changes.
//! Physics that [`crate::EpisodeModel`] has no field for comes in through the terms of its hook,
//! [`crate::beam::ForceTerm`] and its like.
//!
//! A model file may state effects of its own as expressions ([`Registry::with_expressions`]).
//!
//! Two further lists are no candidates of a search: templates say in which part of the simulator, where and how fast something
//! is missing ([`Registry::with_templates`]); unlisted effects are hidden in the episodes of blind tests
//! ([`Registry::with_unlisted`]).

mod effect;
#[cfg(test)]
mod fixtures;
mod registry;
#[cfg(test)]
mod tests;

mod arm_delay;
mod arm_lag;
mod arm_standing_error;
mod axial_law;
mod axial_stiffness;
mod camera_offset_x;
mod camera_offset_z;
mod camera_scale;
mod camera_tilt;
mod companion;
mod creep;
mod delta_anchor;
mod density;
mod dropped_frames;
mod exposure;
mod expression;
mod frame_delay;
mod gravity_tilt;
mod grip_angle;
mod grip_compliance;
mod grip_slip;
mod kelvin_voigt;
mod keypoint_bias;
mod keypoint_noise;
mod lens_distortion;
mod linear_drag;
mod overhang;
mod quadratic_drag;
mod rest_bend;
mod rest_curvature;
mod rest_curvature_gradient;
mod rolling_shutter;
mod start_offset;
mod start_velocity;
mod stiffness_gradient;
mod strand_friction;
mod table_adhesion;
mod table_friction;
mod table_height;
mod templates;
mod term_effect;
mod tip_load;
mod tip_mass;
mod unlisted;
mod wrench_bias;
mod wrench_delay;

pub use effect::{About, Effect, Hook, Sign};
pub use expression::ExpressionError;
pub(crate) use expression::check_names;
pub use registry::{Registry, replaced};
pub use templates::{FREQUENCY as TEMPLATE_FREQUENCY, PLACE as TEMPLATE_PLACE};
