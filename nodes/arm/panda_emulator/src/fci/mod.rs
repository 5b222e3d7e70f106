//! Terms of the Franka Control Interface that all its versions share: robot state, commands, requests and answers.
//!
//! Poses are 4x4 matrices in column-major order. Frames: O base, F flange, NE nominal end effector, EE end effector, K stiffness
//! frame. SI units.

mod errors;
mod requests;
mod state;

pub use errors::{ERROR_NAMES, ErrorKind, Errors};
pub use requests::{
    Answer, CollisionThresholds, Load, ModelLibrary, MoveRequest, MoveStatus, RecoveryStatus, Request, SetterStatus,
    StopStatus,
};
pub use state::{ControllerMode, Generator, RobotCommand, RobotMode, RobotState};

/// Number of joints.
pub const JOINTS: usize = 7;
/// Period of a control cycle, s.
pub const CYCLE_S: f64 = 1e-3;
/// Identity matrix 4x4, column-major.
pub const IDENTITY: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Generation of the robot, which decides protocol, limits and inertias.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Generation {
    /// Franka Emika Robot (Panda), FCI version 5.
    #[default]
    Panda,
    /// Franka Research 3, FCI version 10.
    Fr3,
}

impl Generation {
    /// Returns the version of FCI that the robot's server speaks.
    #[must_use]
    pub fn fci_version(self) -> u16 {
        match self {
            Self::Panda => 5,
            Self::Fr3 => 10,
        }
    }
}
