//! Requests of a client over TCP, and their answers.

use super::{ControllerMode, Generator};

/// Thresholds of contact (lower) and collision (upper).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionThresholds {
    /// Lower joint torques while accelerating, N m.
    pub lower_torques_acceleration: [f64; 7],
    /// Upper joint torques while accelerating, N m.
    pub upper_torques_acceleration: [f64; 7],
    /// Lower joint torques otherwise, N m.
    pub lower_torques_nominal: [f64; 7],
    /// Upper joint torques otherwise, N m.
    pub upper_torques_nominal: [f64; 7],
    /// Lower forces (N) and moments (N m) while accelerating.
    pub lower_forces_acceleration: [f64; 6],
    /// Upper forces (N) and moments (N m) while accelerating.
    pub upper_forces_acceleration: [f64; 6],
    /// Lower forces (N) and moments (N m) otherwise.
    pub lower_forces_nominal: [f64; 6],
    /// Upper forces (N) and moments (N m) otherwise.
    pub upper_forces_nominal: [f64; 6],
}

/// Request for a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MoveRequest {
    /// Controller.
    pub controller: ControllerMode,
    /// Motion generator.
    pub generator: Generator,
    /// Tolerated deviation from the path: translation (m), rotation (rad), elbow (rad).
    pub path_deviation: [f64; 3],
    /// Tolerated deviation from the goal: translation (m), rotation (rad), elbow (rad).
    pub goal_deviation: [f64; 3],
}

/// Load beyond the end effector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in F, m.
    pub centre_m: [f64; 3],
    /// Inertia about the centre of mass, column-major, kg m^2.
    pub inertia: [f64; 9],
}

/// Model library that a client asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelLibrary {
    /// Architecture: 0 x86-64, 1 x86, 2 ARM, 3 ARM64.
    pub architecture: u8,
    /// System: 0 Linux, 1 Windows.
    pub system: u8,
}

/// Request of a client, without the opening `Connect`.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a request lives for one call; a box would allocate for each")]
pub enum Request {
    /// Motion. Answered twice: when it starts, and when it ends.
    Move(MoveRequest),
    /// End of the running motion.
    StopMove,
    /// Cartesian limit with this identifier (FCI 5).
    GetCartesianLimit(i32),
    /// Thresholds of contact and collision.
    SetCollisionBehavior(CollisionThresholds),
    /// Stiffness of the internal joint impedance, N m/rad.
    SetJointImpedance([f64; 7]),
    /// Stiffness of the internal Cartesian impedance: N/m, then N m/rad.
    SetCartesianImpedance([f64; 6]),
    /// Free axes while guided by hand, and whether the elbow is free.
    SetGuidingMode([bool; 6], bool),
    /// Stiffness frame in EE.
    SetEeToK([f64; 16]),
    /// End effector in NE.
    SetNeToEe([f64; 16]),
    /// Load.
    SetLoad(Load),
    /// Cut-off frequencies of the filters, Hz (FCI 5).
    SetFilters([f64; 5]),
    /// Recovery from a reflex.
    AutomaticErrorRecovery,
    /// Shared library of the robot's model (FCI 5).
    LoadModelLibrary(ModelLibrary),
    /// Model as URDF (FCI 10).
    GetRobotModel,
}

/// Answer to [`Request::Move`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MoveStatus {
    /// The motion ended as commanded.
    Success,
    /// The motion began.
    MotionStarted,
    /// `StopMove` ended the motion.
    Preempted,
    /// Refused: the mode is not idle.
    CommandNotPossibleRejected,
    /// Refused: the arm is at a singularity.
    StartAtSingularPoseRejected,
    /// Refused: value out of range.
    InvalidArgumentRejected,
    /// A reflex ended the motion.
    ReflexAborted,
    /// The user stop ended the motion.
    EmergencyAborted,
    /// A command with NaN or of the wrong kind ended the motion.
    InputErrorAborted,
    /// Another reason ended the motion.
    Aborted,
}

/// Answer to [`Request::StopMove`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are those of libfranka")]
pub enum StopStatus {
    Success,
    CommandNotPossibleRejected,
    EmergencyAborted,
    ReflexAborted,
    Aborted,
}

/// Answer to a setter or a getter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are those of libfranka")]
pub enum SetterStatus {
    Success,
    CommandNotPossibleRejected,
    InvalidArgumentRejected,
}

/// Answer to [`Request::AutomaticErrorRecovery`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are those of libfranka")]
pub enum RecoveryStatus {
    Success,
    CommandNotPossibleRejected,
    ManualErrorRecoveryRequiredRejected,
    ReflexAborted,
    EmergencyAborted,
    Aborted,
}

/// Answer to a request.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "an answer lives for one call; a box would allocate for each")]
pub enum Answer {
    /// To [`Request::Move`].
    Move(MoveStatus),
    /// To [`Request::StopMove`].
    Stop(StopStatus),
    /// To a setter, by the request that set.
    Setter(Request, SetterStatus),
    /// To [`Request::GetCartesianLimit`]: size (m), frame and activation of the cuboid.
    CartesianLimit(SetterStatus, [f64; 3], [f64; 16], bool),
    /// To [`Request::AutomaticErrorRecovery`].
    Recovery(RecoveryStatus),
    /// To [`Request::LoadModelLibrary`]: the library, or `None` for an error.
    ModelLibrary(Option<Vec<u8>>),
    /// To [`Request::GetRobotModel`].
    RobotModel(String),
}
