//! Request to the simulator that reproduces a measured episode.

use crate::error::InferenceError;
use catenary_core::episode::MeasuredTrack;
use catenary_core::model::DriveKind;
use catenary_core::{Drive, Fidelity, Model, Policy, SimulationRequest, Track};

/// Measured episode with the request that reproduces it.
#[derive(Debug, Clone)]
pub struct Observed<'a> {
    /// Measured track.
    pub track: &'a Track,
    /// Request that reproduces the episode, without thetas and seed.
    pub template: SimulationRequest,
    /// F, largest number of frames of its simulated tracks.
    pub frames: usize,
}

impl<'a> Observed<'a> {
    /// Pairs `measured` with its request under `model`; see [`request`].
    ///
    /// # Errors
    /// [`InferenceError::Drive`] if the drive of the model is missing.
    pub fn new(
        model: &Model,
        measured: &'a MeasuredTrack,
        policy: Option<&Policy>,
        fidelity: Fidelity,
    ) -> Result<Self, InferenceError> {
        let (template, frames) = request(model, measured, policy, fidelity)?;
        Ok(Self { track: &measured.track, template, frames })
    }
}

/// Returns the request that reproduces `measured`, without thetas and seed, and the largest number of frames of a track (F).
/// `policy` is the policy of the episode, needed by a model that drives by policy.
///
/// # Errors
/// [`InferenceError::Drive`] if the episode has no actions, or no policy is given, though the model drives by them.
pub fn request(
    model: &Model,
    measured: &MeasuredTrack,
    policy: Option<&Policy>,
    fidelity: Fidelity,
) -> Result<(SimulationRequest, usize), InferenceError> {
    let missing = |drive, expected| InferenceError::Drive { drive, expected };
    let seen = measured.track.frames.len();
    // A frame before the first action, after each, and after each step of a rest.
    let frames = |actions: usize| 1 + actions + model.task.map_or(0, |task| task.rest_after(actions));
    let (drive, frames) = match model.observation.drive {
        DriveKind::Grip => (Drive::Grip(measured.grip.clone()), seen),
        DriveKind::Actions if measured.actions.is_empty() => {
            return Err(missing("actions", "the episode's actions"));
        }
        DriveKind::Actions => (Drive::Actions(measured.actions.clone()), seen.max(frames(measured.actions.len()))),
        DriveKind::Policy => {
            let policy = policy.ok_or(missing("policy", "the policy that the episode ran"))?;
            (Drive::Policy(Box::new(policy.clone())), seen.max(frames(policy.steps)))
        }
    };
    // A trajectory is sampled at the measured times. Actions and policies have a frame at the end of each step.
    let frame_times_s = match model.observation.drive {
        DriveKind::Grip => measured.track.frames.iter().map(|f| f.time_s).collect(),
        DriveKind::Actions | DriveKind::Policy => Vec::new(),
    };
    let request = SimulationRequest {
        thetas: Vec::new(),
        effects: Vec::new(),
        drive,
        start: measured.start.clone(),
        frame_times_s,
        target_m: measured.target_m,
        fidelity,
        seed: 0,
        first_episode: 0,
        noise: true,
    };
    Ok((request, frames))
}
