//! Controllers of the control box: joint impedance, Cartesian impedance, guiding by hand, hold after a stop.

use super::chain::{Chain, Frame, Jacobian, JointMatrix, Joints, Six};
use super::plant::MotorLaw;
use super::rigid_body::Terms;
use crate::fci::CYCLE_S;
use nalgebra::{Matrix6, SMatrix};

pub mod external_forces;

/// Damping ratio of the internal controllers. Chosen: a step overshoots by less than 2 %.
const DAMPING_RATIO: f64 = 0.8;
/// Inertia that a joint has at least for its damping, kg m^2. Chosen: the wrist with its rotor.
const LEAST_INERTIA_KG_M2: f64 = 0.05;
/// Effective mass (kg) and inertia (kg m^2) at the hand for the Cartesian damping. Chosen: a Panda at its ready pose.
const HAND_INERTIA: [f64; 6] = [4.0, 4.0, 4.0, 0.1, 0.1, 0.1];
/// Stiffness of the null space of the Cartesian impedance, N m/rad. Guess.
const NULL_STIFFNESS_N_M: f64 = 20.0;
/// Damping of the null space of the Cartesian impedance, N m s/rad. Guess.
const NULL_DAMPING_N_M_S: f64 = 8.0;
/// Damping of a joint that a hand guides, N m s/rad. Guess.
const GUIDING_DAMPING_N_M_S: f64 = 1.0;
/// Damping of a Cartesian axis that is not free while a hand guides, N s/m and N m s/rad. Chosen: stiff to a hand.
const LOCKED_DAMPING: [f64; 6] = [500.0, 500.0, 500.0, 50.0, 50.0, 50.0];

/// Law of the joint impedance for desired angles, speeds and accelerations at the end of the cycle. `rotors`: inertias, kg m^2, that
/// the motors move beside the links.
pub fn joint_impedance(
    stiffness: &[f64; 7],
    desired: (&Joints, &Joints, &Joints),
    terms: &Terms,
    rotors: &Joints,
) -> MotorLaw {
    let (q_d, dq_d, ddq_d) = desired;
    let stiffness = Joints::from(*stiffness);
    let damping = Joints::from_fn(|i, _| {
        let inertia = (terms.mass[(i, i)] + rotors[i]).max(LEAST_INERTIA_KG_M2);
        2.0 * DAMPING_RATIO * (stiffness[i] * inertia).sqrt()
    });
    MotorLaw {
        torque: terms.mass * ddq_d + rotors.component_mul(ddq_d) + terms.coriolis,
        stiffness: JointMatrix::from_diagonal(&stiffness),
        damping: JointMatrix::from_diagonal(&damping),
        q_d: *q_d,
        dq_d: *dq_d,
    }
}

/// Law of the Cartesian impedance. `stiffness`: in the axes of K. `desired`: pose at the end of the cycle, and the joint-space
/// motion that belongs to it.
pub fn cartesian_impedance(
    stiffness: &[f64; 6],
    desired: (&Frame, &Joints, &Joints),
    measured: (&Joints, &Frame, &Jacobian),
    axes_of_k: &Frame,
    terms: &Terms,
) -> MotorLaw {
    let (pose_d, q_d, dq_d) = desired;
    let (q, pose, jacobian) = measured;
    let damping = std::array::from_fn(|i| 2.0 * DAMPING_RATIO * (stiffness[i] * HAND_INERTIA[i]).sqrt());
    let (stiffness, damping) = (turned(stiffness, axes_of_k), turned(&damping, axes_of_k));
    let free = null_space(jacobian);
    let pull = jacobian.tr_mul(&(stiffness * pose.step_to(pose_d)));
    let stiffness = jacobian.tr_mul(&(stiffness * jacobian));
    let posture = free * NULL_STIFFNESS_N_M;
    // The reference runs from the measured angles at the desired speeds. The pose error at the start is part of the torque.
    let reference = q + dq_d * CYCLE_S;
    MotorLaw {
        torque: pull - stiffness * dq_d * CYCLE_S + posture * (q_d - reference) + terms.coriolis,
        stiffness: stiffness + posture,
        damping: jacobian.tr_mul(&(damping * jacobian)) + free * NULL_DAMPING_N_M_S,
        q_d: reference,
        dq_d: *dq_d,
    }
}

/// Law of an arm that a hand guides.
pub fn guided(free_axes: &[bool; 6], jacobian: &Jacobian, axes_of_k: &Frame) -> MotorLaw {
    let locked = std::array::from_fn(|i| if free_axes[i] { 0.0 } else { LOCKED_DAMPING[i] });
    let mut law = MotorLaw::constant(Joints::zeros());
    law.damping = jacobian.tr_mul(&(turned(&locked, axes_of_k) * jacobian))
        + JointMatrix::from_diagonal_element(GUIDING_DAMPING_N_M_S);
    law
}

/// Diagonal matrix in the axes of a frame, turned into those of O.
fn turned(diagonal: &[f64; 6], axes: &Frame) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    for block in [0, 3] {
        let part = nalgebra::Vector3::from_row_slice(&diagonal[block..block + 3]);
        let turned = axes.rotation * nalgebra::Matrix3::from_diagonal(&part) * axes.rotation.transpose();
        matrix.fixed_view_mut::<3, 3>(block, block).copy_from(&turned);
    }
    matrix
}

/// Projector of joint torques that exert no wrench at the hand. Zero at a singularity, where it has no meaning.
fn null_space(jacobian: &Jacobian) -> JointMatrix {
    let square: Matrix6<f64> = jacobian * jacobian.transpose();
    match square.cholesky() {
        Some(cholesky) => {
            let pseudo: SMatrix<f64, 6, 7> = cholesky.solve(jacobian);
            JointMatrix::identity() - jacobian.tr_mul(&pseudo)
        }
        None => JointMatrix::zeros(),
    }
}

/// Reference that an arm without a motion holds: a stop with constant deceleration, then rest.
#[derive(Debug, Clone, Copy)]
pub struct Hold {
    /// Angles, rad.
    pub q: Joints,
    /// Speeds, rad/s.
    pub dq: Joints,
    /// Change of the speeds in a cycle, rad/s.
    slowing: Joints,
    cycles_left: u32,
}

impl Hold {
    /// Hold at rest.
    pub fn at_rest(q: Joints) -> Self {
        Self { q, dq: Joints::zeros(), slowing: Joints::zeros(), cycles_left: 0 }
    }

    /// Stop from speeds, rad/s, within a time.
    pub fn stop(q: Joints, dq: Joints, time_s: f64) -> Self {
        let cycles_left = (time_s / CYCLE_S).round().max(1.0);
        Self { q, dq, slowing: dq / cycles_left, cycles_left: cycles_left as u32 }
    }

    /// Returns true if the reference is at rest.
    pub fn is_at_rest(&self) -> bool {
        self.cycles_left == 0
    }

    /// Angles at the end of the stop, rad.
    pub fn end(&self) -> Joints {
        let left = f64::from(self.cycles_left);
        self.q + self.slowing * (CYCLE_S * 0.5 * left * (left - 1.0))
    }

    /// Advances by a cycle and returns the acceleration, rad/s^2.
    pub fn advance(&mut self) -> Joints {
        if self.cycles_left == 0 {
            return Joints::zeros();
        }
        self.cycles_left -= 1;
        self.dq = if self.cycles_left == 0 { Joints::zeros() } else { self.dq - self.slowing };
        self.q += self.dq * CYCLE_S;
        -self.slowing / CYCLE_S
    }
}

/// Pose of the end effector at joint angles.
pub fn hand_at(q: &Joints, tool: &Frame) -> Frame {
    Chain::at(q).flange.then(tool)
}

/// Speed of the translation of a twist, m/s.
pub fn speed_m_s(twist: &Six) -> f64 {
    twist.fixed_rows::<3>(0).norm()
}
