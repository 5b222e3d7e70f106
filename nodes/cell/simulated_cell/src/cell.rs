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
        let [x, z, moment_y_n_m] = beam.wrench_on_hand();
        Self { force_n: [x, z], moment_y_n_m }
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

/// Hand that holds the object.
enum Hand {
    /// Simulated arm, with the pitch of its hand, rad.
    Arm(Box<ArmModel>, f64),
    /// Hand of an arm elsewhere: its last two poses and their times in s.
    Elsewhere([(f64, GripPose); 2]),
}

impl Hand {
    fn grip(&self, time_s: f64) -> GripPose {
        match self {
            Self::Arm(arm, pitch_rad) => arm.grip(time_s, *pitch_rad),
            Self::Elsewhere([(t0_s, from), (t1_s, to)]) => {
                let share = if t1_s > t0_s { ((time_s - t0_s) / (t1_s - t0_s)).clamp(0.0, 1.0) } else { 1.0 };
                let between = |a: f64, b: f64| a + share * (b - a);
                GripPose {
                    x_m: between(from.x_m, to.x_m),
                    z_m: between(from.z_m, to.z_m),
                    pitch_rad: between(from.pitch_rad, to.pitch_rad),
                }
            }
        }
    }
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
    hand: Hand,
    time_s: f64,
    /// Time at which the object's simulation began: it counts from there.
    object_began_s: f64,
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
        let start = model.arm.start;
        let mut cell = Self::elsewhere(model, theta, fidelity, cell_seed, start)?;
        cell.hand = Hand::Arm(Box::new(cell.simulation.arm([start.x_m, start.z_m])), start.pitch_rad);
        Ok(cell)
    }

    /// Makes a cell whose object hangs at rest in the hand of an arm elsewhere; [`Cell::follow`] moves the hand. Otherwise as
    /// [`Cell::new`].
    ///
    /// # Errors
    /// As [`Cell::new`].
    pub fn elsewhere(
        model: &Model,
        theta: &[f64],
        fidelity: Fidelity,
        cell_seed: u64,
        start: GripPose,
    ) -> Result<Self, CellError> {
        let expected = model.theta.dimension();
        if theta.len() != expected {
            return Err(CellError::Theta { expected, got: theta.len() });
        }
        let target_m = model.task.map(|t| jittered_target(&t, cell_seed));
        let mut simulation = EpisodeSimulation::new(model, Registry::shipped(), fidelity)?;
        simulation.prepare(&Conditions { theta, effects: &[], seed: cell_seed, noise: true, target_m })?;
        let Camera::Pinhole(camera) = *simulation.camera() else { return Err(CellError::Camera(model.name.clone())) };
        simulation.hang(start);
        Ok(Self {
            hand: Hand::Elsewhere([(0.0, start); 2]),
            time_s: 0.0,
            object_began_s: 0.0,
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

    /// Commands the arm to go to (x, z) in m from now on. A hand elsewhere has no target here.
    pub fn set_target(&mut self, target_m: [f64; 2]) {
        if let Hand::Arm(arm, _) = &mut self.hand {
            arm.set_target(self.time_s, target_m);
        }
    }

    /// Advances to `time_s`, at which the hand elsewhere has this pose. Between two calls it moves on a straight line.
    pub fn follow(&mut self, time_s: f64, grip: GripPose) {
        if time_s > self.time_s {
            self.hand = Hand::Elsewhere([(self.time_s, self.grip()), (time_s, grip)]);
            self.advance(time_s);
        }
    }

    /// Advances to `time_s`. A time before the present one changes nothing.
    pub fn advance(&mut self, time_s: f64) {
        if time_s <= self.time_s {
            return;
        }
        if let Hand::Arm(arm, _) = &mut self.hand {
            arm.run_to(time_s);
        }
        let (hand, began_s) = (&self.hand, self.object_began_s);
        self.simulation.advance(time_s - began_s, |t| hand.grip(began_s + t));
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

    /// Stills the object: from now on it hangs at rest from the hand, as at the start of the cell, and what ages in it begins anew.
    pub fn still(&mut self) {
        self.simulation.hang(self.grip());
        self.object_began_s = self.time_s;
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
        self.hand.grip(self.time_s)
    }

    /// Returns the grip's velocity along x and z in m/s.
    pub fn velocity_m_s(&self) -> [f64; 2] {
        match &self.hand {
            Hand::Arm(arm, _) => arm.velocity_m_s(),
            Hand::Elsewhere([(t0_s, from), (t1_s, to)]) if t1_s > t0_s => {
                [to.x_m - from.x_m, to.z_m - from.z_m].map(|d| d / (t1_s - t0_s))
            }
            Hand::Elsewhere(_) => [0.0; 2],
        }
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
        Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    fn cable() -> Model {
        Model::from_yaml(include_str!("../../../../launch_configs/models/measured_cable.yaml")).unwrap()
    }

    fn cell() -> Cell {
        Cell::new(&soft_bar(), &[0.25, 2e4], Fidelity::Fast, 3).unwrap()
    }

    #[test]
    fn a_stilled_object_hangs_as_at_the_start_and_then_moves_on() {
        let tip_m = |c: &Cell| c.snapshot().nodes.last().map(|n| [n[0], n[1]]).unwrap();
        let lean_m = |c: &Cell| tip_m(c)[0] - c.grip().x_m;
        let mut c = cell();
        let at_rest_m = lean_m(&c);
        c.set_target([0.5, 0.4]);
        c.advance(0.4);
        let swinging = (0..100).map(|k| {
            c.advance(0.4 + 0.01 * f64::from(k));
            (lean_m(&c) - at_rest_m).abs()
        });
        assert!(swinging.fold(0.0, f64::max) > 0.02);
        let before = c.time_s();
        c.still();
        assert_eq!(c.time_s(), before);
        assert!((lean_m(&c) - at_rest_m).abs() < 2e-3, "{} {at_rest_m}", lean_m(&c));
        // It stays there, and it swings again when the hand moves.
        c.advance(before + 1.0);
        assert!((lean_m(&c) - at_rest_m).abs() < 2e-3);
        c.set_target([0.4, 0.4]);
        c.advance(before + 1.2);
        assert!((lean_m(&c) - at_rest_m).abs() > 0.02);
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
    fn the_object_follows_a_hand_elsewhere_as_it_follows_the_simulated_arm() {
        let mut own = cell();
        let mut other = Cell::elsewhere(&soft_bar(), &[0.25, 2e4], Fidelity::Fast, 3, own.grip()).unwrap();
        own.set_target([0.45, 0.42]);
        for step in 1..=200 {
            let time_s = 0.005 * f64::from(step);
            own.advance(time_s);
            other.follow(time_s, own.grip());
        }
        let (a, b) = (own.snapshot().nodes[20], other.snapshot().nodes[20]);
        assert!((a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-4, "{a:?} {b:?}");
        assert_eq!(own.velocity_m_s().map(|v| v > 0.0), other.velocity_m_s().map(|v| v > 0.0));
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
            Cell::new(&cable(), &[0.1, 0.02, 0.0, 0.5, 0.05, 1.0, 0.0], Fidelity::Fast, 1),
            Err(CellError::Camera(_))
        ));
        assert_eq!(
            Cell::new(&soft_bar(), &[0.2], Fidelity::Fast, 1).err(),
            Some(CellError::Theta { expected: 2, got: 1 })
        );
    }
}
