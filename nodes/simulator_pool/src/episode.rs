//! One simulated episode: the beam, the arm that moves it, and the camera that looks.

use crate::arm::ArmModel;
use crate::beam::{Beam, Discretisation, GripState, MeasuredPoint};
use crate::effects::Registry;
use crate::parameters::{ParameterError, Values};
use crate::view::Eye;
use crate::world::World;
use catenary_core::camera::Camera;
use catenary_core::model::Object;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::task::{Judge, Moment, Task, Verdict};
use catenary_core::track::End;
use catenary_core::{Fidelity, Frame, GripPose, GripTrajectory, Model, Observation, SimulationRequest, Track, seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::ops::ControlFlow;

/// Time over which the velocity of a measured grip is taken at the start, s.
const GRIP_VELOCITY_BASE_S: f64 = 0.05;

/// Random streams of one episode.
mod stream {
    pub const EFFECTS: u64 = 0;
    pub const CAMERA: u64 = 1;
    pub const TARGET: u64 = 2;
    pub const NOISE: u64 = 3;
    pub const START: u64 = 4;
    pub const DROPS: u64 = 5;
}

/// What makes one episode differ from another of the same model.
#[derive(Debug, Clone, Copy)]
pub struct Conditions<'a> {
    /// The model's inferred parameters.
    pub theta: &'a [f64],
    /// Further parameters by name: they win over the model's own draws.
    pub effects: &'a [(String, f64)],
    /// Seed of the episode.
    pub seed: u64,
    /// Whether camera jitter and keypoint noise are added.
    pub noise: bool,
    /// (x, z) in m of the target; none: the model's, with its jitter.
    pub target_m: Option<[f64; 2]>,
}

impl<'a> Conditions<'a> {
    /// Those of episode `index` of a request; `effects` are its [`effects_of`].
    pub(crate) fn of(request: &'a SimulationRequest, index: usize, effects: &'a [(String, f64)]) -> Self {
        Self {
            theta: &request.thetas[index],
            effects,
            seed: seed::derive(request.seed, request.first_episode + index as u64),
            noise: request.noise,
            target_m: request.target_m,
        }
    }
}

/// The values that a request gives its episode `index` for further parameters.
pub(crate) fn effects_of(request: &SimulationRequest, index: usize) -> Vec<(String, f64)> {
    request.effects.iter().map(|(name, values)| (name.clone(), values[index])).collect()
}

/// A stage on which episodes of one model run, one after the other, in the same memory.
pub struct Stage {
    model: Model,
    registry: Registry,
    world: World,
    beam: Beam,
    eye: Eye,
    target_scaled: [f64; 2],
    /// Draws of the start's velocities, where the conditions ask for noise.
    start_noise: Option<ChaCha8Rng>,
}

impl Stage {
    /// A stage for `model`, which must have been checked, at a fidelity.
    pub fn new(model: &Model, registry: &Registry, fidelity: Fidelity) -> Result<Self, ParameterError> {
        Self::divided(model, registry, Discretisation::of(fidelity))
    }

    /// As [`Self::new`], with time and the beam divided like this.
    pub fn divided(model: &Model, registry: &Registry, discretisation: Discretisation) -> Result<Self, ParameterError> {
        let world = Values::middle(registry, model)?.world(model)?;
        Ok(Self {
            beam: Beam::new(world.beam, discretisation, GripState::default())?,
            eye: Eye::new(&world.view, world.view.camera, None, None),
            target_scaled: [0.0; 2],
            start_noise: None,
            world,
            registry: registry.clone(),
            model: model.clone(),
        })
    }

    /// The model.
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// The effects that the model may name.
    pub(crate) fn registry(&self) -> &Registry {
        &self.registry
    }

    /// The camera and its memory.
    pub(crate) fn eye(&self) -> &Eye {
        &self.eye
    }

    /// The beam.
    pub fn beam(&self) -> &Beam {
        &self.beam
    }

    /// The beam, to move it on.
    pub(crate) fn beam_mut(&mut self) -> &mut Beam {
        &mut self.beam
    }

    /// The world of the present episode.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The camera of the present episode, jitter included.
    pub fn camera(&self) -> &Camera {
        &self.eye.camera
    }

    /// The arm of the present episode, at rest at `position_m` (x, z).
    pub fn arm(&self, position_m: [f64; 2]) -> ArmModel {
        ArmModel::new(&self.world.arm, position_m)
    }

    /// The values of the parameters and effects in these conditions.
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

    /// Puts the object of these conditions on the stage; a shape must follow.
    pub fn prepare(&mut self, c: &Conditions<'_>) -> Result<(), ParameterError> {
        let world = self.values(c)?.world(&self.model)?;
        self.world = world;
        self.beam.reset_to(self.world.beam, &self.world.terms, GripState::default())?;
        let noise = |number| c.noise.then(|| seed::rng(c.seed, number));
        let camera = if c.noise { self.jittered_camera(c.seed) } else { self.world.view.camera };
        self.eye = Eye::new(&self.world.view, camera, noise(stream::NOISE), noise(stream::DROPS));
        self.start_noise = noise(stream::START);
        let target_m = c.target_m.or_else(|| self.model.task.map(|t| jittered_target(&t, c.seed)));
        let place = |[x, z]: [f64; 2]| camera.scaled_from_world([x, 0.0, z]);
        self.target_scaled = target_m.and_then(place).unwrap_or([0.0; 2]);
        Ok(())
    }

    /// Lets the object hang at rest from the grip.
    pub fn hang(&mut self, grip: GripPose) {
        let _counted = self.beam.hang_at_rest(GripState::from_pose(grip, self.world.grip_angle_rad));
        self.remember(0.0);
    }

    /// Moves on to `time_s` while the grip is where `grip` says.
    pub fn advance(&mut self, time_s: f64, grip: impl Fn(f64) -> GripPose) {
        let angle = self.world.grip_angle_rad;
        if self.eye.has_memory() {
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
    }

    pub(crate) fn remember(&mut self, time_s: f64) {
        if self.eye.has_memory() {
            let places_m = self.keypoints_m();
            self.eye.remember(time_s, places_m);
        }
    }

    /// Places (x, z) in m of the object's keypoints now.
    fn keypoints_m(&self) -> [[f64; 2]; 4] {
        let shift = self.world.view.keypoint_shift;
        let fractions = self.keypoint_fractions();
        let seen = if shift == 0.0 { fractions } else { fractions.map(|f| (f + shift).clamp(0.0, 1.0)) };
        self.beam.centre_line_at_deformed_fraction(seen)
    }

    /// The object's keypoints in a frame stamped `time_s`, which must be where the stage is, scaled to -1 .. 1, with noise
    /// where the conditions ask for it.
    pub fn keypoints(&mut self, time_s: f64) -> [[f64; 2]; 4] {
        let places_m = self.keypoints_m();
        self.eye.look(time_s, places_m)
    }

    fn keypoint_fractions(&self) -> [f64; 4] {
        keypoint_fractions(&self.model.object, self.beam.deformed_length_m())
    }

    /// The target as the camera sees it, scaled to -1 .. 1.
    pub fn target_scaled(&self) -> [f64; 2] {
        self.target_scaled
    }

    fn jittered_camera(&self, episode_seed: u64) -> Camera {
        let half = self.model.camera.position_jitter_m;
        let mut rng = seed::rng(episode_seed, stream::CAMERA);
        let mut shift = || if half > 0.0 { rng.random_range(-half..=half) } else { 0.0 };
        match self.world.view.camera {
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
        frame(time_s, dlo, self.target_scaled, grip)
    }

    /// Runs an episode along a measured path, looking at `frame_times_s` until that [is enough](Enough).
    pub fn follow(
        &mut self,
        path: &GripTrajectory,
        start: &StartShape,
        frame_times_s: &[f64],
        is_enough: Enough<'_>,
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
        let turning = -rate(grip.pitch_rad, later.pitch_rad);
        let velocity = [rate(grip.x_m, later.x_m), rate(grip.z_m, later.z_m), turning];
        self.hang(grip);
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
        let _counted = self.beam.set_shape(GripState::from_pose(grip, self.world.grip_angle_rad), velocity, &points);
        self.remember(0.0);
    }

    /// Runs an episode of actions from the model's start pose. `choose` gives the action after an observation; none ends
    /// the episode as complete, as do frames that [are enough](Enough). With `ends`, success and leaving the workspace end it too.
    /// Frames are looked at at each step, and after the last.
    pub fn act(
        &mut self,
        task: &Task,
        ends: bool,
        is_enough: Enough<'_>,
        mut choose: impl FnMut(usize, &Observation) -> Option<[f64; 2]>,
    ) -> Track {
        let start = self.model.arm.start;
        let arm = self.arm([start.x_m, start.z_m]);
        self.hang(start);
        let judge = Judge::new(*task, self.model.camera.view);
        let look = |time_s, path: Path<'_>| {
            self.advance(time_s, path);
            self.frame(time_s, path(time_s))
        };
        execute(task, start.pitch_rad, arm, look, |step, arm, frames| {
            if is_enough(frames) {
                return ControlFlow::Break(End::Complete);
            }
            let frame = &frames[step];
            let observation = Observation::new([frame.eef[0], frame.eef[1]], &frame.dlo, frame.target);
            let is_last = step == task.steps;
            let end = if step > 0 && ends { verdict(&judge, arm, &observation, is_last).end } else { None };
            end.map_or_else(|| or_complete(choose(step, &observation)), ControlFlow::Break)
        })
    }
}

/// Whether the frames of an episode so far, the newest last, are all that is asked for.
pub type Enough<'a> = &'a dyn Fn(&[Frame]) -> bool;

/// Every frame is asked for.
pub fn whole(_: &[Frame]) -> bool {
    false
}

/// Where the grip is as a function of time in s.
pub(crate) type Path<'a> = &'a dyn Fn(f64) -> GripPose;

/// Lets `arm`, whose hand keeps its pitch, execute actions, one each step of the task. `look` moves the object on to a time
/// along the path of the grip and takes the frame there; `choose` gives the action after the last of the frames so far, or the
/// episode's end.
pub(crate) fn execute(
    task: &Task,
    pitch_rad: f64,
    mut arm: ArmModel,
    mut look: impl FnMut(f64, Path<'_>) -> Frame,
    mut choose: impl FnMut(usize, &ArmModel, &[Frame]) -> ControlFlow<End, [f64; 2]>,
) -> Track {
    let mut frames: Vec<Frame> = Vec::new();
    for step in 0.. {
        let time_s = step as f64 * task.step_period_s;
        arm.run_to(time_s);
        frames.push(look(time_s, &|t| arm.grip(t, pitch_rad)));
        match choose(step, &arm, &frames) {
            ControlFlow::Continue(action) => {
                frames[step].action = action;
                arm.set_delta(time_s, action);
            }
            ControlFlow::Break(end) => return Track { frames, end },
        }
    }
    unreachable!("the loop over steps has no end of its own")
}

/// The action, or without one the end of an episode in which everything was done.
pub(crate) fn or_complete(action: Option<[f64; 2]>) -> ControlFlow<End, [f64; 2]> {
    action.map_or(ControlFlow::Break(End::Complete), ControlFlow::Continue)
}

/// What is seen at a moment, with no action yet.
pub(crate) fn frame(time_s: f64, dlo: [[f64; 2]; 4], target: [f64; 2], grip: GripPose) -> Frame {
    Frame { time_s, dlo, target, eef: [grip.x_m, grip.z_m, grip.pitch_rad], action: [0.0; 2] }
}

/// The keypoints' places as fractions of the whole deformed length in m, that behind the fingers included.
pub(crate) fn keypoint_fractions(object: &Object, deformed_length_m: f64) -> [f64; 4] {
    let hidden = (object.hidden_length_m / deformed_length_m).min(1.0);
    object.keypoint_fractions.map(|f| hidden + f * (1.0 - hidden))
}

/// Verdict on an observation after a step; `is_last` says that it was the last one.
pub fn verdict(judge: &Judge, arm: &ArmModel, observation: &Observation, is_last: bool) -> Verdict {
    let inside = |[x, z]: [f64; 2]| judge.task().workspace.contains(x, 0.0, z);
    let left = !inside(observation.eef_m()) || !inside(arm.target_m());
    judge.verdict(&Moment::of(observation, left, is_last))
}

/// (x, z) in m of the target in an episode of this seed.
pub fn jittered_target(task: &Task, episode_seed: u64) -> [f64; 2] {
    let half = task.target_jitter_m;
    let mut rng = seed::rng(episode_seed, stream::TARGET);
    task.target_m.map(|v| if half > 0.0 { v + rng.random_range(-half..=half) } else { v })
}

/// Runs one episode of a request: `drive` moves the grip, `frame_times_s` says when it is looked at (with actions and
/// policies: at every step), until that [is enough](Enough).
pub fn run(
    stage: &mut Stage,
    drive: &Drive,
    start: &StartShape,
    frame_times_s: &[f64],
    is_enough: Enough<'_>,
) -> Result<Track, String> {
    let task = stage.model.task;
    let need_task = || task.ok_or_else(|| format!("model `{}`: actions and policies need a task", stage.model.name));
    match drive {
        Drive::Grip(path) => Ok(stage.follow(path, start, frame_times_s, is_enough)),
        Drive::Actions(actions) => {
            let task = need_task()?;
            Ok(stage.act(&task, false, is_enough, |step, _| actions.get(step).copied()))
        }
        Drive::Policy(policy) => {
            let task = need_task()?;
            let mut track = stage.act(&task, true, is_enough, |step, o| (step < task.steps).then(|| policy.act(o)));
            if track.end == End::Complete {
                track.end = End::StepLimit;
            }
            Ok(track)
        }
    }
}
