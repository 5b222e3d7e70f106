//! What goes into the gate and what comes out of it.

use super::BASE_FRAME;
use crate::pose::ArmPose;
use thiserror::Error;

/// What the arm is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Not enabled: targets are rejected.
    Idle,
    /// Following targets.
    Tracking,
    /// Holding the measured pose; a good target makes it track again.
    Hold,
    /// On its way to the start pose.
    Moving,
    /// A reflex or a contact is latched.
    Reflex,
    /// The user stop is latched.
    UserStop,
    /// No arm.
    Disconnected,
}

/// One command.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Time since its stamp, s; negative where that lies ahead. NaN where it has none.
    pub age_s: f64,
    /// Whether its age was told by `/clock`, as in a replay or a simulation.
    pub simulated_time: bool,
    /// The frame that its pose is in.
    pub frame_id: String,
    /// The pose wanted.
    pub pose: ArmPose,
}

/// Axes along which a command was clamped to the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Clip {
    /// x.
    pub x: bool,
    /// y.
    pub y: bool,
    /// z.
    pub z: bool,
}

impl Clip {
    /// Whether any axis was clamped.
    pub fn any(self) -> bool {
        self.x || self.y || self.z
    }
}

/// What became of a command.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The arm goes to `pose`, which lies inside the workspace.
    Accepted {
        /// The pose in force.
        pose: ArmPose,
        /// Where it was clamped.
        clip: Clip,
    },
    /// The arm keeps its last target.
    Rejected(Rejection),
}

/// Why a command was rejected.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Rejection {
    /// NaN or infinity.
    #[error("the pose is not finite")]
    NotFinite,
    /// A quaternion that is none.
    #[error("the quaternion has not unit norm")]
    NotNormalised,
    /// Another frame.
    #[error("expected frame {BASE_FRAME}, got `{0}`")]
    Frame(String),
    /// Too old, or from the future.
    #[error("the stamp is {age_s:.3} s old; at most {limit_s} s are allowed, either way")]
    Stale {
        /// Age, negative for the future.
        age_s: f64,
        /// Limit.
        limit_s: f64,
    },
    /// Too far from where the arm is.
    #[error(
        "{distance_m:.3} m and {turn_rad:.2} rad from the measured pose; at most {max_m} m and {max_rad} rad are allowed"
    )]
    Jump {
        /// Distance.
        distance_m: f64,
        /// Turn.
        turn_rad: f64,
        /// Limit of the distance.
        max_m: f64,
        /// Limit of the turn.
        max_rad: f64,
    },
    /// The arm is so far outside the workspace that to clamp the target to it would be a jump.
    #[error(
        "the arm is outside the workspace: clamped to it, the target lies {distance_m:.3} m from the measured pose; at most {max_m} m are allowed"
    )]
    FarOutside {
        /// Distance of the clamped target.
        distance_m: f64,
        /// Limit of the distance.
        max_m: f64,
    },
    /// Nobody knows where the arm is.
    #[error("no pose was measured yet")]
    NoPose,
    /// Time comes from a replay or a simulation, and the arm is real.
    #[error("{}", Refusal::Replay)]
    Replay,
    /// The arm may not be commanded.
    #[error("the arm is not enabled: {0}")]
    NotEnabled(String),
    /// The episode was ended by the gate; the arm must be enabled anew.
    #[error("the episode has ended: {0}; enable the arm to begin another")]
    EpisodeOver(String),
}

impl Rejection {
    /// Property at fault, by which rejected targets are counted.
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
            Self::EpisodeOver(_) => "episode over",
        }
    }
}

/// Nodes that could command the arm or answer in its place, in words.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rivals {
    /// Publishers of targets; one is as it should be.
    pub publishers: Vec<String>,
    /// Other nodes that serve the arm's own services or its action.
    pub servers: Vec<String>,
    /// Other nodes that publish an arm's pose or state under the arm's own names.
    pub arms: Vec<String>,
}

impl Rivals {
    /// Why nothing may move beside them; none: it may.
    pub fn check(&self) -> Result<(), Refusal> {
        if self.publishers.len() > 1 {
            return Err(Refusal::Publishers(self.publishers.clone()));
        }
        if !self.servers.is_empty() {
            return Err(Refusal::Servers(self.servers.clone()));
        }
        // It need not serve anything to follow the targets.
        if !self.arms.is_empty() {
            return Err(Refusal::Arms(self.arms.clone()));
        }
        Ok(())
    }
}

/// Why the arm was not enabled, not moved, or not recovered.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Refusal {
    /// More than one publisher of targets.
    #[error(
        "{} publishers on the target topic: {}; expected at most one: end the others, or give them another ROS_DOMAIN_ID",
        .0.len(), .0.join(", ")
    )]
    Publishers(Vec<String>),
    /// Another arm under the same names.
    #[error(
        "another arm has the same services: {}; end one of the two, or give one another ROS_DOMAIN_ID or namespace",
        .0.join(", ")
    )]
    Servers(Vec<String>),
    /// Another arm that may follow the same targets.
    #[error(
        "another node publishes the pose or the state of an arm under this arm's names, and may follow its targets: {}; end one of the two, or give one another ROS_DOMAIN_ID or namespace",
        .0.join(", ")
    )]
    Arms(Vec<String>),
    /// A stop is latched.
    #[error("a {0} is latched: recover first")]
    Latched(&'static str),
    /// The user stop is still pressed.
    #[error("the user stop is still pressed")]
    StillStopped,
    /// No arm.
    #[error("no arm is connected")]
    Disconnected,
    /// Nobody knows where the arm is.
    #[error("no pose was measured yet")]
    NoPose,
    /// Time comes from a replay or a simulation, and the arm is real.
    #[error(
        "time comes from /clock, as in a replay, and a real arm is connected: set allow_replay to move it all the same"
    )]
    Replay,
    /// It is on its way to the start pose.
    #[error("the arm is moving to its start pose")]
    Moving,
}

/// A time between two actions that no policy has.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "step period: expected more than 0 and at most {longest_s} s, after which silence ends a motion, got {step_period_s} s"
)]
pub struct StepPeriod {
    /// The time given.
    pub step_period_s: f64,
    /// The longest that is taken.
    pub longest_s: f64,
}

/// What the transport must do now.
#[derive(Debug, Clone, PartialEq)]
pub enum Order {
    /// Make this pose the target.
    Target(ArmPose),
    /// Make this pose, which was measured, the target, and hold.
    Hold(ArmPose),
    /// End the motion: the arm is not enabled any more.
    End,
}
