//! One episode of a model, moment by moment.

use anyhow::Result;
use catenary_core::camera::MASK_SIZE_PX;
use catenary_core::camera::Pinhole;
use catenary_core::episode::MeasuredTrack;
use catenary_core::{Camera, Fidelity, GripPose, Keypoints, Model, Observation, Task};
use simulator_pool::Registry;
use simulator_pool::arm::ArmModel;
use simulator_pool::beam::Counters;
use simulator_pool::cell::HandWrench;
use simulator_pool::episode::{Conditions, Stage, whole};
use simulator_pool::render::Renderer;
use simulator_pool::scene::Scene;

/// Time over which velocities are taken, s.
const VELOCITY_BASE_S: f64 = 1e-3;
/// Size of pictures, pixels, and focal length of the camera that is made up where a model has none of its own.
const PICTURE_PX: [u32; 2] = [640, 480];
const FOCAL_PX: f64 = 615.0;

/// What moves the clamped end.
pub enum Motion {
    /// The model's arm executes actions.
    Actions { task: Task, actions: Vec<[f64; 2]> },
    /// It follows what was measured.
    Measured(Box<MeasuredTrack>),
}

impl Motion {
    /// Length in s.
    pub fn duration_s(&self) -> f64 {
        match self {
            Self::Actions { task, actions } => actions.len() as f64 * task.step_period_s,
            Self::Measured(m) => m.grip.times_s().last().copied().unwrap_or_default(),
        }
    }
}

/// What the object of the episode is.
pub struct Setting {
    /// Theta in the model's order.
    pub theta: Vec<f64>,
    /// Further parameters by name, which win over the model's.
    pub given: Vec<(String, f64)>,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Whether keypoints, camera and start are noisy as the model says, and effects that are not given drawn.
    pub noise: bool,
}

/// An episode that is being played.
pub struct Player<'a> {
    stage: Stage,
    motion: &'a Motion,
    arm: ArmModel,
    pitch_rad: f64,
    time_s: f64,
    target_m: Option<[f64; 2]>,
    scene: Scene,
    camera: Pinhole,
}

impl<'a> Player<'a> {
    /// The model's object at the start of the motion.
    pub fn new(model: &Model, motion: &'a Motion, setting: &Setting, fidelity: Fidelity) -> Result<Self> {
        let mut stage = Stage::new(model, &Registry::with_unlisted(), fidelity)?;
        // Without noise the target stands where the model has it.
        let target_m = model.task.filter(|_| !setting.noise).map(|t| t.target_m);
        let conditions = Conditions {
            theta: &setting.theta,
            effects: &setting.given,
            seed: setting.seed,
            noise: setting.noise,
            target_m,
        };
        stage.prepare(&conditions)?;
        let target_m = model.task.and_then(|_| stage.camera().plane_from_scaled(stage.target_scaled()));
        let table_m = stage.world().beam.table.map(|t| t.height_m);
        let elements = stage.beam().discretisation().elements;
        let start = model.arm.start;
        let mut player = Self {
            camera: side_view(stage.camera()),
            scene: Scene::new(table_m, target_m, model.object.section, elements),
            arm: stage.arm([start.x_m, start.z_m]),
            pitch_rad: start.pitch_rad,
            time_s: 0.0,
            target_m,
            motion,
            stage,
        };
        match motion {
            Motion::Actions { .. } => player.stage.hang(start),
            Motion::Measured(m) => {
                player.stage.follow(&m.grip, &m.start, &[0.0], &whole);
            }
        }
        Ok(player)
    }

    /// Lets time run on to `time_s`.
    pub fn advance(&mut self, time_s: f64) {
        self.arm.run_to(time_s);
        let (motion, arm, pitch_rad) = (self.motion, &self.arm, self.pitch_rad);
        self.stage.advance(time_s, |t| pose(motion, arm, pitch_rad, t));
        self.time_s = time_s;
    }

    /// Takes action number `step` now; none after the last. Returns the arm's new target (x, z) in m and the action.
    pub fn act(&mut self, step: usize) -> Option<([f64; 2], [f64; 2])> {
        let Motion::Actions { actions, .. } = self.motion else { return None };
        let delta_m = *actions.get(step)?;
        self.arm.set_delta(self.time_s, delta_m);
        Some((self.arm.target_m(), delta_m))
    }

    /// Pose of the grip.
    pub fn grip(&self) -> GripPose {
        pose(self.motion, &self.arm, self.pitch_rad, self.time_s)
    }

    /// Velocity of the grip along x and z in m/s.
    pub fn velocity_m_s(&self) -> [f64; 2] {
        let Motion::Measured(measured) = self.motion else { return self.arm.velocity_m_s() };
        let (now, later) = (self.grip(), measured.grip.at(self.time_s + VELOCITY_BASE_S));
        [(later.x_m - now.x_m) / VELOCITY_BASE_S, (later.z_m - now.z_m) / VELOCITY_BASE_S]
    }

    /// The object's pull on the hand.
    pub fn wrench(&self) -> HandWrench {
        HandWrench::of(self.stage.beam())
    }

    /// Keypoints and target as the model's camera sees them now.
    pub fn keypoints(&mut self) -> Keypoints {
        let size = f64::from(MASK_SIZE_PX);
        let px = |p: [f64; 2]| p.map(|v| 0.5 * (v + 1.0) * size);
        Keypoints {
            dlo_px: self.stage.keypoints(self.time_s).map(px),
            target_px: self.target_m.map(|_| px(self.stage.target_scaled())),
            scores: [1.0; 4],
            target_score: if self.target_m.is_some() { 1.0 } else { 0.0 },
            image_width_px: MASK_SIZE_PX,
            image_height_px: MASK_SIZE_PX,
        }
    }

    /// (x, z) in m of keypoints in the plane of motion.
    pub fn plane_m(&self, keypoints: &Keypoints) -> [[f64; 2]; 4] {
        keypoints.dlo_px.map(|px| self.stage.camera().plane_from_mask(px).unwrap_or([f64::NAN; 2]))
    }

    /// The observation that keypoints make now.
    pub fn observation(&self, keypoints: &Keypoints) -> Observation {
        let grip = self.grip();
        let target = keypoints.target_scaled().unwrap_or_default();
        Observation::new([grip.x_m, grip.z_m], &keypoints.dlo_scaled(), target)
    }

    /// Whether hand and target pose lie in the task's workspace, where there is a task.
    pub fn is_inside(&self) -> bool {
        let Motion::Actions { task, .. } = self.motion else { return true };
        let (grip, [x, z]) = (self.grip(), self.arm.target_m());
        task.workspace.contains(grip.x_m, 0.0, grip.z_m) && task.workspace.contains(x, 0.0, z)
    }

    /// What the simulation has done.
    pub fn counters(&self) -> Counters {
        self.stage.beam().counters()
    }

    /// The camera of the pictures.
    pub fn camera(&self) -> &Pinhole {
        &self.camera
    }

    /// Draws the moment as `camera` sees it, [`Player::camera`] or one like it; `frame` picks the noise.
    pub fn draw(&mut self, renderer: &mut Renderer, camera: &Pinhole, frame: u64) {
        self.scene.update(self.grip(), self.stage.beam().nodes());
        renderer.draw(&self.scene, camera, frame);
    }
}

fn pose(motion: &Motion, arm: &ArmModel, pitch_rad: f64, time_s: f64) -> GripPose {
    match motion {
        Motion::Measured(m) => m.grip.at(time_s),
        Motion::Actions { .. } => arm.grip(time_s, pitch_rad),
    }
}

/// The model's camera, or, where coordinates are those of the plane itself, one that sees as much of it from the side.
pub fn side_view(camera: &Camera) -> Pinhole {
    match camera {
        Camera::Pinhole(p) => *p,
        Camera::Plane(p) => {
            let [width, height] = PICTURE_PX;
            let [x, z] = p.centre_m;
            let distance_m = FOCAL_PX * p.side_m / f64::from(height);
            Pinhole {
                image_width_px: width,
                image_height_px: height,
                focal_px: FOCAL_PX,
                position_m: [x, -distance_m, z],
                look_at_m: [x, 0.0, z],
                ..Pinhole::default()
            }
        }
    }
}
