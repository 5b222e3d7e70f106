//! A simulated cell: arm, object and camera, advancing in time under commands.

use crate::arm::ArmModel;
use crate::beam::{Beam, Counters};
use crate::effects::Registry;
use crate::episode::{Conditions, Stage, jittered_target};
use crate::parameters::ParameterError;
use crate::scene::{Part, Scene, Touch};
use catenary_core::camera::{Camera, Pinhole};
use catenary_core::{Fidelity, GripPose, Model, seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;
use thiserror::Error;

/// Why a cell was not made.
#[derive(Debug, Error, PartialEq)]
pub enum CellError {
    /// The model's parameters make no object.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// A cell draws pictures, so its camera must be a pinhole.
    #[error("model `{0}`: a simulated cell needs a pinhole camera")]
    Camera(String),
    /// Theta of the wrong length.
    #[error("theta: expected {expected} values, got {got}")]
    Theta {
        /// Length wanted.
        expected: usize,
        /// Length given.
        got: usize,
    },
}

/// Forces of the object on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HandWrench {
    /// Force along x and z in N, frame panda_link0.
    pub force_n: [f64; 2],
    /// Moment about y in N m, frame panda_link0.
    pub moment_y_n_m: f64,
}

impl HandWrench {
    /// The reaction to what holds the object.
    pub fn of(beam: &Beam) -> Self {
        let held = beam.grip_reaction();
        // A counter-clockwise moment in the x-z plane turns about -y.
        Self { force_n: [-held.force_x_n, -held.force_z_n], moment_y_n_m: held.moment_n_m }
    }
}

/// Everything that a picture needs, taken at one moment.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Pose of the grip.
    pub grip: GripPose,
    /// Nodes of the object: x, z in m and angle in rad.
    pub nodes: Vec<[f64; 3]>,
}

/// What one picture is made of.
#[derive(Debug, Clone)]
pub struct Light {
    /// Bands of rows of equal height from the first row on; a picture of each band is the mean over its moments.
    pub bands: Vec<Vec<Snapshot>>,
    /// Whether the camera drops this frame and shows the one before.
    pub dropped: bool,
}

/// Bands into which a rolling shutter's picture is divided, and moments at which an exposure is looked at.
const SHUTTER_BANDS: usize = 4;
const EXPOSURE_MOMENTS: usize = 3;
/// Random stream of dropped frames.
const DROP_STREAM: u64 = 29;

/// The cell.
pub struct Cell {
    stage: Stage,
    arm: ArmModel,
    pitch_rad: f64,
    time_s: f64,
    target_m: Option<[f64; 2]>,
    table_height_m: Option<f64>,
    camera: Pinhole,
    /// Snapshots of the last [`crate::world::View::memory_s`], oldest first, where the camera needs them.
    past: VecDeque<(f64, Snapshot)>,
    drops: ChaCha8Rng,
    section: catenary_core::model::Section,
}

impl Cell {
    /// A cell whose object has the parameters `theta` and whose effects, camera jitter and target jitter are drawn with
    /// `cell_seed`. The arm is at the model's start pose and the object hangs at rest.
    pub fn new(model: &Model, theta: &[f64], fidelity: Fidelity, cell_seed: u64) -> Result<Self, CellError> {
        let expected = model.theta.dimension();
        if theta.len() != expected {
            return Err(CellError::Theta { expected, got: theta.len() });
        }
        let target_m = model.task.map(|t| jittered_target(&t, cell_seed));
        let mut stage = Stage::new(model, Registry::shipped(), fidelity)?;
        stage.prepare(&Conditions { theta, effects: &[], seed: cell_seed, noise: true, target_m })?;
        let Camera::Pinhole(camera) = *stage.camera() else { return Err(CellError::Camera(model.name.clone())) };
        let start = model.arm.start;
        stage.hang(start);
        Ok(Self {
            arm: stage.arm([start.x_m, start.z_m]),
            pitch_rad: start.pitch_rad,
            time_s: 0.0,
            target_m,
            table_height_m: stage.world().beam.table.map(|t| t.height_m),
            camera,
            past: VecDeque::new(),
            drops: seed::rng(cell_seed, DROP_STREAM),
            section: model.object.section,
            stage,
        })
    }

    /// Time since the cell was made, s.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The camera, jitter included.
    pub fn camera(&self) -> &Pinhole {
        &self.camera
    }

    /// From now on the arm goes to (x, z) in m.
    pub fn set_target(&mut self, target_m: [f64; 2]) {
        self.arm.set_target(self.time_s, target_m);
    }

    /// Lets time run on to `time_s`; a time before the present one changes nothing.
    pub fn advance(&mut self, time_s: f64) {
        if time_s <= self.time_s {
            return;
        }
        self.arm.run_to(time_s);
        let (arm, pitch_rad) = (&self.arm, self.pitch_rad);
        self.stage.advance(time_s, |t| arm.grip(t, pitch_rad));
        self.time_s = time_s;
        let memory_s = self.stage.world().view.memory_s();
        if memory_s > 0.0 {
            self.past.push_back((time_s, self.snapshot()));
            while self.past.len() > 1 && self.past[1].0 <= time_s - memory_s {
                self.past.pop_front();
            }
        }
    }

    /// What a picture stamped with the present time is made of, as delay, exposure and shutter of the camera have it.
    pub fn light(&mut self) -> Light {
        let view = &self.stage.world().view;
        let (delay_s, exposure_s, shutter_s) = (view.frame_delay_s, view.exposure_s, view.rolling_shutter_s);
        let dropped = view.dropped_share > 0.0 && self.drops.random::<f64>() < view.dropped_share;
        let bands = if shutter_s > 0.0 { SHUTTER_BANDS } else { 1 };
        let moments = if exposure_s > 0.0 { EXPOSURE_MOMENTS } else { 1 };
        let band = |b: usize| {
            let row = (b as f64 + 0.5) / bands as f64;
            let moment = |m: usize| {
                let age_s = delay_s + shutter_s * (1.0 - row) + exposure_s * (m as f64 + 0.5) / moments as f64;
                self.snapshot_at(self.time_s - age_s)
            };
            (0..moments).map(moment).collect()
        };
        Light { bands: (0..bands).map(band).collect(), dropped }
    }

    /// The snapshot nearest to `time_s` among those kept.
    fn snapshot_at(&self, time_s: f64) -> Snapshot {
        let nearest = self.past.iter().min_by(|a, b| (a.0 - time_s).abs().total_cmp(&(b.0 - time_s).abs()));
        nearest.map_or_else(|| self.snapshot(), |(_, snapshot)| snapshot.clone())
    }

    /// The measured pose of the grip.
    pub fn grip(&self) -> GripPose {
        self.arm.grip(self.time_s, self.pitch_rad)
    }

    /// The grip's velocity along x and z in m/s.
    pub fn velocity_m_s(&self) -> [f64; 2] {
        self.arm.velocity_m_s()
    }

    /// The object's pull on the hand.
    pub fn wrench(&self) -> HandWrench {
        HandWrench::of(self.stage.beam())
    }

    /// What the object's simulation did since the cell was made.
    pub fn counters(&self) -> Counters {
        self.stage.beam().counters()
    }

    /// What a picture of this moment needs.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { grip: self.grip(), nodes: self.stage.beam().nodes().to_vec() }
    }

    /// A scene for pictures and contact queries of this cell; [`Scene::update`] brings it up to a snapshot.
    pub fn scene(&self) -> Scene {
        Scene::new(self.table_height_m, self.target_m, self.section, self.stage.beam().discretisation().elements)
    }
}

/// What must not touch: the gripper and the table, or the gripper and the target.
pub fn collisions(touches: &[Touch]) -> impl Iterator<Item = &Touch> {
    touches.iter().filter(|t| t.first == Part::Gripper || t.second == Part::Gripper)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::tests::{cable, soft_bar};

    fn cell() -> Cell {
        Cell::new(&soft_bar(), &[0.25, 2e4], Fidelity::Fast, 3).unwrap()
    }

    #[test]
    fn at_rest_the_hand_carries_the_weight() {
        let mut c = cell();
        c.advance(0.1);
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
    fn a_late_camera_with_a_rolling_shutter_sees_what_was() {
        let mut model = soft_bar();
        model.parameters.insert("frame_delay_s".into(), 0.1);
        model.parameters.insert("rolling_shutter_s".into(), 0.04);
        let mut c = Cell::new(&model, &[0.25, 2e4], Fidelity::Fast, 3).unwrap();
        c.set_target([0.5, 0.42]);
        (1..60).for_each(|i| c.advance(0.005 * f64::from(i)));
        let light = c.light();
        let x: Vec<f64> = light.bands.iter().map(|b| b[0].grip.x_m).collect();
        assert!(x.len() == 4 && x.is_sorted() && x[3] < c.grip().x_m - 0.01 && x[0] < x[3], "{x:?}");
        assert_eq!(cell().light().bands[0][0].grip, cell().grip());
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
        let touches = scene.touches(0.0);
        assert_eq!(collisions(&touches).count(), 1, "{touches:?}");
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
