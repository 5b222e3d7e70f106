//! Order of the fields of a robot state, which versions 5 and 10 share.

use super::bytes::Writer;
use crate::fci::{ControllerMode, Generator, RobotMode, RobotState};

/// Passes the numbers of a state on, in their order on the wire.
pub fn for_each_field(s: &RobotState, mut put: impl FnMut(&[f64])) {
    for pose in [&s.o_t_ee, &s.o_t_ee_d, &s.f_t_ee, &s.ee_t_k, &s.f_t_ne, &s.ne_t_ee] {
        put(pose);
    }
    put(&[s.m_ee]);
    put(&s.i_ee);
    put(&s.f_x_cee);
    put(&[s.m_load]);
    put(&s.i_load);
    put(&s.f_x_cload);
    put(&s.elbow);
    put(&s.elbow_d);
    for joints in [&s.tau_j, &s.tau_j_d, &s.dtau_j, &s.q, &s.q_d, &s.dq, &s.dq_d, &s.ddq_d, &s.joint_contact] {
        put(joints);
    }
    put(&s.cartesian_contact);
    put(&s.joint_collision);
    put(&s.cartesian_collision);
    put(&s.tau_ext_hat_filtered);
    put(&s.o_f_ext_hat_k);
    put(&s.k_f_ext_hat_k);
    put(&s.o_dp_ee_d);
    put(&s.o_ddp_o);
    for elbow in [&s.elbow_c, &s.delbow_c, &s.ddelbow_c] {
        put(elbow);
    }
    put(&s.o_t_ee_c);
    put(&s.o_dp_ee_c);
    put(&s.o_ddp_ee_c);
    put(&s.theta);
    put(&s.dtheta);
}

/// Writes modes and errors: 85 bytes.
pub fn put_modes(s: &RobotState, w: &mut Writer) {
    w.put(&[s.motion.map_or(0, |(generator, _)| generator_number(generator))]);
    // 3: "other", without a motion.
    w.put(&[s.motion.map_or(3, |(_, controller)| controller_number(controller))]);
    w.flags(&s.errors.flags());
    w.flags(&s.reflex_reason.flags());
    w.put(&[match s.robot_mode {
        RobotMode::Other => 0,
        RobotMode::Idle => 1,
        RobotMode::Move => 2,
        RobotMode::Guiding => 3,
        RobotMode::Reflex => 4,
        RobotMode::UserStopped => 5,
        RobotMode::AutomaticErrorRecovery => 6,
    }]);
}

/// Number of a generator in a state. A `Move` request has one less.
fn generator_number(generator: Generator) -> u8 {
    match generator {
        Generator::JointPosition => 1,
        Generator::JointVelocity => 2,
        Generator::CartesianPosition => 3,
        Generator::CartesianVelocity => 4,
        Generator::None => 5,
    }
}

fn controller_number(controller: ControllerMode) -> u8 {
    match controller {
        ControllerMode::JointImpedance => 0,
        ControllerMode::CartesianImpedance => 1,
        ControllerMode::External => 2,
    }
}
