//! What the simulator is asked for: the measured episode, as the model drives it.

use crate::error::InferenceError;
use catenary_core::episode::MeasuredTrack;
use catenary_core::model::DriveKind;
use catenary_core::{Drive, Fidelity, Model, Policy, SimulationRequest, Track};

/// A measured episode, and what the simulator is asked for to reproduce it.
#[derive(Debug, Clone)]
pub struct Observed<'a> {
    /// What was measured.
    pub track: &'a Track,
    /// The request that reproduces it, without thetas and seed.
    pub template: SimulationRequest,
    /// F, the greatest number of frames of any of its tracks.
    pub frames: usize,
}

impl<'a> Observed<'a> {
    /// `measured` as `model` drives it; see [`request`].
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

/// The request that reproduces `measured`, without thetas and seed, and the greatest number of frames of a track (F).
/// `policy` is the one that the episode ran; only a model that drives by policy needs it.
pub fn request(
    model: &Model,
    measured: &MeasuredTrack,
    policy: Option<&Policy>,
    fidelity: Fidelity,
) -> Result<(SimulationRequest, usize), InferenceError> {
    let missing = |drive, expected| InferenceError::Drive { drive, expected };
    let seen = measured.track.frames.len();
    let (drive, frames) = match model.observation.drive {
        DriveKind::Grip => (Drive::Grip(measured.grip.clone()), seen),
        DriveKind::Actions if measured.actions.is_empty() => {
            return Err(missing("actions", "the episode's actions"));
        }
        DriveKind::Actions => (Drive::Actions(measured.actions.clone()), seen.max(measured.actions.len() + 1)),
        DriveKind::Policy => {
            let policy = policy.ok_or(missing("policy", "the policy that the episode ran"))?;
            (Drive::Policy(Box::new(policy.clone())), seen.max(policy.steps + 1))
        }
    };
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
