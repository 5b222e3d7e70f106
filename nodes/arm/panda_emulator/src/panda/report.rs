//! Robot state that the control box reports.

use super::chain::Joints;
use super::motion::cartesian::{CartesianPath, elbow_of};
use super::rigid_body::GRAVITY_M_S2;
use super::{Panda, control};
use crate::fci::ControllerMode;

impl Panda {
    /// Writes everything but the clock into the state.
    pub(super) fn report(&mut self) {
        self.report_configuration();
        self.report_measured();
        self.report_desired();
        let mode = self.mode();
        let state = &mut self.state;
        state.motion = self.motion.as_ref().map(|m| (m.request.generator, m.request.controller));
        state.errors = self.errors;
        state.reflex_reason = self.reflex_reason;
        state.robot_mode = mode;
        state.control_command_success_rate = self.motion.as_ref().map_or(0.0, |m| m.losses.success_rate());
    }

    fn report_configuration(&mut self) {
        let (state, configuration, hand) = (&mut self.state, &self.configuration, &self.settings.end_effector);
        state.f_t_ne = configuration.f_t_ne;
        state.ne_t_ee = configuration.ne_t_ee;
        state.f_t_ee = configuration.tool().to_array();
        state.ee_t_k = configuration.ee_t_k;
        (state.m_ee, state.i_ee, state.f_x_cee) = (hand.mass_kg, hand.inertia, hand.centre_m);
        let load = &configuration.load;
        (state.m_load, state.i_load, state.f_x_cload) = (load.mass_kg, load.inertia, load.centre_m);
        state.o_ddp_o = GRAVITY_M_S2;
    }

    fn report_measured(&mut self) {
        let (state, measured, external) = (&mut self.state, &self.measured, &self.external);
        let readings = &measured.readings;
        state.o_t_ee = measured.hand.to_array();
        state.elbow = elbow_of(&readings.q);
        (state.q, state.dq) = (readings.q.into(), readings.dq.into());
        (state.tau_j, state.dtau_j) = (readings.tau.into(), measured.torque_rate.into());
        let gear = self.settings.gear_stiffness_n_m_per_rad;
        state.theta = (readings.q + readings.tau / gear).into();
        state.dtheta = (readings.dq + measured.torque_rate / gear).into();
        state.tau_ext_hat_filtered = external.torques.into();
        (state.o_f_ext_hat_k, state.k_f_ext_hat_k) = (external.wrench_o.into(), external.wrench_k.into());
        (state.joint_contact, state.cartesian_contact) = (self.contact.joints, self.contact.axes);
        (state.joint_collision, state.cartesian_collision) =
            (self.contact.joint_collisions, self.contact.axis_collisions);
    }

    fn report_desired(&mut self) {
        let tool = self.configuration.tool();
        let (q, dq, ddq) = match &self.motion {
            Some(motion) => {
                let path = motion.generator.joints();
                (path.q, path.dq, path.ddq)
            }
            None => (self.hold.q, self.hold.dq, Joints::zeros()),
        };
        let pose = control::hand_at(&q, &tool);
        let rest = CartesianPath::at_rest(q, pose);
        let path = self.motion.as_ref().and_then(|m| m.generator.cartesian()).unwrap_or(&rest);
        let state = &mut self.state;
        (state.q_d, state.dq_d, state.ddq_d) = (q.into(), dq.into(), ddq.into());
        state.o_t_ee_d = pose.to_array();
        state.o_dp_ee_d = path.twist.into();
        state.elbow_d = elbow_of(&q);
        state.o_t_ee_c = path.pose.to_array();
        (state.o_dp_ee_c, state.o_ddp_ee_c) = (path.twist.into(), path.acceleration.into());
        state.elbow_c = path.elbow;
        state.delbow_c = [path.elbow_speed_rad_s, 0.0];
        state.ddelbow_c = [path.elbow_acceleration_rad_s2, 0.0];
        state.tau_j_d = match &self.motion {
            Some(motion) if motion.request.controller == ControllerMode::External => motion.commanded_torque.into(),
            Some(motion) if motion.losses.has_begun() => self.internal_torque.into(),
            _ => [0.0; 7],
        };
    }
}
