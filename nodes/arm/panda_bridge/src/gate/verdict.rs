//! Inputs and outputs of the gate.

use super::writer::{Stranger, Writer};
use crate::pose::ArmPose;
use thiserror::Error;

/// Frame of commands.
pub const BASE_FRAME: &str = "panda_link0";

/// Mode of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Not enabled: targets are rejected.
    Idle,
    /// Following targets.
    Tracking,
    /// Holding the measured pose; an accepted target makes it track again.
    Hold,
    /// Moving to the start pose.
    Moving,
    /// Latched reflex or contact.
    Reflex,
    /// Latched user stop.
    UserStop,
    /// No connection to the arm.
    Disconnected,
}

/// Command with a target pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Writer of the message.
    pub writer: Writer,
    /// Time since the stamp of the command, s; negative for a stamp in the future, NaN without a stamp.
    pub age_s: f64,
    /// True if the age was measured with `/clock`, as in a replay or a simulation.
    pub simulated_time: bool,
    /// Frame of the pose.
    pub frame_id: String,
    /// Target pose.
    pub pose: ArmPose,
}

/// Axes along which a command was clamped to the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Clip {
    /// Clamped along x.
    pub x: bool,
    /// Clamped along y.
    pub y: bool,
    /// Clamped along z.
    pub z: bool,
}

impl Clip {
    /// Returns true if any axis was clamped.
    pub fn any(self) -> bool {
        self.x || self.y || self.z
    }
}

/// Outcome of a command.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Accepted: `pose`, inside the workspace, is the new target.
    Accepted {
        /// Target in force.
        pose: ArmPose,
        /// Axes along which it was clamped.
        clip: Clip,
    },
    /// Rejected: the previous target stays in force.
    Rejected(Rejection),
}

/// Reason of a rejected command.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Rejection {
    /// NaN or infinity in the pose.
    #[error("the pose is not finite")]
    NotFinite,
    /// Quaternion without unit norm.
    #[error("expected a quaternion of unit norm")]
    NotNormalised,
    /// Frame other than [`BASE_FRAME`].
    #[error("expected frame {BASE_FRAME}, got `{0}`")]
    Frame(String),
    /// Stamp that is too old or too far in the future.
    #[error("the stamp is {age_s:.3} s old; at most {limit_s} s are allowed, either way")]
    Stale {
        /// Age, s, negative for the future.
        age_s: f64,
        /// Limit, s.
        limit_s: f64,
    },
    /// Target too far from the measured pose.
    #[error(
        "{distance_m:.3} m and {turn_rad:.2} rad from the measured pose; at most {max_m} m and {max_rad} rad are allowed"
    )]
    Jump {
        /// Distance, m.
        distance_m: f64,
        /// Angle, rad.
        turn_rad: f64,
        /// Limit of the distance, m.
        max_m: f64,
        /// Limit of the angle, rad.
        max_rad: f64,
    },
    /// Arm so far outside the workspace that the clamped target would be a jump.
    #[error(
        "the arm is outside the workspace: clamped to it, the target lies {distance_m:.3} m from the measured pose; at most {max_m} m are allowed"
    )]
    FarOutside {
        /// Distance of the clamped target, m.
        distance_m: f64,
        /// Limit of the distance, m.
        max_m: f64,
    },
    /// No measured pose.
    #[error("no pose was measured yet")]
    NoPose,
    /// Age of the command was measured with `/clock` while a real arm is connected.
    #[error("{}", Refusal::Replay)]
    Replay,
    /// Arm that is not enabled, with the reason.
    #[error("the arm is not enabled: {0}")]
    NotEnabled(String),
    /// Command of another writer than the one that the arm follows. It ends the motion.
    #[error(transparent)]
    Stranger(Stranger),
    /// Episode that the gate has ended: the arm must be enabled again.
    #[error("the episode has ended: {0}; enable the arm to begin another")]
    EpisodeOver(String),
}

impl Rejection {
    /// Returns the kind of the fault, under which rejected targets are counted.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::NotFinite => "not finite",
            Self::NotNormalised => "quaternion",
            Self::Frame(_) => "frame",
            Self::Stale { .. } => "stamp",
            Self::Jump { .. } => "jump",
            Self::FarOutside { .. } => "far outside",
            Self::NoPose => "no pose",
            Self::Replay => "replay",
            Self::NotEnabled(_) => "not enabled",
            Self::Stranger(_) => "stranger",
            Self::EpisodeOver(_) => "episode over",
        }
    }
}

/// Names of nodes that could command the arm or answer in its place, as text for messages.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rivals {
    /// Publishers of targets; one is allowed.
    pub publishers: Vec<String>,
    /// Writer of the only publisher of targets; `None` if nobody publishes targets.
    pub writer: Option<Writer>,
    /// Other nodes that serve the arm's own services or its action.
    pub servers: Vec<String>,
    /// Other nodes that publish an arm's pose or state under the arm's own names.
    pub arms: Vec<String>,
}

impl Rivals {
    /// Checks that the arm may move beside these nodes.
    ///
    /// # Errors
    /// [`Refusal`] with the names of the nodes.
    pub fn check(&self) -> Result<(), Refusal> {
        if self.publishers.len() > 1 {
            return Err(Refusal::Publishers(self.publishers.clone()));
        }
        if !self.servers.is_empty() {
            return Err(Refusal::Servers(self.servers.clone()));
        }
        // A second arm without services can still follow the targets.
        if !self.arms.is_empty() {
            return Err(Refusal::Arms(self.arms.clone()));
        }
        Ok(())
    }
}

/// Reason of a refused request to enable, move or recover the arm.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Refusal {
    /// More than one publisher of targets.
    #[error(
        "{} publishers on the target topic: {}; expected at most one: end the others, or give them another ROS_DOMAIN_ID",
        .0.len(), .0.join(", ")
    )]
    Publishers(Vec<String>),
    /// Another node that serves the arm's names.
    #[error(
        "another arm has the same services: {}; end one of the two, or start one of them with a different ROS_DOMAIN_ID or namespace",
        .0.join(", ")
    )]
    Servers(Vec<String>),
    /// Another node that publishes under the arm's names and may follow the same targets.
    #[error(
        "another node publishes the pose or the state of an arm under this arm's names, and may follow its targets: {}; end one of the two, or start one of them with a different ROS_DOMAIN_ID or namespace",
        .0.join(", ")
    )]
    Arms(Vec<String>),
    /// Latched stop.
    #[error("a {0} is latched: recover first")]
    Latched(&'static str),
    /// User stop that is still pressed.
    #[error("the user stop is still pressed")]
    StillStopped,
    /// No connection to the arm.
    #[error("no arm is connected")]
    Disconnected,
    /// No measured pose.
    #[error("no pose was measured yet")]
    NoPose,
    /// Time from `/clock` in front of a real arm.
    #[error(
        "time comes from /clock, as in a replay, and a real arm is connected: set allow_replay to move it all the same"
    )]
    Replay,
    /// Running move to the start pose.
    #[error("the arm is moving to its start pose")]
    Moving,
}

/// Step period out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "step period: expected more than 0 and at most {longest_s} s, because the gate ends a motion after that time without a target, got {step_period_s} s"
)]
pub struct StepPeriod {
    /// Step period, s.
    pub step_period_s: f64,
    /// Maximum step period, s.
    pub longest_s: f64,
}

/// Order to the plant.
#[derive(Debug, Clone, PartialEq)]
pub enum Order {
    /// Make this pose the target.
    Target(ArmPose),
    /// Make this measured pose the target and hold it.
    Hold(ArmPose),
    /// End the motion: the arm is no longer enabled.
    End,
}
