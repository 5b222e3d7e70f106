//! Robot state and robot command of a cycle.

use super::{Errors, IDENTITY};

/// State of the control box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RobotMode {
    /// Brakes closed, or starting.
    #[default]
    Other,
    /// Brakes open, no motion.
    Idle,
    /// Motion of a client.
    Move,
    /// Guided by hand.
    Guiding,
    /// Stopped by a reflex.
    Reflex,
    /// Stopped by the user.
    UserStopped,
    /// Recovering from a reflex.
    AutomaticErrorRecovery,
}

/// Motion generator of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Generator {
    /// Joint positions.
    JointPosition,
    /// Joint velocities.
    JointVelocity,
    /// Pose of the end effector.
    CartesianPosition,
    /// Twist of the end effector.
    CartesianVelocity,
    /// No generator: torques alone (FCI 10).
    None,
}

/// Controller of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerMode {
    /// Internal joint impedance.
    JointImpedance,
    /// Internal Cartesian impedance.
    CartesianImpedance,
    /// Torques of the client.
    External,
}

/// Robot state of one cycle. The names are those of libfranka in lower case.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the names are those of libfranka's RobotState, whose documentation holds")]
pub struct RobotState {
    /// Clock of the control box, ms.
    pub message_id: u64,
    pub o_t_ee: [f64; 16],
    pub o_t_ee_d: [f64; 16],
    pub f_t_ee: [f64; 16],
    pub ee_t_k: [f64; 16],
    pub f_t_ne: [f64; 16],
    pub ne_t_ee: [f64; 16],
    pub m_ee: f64,
    pub i_ee: [f64; 9],
    pub f_x_cee: [f64; 3],
    pub m_load: f64,
    pub i_load: [f64; 9],
    pub f_x_cload: [f64; 3],
    pub elbow: [f64; 2],
    pub elbow_d: [f64; 2],
    pub tau_j: [f64; 7],
    pub tau_j_d: [f64; 7],
    pub dtau_j: [f64; 7],
    pub q: [f64; 7],
    pub q_d: [f64; 7],
    pub dq: [f64; 7],
    pub dq_d: [f64; 7],
    pub ddq_d: [f64; 7],
    pub joint_contact: [f64; 7],
    pub cartesian_contact: [f64; 6],
    pub joint_collision: [f64; 7],
    pub cartesian_collision: [f64; 6],
    pub tau_ext_hat_filtered: [f64; 7],
    pub o_f_ext_hat_k: [f64; 6],
    pub k_f_ext_hat_k: [f64; 6],
    pub o_dp_ee_d: [f64; 6],
    pub o_ddp_o: [f64; 3],
    pub elbow_c: [f64; 2],
    pub delbow_c: [f64; 2],
    pub ddelbow_c: [f64; 2],
    pub o_t_ee_c: [f64; 16],
    pub o_dp_ee_c: [f64; 6],
    pub o_ddp_ee_c: [f64; 6],
    pub theta: [f64; 7],
    pub dtheta: [f64; 7],
    /// Generator and controller of the running motion; `None` without one.
    pub motion: Option<(Generator, ControllerMode)>,
    /// Errors that hold now.
    pub errors: Errors,
    /// Errors that ended the last motion.
    pub reflex_reason: Errors,
    pub robot_mode: RobotMode,
    /// Share of the last 100 commands that arrived in time, 0 to 1.
    pub control_command_success_rate: f64,
}

impl RobotState {
    /// Passes all numbers on, in the order that the versions of the FCI share.
    pub fn for_each_field(&self, mut put: impl FnMut(&[f64])) {
        for pose in [&self.o_t_ee, &self.o_t_ee_d, &self.f_t_ee, &self.ee_t_k, &self.f_t_ne, &self.ne_t_ee] {
            put(pose);
        }
        put(&[self.m_ee]);
        put(&self.i_ee);
        put(&self.f_x_cee);
        put(&[self.m_load]);
        put(&self.i_load);
        put(&self.f_x_cload);
        put(&self.elbow);
        put(&self.elbow_d);
        for joints in [
            &self.tau_j,
            &self.tau_j_d,
            &self.dtau_j,
            &self.q,
            &self.q_d,
            &self.dq,
            &self.dq_d,
            &self.ddq_d,
            &self.joint_contact,
        ] {
            put(joints);
        }
        put(&self.cartesian_contact);
        put(&self.joint_collision);
        put(&self.cartesian_collision);
        put(&self.tau_ext_hat_filtered);
        put(&self.o_f_ext_hat_k);
        put(&self.k_f_ext_hat_k);
        put(&self.o_dp_ee_d);
        put(&self.o_ddp_o);
        for elbow in [&self.elbow_c, &self.delbow_c, &self.ddelbow_c] {
            put(elbow);
        }
        put(&self.o_t_ee_c);
        put(&self.o_dp_ee_c);
        put(&self.o_ddp_ee_c);
        put(&self.theta);
        put(&self.dtheta);
    }

    /// Returns true if no number is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let mut finite = self.control_command_success_rate.is_finite();
        self.for_each_field(|numbers| finite &= numbers.iter().all(|number| number.is_finite()));
        finite
    }
}

impl Default for RobotState {
    fn default() -> Self {
        Self {
            message_id: 0,
            o_t_ee: IDENTITY,
            o_t_ee_d: IDENTITY,
            f_t_ee: IDENTITY,
            ee_t_k: IDENTITY,
            f_t_ne: IDENTITY,
            ne_t_ee: IDENTITY,
            m_ee: 0.0,
            i_ee: [0.0; 9],
            f_x_cee: [0.0; 3],
            m_load: 0.0,
            i_load: [0.0; 9],
            f_x_cload: [0.0; 3],
            elbow: [0.0; 2],
            elbow_d: [0.0; 2],
            tau_j: [0.0; 7],
            tau_j_d: [0.0; 7],
            dtau_j: [0.0; 7],
            q: [0.0; 7],
            q_d: [0.0; 7],
            dq: [0.0; 7],
            dq_d: [0.0; 7],
            ddq_d: [0.0; 7],
            joint_contact: [0.0; 7],
            cartesian_contact: [0.0; 6],
            joint_collision: [0.0; 7],
            cartesian_collision: [0.0; 6],
            tau_ext_hat_filtered: [0.0; 7],
            o_f_ext_hat_k: [0.0; 6],
            k_f_ext_hat_k: [0.0; 6],
            o_dp_ee_d: [0.0; 6],
            o_ddp_o: [0.0; 3],
            elbow_c: [0.0; 2],
            delbow_c: [0.0; 2],
            ddelbow_c: [0.0; 2],
            o_t_ee_c: IDENTITY,
            o_dp_ee_c: [0.0; 6],
            o_ddp_ee_c: [0.0; 6],
            theta: [0.0; 7],
            dtheta: [0.0; 7],
            motion: None,
            errors: Errors::default(),
            reflex_reason: Errors::default(),
            robot_mode: RobotMode::default(),
            control_command_success_rate: 0.0,
        }
    }
}

/// Command of a client for one cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotCommand {
    /// `message_id` of the state that the command answers.
    pub message_id: u64,
    /// Joint positions, rad.
    pub q_c: [f64; 7],
    /// Joint velocities, rad/s.
    pub dq_c: [f64; 7],
    /// Pose of the end effector in O.
    pub o_t_ee_c: [f64; 16],
    /// Twist of the end effector in O: m/s, then rad/s.
    pub o_dp_ee_c: [f64; 6],
    /// Position of joint 3 (rad) and sign of joint 4, if the client commands the elbow.
    pub elbow_c: Option<[f64; 2]>,
    /// Joint torques without gravity and friction, N m.
    pub tau_j_d: [f64; 7],
    /// The client ends the motion with this command.
    pub finished: bool,
}
