//! One control cycle: from the robot's state and the orders to torques. Pure but for the client library's model.

use super::settings::FciSettings;
use super::shared::Orders;
use crate::law::{self, ArmMotion, Barriers, ImpedanceLaw, Jacobian, Joints};
use franka::{Frame, Model, RobotState};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use std::time::Duration;

/// Joint speed below which the arm is at rest, rad/s. The robot aborts a motion that ends faster.
const REST_RAD_S: f64 = 0.01;
/// Cycles at rest before a motion ends.
const REST_CYCLES: u32 = 20;
/// Cycles after which a motion ends without rest: someone pushes the arm. The robot then stops it by a reflex.
const MOST_CYCLES: u32 = 3000;

/// Torques of a cycle, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// The motion goes on.
    Go([f64; 7]),
    /// The motion ends with these torques.
    Finish([f64; 7]),
}

/// State of a motion between its cycles.
pub struct Cycle<'a> {
    settings: &'a FciSettings,
    model: &'a Model,
    barriers: Barriers,
    law: Option<ImpedanceLaw>,
    /// Number of the newest hold that the law has taken.
    holds: u64,
    stopping: u32,
    resting: u32,
}

impl<'a> Cycle<'a> {
    /// Silence of the node after which the arm comes to rest.
    pub const PATIENCE: Duration = Duration::from_millis(100);

    /// Creates the cycle of a motion that has not begun.
    pub fn new(settings: &'a FciSettings, model: &'a Model, orders: &Orders) -> Self {
        let barriers = Barriers::new(settings.generation.limits(), settings.cutoff_hz);
        Self { settings, model, barriers, law: None, holds: orders.holds, stopping: 0, resting: 0 }
    }

    /// Returns the torques that answer a state. `wanted`: the motion goes on; otherwise it comes to rest and ends.
    pub fn step(&mut self, state: &RobotState, orders: &Orders, wanted: bool) -> Step {
        let motion = motion(self.model, state);
        let law = self.law.get_or_insert_with(|| ImpedanceLaw::new(self.settings.law, orders.compliance, &motion));
        law.set_compliance(orders.compliance);
        if let Some(posture) = orders.posture {
            law.set_posture(posture);
        }
        match (wanted, self.stopping, orders.target) {
            // The filtered target may lead the arm: a hold brakes where the arm is.
            (true, ..) if orders.holds != self.holds => law.hold(motion.pose),
            (true, _, Some(target)) => law.set_target(target),
            (true, _, None) => {}
            // The stop begins.
            (false, 0, _) => law.hold(motion.pose),
            (false, ..) => {}
        }
        self.holds = orders.holds;
        self.stopping = if wanted { 0 } else { self.stopping + 1 };
        let torques = law.torques(&motion);
        let last = Joints::from(state.tau_J_d);
        let shaped = self.barriers.shape(&torques, &motion.q, &motion.dq, &last).into();
        self.resting = if motion.dq.amax() < REST_RAD_S { self.resting + 1 } else { 0 };
        let ends = self.stopping > 0 && (self.resting >= REST_CYCLES || self.stopping >= MOST_CYCLES);
        if ends { Step::Finish(shaped) } else { Step::Go(shaped) }
    }
}

/// Returns the posture of a motion that begins at this state; `kept` is that of the last motion.
pub fn posture_at_begin(kept: Option<Joints>, model: &Model, state: &RobotState) -> Joints {
    law::posture_at_begin(kept, &motion(model, state))
}

fn motion(model: &Model, state: &RobotState) -> ArmMotion {
    ArmMotion {
        q: state.q.into(),
        dq: state.dq.into(),
        pose: isometry(&state.O_T_EE),
        jacobian: Jacobian::from_column_slice(&model.zero_jacobian(Frame::EndEffector, state)),
        coriolis: model.coriolis(state).into(),
    }
}

/// Converts a column-major matrix 4x4 to a pose.
#[must_use]
pub fn isometry(matrix: &[f64; 16]) -> Isometry3<f64> {
    let rotation = Matrix3::from_fn(|row, column| matrix[4 * column + row]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts(Translation3::new(matrix[12], matrix[13], matrix[14]), rotation)
}
