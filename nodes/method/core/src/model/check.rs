//! Checks of the values of a model. Each error names the path of the field; the line follows from the path.

use super::outline::{Content, Node};
use super::{ArmLaw, MODEL_VERSION, Model, ModelError, Place, Section, expression};
use crate::task::{MOST_STEPS, REWARD_RANGE_M, STEP_PERIOD_S};
use crate::{Goal, GripPose, Task};
use std::collections::BTreeSet;

/// Plausible ranges, chosen wide of any cell with a Panda, whose hand opens 80 mm. A value outside is probably in another unit: mm, degrees, ms.
const THICKNESS_M: [f64; 2] = [1e-5, 0.1];
const HIDDEN_LENGTH_M: [f64; 2] = [0.0, 0.1];
const POSITION_M: [f64; 2] = [-10.0, 10.0];
const JITTER_M: [f64; 2] = [0.0, 0.5];
const POSE_NOISE_M: [f64; 2] = [0.0, 0.1];
const PITCH_NOISE_RAD: [f64; 2] = [0.0, 0.5];
const ANGLE_RAD: [f64; 2] = [-std::f64::consts::TAU, std::f64::consts::TAU];
const FRAME_PERIOD_S: [f64; 2] = [1e-4, 5.0];
const START_VELOCITY_SD_M_S: [f64; 2] = [0.0, 5.0];
/// From the resolution of the best force sensors to the limits of a Panda.
const FORCE_SD_N: [f64; 2] = [1e-4, 1e3];
const TORQUE_SD_N_M: [f64; 2] = [1e-5, 1e2];
const RATE_HZ: [f64; 2] = [0.1, 1e4];
const KEYPOINT_NOISE_PX: [f64; 2] = [0.0, 100.0];

/// Rejects a file of another version, with a hint for newer versions and for a missing field.
pub(super) fn version(outline: Option<&Node>) -> Result<(), ModelError> {
    let Some(outline) = outline.filter(|o| matches!(o.content, Content::Map { .. })) else { return Ok(()) };
    let line = Some(outline.line_of("version"));
    let refuse = |got: &str, hint: &str| {
        let place = Place { line, field: "version".into() };
        let expected = format!("{MODEL_VERSION}, the version that this program reads");
        Err(ModelError::Value { place, expected, got: format!("{got}{hint}") })
    };
    match outline.get("version").map(|v| &v.content) {
        None => refuse("none", &format!("; begin the file with `version: {MODEL_VERSION}`")),
        Some(Content::Scalar(text)) => match text.parse::<u32>() {
            Ok(MODEL_VERSION) => Ok(()),
            Ok(newer) if newer > MODEL_VERSION => refuse(text, ": a newer catenary wrote it"),
            Ok(_) | Err(_) => refuse(text, ""),
        },
        Some(_) => refuse("a collection", ""),
    }
}

impl Model {
    /// Checks every value.
    ///
    /// # Errors
    /// [`ModelError::Value`] or [`ModelError::Text`] of the first field that makes no sense.
    pub fn check(&self) -> Result<(), ModelError> {
        if self.version != MODEL_VERSION {
            return Err(ModelError::value("version", MODEL_VERSION.to_string(), self.version));
        }
        self.check_distributions()?;
        self.check_names()?;
        self.check_nominal()?;
        for (name, v) in &self.parameters {
            finite(&format!("parameters.{name}"), *v)?;
        }
        self.check_object()?;
        let o = &self.observation;
        // A single frame shows no motion; 10 000 frames are 2 min 47 s at the 60 Hz of the cell's camera.
        if !(2..=10_000).contains(&o.frames) {
            return Err(ModelError::value("observation.frames", "2 to 10000", o.frames));
        }
        ModelError::within("observation.frame_period_s", FRAME_PERIOD_S, "s", o.frame_period_s)?;
        ModelError::within("observation.start_velocity_sd_m_s", START_VELOCITY_SD_M_S, "m/s", o.start_velocity_sd_m_s)?;
        ModelError::within("observation.grip_position_sd_m", POSE_NOISE_M, "m", o.grip_position_sd_m)?;
        ModelError::within("observation.grip_pitch_sd_rad", PITCH_NOISE_RAD, "rad", o.grip_pitch_sd_rad)?;
        self.check_wrench()?;
        self.camera.view.check()?;
        ModelError::within("camera.rate_hz", RATE_HZ, "Hz", self.camera.rate_hz)?;
        ModelError::within("camera.keypoint_noise_px", KEYPOINT_NOISE_PX, "px", self.camera.keypoint_noise_px)?;
        ModelError::within("camera.position_jitter_m", JITTER_M, "m", self.camera.position_jitter_m)?;
        self.check_arm()?;
        self.check_lacking()?;
        expression::check(&self.expressions)?;
        self.task.as_ref().map_or(Ok(()), task)
    }

    /// Checks the noise of the wrench, and that something is observed.
    fn check_wrench(&self) -> Result<(), ModelError> {
        let Some(noise) = self.observation.wrench else {
            let expected = "true, or observation.wrench: without both nothing is observed";
            return match self.observation.keypoints {
                true => Ok(()),
                false => Err(ModelError::value("observation.keypoints", expected, false)),
            };
        };
        noise
            .force_sd_n
            .into_iter()
            .try_for_each(|sd| ModelError::within("observation.wrench.force_sd_n", FORCE_SD_N, "N", sd))?;
        ModelError::within("observation.wrench.torque_sd_n_m", TORQUE_SD_N_M, "N m", noise.torque_sd_n_m)
    }

    /// Path of the field that sets the parameter `name`: `parameters.NAME`, `theta.NAME` or `effects.NAME`. It is
    /// `parameters` if no field sets it.
    pub fn field_of(&self, name: &str) -> String {
        let is_theta = self.theta.index_of(name).is_some();
        let is_effect = self.effects.iter().any(|e| e.name == name);
        match (self.parameters.contains_key(name), is_theta, is_effect) {
            (true, _, _) => format!("parameters.{name}"),
            (_, true, _) => format!("theta.{name}"),
            (_, _, true) => format!("effects.{name}"),
            _ => "parameters".to_owned(),
        }
    }

    fn check_distributions(&self) -> Result<(), ModelError> {
        if self.theta.dimension() == 0 {
            return Err(ModelError::value("theta", "at least one parameter with a prior", "none"));
        }
        for p in self.theta.parameters() {
            p.prior.check().map_err(|what| ModelError::text(format!("theta.{}.prior", p.name), what))?;
        }
        for e in &self.effects {
            e.distribution
                .check()
                .map_err(|what| ModelError::text(format!("effects.{}.distribution", e.name), what))?;
        }
        Ok(())
    }

    /// Checks that each parameter is either fixed, inferred or drawn, and only once.
    fn check_names(&self) -> Result<(), ModelError> {
        let theta = self.theta.parameters().iter().enumerate().map(|(i, p)| (format!("theta.{i}"), &p.name));
        let effects = self.effects.iter().enumerate().map(|(i, e)| (format!("effects.{i}"), &e.name));
        // `parameters` is a map, so its own names come once.
        let mut seen: BTreeSet<&String> = self.parameters.keys().collect();
        for (field, name) in theta.chain(effects) {
            if !seen.insert(name) {
                let expected = "each name once among parameters, theta and effects";
                return Err(ModelError::value(field, expected, format!("`{name}` once more")));
            }
        }
        Ok(())
    }

    /// Checks that nominal values belong to parameters of `theta` or `effects` and lie within their bounds.
    fn check_nominal(&self) -> Result<(), ModelError> {
        for (name, value) in &self.nominal {
            let theta = self.theta.parameters().iter().find(|p| p.name == *name).map(|p| &p.prior);
            let effect = || self.effects.iter().find(|e| e.name == *name).map(|e| &e.distribution);
            let field = format!("nominal.{name}");
            let Some(prior) = theta.or_else(effect) else {
                return Err(ModelError::value(
                    field,
                    "the name of a parameter in theta or effects",
                    format!("`{name}`"),
                ));
            };
            let (low, high) = prior.bounds();
            if !(low..=high).contains(value) {
                return Err(ModelError::value(field, format!("{low} to {high}, where its prior lies"), value));
            }
        }
        Ok(())
    }

    fn check_object(&self) -> Result<(), ModelError> {
        match self.object.section {
            Section::Square { side_m } => ModelError::within("object.section.square.side_m", THICKNESS_M, "m", side_m)?,
            Section::Round { diameter_m } => {
                ModelError::within("object.section.round.diameter_m", THICKNESS_M, "m", diameter_m)?
            }
        }
        let f = self.object.keypoint_fractions;
        if !(f[0] >= 0.0 && f[3] <= 1.0 && f.windows(2).all(|w| w[0] < w[1])) {
            let expected = "four increasing numbers within 0 and 1";
            return Err(ModelError::value("object.keypoint_fractions", expected, format!("{f:?}")));
        }
        ModelError::within("object.hidden_length_m", HIDDEN_LENGTH_M, "m", self.object.hidden_length_m)?;
        ModelError::within("object.grip_angle_rad", ANGLE_RAD, "rad", self.object.grip_angle_rad)
    }

    fn check_arm(&self) -> Result<(), ModelError> {
        arm_law(&self.arm.law)?;
        ModelError::within("arm.pose_noise_m", POSE_NOISE_M, "m", self.arm.pose_noise_m)?;
        let GripPose { x_m, z_m, pitch_rad } = self.arm.start;
        ModelError::within("arm.start.x_m", POSITION_M, "m", x_m)?;
        ModelError::within("arm.start.z_m", POSITION_M, "m", z_m)?;
        ModelError::within("arm.start.pitch_rad", ANGLE_RAD, "rad", pitch_rad)
    }
}

impl Model {
    fn check_lacking(&self) -> Result<(), ModelError> {
        for (name, odds) in &self.lacking.prior_odds {
            let field = format!("lacking.prior_odds.{name}");
            positive(&field, *odds)?;
            if self.lacking.vetoes.contains(name) {
                return Err(ModelError::value(field, "none, as the effect is vetoed", odds));
            }
        }
        Ok(())
    }
}

/// Checks the constants of an arm's law.
pub(super) fn arm_law(law: &ArmLaw) -> Result<(), ModelError> {
    law.constants().into_iter().try_for_each(|(field, v, range, unit)| ModelError::within(field, range, unit, v))
}

/// Checks a task.
pub(super) fn task(task: &Task) -> Result<(), ModelError> {
    if task.steps == 0 {
        return Err(ModelError::value("task.steps", "at least 1", task.steps));
    }
    ModelError::within("task.step_period_s", STEP_PERIOD_S, "s", task.step_period_s)?;
    if let Some(reward_range_m) = task.goal.reward_range_m() {
        // The steps before the end earn nothing, and are no successes.
        positive("task.success_reward", task.success_reward)?;
        ModelError::within(
            &format!("task.goal.{}.reward_range_m", task.goal.name()),
            REWARD_RANGE_M,
            "m",
            reward_range_m,
        )?;
    }
    if task.steps.saturating_add(task.rest_steps) > MOST_STEPS {
        let is_alone = task.steps > MOST_STEPS;
        let (field, got) = if is_alone { ("task.steps", task.steps) } else { ("task.rest_steps", task.rest_steps) };
        return Err(ModelError::value(field, format!("at most {MOST_STEPS} steps in all"), got));
    }
    if task.rest_steps > 0 && task.goal == Goal::Reach {
        return Err(ModelError::value(
            "task.rest_steps",
            "0 for the goal `reach`, whose every step is rewarded",
            task.rest_steps,
        ));
    }
    // A single rest step shows no motion.
    if matches!(task.goal, Goal::Settle { .. }) && task.rest_steps < 2 {
        return Err(ModelError::value("task.rest_steps", "at least 2 for the goal `settle`", task.rest_steps));
    }
    if task.ends_at_success && task.goal != Goal::Reach {
        let got = format!("true with `{}`, which is judged at its end", task.goal.name());
        return Err(ModelError::value("task.ends_at_success", "false, or the goal `reach`", got));
    }
    ModelError::within("task.target_jitter_m", JITTER_M, "m", task.target_jitter_m)?;
    task.target_m.into_iter().try_for_each(|v| ModelError::within("task.target_m", POSITION_M, "m", v))?;
    finite("task.success_reward", task.success_reward)?;
    refuse_unless(
        task.success_reward <= 1.0,
        "task.success_reward",
        "at most 1, the greatest reward",
        task.success_reward,
    )?;
    let w = &task.workspace;
    for (axis, [low, high]) in [("x_m", w.x_m), ("y_m", w.y_m), ("z_m", w.z_m)] {
        if !(low.is_finite() && high.is_finite() && low < high) {
            let got = format!("[{low}, {high}]");
            return Err(ModelError::value(format!("task.workspace.{axis}"), "[low, high] with low < high", got));
        }
        [low, high]
            .into_iter()
            .try_for_each(|v| ModelError::within(&format!("task.workspace.{axis}"), POSITION_M, "m", v))?;
    }
    Ok(())
}

fn refuse_unless(holds: bool, field: &str, expected: &str, v: f64) -> Result<(), ModelError> {
    if holds { Ok(()) } else { Err(ModelError::value(field, expected, v)) }
}

fn finite(field: &str, v: f64) -> Result<(), ModelError> {
    refuse_unless(v.is_finite(), field, "a finite number", v)
}

fn positive(field: &str, v: f64) -> Result<(), ModelError> {
    refuse_unless(v.is_finite() && v > 0.0, field, "a positive number", v)
}
