//! Settings of one episode: beam, grip, arm and camera, effects included.

use crate::beam::{BeamParameters, StartChange, Terms};
use catenary_core::model::ArmLaw;
use catenary_core::{Camera, DeltaAnchor};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Answer of a table's effect if the model has no table.
pub const NO_TABLE: &str = "a model with a table (table_height_m), got one without";

/// Settings of one episode. Effects change them before the episode starts.
#[derive(Debug, Clone)]
pub struct EpisodeModel {
    /// Object, table, gravity and grip.
    pub beam: BeamParameters,
    /// Terms from outside: forces, materials and grips that [`BeamParameters`] has no field for.
    pub terms: Terms,
    /// Change of the object's state at the start.
    pub start: StartChange,
    /// Angle in rad of the clamped tangent from +x at pitch 0, counter-clockwise.
    pub grip_angle_rad: f64,
    /// Arm.
    pub arm: ArmSettings,
    /// Camera.
    pub camera: CameraSettings,
    /// Sensor of the wrench on the hand; none if the model does not observe the wrench.
    pub wrench: Option<WrenchSettings>,
    /// Slip of the strands to which the effect of their friction refers.
    pub strand_slip: StrandSlip,
    /// Place of a bend of the unloaded object, as a fraction of the length from the grip.
    pub rest_bend_place: f64,
    /// Numbers that the expressions of the model file name, as far as something gives their values.
    pub expression_numbers: BTreeMap<&'static str, f64>,
    /// Place and frequency of the templates.
    pub templates: Companions,
    /// Place and frequency of the unlisted effects.
    pub unlisted: Companions,
}

/// Answer of an effect of the wrench's sensor if the model does not observe the wrench.
pub const NO_WRENCH: &str = "a model that observes the wrench (observation.wrench)";

/// Sensor of the wrench on the hand. Wrenches are in the order of [`catenary_core::Frame::wrench`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrenchSettings {
    /// Bias: measured less true wrench, in N, N and N m.
    pub bias: [f64; 3],
    /// Age in s of a wrench at its stamp.
    pub delay_s: f64,
    /// Standard deviations of the noise, in N, N and N m.
    pub noise_sd: [f64; 3],
}

impl WrenchSettings {
    /// Makes the settings of a sensor without faults but noise.
    pub fn new(noise_sd: [f64; 3]) -> Self {
        Self { bias: [0.0; 3], delay_s: 0.0, noise_sd }
    }
}

/// Values that set where and how fast effects act. They do nothing alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Companions {
    /// Place, as a fraction of the length from the grip (0) to the tip (1).
    pub place: f64,
    /// Frequency in Hz.
    pub frequency_hz: f64,
}

impl Default for Companions {
    fn default() -> Self {
        Self { place: 0.5, frequency_hz: 1.0 }
    }
}

/// Slip of a cable's strands, for the effect of their friction. It does nothing alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrandSlip {
    /// Turn of the whole length in rad at which strands slip: slip moment over sticking stiffness, times the length.
    pub turn_rad: f64,
    /// Ratio of the greatest to the least curvature at which strands slip: 1 if all slip at once.
    pub spread: f64,
}

impl Default for StrandSlip {
    fn default() -> Self {
        // The turn is about the median of its prior.
        Self { turn_rad: 0.17, spread: 1.0 }
    }
}

/// Settings of the arm: how it follows its commands.
#[derive(Clone)]
pub struct ArmSettings {
    /// Law of motion.
    pub law: ArmLaw,
    /// Delay in s before the arm begins to follow a target.
    pub delay_s: f64,
    /// Time constant in s in addition to the law's own.
    pub extra_lag_s: f64,
    /// Standing error: distance in m from the target at which the arm stops.
    pub standing_error_m: f64,
    /// Anchor that a delta is added to.
    pub anchor: DeltaAnchor,
    /// Share, 0 to 1, of the other anchor.
    pub other_anchor_share: f64,
    /// Changes of the targets, in the order in which they act.
    pub terms: Vec<Arc<dyn ActuationTerm>>,
    /// Changes of the displacements. Their excesses add up.
    pub displacements: Vec<Arc<dyn DisplacementTerm>>,
}

impl ArmSettings {
    /// Makes the settings of an arm without delay, lag or standing error.
    pub fn new(law: ArmLaw, anchor: DeltaAnchor) -> Self {
        Self {
            law,
            delay_s: 0.0,
            extra_lag_s: 0.0,
            standing_error_m: 0.0,
            anchor,
            other_anchor_share: 0.0,
            terms: Vec::new(),
            displacements: Vec::new(),
        }
    }
}

/// Change of the displacements that the arm executes.
pub trait DisplacementTerm: Send + Sync {
    /// Returns the excess (x, z) in m of the executed displacement over the commanded one.
    fn excess_m(&self, displacement_m: [f64; 2]) -> [f64; 2];
}

/// Change of the arm's targets.
pub trait ActuationTerm: Send + Sync {
    /// Returns the target (x, z) in m that the arm follows if `target_m` is commanded at `time_s`.
    fn target(&self, time_s: f64, target_m: [f64; 2]) -> [f64; 2];
}

/// Settings of the camera: how the object is seen.
#[derive(Clone)]
pub struct CameraSettings {
    /// Projection, without the episode's jitter.
    pub view: Camera,
    /// Standard deviation of a keypoint coordinate in mask pixels.
    pub keypoint_noise_px: f64,
    /// Shift of the keypoints towards the tip, as a share of the visible length.
    pub keypoint_shift: f64,
    /// Age in s of a frame's content at its stamp.
    pub frame_delay_s: f64,
    /// Exposure in s. It ends at the frame's age.
    pub exposure_s: f64,
    /// Read-out time in s: the first row is older than the last by this time.
    pub rolling_shutter_s: f64,
    /// Share of frames that repeat the one before.
    pub dropped_share: f64,
    /// Changes of the keypoints, in the order in which they act.
    pub terms: Vec<Arc<dyn ObservationTerm>>,
}

impl CameraSettings {
    /// Makes the settings of a camera without faults but keypoint noise.
    pub fn new(camera: Camera, keypoint_noise_px: f64) -> Self {
        Self {
            view: camera,
            keypoint_noise_px,
            keypoint_shift: 0.0,
            frame_delay_s: 0.0,
            exposure_s: 0.0,
            rolling_shutter_s: 0.0,
            dropped_share: 0.0,
            terms: Vec::new(),
        }
    }

    /// Returns the age in s of the oldest light in a frame.
    pub fn memory_s(&self) -> f64 {
        self.frame_delay_s + self.exposure_s + self.rolling_shutter_s
    }
}

/// Change of the tracked keypoints.
pub trait ObservationTerm: Send + Sync {
    /// Changes the keypoints of a frame stamped `time_s`, before noise. Coordinates are scaled to -1 .. 1 over the
    /// mask.
    fn change(&self, time_s: f64, keypoints: &mut [[f64; 2]; 4]);
}

impl std::fmt::Debug for ArmSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { law, delay_s, extra_lag_s, standing_error_m, anchor, other_anchor_share, terms, displacements } =
            self;
        f.debug_struct("ArmSettings")
            .field("law", law)
            .field("delay_s", delay_s)
            .field("extra_lag_s", extra_lag_s)
            .field("standing_error_m", standing_error_m)
            .field("anchor", anchor)
            .field("other_anchor_share", other_anchor_share)
            .field("terms", &terms.len())
            .field("displacements", &displacements.len())
            .finish()
    }
}

impl std::fmt::Debug for CameraSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { view, terms, .. } = self;
        f.debug_struct("CameraSettings")
            .field("view", view)
            .field("keypoint_noise_px", &self.keypoint_noise_px)
            .field("keypoint_shift", &self.keypoint_shift)
            .field("frame_delay_s", &self.frame_delay_s)
            .field("exposure_s", &self.exposure_s)
            .field("rolling_shutter_s", &self.rolling_shutter_s)
            .field("dropped_share", &self.dropped_share)
            .field("terms", &terms.len())
            .finish()
    }
}
