//! The batch simulator, as inference sees it.

use crate::{Frame, GripTrajectory, Policy, Track};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use thiserror::Error;

/// How finely time and the object are divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// Coarse time steps, for training.
    Fast,
    /// The mesh of `Reference` in the time steps of `Fast`, for soft objects that fold or lie down.
    FineMesh,
    /// For inference.
    #[default]
    Standard,
    /// Fine mesh and time steps, for cells whose truth is to be found and for checks.
    Reference,
}

impl Fidelity {
    /// All of them.
    pub const ALL: [Fidelity; 4] = [Fidelity::Fast, Fidelity::FineMesh, Fidelity::Standard, Fidelity::Reference];

    /// The name used in files, messages and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Fidelity::Fast => "fast",
            Fidelity::FineMesh => "fine_mesh",
            Fidelity::Standard => "standard",
            Fidelity::Reference => "reference",
        }
    }

    /// What it is for, in a few words.
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

    /// The fidelity that is called `name`.
    pub fn from_name(name: &str) -> Option<Fidelity> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// What moves the clamped end.
#[derive(Debug, Clone, PartialEq)]
pub enum Drive {
    /// It follows a measured path.
    Grip(GripTrajectory),
    /// The model's arm executes these actions (dx, dz) in m, one a step.
    Actions(Vec<[f64; 2]>),
    /// The model's arm executes the mean actions of this policy, up to the task's end.
    Policy(Box<Policy>),
}

/// The shape that the object starts from.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum StartShape {
    /// It hangs at rest from the grip, as after a lift.
    #[default]
    HangingAtRest,
    /// It passes through four points of its centre line, which move.
    Measured {
        /// (x, z) in m, frame panda_link0, at the keypoints' fractions of the length, from the grip on.
        points_m: [[f64; 2]; 4],
        /// Their velocities in m/s.
        velocities_m_s: [[f64; 2]; 4],
    },
}

/// A batch of episodes of one model that differ in theta and in the seed alone.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationRequest {
    /// N thetas in the model's order and units.
    pub thetas: Vec<Vec<f64>>,
    /// Further parameters that the batch sets: name, and one value an episode.
    pub effects: Vec<(String, Vec<f64>)>,
    /// What moves the clamped end.
    pub drive: Drive,
    /// The shape that the object starts from.
    pub start: StartShape,
    /// When the episode is looked at, s since its start; empty: at every step of the policy.
    pub frame_times_s: Vec<f64>,
    /// (x, z) in m of the target; none: the model's, with its jitter.
    pub target_m: Option<[f64; 2]>,
    /// Fidelity of the simulation.
    pub fidelity: Fidelity,
    /// Seed of the batch: episode i depends on it and on `first_episode + i` alone.
    pub seed: u64,
    /// Number of the first episode: a batch may be asked for in parts.
    pub first_episode: u64,
    /// Whether the model's camera noise is added.
    pub noise: bool,
}

impl SimulationRequest {
    /// The episodes of the batch at these places, as a batch of their own: they come out the same.
    pub fn part(&self, episodes: Range<usize>) -> SimulationRequest {
        let (from, to) = (episodes.start.min(self.thetas.len()), episodes.end.min(self.thetas.len()));
        // Values that are not one an episode stay as they are, for the simulator to refuse.
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

/// Why nothing was simulated.
#[derive(Debug, Error)]
pub enum SimulatorError {
    /// The request or the model makes no sense; the message names the field and the value.
    #[error("simulator: {0}")]
    Input(String),
    /// The service behind the simulator failed.
    #[error("simulator: {0}")]
    Backend(String),
}

/// What is asked of a place of a batch and the frames of its episode so far, the newest last: whether that is enough of it.
pub type IsEnough<'a> = &'a (dyn Fn(usize, &[Frame]) -> bool + Sync);

/// Until when the episodes of a batch are asked for.
#[derive(Clone, Copy)]
pub struct Until<'a> {
    /// Asked after each frame. The same frames must have the same answer.
    pub is_enough: IsEnough<'a>,
    /// A number that stands for it where answers are kept: two that may say different things have different ones.
    pub number: u64,
}

/// Simulates batches of episodes of the model it was made for.
pub trait Simulator {
    /// Simulates the batch. Returns one track a theta, in order; the same request gives the same bits.
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError>;

    /// As [`Self::simulate`], but an episode may end at a frame from which on nobody asks for it: its frames are then the first of
    /// those that it would have had, without an action after the last, and its end says nothing. A simulator that cannot end sooner
    /// gives the whole.
    ///
    /// # Errors
    /// As [`Self::simulate`].
    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        let _ = until;
        self.simulate(request)
    }
}

/// How a frame changes with a parameter, per unit of it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FrameDerivative {
    /// Of the object's keypoints (x, y), which are scaled to -1 .. 1 over the image.
    pub dlo: [[f64; 2]; 4],
    /// Of the target's centre (x, y), scaled likewise.
    pub target: [f64; 2],
    /// Of the end effector's x and z in m and its pitch in rad.
    pub eef: [f64; 3],
}

/// A track, and how it changes with parameters.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TrackSensitivities {
    /// The track itself, as [`Simulator::simulate`] gives it, to the bit.
    pub track: Track,
    /// One entry a parameter, in the order asked for: the derivative of each frame by it.
    pub derivatives: Vec<Vec<FrameDerivative>>,
    /// The change of each parameter over which its derivative was taken, in its unit: tiny, but where a parameter's
    /// presence alone changes the mesh, and the derivative is the mean slope up to a likely magnitude.
    pub changes: Vec<f64>,
}

/// A simulator that says how tracks change with its parameters.
pub trait DifferentiableSimulator: Simulator {
    /// Simulates the batch, and differentiates each track by the parameters and effects called `names`, at the values
    /// that they have in it; an effect that is absent, at zero. Noise, where it is asked for, is that of the track, and an
    /// effect that acts at random has the derivative zero. Where a parameter has a kink or an end, the derivative is that
    /// to one side. The drive must be a path or actions: a policy's actions would have to be differentiated, too. An
    /// episode that does not begin at rest where it should is refused.
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError>;
}
