//! Batch simulator: the interface through which inference reaches a simulator.

use crate::{Frame, GripTrajectory, Policy, Track};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use thiserror::Error;

/// Resolution of a simulation in time and along the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// Coarse time steps, for training.
    Fast,
    /// Mesh of `Reference` and time steps of `Fast`, for soft objects that fold or lie down.
    FineMesh,
    /// Resolution for inference.
    #[default]
    Standard,
    /// Fine mesh and time steps, for simulated cells with a hidden truth and for checks.
    Reference,
}

impl Fidelity {
    /// All fidelities.
    pub const ALL: [Fidelity; 4] = [Fidelity::Fast, Fidelity::FineMesh, Fidelity::Standard, Fidelity::Reference];

    /// Name in files, messages and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Fidelity::Fast => "fast",
            Fidelity::FineMesh => "fine_mesh",
            Fidelity::Standard => "standard",
            Fidelity::Reference => "reference",
        }
    }

    /// Purpose in a few words, for `--help`.
    pub fn description(self) -> &'static str {
        match self {
            Fidelity::Fast => "coarse time steps, for training",
            Fidelity::FineMesh => {
                "the mesh of reference in the time steps of fast, for soft objects that fold or lie down"
            }
            Fidelity::Standard => "for inference",
            Fidelity::Reference => "fine mesh and time steps, for truths and checks",
        }
    }

    /// Fidelity with this name; none if no fidelity has it.
    pub fn from_name(name: &str) -> Option<Fidelity> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// Drive of the clamped end.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum Drive {
    /// It follows a measured path.
    Grip(GripTrajectory),
    /// The model's arm executes these actions (dx, dz) in m, one a step.
    Actions(Vec<[f64; 2]>),
    /// The model's arm executes the mean actions of this policy, up to the task's end.
    Policy(Box<Policy>),
}

/// Shape of the object at the start.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub enum StartShape {
    /// It hangs at rest from the grip, as after a lift.
    #[default]
    HangingAtRest,
    /// It passes through four moving points of its centre line.
    Measured {
        /// (x, z) in m, frame panda_link0, at the model's keypoint fractions of the length, from the grip on.
        points_m: [[f64; 2]; 4],
        /// Velocities (x, z) of the points in m/s.
        velocities_m_s: [[f64; 2]; 4],
    },
}

/// Request of a batch of N episodes of one model. They differ in theta, in effects and in the seed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SimulationRequest {
    /// N thetas in the model's order and units.
    pub thetas: Vec<Vec<f64>>,
    /// Further parameters that the batch sets: name, and one value for each episode.
    pub effects: Vec<(String, Vec<f64>)>,
    /// Drive of the clamped end.
    pub drive: Drive,
    /// Shape of the object at the start.
    pub start: StartShape,
    /// Times of the frames in s since the start; empty for a frame at every step of the policy.
    pub frame_times_s: Vec<f64>,
    /// (x, z) in m of the target; none for the model's target with its jitter.
    pub target_m: Option<[f64; 2]>,
    /// Fidelity of the simulation.
    pub fidelity: Fidelity,
    /// Seed of the batch. The random numbers of episode i depend on it and on `first_episode + i` alone.
    pub seed: u64,
    /// Number of the first episode. It lets a batch be requested in parts.
    pub first_episode: u64,
    /// True to add the model's camera noise.
    pub noise: bool,
}

impl SimulationRequest {
    /// Request for the episodes at these indices alone. They are equal, bit by bit, to the same episodes of the whole
    /// batch.
    pub fn part(&self, episodes: Range<usize>) -> SimulationRequest {
        let (from, to) = (episodes.start.min(self.thetas.len()), episodes.end.min(self.thetas.len()));
        // Effects without one value for each episode are kept unchanged: the simulator refuses them with its own
        // message.
        let values = |v: &Vec<f64>| if v.len() == self.thetas.len() { v[from..to].to_vec() } else { v.clone() };
        SimulationRequest {
            thetas: self.thetas[from..to].to_vec(),
            effects: self.effects.iter().map(|(name, v)| (name.clone(), values(v))).collect(),
            drive: self.drive.clone(),
            start: self.start.clone(),
            frame_times_s: self.frame_times_s.clone(),
            first_episode: self.first_episode + from as u64,
            ..*self
        }
    }
}

/// Reason for which nothing was simulated.
#[derive(Debug, Error)]
pub enum SimulatorError {
    /// The request or the model makes no sense; the message names the field and the value.
    #[error("simulator: {0}")]
    Input(String),
    /// The service behind the simulator failed.
    #[error("simulator: {0}")]
    Backend(String),
}

/// Stopping rule of an episode: called with its index in the batch and its frames so far, the newest last. It returns
/// true if no further frame is needed.
pub type IsEnough<'a> = &'a (dyn Fn(usize, &[Frame]) -> bool + Sync);

/// Stopping rule of a batch, with its number in caches.
#[derive(Clone, Copy)]
pub struct Until<'a> {
    /// Rule that is called after each frame. Equal frames must give equal answers.
    pub is_enough: IsEnough<'a>,
    /// Identity of the rule in caches of tracks. Rules that may answer differently must have different numbers.
    pub number: u64,
}

/// Simulator of batches of episodes of one model.
pub trait Simulator {
    /// Simulates the batch. Returns one track for each theta, in order. Equal requests give equal bits.
    ///
    /// # Errors
    /// [`SimulatorError`] if the request makes no sense or the service fails.
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError>;

    /// Simulates the batch as [`Self::simulate`] does, but may stop an episode early by the rule `until`.
    ///
    /// A stopped episode holds the first frames of the whole one, without an action after the last. Its end has no
    /// meaning. The default implementation never stops early.
    ///
    /// # Errors
    /// As [`Self::simulate`].
    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        let _ = until;
        self.simulate(request)
    }

    /// Smallest and largest value of the parameter or effect called `name` that the simulator accepts, in the parameter's
    /// unit: the physical limits of a prior's support. None if they are unknown, as in the default implementation.
    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        let _ = name;
        None
    }
}

/// Derivative of a frame with respect to a parameter, per unit of the parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FrameDerivative {
    /// Derivative of the object's four keypoints (x, y), which are scaled to -1 .. 1 over the image.
    pub dlo: [[f64; 2]; 4],
    /// Derivative of the target's centre (x, y), which is scaled to -1 .. 1 over the image.
    pub target: [f64; 2],
    /// Derivative of the end effector's x and z in m and its pitch in rad.
    pub eef: [f64; 3],
    /// Derivative of the wrench on the hand: force along x and z in N, torque about +y in N m; zero if it is not observed.
    #[serde(default)]
    pub wrench: [f64; 3],
}

/// Track with its derivatives with respect to parameters.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TrackSensitivities {
    /// Track, equal to that of [`Simulator::simulate`] bit by bit.
    pub track: Track,
    /// Derivatives: for each parameter, in the requested order, one entry for each frame.
    pub derivatives: Vec<Vec<FrameDerivative>>,
    /// Step of each parameter, in its unit, over which its derivative was taken. It is tiny, except for a parameter
    /// whose presence changes the mesh: its derivative is the mean slope up to a likely magnitude.
    pub changes: Vec<f64>,
}

/// Simulator that also returns derivatives of tracks with respect to parameters.
pub trait DifferentiableSimulator: Simulator {
    /// Simulates the batch and differentiates each track with respect to the parameters and effects in `names`.
    ///
    /// Derivatives are taken at the values of the request, and at zero for an effect that is absent. Noise is held
    /// constant. The derivative with respect to a random effect is zero. At a kink or an end of a parameter's range, the
    /// derivative is one-sided. The drive must be a path or actions, because a policy's actions depend on the parameters, too.
    ///
    /// # Errors
    /// [`SimulatorError`] as for [`Simulator::simulate`], and for an episode whose start at rest is not at rest.
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError>;
}
