//! Simulation of one episode: the beam, the arm that moves it, and the camera that sees it.

use super::conditions::{Conditions, jittered_target, stream};
use super::steps::{Path, StopCriterion, execute, frame};
use crate::arm::ArmModel;
use crate::beam::{Beam, Discretisation, GripState, MeasuredPoint};
use crate::effects::Registry;
use crate::episode_model::EpisodeModel;
use crate::imperfect_camera::ImperfectCamera;
use crate::parameters::{ParameterError, Values};
use crate::wrench_sensor::WrenchSensor;
use catenary_core::camera::Camera;
use catenary_core::model::Object;
use catenary_core::simulator::StartShape;
use catenary_core::task::Task;
use catenary_core::track::End;
use catenary_core::{Fidelity, Frame, GripPose, GripTrajectory, Model, Observation, Track, seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::ops::ControlFlow;

/// Time in s over which the initial velocity of a measured grip is taken.
// Long against a sample of a recorded pose (10 ms at 100 Hz), so that its noise averages; short against a hand's
// motion.
const GRIP_VELOCITY_BASE_S: f64 = 0.05;

/// Simulation of episodes of one model, one after the other, in one memory.
pub struct EpisodeSimulation {
    model: Model,
    registry: Registry,
    episode_model: EpisodeModel,
    beam: Beam,
    imperfect_camera: ImperfectCamera,
    /// Sensor of the wrench; none if the model does not observe it.
    wrench_sensor: Option<WrenchSensor>,
    target_scaled: [f64; 2],
    /// Random source of the initial velocities; none if the conditions ask for no noise.
    start_noise: Option<ChaCha8Rng>,
}

impl EpisodeSimulation {
    /// Makes the simulation of `model`, which must have been checked, at a fidelity.
    pub fn new(model: &Model, registry: &Registry, fidelity: Fidelity) -> Result<Self, ParameterError> {
        Self::with_discretisation(model, registry, Discretisation::of(fidelity))
    }

    /// Makes the simulation of `model`, which must have been checked, with a discretisation.
    pub fn with_discretisation(
        model: &Model,
        registry: &Registry,
        discretisation: Discretisation,
    ) -> Result<Self, ParameterError> {
        let registry = registry.with_expressions(model)?;
        let episode_model = Values::middle(&registry, model)?.episode_model(model)?;
        Ok(Self {
            beam: Beam::new(episode_model.beam, discretisation, GripState::default())?,
            imperfect_camera: ImperfectCamera::new(&episode_model.camera, episode_model.camera.view, None, None),
            wrench_sensor: None,
            target_scaled: [0.0; 2],
            start_noise: None,
            episode_model,
            registry,
            model: model.clone(),
        })
    }

    /// Returns the model.
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the effects that the model may name.
    pub(crate) fn registry(&self) -> &Registry {
        &self.registry
    }

    /// Returns the beam.
    pub fn beam(&self) -> &Beam {
        &self.beam
    }

    /// Returns the beam, for steps that the caller makes.
    pub(crate) fn beam_mut(&mut self) -> &mut Beam {
        &mut self.beam
    }

    /// Returns the settings of the present episode.
    pub fn episode_model(&self) -> &EpisodeModel {
        &self.episode_model
    }

    /// Returns the camera of the present episode, jitter included.
    pub fn camera(&self) -> &Camera {
        &self.imperfect_camera.camera
    }

    /// Makes the arm of the present episode, at rest at `position_m` (x, z).
    pub fn arm(&self, position_m: [f64; 2]) -> ArmModel {
        ArmModel::new(&self.episode_model.arm, position_m)
    }

    /// Resolves parameters and effects in the given conditions, drawing the model's own effects.
    pub(crate) fn values(&self, c: &Conditions<'_>) -> Result<Values<'_>, ParameterError> {
        let mut effects_rng = seed::rng(c.seed, stream::EFFECTS);
        let drawn: Vec<(&str, f64)> = self
            .model
            .effects
            .iter()
            .map(|e| (e.name.as_str(), e.distribution.from_unit(effects_rng.random::<f64>())))
            .collect();
        let given = c.effects.iter().map(|(name, value)| (name.as_str(), *value));
        Values::resolve(&self.registry, &self.model, c.theta, drawn.into_iter().chain(given))
    }

    /// Prepares an episode of the given conditions. An initial shape must follow.
    pub fn prepare(&mut self, c: &Conditions<'_>) -> Result<(), ParameterError> {
        let episode_model = self.values(c)?.episode_model(&self.model)?;
        self.episode_model = episode_model;
        self.beam.reset_to(self.episode_model.beam, &self.episode_model.terms, GripState::default())?;
        let noise = |number| c.noise.then(|| seed::rng(c.seed, number));
        let camera = if c.noise { self.jittered_camera(c.seed) } else { self.episode_model.camera.view };
        self.imperfect_camera =
            ImperfectCamera::new(&self.episode_model.camera, camera, noise(stream::NOISE), noise(stream::DROPS));
        self.wrench_sensor =
            self.episode_model.wrench.map(|settings| WrenchSensor::new(settings, noise(stream::WRENCH)));
        self.start_noise = noise(stream::START);
        let target_m = c.target_m.or_else(|| self.model.task.map(|t| jittered_target(&t, c.seed)));
        let place = |[x, z]: [f64; 2]| camera.scaled_from_world([x, 0.0, z]);
        self.target_scaled = target_m.and_then(place).unwrap_or([0.0; 2]);
        Ok(())
    }

    /// Starts with the object hanging at rest from the grip.
    pub fn hang(&mut self, grip: GripPose) {
        self.hang_at_rest(grip);
        self.change_start();
        // Of a beam at rest the accelerations are known before the first step: they are zero.
        if let Some(sensor) = &mut self.wrench_sensor {
            sensor.remember(0.0, self.beam.wrench_on_hand());
        }
    }

    fn hang_at_rest(&mut self, grip: GripPose) {
        let _counted = self.beam.hang_at_rest(GripState::from_pose(grip, self.episode_model.grip_angle_rad));
    }

    fn change_start(&mut self) {
        self.beam.change_start(&self.episode_model.start);
        self.remember(0.0);
    }

    /// Advances to `time_s`. `grip` gives the pose of the grip at a time in s.
    pub fn advance(&mut self, time_s: f64, grip: impl Fn(f64) -> GripPose) {
        let angle = self.episode_model.grip_angle_rad;
        // A camera that shows the past needs the keypoints at every step, not only at the frames, and the wrench within a step lies
        // between those at its ends.
        if self.has_memory() {
            let step_s = self.beam.discretisation().time_step_s;
            loop {
                let next_s = self.beam.time_s() + step_s;
                if next_s >= time_s {
                    break;
                }
                self.beam.advance_to(next_s, |t| GripState::from_pose(grip(t), angle));
                self.remember(self.beam.time_s());
            }
        }
        self.beam.advance_to(time_s, |t| GripState::from_pose(grip(t), angle));
        self.remember_wrench();
    }

    /// Returns true if [`Self::remember`] must be called at every step.
    pub(crate) fn has_memory(&self) -> bool {
        self.imperfect_camera.has_memory() || self.wrench_sensor.is_some()
    }

    /// Stores what camera and sensor need at `time_s`, the end of a step.
    pub(crate) fn remember(&mut self, time_s: f64) {
        if self.imperfect_camera.has_memory() {
            let places_m = self.keypoints_m();
            self.imperfect_camera.remember(time_s, places_m);
        }
        self.remember_wrench();
    }

    /// Stores the wrench on the hand at the newest step, if the model observes it. A beam that starts in motion has no accelerations before its
    /// first step.
    pub(crate) fn remember_wrench(&mut self) {
        if let Some(sensor) = &mut self.wrench_sensor
            && self.beam.time_s() > 0.0
        {
            sensor.remember(self.beam.time_s(), self.beam.wrench_on_hand());
        }
    }

    /// Returns the wrench on the hand at `time_s`, to which the simulation must have advanced, as the sensor measures it, in the order of
    /// [`Frame::wrench`]. None if the model does not observe it.
    pub fn wrench(&mut self, time_s: f64) -> Option<[f64; 3]> {
        self.wrench_sensor.as_mut()?.read(time_s)
    }

    /// Returns the present places (x, z) in m of the object's keypoints.
    fn keypoints_m(&self) -> [[f64; 2]; 4] {
        let shift = self.episode_model.camera.keypoint_shift;
        let fractions = self.keypoint_fractions();
        let seen = if shift == 0.0 { fractions } else { fractions.map(|f| (f + shift).clamp(0.0, 1.0)) };
        self.beam.centre_line_at_deformed_fraction(seen)
    }

    /// Returns points (x, z) in m at fractions of the visible length, from the fingers (0) to the tip (1), now.
    pub fn visible_points_m<const K: usize>(&self, fractions: [f64; K]) -> [[f64; 2]; K] {
        let whole = whole_fractions(&self.model.object, self.beam.deformed_length_m(), fractions);
        self.beam.centre_line_at_deformed_fraction(whole)
    }

    /// Returns the object's keypoints in a frame stamped `time_s`, scaled to -1 .. 1, with noise if the conditions ask
    /// for it. The simulation must have advanced to `time_s`.
    pub fn keypoints(&mut self, time_s: f64) -> [[f64; 2]; 4] {
        let places_m = self.keypoints_m();
        self.imperfect_camera.capture(time_s, places_m)
    }

    fn keypoint_fractions(&self) -> [f64; 4] {
        keypoint_fractions(&self.model.object, self.beam.deformed_length_m())
    }

    /// Returns the target as the camera sees it, scaled to -1 .. 1.
    pub fn target_scaled(&self) -> [f64; 2] {
        self.target_scaled
    }

    fn jittered_camera(&self, episode_seed: u64) -> Camera {
        let half = self.model.camera.position_jitter_m;
        let mut rng = seed::rng(episode_seed, stream::CAMERA);
        let mut shift = || if half > 0.0 { rng.random_range(-half..=half) } else { 0.0 };
        match self.episode_model.camera.view {
            Camera::Pinhole(mut p) => {
                p.position_m = p.position_m.map(|v| v + shift());
                Camera::Pinhole(p)
            }
            Camera::Plane(mut p) => {
                p.centre_m = p.centre_m.map(|v| v + shift());
                Camera::Plane(p)
            }
        }
    }

    pub(crate) fn frame(&mut self, time_s: f64, grip: GripPose) -> Frame {
        let dlo = self.keypoints(time_s);
        Frame { wrench: self.wrench(time_s), ..frame(time_s, dlo, self.target_scaled, grip) }
    }

    /// Runs an episode along a measured path, with frames at `frame_times_s`, until [`StopCriterion`] stops it.
    pub fn follow(
        &mut self,
        path: &GripTrajectory,
        start: &StartShape,
        frame_times_s: &[f64],
        is_enough: StopCriterion<'_>,
    ) -> Track {
        self.start_on(path, start);
        let mut frames = Vec::with_capacity(frame_times_s.len());
        for &t in frame_times_s {
            self.advance(t, |t| path.at(t));
            frames.push(self.frame(t, path.at(t)));
            if is_enough(&frames) {
                break;
            }
        }
        Track { frames, end: End::Complete }
    }

    pub(crate) fn start_on(&mut self, path: &GripTrajectory, start: &StartShape) {
        let grip = path.at(0.0);
        let StartShape::Measured { points_m, velocities_m_s } = start else { return self.hang(grip) };
        let later = path.at(GRIP_VELOCITY_BASE_S);
        let rate = |a: f64, b: f64| (b - a) / GRIP_VELOCITY_BASE_S;
        // A positive pitch turns clockwise, the tangent counter-clockwise.
        let turning = -rate(grip.pitch_rad, later.pitch_rad);
        let velocity = [rate(grip.x_m, later.x_m), rate(grip.z_m, later.z_m), turning];
        // The hanging shape gives the deformed length, which places the keypoints on the beam.
        self.hang_at_rest(grip);
        let fractions = self.keypoint_fractions();
        let sd = self.model.observation.start_velocity_sd_m_s;
        let mut drawn = |v: f64| match &mut self.start_noise {
            Some(rng) if sd > 0.0 => v + sd * rng.sample::<f64, _>(StandardNormal),
            _ => v,
        };
        let velocities_m_s = velocities_m_s.map(|v| v.map(&mut drawn));
        let points: [MeasuredPoint; 4] = std::array::from_fn(|k| MeasuredPoint {
            fraction: fractions[k],
            position_m: points_m[k],
            velocity_m_s: velocities_m_s[k],
        });
        let _counted =
            self.beam.set_shape(GripState::from_pose(grip, self.episode_model.grip_angle_rad), velocity, &points);
        self.change_start();
    }

    /// Runs an episode of actions from the model's start pose, with a frame before each step and after the last.
    ///
    /// `choose` gives the action after an observation, none for a step of the rest, or the end. [`StopCriterion`] ends the
    /// episode as complete.
    pub fn act(
        &mut self,
        task: &Task,
        is_enough: StopCriterion<'_>,
        mut choose: impl FnMut(usize, &Observation, &ArmModel) -> ControlFlow<End, Option<[f64; 2]>>,
    ) -> Track {
        let start = self.model.arm.start;
        let arm = self.arm([start.x_m, start.z_m]);
        self.hang(start);
        let frame_at = |time_s, path: Path<'_>| {
            self.advance(time_s, path);
            self.frame(time_s, path(time_s))
        };
        execute(task, start.pitch_rad, arm, frame_at, |step, arm, frames| {
            if is_enough(frames) {
                return ControlFlow::Break(End::Complete);
            }
            let frame = &frames[step];
            let observation = Observation::new([frame.eef[0], frame.eef[1]], &frame.dlo, frame.target);
            choose(step, &observation, arm)
        })
    }
}

/// Returns the keypoints' places as fractions of the whole deformed length, with the part hidden by the fingers.
pub(crate) fn keypoint_fractions(object: &Object, deformed_length_m: f64) -> [f64; 4] {
    whole_fractions(object, deformed_length_m, object.keypoint_fractions)
}

/// Returns fractions of the whole deformed length for those of its visible part.
fn whole_fractions<const K: usize>(object: &Object, deformed_length_m: f64, visible: [f64; K]) -> [f64; K] {
    let hidden = (object.hidden_length_m / deformed_length_m).min(1.0);
    visible.map(|f| hidden + f * (1.0 - hidden))
}
