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
    let mut session = Session::torque(Settings::default());
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

/// The motions of libfranka's examples run on a Panda with the thresholds at power-up, which are those that the examples set.
#[test]
fn motions_of_the_examples_of_libfranka_end_in_success_with_power_up_thresholds() {
    use std::f64::consts::{FRAC_PI_4, FRAC_PI_8, PI};
    type Path = fn(&RobotState, f64, &mut RobotCommand);
    let joint_positions: Path = |start, t, command| {
        let angle = FRAC_PI_8 * (1.0 - (PI / 2.5 * t).cos());
        [3, 4, 6].iter().for_each(|i| command.q_c[*i] = start.q_d[*i] + angle);
    };
    let joint_speeds: Path = |_, t, command| {
        let cycle = (-1.0_f64).powf(((t - t % 1.0) / 1.0).floor());
        let omega = cycle * 0.5 * (1.0 - (2.0 * PI * t).cos());
        [3, 4, 5, 6].iter().for_each(|i| command.dq_c[*i] = omega);
    };
    let poses: Path = |start, t, command| {
        let angle = FRAC_PI_4 * (1.0 - (PI / 5.0 * t).cos());
        command.o_t_ee_c[12] = start.o_t_ee_c[12] + 0.3 * angle.sin();
        command.o_t_ee_c[14] = start.o_t_ee_c[14] + 0.3 * (angle.cos() - 1.0);
    };
    let twists: Path = |_, t, command| {
        let cycle = (-1.0_f64).powf(((t - t % 4.0) / 4.0).floor());
        let speed = cycle * 0.05 * (1.0 - (2.0 * PI / 4.0 * t).cos());
        (command.o_dp_ee_c[0], command.o_dp_ee_c[2]) = (speed * FRAC_PI_4.cos(), -speed * FRAC_PI_4.sin());
    };
    for (generator, path, time_s) in [
        (Generator::JointPosition, joint_positions, 5.0),
        (Generator::JointVelocity, joint_speeds, 2.0),
        (Generator::CartesianPosition, poses, 10.0),
        (Generator::CartesianVelocity, twists, 8.0),
    ] {
        for controller in [ControllerMode::JointImpedance, ControllerMode::CartesianImpedance] {
            let mut session = Session::new(Settings::default());
            session.start(controller, generator);
            let start = session.state().clone();
            for k in 0..=(time_s * 1000.0) as u32 {
                path(&start, f64::from(k) * 1e-3, &mut session.command);
                let state = session.step();
                let reasons: Vec<_> = state.reflex_reason.names().collect();
                assert_eq!(state.robot_mode, RobotMode::Move, "{generator:?} {controller:?} {k} ms: {reasons:?}");
            }
            session.command.finished = true;
            session.step();
            assert_eq!(session.move_status(), Some(MoveStatus::Success), "{generator:?} {controller:?}");
        }
    }
}

#[test]
fn arm_that_is_pushed_off_its_path_violates_the_tolerance_of_the_request() {
    let free = Settings { collision: thresholds(1e6, 1e6), ..settings() };
    let mut session = Session::new(free);
    session.panda.request(1, &Request::SetCartesianImpedance([200.0, 200.0, 200.0, 20.0, 20.0, 20.0]));
    assert_eq!(session.panda.take_answers().len(), 1);
    let (controller, generator) = (ControllerMode::CartesianImpedance, Generator::CartesianVelocity);
    let request = MoveRequest { controller, generator, path_deviation: [0.05, 3.12, 6.3], goal_deviation: [10.0; 3] };
    session.panda.request(MOVE, &Request::Move(request));
    assert_eq!(session.move_status(), Some(MoveStatus::MotionStarted));
    session.panda.push([0.0, 5.0, 0.0, 0.0, 0.0, 0.0]);
    session.steps(500);
    assert_eq!(session.state().robot_mode, RobotMode::Move, "5 N move a spring of 200 N/m by 25 mm");
    session.panda.push([0.0, 20.0, 0.0, 0.0, 0.0, 0.0]);
    session.steps(500);
    session.assert_reflex(ErrorKind::MaxPathPoseDeviationViolation);
}

#[test]
fn joint_impedance_is_stable_whatever_the_motors_hide_of_their_rotors() {
    for rotor_inertia_ratio in [0.0, 0.2, 1.0] {
        let free = Settings { rotor_inertia_ratio, ..settings() };
        let mut session = Session::moving(free, ControllerMode::JointImpedance, Generator::JointPosition);
        let error = swing(&mut session, 6, 0.3, 2000);
        assert!(error < 5e-3, "ratio {rotor_inertia_ratio}: {error} rad");
        assert!(session.panda.true_joints().1.iter().all(|v| v.abs() < 0.01));
    }
}

/// Cartesian impedance of a client in torque mode, as in serl_franka_controllers: errors clipped to 1 cm and 0.05, 2000 N/m and
/// 150 N m/rad, critical damping of a unit mass, and the torque limited to 1 N m a cycle. It runs on a Panda, thus it must be stable here.
#[test]
fn impedance_of_a_client_moves_the_hand_and_comes_to_rest() {
    use crate::panda::chain::{Chain, Frame, Joints, Six};
    let mut session = Session::torque(Settings::default());
    let tool = Frame::from_array(&session.state().f_t_ee);
    let mut target = Frame::from_array(&session.state().o_t_ee);
    for k in 0..3000 {
        if k < 500 {
            target.origin.y += 1e-4;
        }
        let state = session.state();
        let chain = Chain::at(&Joints::from(state.q));
        let hand = chain.flange.then(&tool);
        let jacobian = chain.jacobian(&hand.origin);
        let step = hand.step_to(&target);
        let twist = jacobian * Joints::from(state.dq);
        let wrench = Six::from_fn(|i, _| match i {
            0..3 => 2000.0 * step[i].clamp(-0.01, 0.01) - 89.0 * twist[i],
            _ => 150.0 * (0.5 * step[i]).clamp(-0.05, 0.05) - 7.0 * twist[i],
        });
        let torque = jacobian.tr_mul(&wrench);
        for i in 0..7 {
            let last = session.state().tau_j_d[i];
            session.command.tau_j_d[i] = torque[i].clamp(last - 1.0, last + 1.0);
        }
        let reasons: Vec<_> = session.step().reflex_reason.names().collect();
        assert_eq!(session.state().robot_mode, RobotMode::Move, "cycle {k}: {reasons:?}");
    }
    let hand = Frame::from_array(&session.panda.true_hand().0);
    let error_m = hand.step_to(&target).fixed_rows::<3>(0).norm();
    assert!(error_m < 5e-3, "{error_m} m from the target");
    assert!(session.panda.true_joints().1.iter().all(|v| v.abs() < 0.01), "{:?}", session.panda.true_joints().1);
}
