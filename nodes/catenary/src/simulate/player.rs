//! Player of one simulated episode, moment by moment.

use anyhow::Result;
use catenary_core::camera::MASK_SIZE_PX;
use catenary_core::camera::Pinhole;
use catenary_core::episode::MeasuredTrack;
use catenary_core::{Camera, Fidelity, GripPose, Keypoints, Model, Observation, Task};
use catenary_simulator::Registry;
use catenary_simulator::arm::ArmModel;
use catenary_simulator::beam::Counters;
use catenary_simulator::episode::{Conditions, EpisodeSimulation, never_stop};
use simulated_cell::cell::HandWrench;
use simulated_cell::render::Renderer;
use simulated_cell::scene::Scene;

/// Time step of the differences that give velocities, s.
const VELOCITY_BASE_S: f64 = 1e-3;
/// Size of pictures and focal length, both in pixels, for a model whose camera sees the plane itself.
const PICTURE_PX: [u32; 2] = [640, 480];
const FOCAL_PX: f64 = 615.0;

/// Motion of the clamped end.
pub enum Motion {
    /// Actions that the model's arm executes.
    Actions { task: Task, actions: Vec<[f64; 2]> },
    /// Measured motion that the grip follows.
    Measured(Box<MeasuredTrack>),
}

impl Motion {
    /// Number of steps, with those of the task's rest; none for a measured motion.
    pub fn steps(&self) -> Option<usize> {
        match self {
            Self::Actions { task, actions } => Some(actions.len() + task.rest_after(actions.len())),
            Self::Measured(_) => None,
        }
    }

    /// Length of the motion, s.
    pub fn duration_s(&self) -> f64 {
        match self {
            Self::Actions { task, .. } => self.steps().unwrap_or(0) as f64 * task.step_period_s,
            Self::Measured(m) => m.grip.times_s().last().copied().unwrap_or_default(),
        }
    }
}

/// Object of the episode, and noise.
pub struct Setting {
    /// Theta in the model's order.
    pub theta: Vec<f64>,
    /// Values of further parameters by name. They override the model's.
    pub given: Vec<(String, f64)>,
    /// Seed of every random draw.
    pub seed: u64,
    /// True if keypoints, camera and start have the model's noise, and effects without a given value are drawn.
    pub noise: bool,
}

/// Episode that is being played.
pub struct Player<'a> {
    simulation: EpisodeSimulation,
    motion: &'a Motion,
    arm: ArmModel,
    pitch_rad: f64,
    time_s: f64,
    target_m: Option<[f64; 2]>,
    fractions: [f64; 4],
    scene: Scene,
    camera: Pinhole,
}

impl<'a> Player<'a> {
    /// Player with the model's object at the start of the motion. Returns an error for impossible parameters.
    pub fn new(model: &Model, motion: &'a Motion, setting: &Setting, fidelity: Fidelity) -> Result<Self> {
        let mut simulation = EpisodeSimulation::new(model, &Registry::complete(), fidelity)?;
        // Without noise the target stands where the model has it.
        let target_m = model.task.filter(|_| !setting.noise).map(|t| t.target_m);
        let conditions = Conditions {
            theta: &setting.theta,
            effects: &setting.given,
            seed: setting.seed,
            noise: setting.noise,
            target_m,
        };
        simulation.prepare(&conditions)?;
        let target_m = model.task.and_then(|_| simulation.camera().plane_from_scaled(simulation.target_scaled()));
        let table_m = simulation.episode_model().beam.table.map(|t| t.height_m);
        let elements = simulation.beam().discretisation().elements;
        let start = model.arm.start;
        let mut player = Self {
            camera: side_view(simulation.camera()),
            scene: Scene::new(table_m, target_m, model.object.section, elements),
            arm: simulation.arm([start.x_m, start.z_m]),
            pitch_rad: start.pitch_rad,
            time_s: 0.0,
            target_m,
            fractions: model.object.keypoint_fractions,
            motion,
            simulation,
        };
        match motion {
            Motion::Actions { .. } => player.simulation.hang(start),
            Motion::Measured(m) => {
                player.simulation.follow(&m.grip, &m.start, &[0.0], &never_stop);
            }
        }
        Ok(player)
    }

    /// Advances the simulation to `time_s`.
    pub fn advance(&mut self, time_s: f64) {
        self.arm.run_to(time_s);
        let (motion, arm, pitch_rad) = (self.motion, &self.arm, self.pitch_rad);
        self.simulation.advance(time_s, |t| pose(motion, arm, pitch_rad, t));
        self.time_s = time_s;
    }

    /// Takes action number `step`. Returns the arm's new target (x, z) in m and the action; `None` after the last
    /// action.
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

    /// Velocity of the grip along x and z, m/s.
    pub fn velocity_m_s(&self) -> [f64; 2] {
        // A measured path has no velocity of its own; the arm model does.
        let Motion::Measured(measured) = self.motion else { return self.arm.velocity_m_s() };
        let (now, later) = (self.grip(), measured.grip.at(self.time_s + VELOCITY_BASE_S));
        [(later.x_m - now.x_m) / VELOCITY_BASE_S, (later.z_m - now.z_m) / VELOCITY_BASE_S]
    }

    /// Force and moment of the object on the hand: as the model's sensor measures them, or the true ones if the model does not observe them.
    pub fn wrench(&mut self) -> HandWrench {
        match self.simulation.wrench(self.time_s) {
            Some([x, z, moment_y_n_m]) => HandWrench { force_n: [x, z], moment_y_n_m },
            None => HandWrench::of(self.simulation.beam()),
        }
    }

    /// Keypoints and target as the model's camera sees them now.
    pub fn keypoints(&mut self) -> Keypoints {
        let size = f64::from(MASK_SIZE_PX);
        let px = |p: [f64; 2]| p.map(|v| 0.5 * (v + 1.0) * size);
        Keypoints {
            dlo_px: self.simulation.keypoints(self.time_s).map(px),
            target_px: self.target_m.map(|_| px(self.simulation.target_scaled())),
            scores: [1.0; 4],
            target_score: if self.target_m.is_some() { 1.0 } else { 0.0 },
            image_width_px: MASK_SIZE_PX,
            image_height_px: MASK_SIZE_PX,
        }
    }

    /// Keypoints where the object is now: without the faults of the model's camera, which pictures do not have either. None if a part of the
    /// object is behind the camera.
    pub fn true_keypoints_px(&self) -> Option<[[f64; 2]; 4]> {
        let places = self.simulation.visible_points_m(self.fractions);
        let [a, b, c, d] = places.map(|[x, z]| self.simulation.camera().mask_from_world([x, 0.0, z]));
        Some([a?, b?, c?, d?])
    }

    /// Keypoints in the plane of motion, (x, z) in m. A point without intersection is NaN.
    pub fn plane_m(&self, keypoints: &Keypoints) -> [[f64; 2]; 4] {
        keypoints.dlo_px.map(|px| self.simulation.camera().plane_from_mask(px).unwrap_or([f64::NAN; 2]))
    }

    /// Observation of the policy, from these keypoints.
    pub fn observation(&self, keypoints: &Keypoints) -> Observation {
        let grip = self.grip();
        let target = keypoints.target_scaled().unwrap_or_default();
        Observation::new([grip.x_m, grip.z_m], &keypoints.dlo_scaled(), target)
    }

    /// True if hand and target pose lie in the task's workspace; always true without actions.
    pub fn is_inside(&self) -> bool {
        let Motion::Actions { task, .. } = self.motion else { return true };
        let (grip, [x, z]) = (self.grip(), self.arm.target_m());
        task.workspace.contains(grip.x_m, 0.0, grip.z_m) && task.workspace.contains(x, 0.0, z)
    }

    /// Counters of the simulation.
    pub fn counters(&self) -> Counters {
        self.simulation.beam().counters()
    }

    /// Camera of the pictures.
    pub fn camera(&self) -> &Pinhole {
        &self.camera
    }

    /// Draws the moment as seen by `camera`, which is [`Player::camera`] or a variant of it; `frame` selects the noise.
    pub fn draw(&mut self, renderer: &mut Renderer, camera: &Pinhole, frame: u64) {
        self.scene.update(self.grip(), self.simulation.beam().nodes());
        renderer.draw(&self.scene, camera, frame);
    }
}

fn pose(motion: &Motion, arm: &ArmModel, pitch_rad: f64, time_s: f64) -> GripPose {
    match motion {
        Motion::Measured(m) => m.grip.at(time_s),
        Motion::Actions { .. } => arm.grip(time_s, pitch_rad),
    }
}

/// The model's camera. For a model in coordinates of the plane, a camera at the side that sees the same area.
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
