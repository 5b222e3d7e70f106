//! Estimate of external torques and of the wrench at the stiffness frame.

use crate::fci::CYCLE_S;
use crate::panda::chain::{Frame, Jacobian, Joints, Six};
use crate::panda::configuration::gain;
use crate::panda::plant::sensors::Readings;
use crate::panda::rigid_body::Terms;
use nalgebra::{Matrix6, Vector3};

/// Smallest singular value of the Jacobian at K below which the wrench is reported as zero: a user measured it on two Pandas
/// (libfranka, issue 76).
const UNOBSERVABLE: f64 = 0.08;
/// Manipulability below which a Cartesian motion cannot start. Guess.
const SINGULAR: f64 = 5e-3;

/// Estimate of external forces. Forces by the robot on the world are positive.
#[derive(Debug, Clone)]
pub struct ExternalForces {
    gain: f64,
    inertial_ratio: f64,
    last_speeds: Joints,
    /// Filtered external torques, N m.
    pub torques: Joints,
    /// Wrench at K in the axes of O, N and N m.
    pub wrench_o: Six,
    /// Wrench at K in the axes of K, N and N m.
    pub wrench_k: Six,
}

impl ExternalForces {
    /// Estimate with a first-order filter. `inertial_ratio`: share of the inertial torques that it takes into account.
    pub fn new(cutoff_hz: f64, inertial_ratio: f64) -> Self {
        Self {
            gain: gain(cutoff_hz),
            inertial_ratio,
            last_speeds: Joints::zeros(),
            torques: Joints::zeros(),
            wrench_o: Six::zeros(),
            wrench_k: Six::zeros(),
        }
    }

    /// Forgets what it has estimated.
    pub fn reset(&mut self) {
        *self = Self { gain: self.gain, ..Self::new(1.0, self.inertial_ratio) };
    }

    /// Updates the estimate. `terms`: the control box's model, which differs from the arm.
    pub fn update(&mut self, readings: &Readings, terms: &Terms, jacobian_k: &Jacobian, k: &Frame) {
        let acceleration = (readings.dq - self.last_speeds) / CYCLE_S;
        self.last_speeds = readings.dq;
        let modelled = terms.gravity + terms.coriolis + terms.mass * acceleration * self.inertial_ratio;
        self.torques += (readings.tau - modelled - self.torques) * self.gain;
        self.wrench_o = wrench(&self.torques, jacobian_k).unwrap_or_default();
        let turn = |row: usize| -> Vector3<f64> { k.rotation.tr_mul(&self.wrench_o.fixed_rows::<3>(row)) };
        let (force, moment) = (turn(0), turn(3));
        self.wrench_k = Six::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
    }
}

/// Returns true if the arm is too near a singularity for the start of a Cartesian motion.
pub fn is_singular(jacobian: &Jacobian) -> bool {
    let square: Matrix6<f64> = jacobian * jacobian.transpose();
    square.determinant().max(0.0).sqrt() < SINGULAR
}

/// Wrench that best explains joint torques: the pseudo-inverse of the transposed Jacobian. `None` near a singularity.
fn wrench(torques: &Joints, jacobian: &Jacobian) -> Option<Six> {
    let square: Matrix6<f64> = jacobian * jacobian.transpose();
    // Positive definite exactly if every singular value of the Jacobian exceeds the bound.
    let _observable = (square - Matrix6::from_diagonal_element(UNOBSERVABLE * UNOBSERVABLE)).cholesky()?;
    square.cholesky().map(|cholesky| cholesky.solve(&(jacobian * torques)))
}
