//! Settings of the direct transport.

use crate::compliance::Compliance;
use crate::kinematics::{JOINTS, READY_RAD};
use crate::law::{JointLimits, LawSettings};

/// Real-time priority of the control thread unless another one is set: above the kernel's threads for interrupts, which have 50, and
/// below its own watchdogs, which have 99.
pub const DEFAULT_PRIORITY: i32 = 80;

/// Generation of the arm, which decides the version of its protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Generation {
    /// Franka Emika Robot (Panda) with system 4.2.1 or newer: FCI version 5.
    Panda,
    /// Franka Research 3 with system 5.9 or newer: FCI version 10.
    Fr3,
}

impl Generation {
    /// Returns the limits of the joints.
    #[must_use]
    pub fn limits(self) -> JointLimits {
        match self {
            Self::Panda => JointLimits::default(),
            Self::Fr3 => JointLimits::fr3(),
        }
    }
}

/// Thresholds above which the robot stops by a reflex. Contact is reported from half of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// External joint torques, N m.
    pub torque_n_m: [f64; 7],
    /// External force (N) and moment (N m) at the end effector.
    pub wrench: [f64; 6],
}

impl Default for Collision {
    fn default() -> Self {
        Self {
            // Chosen: 40 N is the force that DROID allows; a Panda's own estimate passes 20 N in free air above 1 m/s^2. The joint
            // torques are those of 40 N at a lever of 0.8 m, and less in the wrist.
            torque_n_m: [32.0, 32.0, 32.0, 32.0, 16.0, 16.0, 12.0],
            wrench: [40.0, 40.0, 40.0, 20.0, 20.0, 20.0],
        }
    }
}

/// Load beyond the hand, which the robot carries without being told by Desk.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the flange frame, m.
    pub centre_m: [f64; 3],
    /// Moments of inertia about the centre of mass, kg m^2.
    pub inertia_kg_m2: [f64; 3],
}

/// Settings of a connection.
#[derive(Debug, Clone, PartialEq)]
pub struct FciSettings {
    /// Name or address of the robot, optionally with `:port`.
    pub host: String,
    /// Generation of the arm.
    pub generation: Generation,
    /// Real-time priority (SCHED_FIFO) of the control thread, 1 to 99.
    pub priority: i32,
    /// Processor that the control thread is bound to, from 0; `None`: any.
    pub cpu: Option<usize>,
    /// Cut-off frequency of the torques' low-pass, Hz; 1000 and more switch it off.
    pub cutoff_hz: f64,
    /// Gains beside the compliance.
    pub law: LawSettings,
    /// Posture that a move to the start brings the arm near to, rad.
    pub rest_joints_rad: [f64; JOINTS],
    /// Compliance at the start.
    pub compliance: Compliance,
    /// Collision thresholds.
    pub collision: Collision,
    /// Load beyond the hand.
    pub load: Load,
}

impl FciSettings {
    /// Settings of a connection to this host, with SERL's gains and no load.
    #[must_use]
    pub fn new(host: &str, generation: Generation) -> Self {
        Self {
            host: host.to_owned(),
            generation,
            priority: DEFAULT_PRIORITY,
            cpu: None,
            cutoff_hz: 100.0,
            law: LawSettings::default(),
            rest_joints_rad: READY_RAD,
            compliance: Compliance::default(),
            collision: Collision::default(),
            load: Load::default(),
        }
    }
}
