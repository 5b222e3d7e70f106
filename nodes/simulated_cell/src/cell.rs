//! Simulated cell: arm, object and camera, advanced in time under commands.

use crate::scene::{Contact, Part, Scene};
use catenary_core::camera::{Camera, Pinhole};
use catenary_core::{Fidelity, GripPose, Model, seed};
use catenary_simulator::Registry;
use catenary_simulator::arm::ArmModel;
use catenary_simulator::beam::{Beam, Counters};
use catenary_simulator::episode::{Conditions, EpisodeSimulation, jittered_target};
use catenary_simulator::parameters::ParameterError;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;
use thiserror::Error;

/// Error of a cell that cannot be made.
#[derive(Debug, Error, PartialEq)]
pub enum CellError {
    /// Parameters from which no object can be built.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// Camera that is not a pinhole: a cell draws pictures.
    #[error("model `{0}`: a simulated cell needs a pinhole camera")]
    Camera(String),
    /// Theta of the wrong length.
    #[error("theta: expected {expected} values, got {got}")]
    Theta {
        /// Expected length.
        expected: usize,
        /// Given length.
        got: usize,
    },
}

/// Wrench of the object on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HandWrench {
    /// Force along x and z in N, frame panda_link0.
    pub force_n: [f64; 2],
    /// Moment about y in N m, frame panda_link0.
    pub moment_y_n_m: f64,
}

impl HandWrench {
    /// Returns the wrench of a held beam on the hand.
    pub fn of(beam: &Beam) -> Self {
        let held = beam.grip_reaction();
        // The moment on the hand is minus the moment on the beam. Counter-clockwise in x-z is about -y. The two signs
        // cancel.
        Self { force_n: [-held.force_x_n, -held.force_z_n], moment_y_n_m: held.moment_n_m }
    }
}

/// State of the cell at one moment, as a picture needs it.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Pose of the grip.
    pub grip: GripPose,
    /// Nodes of the object: x, z in m and angle in rad.
    pub nodes: Vec<[f64; 3]>,
}

/// Moments that one picture is made of.
#[derive(Debug, Clone)]
pub struct Exposure {
    /// Bands of rows of equal height, from the first row on. Each band is the mean of the pictures of its moments.
    pub bands: Vec<Vec<Snapshot>>,
    /// True if the camera drops this frame and shows the one before.
    pub dropped: bool,
}

/// Number of bands of a picture with rolling shutter, and number of moments of an exposure.
// Each moment of each band costs one drawing of the scene: 12 at most.
const SHUTTER_BANDS: usize = 4;
const EXPOSURE_MOMENTS: usize = 3;
/// Random stream of dropped frames.
const DROP_STREAM: u64 = 29;

/// Simulated cell.
pub struct Cell {
    simulation: EpisodeSimulation,
    arm: ArmModel,
    pitch_rad: f64,
    time_s: f64,
    target_m: Option<[f64; 2]>,
    table_height_m: Option<f64>,
    camera: Pinhole,
    /// Snapshots of the last [`catenary_simulator::episode_model::CameraSettings::memory_s`], oldest first. Empty if the
    /// camera has no delay, no exposure time and no rolling shutter.
    past: VecDeque<(f64, Snapshot)>,
    drops: ChaCha8Rng,
    section: catenary_core::model::Section,
}

impl Cell {
    /// Makes a cell with the arm at the model's start pose and the object hanging at rest. The object has the
    /// parameters `theta`; effects, camera jitter and target jitter are drawn with `cell_seed`.
    ///
    /// # Errors
    /// [`CellError`] if theta has the wrong length, the parameters make no object, or the camera is not a pinhole.
    pub fn new(model: &Model, theta: &[f64], fidelity: Fidelity, cell_seed: u64) -> Result<Self, CellError> {
        let expected = model.theta.dimension();
        if theta.len() != expected {
            return Err(CellError::Theta { expected, got: theta.len() });
        }
        let target_m = model.task.map(|t| jittered_target(&t, cell_seed));
        let mut simulation = EpisodeSimulation::new(model, Registry::shipped(), fidelity)?;
        simulation.prepare(&Conditions { theta, effects: &[], seed: cell_seed, noise: true, target_m })?;
        let Camera::Pinhole(camera) = *simulation.camera() else { return Err(CellError::Camera(model.name.clone())) };
        let start = model.arm.start;
        simulation.hang(start);
        Ok(Self {
            arm: simulation.arm([start.x_m, start.z_m]),
            pitch_rad: start.pitch_rad,
            time_s: 0.0,
            target_m,
            table_height_m: simulation.episode_model().beam.table.map(|t| t.height_m),
            camera,
            past: VecDeque::new(),
            drops: seed::rng(cell_seed, DROP_STREAM),
            section: model.object.section,
            simulation,
        })
    }

    /// Returns the time in s since the cell was made.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns the camera, jitter included.
    pub fn camera(&self) -> &Pinhole {
        &self.camera
    }

    /// Commands the arm to go to (x, z) in m from now on.
    pub fn set_target(&mut self, target_m: [f64; 2]) {
        self.arm.set_target(self.time_s, target_m);
    }

    /// Advances to `time_s`. A time before the present one changes nothing.
    pub fn advance(&mut self, time_s: f64) {
        if time_s <= self.time_s {
            return;
        }
        self.arm.run_to(time_s);
        let (arm, pitch_rad) = (&self.arm, self.pitch_rad);
        self.simulation.advance(time_s, |t| arm.grip(t, pitch_rad));
        self.time_s = time_s;
        let memory_s = self.simulation.episode_model().camera.memory_s();
        if memory_s > 0.0 {
            self.past.push_back((time_s, self.snapshot()));
            // One snapshot older than the memory is kept, because the oldest moment of an exposure may lie between it and
            // the next snapshot.
            while self.past.len() > 1 && self.past[1].0 <= time_s - memory_s {
                self.past.pop_front();
            }
        }
    }

    /// Returns the snapshots of which a picture stamped with the present time consists. Their ages follow from the camera's
    /// delay, exposure time and rolling shutter.
    pub fn exposure(&mut self) -> Exposure {
        let camera = &self.simulation.episode_model().camera;
        let (delay_s, exposure_s, shutter_s) = (camera.frame_delay_s, camera.exposure_s, camera.rolling_shutter_s);
        let dropped = camera.dropped_share > 0.0 && self.drops.random::<f64>() < camera.dropped_share;
        let bands = if shutter_s > 0.0 { SHUTTER_BANDS } else { 1 };
        let moments = if exposure_s > 0.0 { EXPOSURE_MOMENTS } else { 1 };
        let band = |b: usize| {
            let row = (b as f64 + 0.5) / bands as f64;
            let moment = |m: usize| {
                // Rows are read from the first to the last, so that the first row is the oldest.
                let age_s = delay_s + shutter_s * (1.0 - row) + exposure_s * (m as f64 + 0.5) / moments as f64;
                self.snapshot_at(self.time_s - age_s)
            };
            (0..moments).map(moment).collect()
        };
        Exposure { bands: (0..bands).map(band).collect(), dropped }
    }

    /// Returns the kept snapshot nearest to `time_s`.
    fn snapshot_at(&self, time_s: f64) -> Snapshot {
        let nearest = self.past.iter().min_by(|a, b| (a.0 - time_s).abs().total_cmp(&(b.0 - time_s).abs()));
        nearest.map_or_else(|| self.snapshot(), |(_, snapshot)| snapshot.clone())
    }

    /// Returns the pose of the grip, without noise.
    pub fn grip(&self) -> GripPose {
        self.arm.grip(self.time_s, self.pitch_rad)
    }

    /// Returns the grip's velocity along x and z in m/s.
    pub fn velocity_m_s(&self) -> [f64; 2] {
        self.arm.velocity_m_s()
    }

    /// Returns the object's wrench on the hand.
    pub fn wrench(&self) -> HandWrench {
        HandWrench::of(self.simulation.beam())
    }

    /// Returns the counters of the object's simulation since the cell was made.
    pub fn counters(&self) -> Counters {
        self.simulation.beam().counters()
    }

    /// Returns the cell's state at the present moment.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { grip: self.grip(), nodes: self.simulation.beam().nodes().to_vec() }
    }

    /// Makes a scene for pictures and contact queries of this cell. [`Scene::update`] moves it to a snapshot.
    pub fn scene(&self) -> Scene {
        Scene::new(self.table_height_m, self.target_m, self.section, self.simulation.beam().discretisation().elements)
    }
}

/// Contacts that are collisions: gripper with table, or gripper with target.
pub fn collisions(contacts: &[Contact]) -> impl Iterator<Item = &Contact> {
    contacts.iter().filter(|t| t.first == Part::Gripper || t.second == Part::Gripper)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn soft_bar() -> Model {
        Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    fn cable() -> Model {
        Model::from_yaml(include_str!("../../../launch_configs/models/measured_cable.yaml")).unwrap()
    }

    fn cell() -> Cell {
        Cell::new(&soft_bar(), &[0.25, 2e4], Fidelity::Fast, 3).unwrap()
    }

    #[test]
    fn at_rest_the_hand_carries_the_weight() {
        let mut c = cell();
        c.advance(0.1);
        // Density times section times length times gravity of the shipped soft bar.
        let weight_n = 1055.0 * 0.015 * 0.015 * 0.25 * 9.81;
        assert!((c.wrench().force_n[1] + weight_n).abs() < 0.02 * weight_n, "{:?} against {weight_n} N", c.wrench());
        assert_eq!(c.velocity_m_s(), [0.0, 0.0]);
    }

    #[test]
    fn the_arm_goes_where_it_is_sent_and_the_object_follows() {
        let mut c = cell();
        let before = c.snapshot().nodes[20];
        c.set_target([0.5, 0.42]);
        c.advance(0.1);
        assert!(c.velocity_m_s()[0] > 0.1);
        c.advance(5.0);
        assert!((c.grip().x_m - 0.5).abs() < 1e-9);
        assert!((c.snapshot().nodes[20][0] - before[0] - 0.1).abs() < 0.02);
    }

    #[test]
    fn a_late_camera_with_a_rolling_shutter_sees_the_past_row_by_row() {
        let mut model = soft_bar();
        model.parameters.insert("frame_delay_s".into(), 0.1);
        model.parameters.insert("rolling_shutter_s".into(), 0.04);
        let mut c = Cell::new(&model, &[0.25, 2e4], Fidelity::Fast, 3).unwrap();
        c.set_target([0.5, 0.42]);
        (1..60).for_each(|i| c.advance(0.005 * f64::from(i)));
        let exposure = c.exposure();
        let x: Vec<f64> = exposure.bands.iter().map(|b| b[0].grip.x_m).collect();
        assert!(x.len() == 4 && x.is_sorted() && x[3] < c.grip().x_m - 0.01 && x[0] < x[3], "{x:?}");
        assert_eq!(cell().exposure().bands[0][0].grip, cell().grip());
    }

    #[test]
    fn time_does_not_run_back() {
        let mut c = cell();
        c.advance(0.2);
        let state = c.snapshot().nodes;
        c.advance(0.1);
        assert_eq!((c.time_s(), c.snapshot().nodes), (0.2, state));
    }

    #[test]
    fn a_hand_on_the_table_is_a_collision() {
        let mut c = cell();
        c.set_target([0.4, -0.01]);
        c.advance(3.0);
        let mut scene = c.scene();
        let s = c.snapshot();
        scene.update(s.grip, &s.nodes);
        let contacts = scene.contacts(0.0);
        assert_eq!(collisions(&contacts).count(), 1, "{contacts:?}");
    }

    #[test]
    fn a_cell_needs_a_camera_and_all_of_theta() {
        assert!(matches!(
            Cell::new(&cable(), &[0.1, 0.02, 0.0, 0.5, 0.05], Fidelity::Fast, 1),
            Err(CellError::Camera(_))
        ));
        assert_eq!(
            Cell::new(&soft_bar(), &[0.2], Fidelity::Fast, 1).err(),
            Some(CellError::Theta { expected: 2, got: 1 })
        );
    }
}
