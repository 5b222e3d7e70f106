//! Errors of the control box, by the index that the robot state gives them.

/// Number of errors in a robot state.
const COUNT: usize = 41;

/// Error of the control box. The discriminant is its index in the robot state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are those of libfranka")]
#[repr(usize)]
pub enum ErrorKind {
    JointPositionLimitsViolation = 0,
    CartesianPositionLimitsViolation,
    SelfCollisionAvoidanceViolation,
    JointVelocityViolation,
    CartesianVelocityViolation,
    ForceControlSafetyViolation,
    JointReflex,
    CartesianReflex,
    MaxGoalPoseDeviationViolation,
    MaxPathPoseDeviationViolation,
    CartesianVelocityProfileSafetyViolation,
    JointPositionMotionGeneratorStartPoseInvalid,
    JointMotionGeneratorPositionLimitsViolation,
    JointMotionGeneratorVelocityLimitsViolation,
    JointMotionGeneratorVelocityDiscontinuity,
    JointMotionGeneratorAccelerationDiscontinuity,
    CartesianPositionMotionGeneratorStartPoseInvalid,
    CartesianMotionGeneratorElbowLimitViolation,
    CartesianMotionGeneratorVelocityLimitsViolation,
    CartesianMotionGeneratorVelocityDiscontinuity,
    CartesianMotionGeneratorAccelerationDiscontinuity,
    CartesianMotionGeneratorElbowSignInconsistent,
    CartesianMotionGeneratorStartElbowInvalid,
    ForceControllerDesiredForceToleranceViolation,
    StartElbowSignInconsistent,
    CommunicationConstraintsViolation,
    PowerLimitViolation,
    CartesianMotionGeneratorJointPositionLimitsViolation,
    CartesianMotionGeneratorJointVelocityLimitsViolation,
    CartesianMotionGeneratorJointVelocityDiscontinuity,
    CartesianMotionGeneratorJointAccelerationDiscontinuity,
    CartesianPositionMotionGeneratorInvalidFrame,
    ControllerTorqueDiscontinuity,
    JointP2pInsufficientTorqueForPlanning,
    TauJRangeViolation,
    InstabilityDetected,
    JointMoveInWrongDirection,
    CartesianSplineMotionGeneratorViolation,
    JointViaMotionGeneratorPlanningJointLimitViolation,
    BaseAccelerationInitializationTimeout,
    BaseAccelerationInvalidReading,
}

/// Names of the errors as libfranka prints them, by index.
pub const ERROR_NAMES: [&str; COUNT] = [
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_j_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
];

/// Set of errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Errors(u64);

impl Errors {
    /// Set of one error.
    #[must_use]
    pub fn of(kind: ErrorKind) -> Self {
        Self(1 << kind as usize)
    }

    /// Adds an error.
    pub fn insert(&mut self, kind: ErrorKind) {
        self.0 |= 1 << kind as usize;
    }

    /// Set of the errors of both sets.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Set of the errors that are in this set and not in the other.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Errors of the set that stay in the robot state after the arm has stopped: position limits and self-collision.
    #[must_use]
    pub fn lasting(self) -> Self {
        let kinds = [ErrorKind::JointPositionLimitsViolation, ErrorKind::SelfCollisionAvoidanceViolation];
        Self(self.0 & Self::of(kinds[0]).union(Self::of(kinds[1])).0)
    }

    /// Returns true if the set holds this error.
    #[must_use]
    pub fn contains(self, kind: ErrorKind) -> bool {
        self.0 & (1 << kind as usize) != 0
    }

    /// Returns true if the set is empty.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns a flag for each index.
    #[must_use]
    pub fn flags(self) -> [bool; COUNT] {
        std::array::from_fn(|i| self.0 & (1 << i) != 0)
    }

    /// Returns the names of the errors.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        ERROR_NAMES.iter().enumerate().filter(move |(i, _)| self.0 & (1 << i) != 0).map(|(_, name)| *name)
    }
}
