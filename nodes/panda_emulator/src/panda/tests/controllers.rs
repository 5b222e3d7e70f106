//! Internal controllers: they follow a path and stay stable.

use super::*;

fn swing(session: &mut Session, joint: usize, amplitude_rad: f64, cycles: u32) -> f64 {
    let start = session.state().q_d;
    let mut error: f64 = 0.0;
    for k in 1..=cycles {
        let share = f64::from(k) / f64::from(cycles);
        session.command.q_c[joint] = start[joint] + amplitude_rad * 0.5 * (1.0 - (std::f64::consts::TAU * share).cos());
        let state = session.step();
        assert_eq!(state.robot_mode, RobotMode::Move, "{:?}", state.reflex_reason.names().collect::<Vec<_>>());
        error = error.max((state.q[joint] - state.q_d[joint]).abs());
    }
    error
}

#[test]
fn joint_impedance_follows_a_swing_of_each_joint_within_3_mrad() {
    for joint in 0..7 {
        let mut session = Session::moving(settings(), ControllerMode::JointImpedance, Generator::JointPosition);
        let error = swing(&mut session, joint, 0.3, 3000);
        assert!(error < 3e-3, "joint {joint}: {error} rad");
        session.command.finished = true;
        session.step();
        assert_eq!(session.move_status(), Some(MoveStatus::Success), "joint {joint}");
    }
}

#[test]
fn cartesian_impedance_follows_a_circle_within_6_mm_and_ends_in_success() {
    let mut session = Session::moving(settings(), ControllerMode::CartesianImpedance, Generator::CartesianPosition);
    let start = session.state().o_t_ee_c;
    for k in 1..=4000 {
        // The angle runs from 0 to 2 pi with speed and acceleration zero at both ends.
        let s = f64::from(k) / 4000.0;
        let angle = std::f64::consts::TAU * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
        session.command.o_t_ee_c[12] = start[12] + 0.05 * (1.0 - angle.cos());
        session.command.o_t_ee_c[13] = start[13] + 0.05 * angle.sin();
        let state = session.step();
        assert_eq!(state.robot_mode, RobotMode::Move, "{:?}", state.reflex_reason.names().collect::<Vec<_>>());
        let error_m = (12..15).map(|i| (state.o_t_ee[i] - state.o_t_ee_c[i]).abs()).fold(0.0, f64::max);
        assert!(error_m < 6e-3, "{error_m} m in cycle {k}");
    }
    session.command.finished = true;
    session.step();
    assert_eq!(session.move_status(), Some(MoveStatus::Success));
}

#[test]
fn filter_of_the_controller_lags_behind_a_step_of_torque() {
    let mut session = Session::new(settings());
    session.panda.request(1, &Request::SetFilters([100.0; 5]));
    assert_eq!(session.panda.take_answers().len(), 1);
    session.start(ControllerMode::External, Generator::JointVelocity);
    session.step();
    session.command.tau_j_d[0] = 1.0;
    session.step();
    let motion = session.panda.motion.as_ref().unwrap();
    assert!((motion.torque[0] - 0.385_869_5).abs() < 1e-6);
    assert_eq!(session.state().tau_j_d[0], 1.0);
}

#[test]
fn wrist_damping_of_15_n_m_s_is_stable_in_torque_control() {
    let mut session = Session::torque(settings());
    for k in 0..2000 {
        let damping = [50.0, 50.0, 50.0, 50.0, 15.0, 15.0, 15.0];
        for i in 0..7 {
            let kick = if k < 20 { 0.5 } else { 0.0 };
            let wanted: f64 = kick - damping[i] * session.state().dq[i];
            let last = session.state().tau_j_d[i];
            session.command.tau_j_d[i] = wanted.clamp(last - 0.99, last + 0.99);
        }
        session.step();
    }
    assert_eq!(session.state().robot_mode, RobotMode::Move);
    assert!(session.state().dq.iter().all(|v| v.abs() < 0.01), "{:?}", session.state().dq);
}
