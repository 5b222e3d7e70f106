//! The world of one episode: everything that the simulator is made of, effects included.

use crate::beam::{BeamParameters, Terms};
use catenary_core::model::ArmLaw;
use catenary_core::{Camera, DeltaAnchor};
use std::sync::Arc;

/// What an effect of the table answers where there is none.
pub const NO_TABLE: &str = "a model with a table (table_height_m)";

/// What an episode consists of. Effects change it before the episode starts.
#[derive(Debug, Clone)]
pub struct World {
    /// The object, the table, gravity, and how the object is held.
    pub beam: BeamParameters,
    /// Forces, materials and ways of holding that the beam does not know itself.
    pub terms: Terms,
    /// Angle in rad of the clamped tangent from +x at pitch 0, counter-clockwise.
    pub grip_angle_rad: f64,
    /// The arm.
    pub arm: ArmSettings,
    /// How the object is seen.
    pub view: View,
}

/// How the arm follows its commands.
#[derive(Clone)]
pub struct ArmSettings {
    /// The law of its motion.
    pub law: ArmLaw,
    /// Time in s before it begins to follow a target.
    pub delay_s: f64,
    /// Time constant in s on top of the law's own.
    pub extra_lag_s: f64,
    /// Distance in m from the target at which it sticks.
    pub standing_error_m: f64,
    /// What a delta is added to.
    pub anchor: DeltaAnchor,
    /// Share, 0 to 1, of the other anchor.
    pub other_anchor_share: f64,
    /// Changes of the targets, in order.
    pub terms: Vec<Arc<dyn ActuationTerm>>,
}

impl ArmSettings {
    /// An arm of that law, without anything else.
    pub fn new(law: ArmLaw, anchor: DeltaAnchor) -> Self {
        Self {
            law,
            delay_s: 0.0,
            extra_lag_s: 0.0,
            standing_error_m: 0.0,
            anchor,
            other_anchor_share: 0.0,
            terms: Vec::new(),
        }
    }
}

/// A change of what the arm is told.
pub trait ActuationTerm: Send + Sync {
    /// The target (x, z) in m that the arm follows when `target_m` is commanded at `time_s`.
    fn target(&self, time_s: f64, target_m: [f64; 2]) -> [f64; 2];
}

/// How the object is seen.
#[derive(Clone)]
pub struct View {
    /// The camera, without the jitter of the episode.
    pub camera: Camera,
    /// Standard deviation of a keypoint coordinate in mask pixels.
    pub keypoint_noise_px: f64,
    /// Shift of the keypoints towards the tip, as a share of the visible length.
    pub keypoint_shift: f64,
    /// Age in s of what a frame shows.
    pub frame_delay_s: f64,
    /// Time in s over which a frame gathers light, up to its age.
    pub exposure_s: f64,
    /// Time in s by which the first row is older than the last.
    pub rolling_shutter_s: f64,
    /// Share of frames that show what the one before showed.
    pub dropped_share: f64,
    /// Changes of the keypoints, in order.
    pub terms: Vec<Arc<dyn ObservationTerm>>,
}

impl View {
    /// A camera without faults.
    pub fn new(camera: Camera, keypoint_noise_px: f64) -> Self {
        Self {
            camera,
            keypoint_noise_px,
            keypoint_shift: 0.0,
            frame_delay_s: 0.0,
            exposure_s: 0.0,
            rolling_shutter_s: 0.0,
            dropped_share: 0.0,
            terms: Vec::new(),
        }
    }

    /// Age in s of the oldest light in a frame.
    pub fn memory_s(&self) -> f64 {
        self.frame_delay_s + self.exposure_s + self.rolling_shutter_s
    }
}

/// A change of what the camera's tracker says.
pub trait ObservationTerm: Send + Sync {
    /// Changes the keypoints of a frame with that stamp, in coordinates scaled to -1 .. 1 over the mask, before noise.
    fn change(&self, time_s: f64, keypoints: &mut [[f64; 2]; 4]);
}

impl std::fmt::Debug for ArmSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { law, delay_s, extra_lag_s, standing_error_m, anchor, other_anchor_share, terms } = self;
        f.debug_struct("ArmSettings")
            .field("law", law)
            .field("delay_s", delay_s)
            .field("extra_lag_s", extra_lag_s)
            .field("standing_error_m", standing_error_m)
            .field("anchor", anchor)
            .field("other_anchor_share", other_anchor_share)
            .field("terms", &terms.len())
            .finish()
    }
}

impl std::fmt::Debug for View {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { camera, terms, .. } = self;
        f.debug_struct("View")
            .field("camera", camera)
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
