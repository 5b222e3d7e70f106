//! The motion generators of the FCI.

use super::cartesian::CartesianPath;
use super::joint::{COMMANDED_POSITIONS, COMMANDED_SPEEDS, JointPath};
use crate::fci::{ErrorKind, Errors, Generator, RobotCommand};
use crate::panda::chain::{Chain, Frame, Joints, Six};
use crate::panda::checks::limits::Limits;

/// Translation (m/s) and rotation (rad/s) above which a Cartesian path still moves when it is finished. Guess.
const REST_TWIST: f64 = 0.01;

/// Surroundings of a generator.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// Limits of commands.
    pub limits: &'a Limits,
    /// End effector in the flange.
    pub tool: &'a Frame,
    /// Maximum difference of a first command from the start, rad and m.
    pub start_tolerance: f64,
}

/// Command with NaN or infinity in the channel of the generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotFinite;

/// Generator and the last point of its path.
#[derive(Debug, Clone)]
pub enum MotionGenerator {
    /// Joint positions.
    JointPosition(JointPath),
    /// Joint speeds.
    JointVelocity(JointPath),
    /// Poses of the end effector.
    CartesianPosition(Box<CartesianPath>),
    /// Twists of the end effector.
    CartesianVelocity(Box<CartesianPath>),
    /// None: torques alone.
    Still(JointPath),
}

impl MotionGenerator {
    /// Generator at rest at joint angles `q`, rad.
    pub fn at_rest(kind: Generator, q: Joints, tool: &Frame) -> Self {
        let cartesian = || Box::new(CartesianPath::at_rest(q, Chain::at(&q).flange.then(tool)));
        match kind {
            Generator::JointPosition => Self::JointPosition(JointPath::at_rest(q)),
            Generator::JointVelocity => Self::JointVelocity(JointPath::at_rest(q)),
            Generator::CartesianPosition => Self::CartesianPosition(cartesian()),
            Generator::CartesianVelocity => Self::CartesianVelocity(cartesian()),
            Generator::None => Self::Still(JointPath::at_rest(q)),
        }
    }

    /// Joint-space path.
    pub fn joints(&self) -> &JointPath {
        match self {
            Self::JointPosition(path) | Self::JointVelocity(path) | Self::Still(path) => path,
            Self::CartesianPosition(path) | Self::CartesianVelocity(path) => &path.joints,
        }
    }

    /// Cartesian path, if the generator has one.
    pub fn cartesian(&self) -> Option<&CartesianPath> {
        match self {
            Self::CartesianPosition(path) | Self::CartesianVelocity(path) => Some(path),
            _ => None,
        }
    }

    /// Follows a command and returns the errors. A command with errors is not followed. `first`: first command of the motion.
    ///
    /// # Errors
    /// [`NotFinite`] for NaN or infinity in the generator's channel.
    pub fn follow(&mut self, command: &RobotCommand, first: bool, around: &Surroundings) -> Result<Errors, NotFinite> {
        let Surroundings { limits, tool, start_tolerance } = *around;
        let elbow = finite_elbow(command)?;
        Ok(match self {
            Self::JointPosition(path) => {
                let q = Joints::from(finite(command.q_c)?);
                if first && (q - path.q).amax() > start_tolerance {
                    return Ok(Errors::of(ErrorKind::JointPositionMotionGeneratorStartPoseInvalid));
                }
                path.go_to(q, limits, &COMMANDED_POSITIONS)
            }
            Self::JointVelocity(path) => path.go_at(finite(command.dq_c)?.into(), limits, &COMMANDED_SPEEDS),
            Self::CartesianPosition(path) => {
                let matrix = finite(command.o_t_ee_c)?;
                let start = Frame::is_valid(&matrix).then(|| Frame::from_array(&matrix));
                match first.then(|| path.start_errors(start.as_ref(), elbow, start_tolerance)) {
                    Some(errors) if !errors.is_empty() => errors,
                    _ => path.go_to(&matrix, elbow, limits, tool),
                }
            }
            Self::CartesianVelocity(path) => {
                let twist = Six::from(finite(command.o_dp_ee_c)?);
                match first.then(|| path.start_errors(None, elbow, start_tolerance)) {
                    Some(errors) if !errors.is_empty() => errors,
                    _ => path.go_at(twist, elbow, limits, tool),
                }
            }
            Self::Still(_) => Errors::default(),
        })
    }

    /// Goes on without a command.
    pub fn extrapolate(&mut self, around: &Surroundings) {
        match self {
            Self::JointPosition(path) | Self::JointVelocity(path) => path.extrapolate(around.limits),
            Self::CartesianPosition(path) | Self::CartesianVelocity(path) => {
                path.extrapolate(around.limits, around.tool);
            }
            Self::Still(_) => {}
        }
    }

    /// Error of a motion that is finished while its path moves.
    pub fn error_of_moving_end(&self, rest_speed_rad_s: f64) -> Option<ErrorKind> {
        match self.cartesian() {
            Some(path) if path.twist.amax() > REST_TWIST => {
                Some(ErrorKind::CartesianMotionGeneratorVelocityDiscontinuity)
            }
            None if self.joints().dq.amax() > rest_speed_rad_s => {
                Some(ErrorKind::JointMotionGeneratorVelocityDiscontinuity)
            }
            _ => None,
        }
    }
}

fn finite<const N: usize>(values: [f64; N]) -> Result<[f64; N], NotFinite> {
    if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(NotFinite) }
}

fn finite_elbow(command: &RobotCommand) -> Result<Option<[f64; 2]>, NotFinite> {
    command.elbow_c.map(finite).transpose()
}
