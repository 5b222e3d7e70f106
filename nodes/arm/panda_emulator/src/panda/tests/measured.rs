//! Measured arm: pose, gravity, load, contact, limits of the arm, determinism.

use super::*;
use crate::Wall;
use crate::panda::rigid_body::NO_LOAD;
use franka::model::{FER_URDF, Frame, Model};

#[test]
fn pose_is_that_of_the_model_with_the_hand_0_2104_m_beyond_joint_7() {
    let session = Session::new(settings());
    let state = session.state();
    let model = Model::from_urdf(FER_URDF).unwrap();
    let pose = model.pose_q(Frame::EndEffector, &state.q, &state.f_t_ee, &IDENTITY);
    assert!(pose.iter().zip(state.o_t_ee).all(|(a, b)| (a - b).abs() < 1e-12));
    let joint = model.pose_q(Frame::Joint7, &state.q, &IDENTITY, &IDENTITY);
    assert!(((joint[14] - state.o_t_ee[14]) - 0.2104).abs() < 1e-6);
    assert_eq!(state.o_ddp_o, [0.0, 0.0, -9.81]);
    assert_eq!(state.f_t_ee[14], f64::from(0.1034_f32));
}

#[test]
fn torque_of_an_arm_at_rest_is_its_gravity_within_the_errors_of_sensors_and_model() {
    let mut session = Session::new(settings());
    session.idle(500);
    let state = session.state();
    let model = Model::from_urdf(FER_URDF).unwrap();
    let gravity = model.gravity_q(&state.q, state.m_ee, &state.f_x_cee, &state.o_ddp_o);
    for i in 0..7 {
        // 0.20 N m between the models, 0.2 N m of stiction, half a step of the sensor.
        let allowed = settings().torque_bias_n_m[i].abs() + 0.20 + 0.2 + 0.025;
        assert!((state.tau_j[i] - gravity[i]).abs() <= allowed, "joint {i}: {} {}", state.tau_j[i], gravity[i]);
    }
    assert_eq!(state.control_command_success_rate, 0.0);
}

#[test]
fn push_shows_with_the_sign_of_the_force_on_the_world() {
    let mut session = Session::new(Settings { torque_bias_n_m: [0.0; 7], ..settings() });
    session.idle(500);
    let before = session.state().o_f_ext_hat_k;
    session.panda.push([0.0, 0.0, 8.0, 0.0, 0.0, 0.0]);
    session.idle(500);
    let change = session.state().o_f_ext_hat_k[2] - before[2];
    // Friction of the joints carries a part of the push.
    assert!((-9.5..-6.0).contains(&change), "the world pushes up, the robot presses down: {change} N");
}

#[test]
fn push_of_25_n_is_contact_then_cartesian_reflex_and_nothing_at_high_thresholds() {
    for (limit, trips) in [(20.0, true), (100.0, false)] {
        let mut behaviour = thresholds(100.0, limit);
        behaviour.lower_forces_nominal = [10.0; 6];
        behaviour.lower_forces_acceleration = [10.0; 6];
        let mut session = Session::new(settings());
        session.panda.request(1, &Request::SetCollisionBehavior(behaviour));
        assert_eq!(session.panda.take_answers().len(), 1);
        session.start(ControllerMode::JointImpedance, Generator::JointVelocity);
        session.steps(100);
        session.panda.push([25.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let mut contact = false;
        for _ in 0..300 {
            session.step();
            contact |= session.state().robot_mode == RobotMode::Move && session.state().cartesian_contact[0] == 1.0;
        }
        assert!(contact, "contact comes before the reflex");
        if trips {
            assert_eq!(session.state().cartesian_collision[0], 1.0);
            session.assert_reflex(ErrorKind::CartesianReflex);
            assert_eq!(session.state().cartesian_collision, [0.0; 6]);
        } else {
            assert_eq!(session.state().robot_mode, RobotMode::Move);
        }
    }
}

#[test]
fn unknown_load_of_half_a_kilogram_sags_by_its_weight_over_the_stiffness() {
    let ball = crate::fci::Load { mass_kg: 0.5, centre_m: [0.0, 0.0, 0.1034], inertia: [0.0; 9] };
    let sag_m = |true_load, configured| {
        // Friction would carry a part of the weight.
        let free = Settings { true_load, stiction_n_m: [0.0; 7], friction_ratio: 0.0, ..settings() };
        let mut session = Session::new(free);
        session.panda.request(1, &Request::SetLoad(configured));
        session.panda.request(1, &Request::SetCartesianImpedance([500.0, 500.0, 500.0, 50.0, 50.0, 50.0]));
        assert_eq!(session.panda.take_answers().len(), 2);
        session.start(ControllerMode::CartesianImpedance, Generator::CartesianVelocity);
        session.steps(3000);
        assert_eq!(session.state().robot_mode, RobotMode::Move);
        session.panda.true_hand().0[14]
    };
    let bare_m = sag_m(NO_LOAD, NO_LOAD);
    let sunk_m = bare_m - sag_m(ball, NO_LOAD);
    let expected_m = 0.5 * 9.81 / 500.0;
    assert!((sunk_m - expected_m).abs() < 0.05 * expected_m, "sag {sunk_m} m, expected {expected_m} m");
    let known_m = bare_m - sag_m(ball, ball);
    assert!(known_m.abs() < 1e-4, "a configured load sags by {known_m} m");
}

#[test]
fn free_arm_without_commanded_torque_stays_where_it_is() {
    let mut session = Session::torque(settings());
    let before = *session.panda.true_joints().0;
    session.steps(2000);
    let drift_rad = before.iter().zip(session.panda.true_joints().0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(drift_rad < 0.01, "gravity compensation lets the arm drift by {drift_rad} rad in 2 s");
}

#[test]
fn speed_of_a_joint_beyond_its_limit_is_a_velocity_violation() {
    let mut session = Session::new(Settings { hand_speed_m_s: 50.0, ..settings() });
    session.panda.request(1, &Request::SetCollisionBehavior(thresholds(1000.0, 1000.0)));
    assert_eq!(session.panda.take_answers().len(), 1);
    session.start(ControllerMode::External, Generator::JointVelocity);
    let mut fastest: f64 = 0.0;
    for _ in 0..2000 {
        let torque = &mut session.command.tau_j_d[6];
        *torque = (*torque + 0.05).min(5.0);
        session.step();
        if session.state().robot_mode != RobotMode::Move {
            break;
        }
        fastest = fastest.max(session.state().dq[6]);
    }
    assert!(fastest > 2.61, "{fastest} rad/s");
    session.assert_reflex(ErrorKind::JointVelocityViolation);
}

#[test]
fn reflex_brings_the_arm_to_rest_in_the_stop_time_and_holds_it() {
    let mut session = Session::torque(settings());
    for k in 0..150 {
        session.command.tau_j_d[0] = f64::from(k.min(80)) * 0.1;
        session.step();
    }
    let speed = session.panda.true_joints().1[0];
    assert!(speed > 0.3, "{speed} rad/s");
    session.idle(20);
    assert_eq!(session.state().robot_mode, RobotMode::Reflex);
    session.idle(160);
    assert!(session.panda.true_joints().1[0].abs() < 0.01, "{} rad/s", session.panda.true_joints().1[0]);
    let before = *session.panda.true_joints().0;
    session.idle(500);
    let crept = before.iter().zip(session.panda.true_joints().0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(crept < 1e-3, "{crept} rad");
}

#[test]
fn same_seed_and_commands_give_the_same_bits() {
    let run = |seed: u64| {
        let mut session = Session::new(Settings::default());
        session.panda = Panda::new(Settings::default(), seed).unwrap();
        session.start(ControllerMode::External, Generator::JointVelocity);
        let mut bits = Vec::new();
        for k in 0..500 {
            session.command.tau_j_d[5] = (f64::from(k) * 0.01).sin();
            let state = session.step();
            bits.extend(state.q.iter().chain(&state.dq).chain(&state.o_f_ext_hat_k).map(|v| v.to_bits()));
        }
        bits
    };
    assert!(run(3) == run(3));
    assert!(run(3) != run(4), "the seed reaches the noise");
}

#[test]
fn joint_pushed_out_of_its_range_may_come_back_after_recovery_or_needs_desk() {
    for manual in [false, true] {
        let start_joints_rad = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 2.87];
        let mut session =
            Session::new(Settings { start_joints_rad, limits_need_manual_recovery: manual, ..settings() });
        session.panda.request(1, &Request::SetCollisionBehavior(thresholds(100.0, 100.0)));
        assert_eq!(session.panda.take_answers().len(), 1);
        session.start(ControllerMode::External, Generator::JointVelocity);
        for _ in 0..2000 {
            session.command.tau_j_d[6] = (session.command.tau_j_d[6] + 0.01).min(1.5);
            if session.step().robot_mode != RobotMode::Move {
                break;
            }
        }
        assert!(session.state().reflex_reason.contains(ErrorKind::JointPositionLimitsViolation));
        assert_eq!(session.move_status(), Some(MoveStatus::ReflexAborted));
        session.idle(300);
        assert!(session.state().errors.contains(ErrorKind::JointPositionLimitsViolation), "the error stays");
        if manual {
            assert_eq!(session.recover(), RecoveryStatus::ManualErrorRecoveryRequiredRejected);
            session.panda.set_brakes(false);
            session.panda.set_brakes(true);
        } else {
            assert_eq!(session.recover(), RecoveryStatus::Success);
        }
        session.start(ControllerMode::External, Generator::JointVelocity);
        session.command.tau_j_d = [0.0; 7];
        for _ in 0..400 {
            session.command.tau_j_d[6] = (session.command.tau_j_d[6] - 0.01).max(-0.8);
            session.step();
        }
        assert_eq!(session.state().robot_mode, RobotMode::Move, "manual {manual}");
        assert!(session.state().q[6] < 2.8973);
    }
}

#[test]
fn hand_that_leaves_the_cuboid_is_a_cartesian_position_violation() {
    let mut frame = IDENTITY;
    (frame[12], frame[14]) = (0.3, 0.5);
    let mut session = Session::new(Settings { workspace_box: Some(([0.4, 0.2, 0.6], frame)), ..settings() });
    session.panda.request(1, &Request::GetCartesianLimit(0));
    let answers = session.panda.take_answers();
    assert!(matches!(answers[0].1, Answer::CartesianLimit(_, [0.4, 0.2, 0.6], _, true)), "{answers:?}");
    session.start(ControllerMode::JointImpedance, Generator::CartesianVelocity);
    for _ in 0..2000 {
        let speed = &mut session.command.o_dp_ee_c[1];
        *speed = (*speed + 5e-4).min(0.1);
        if session.step().robot_mode != RobotMode::Move {
            break;
        }
    }
    assert!((session.state().o_t_ee[13] - 0.1).abs() < 5e-3, "{}", session.state().o_t_ee[13]);
    session.command.o_dp_ee_c[1] = 0.0;
    let reasons: Vec<_> = session.state().reflex_reason.names().collect();
    assert_eq!(reasons, ["cartesian_position_limits_violation"]);
}

#[test]
fn setters_echo_in_the_state() {
    const INERTIA: [f64; 9] = [0.003, 0.001, 0.0, 0.001, 0.003, 0.0, 0.0, 0.0, 0.003];
    let mut session = Session::new(settings());
    let mut frame = IDENTITY;
    frame[14] = 0.05;
    let load = crate::fci::Load { mass_kg: 0.3, centre_m: [0.0, 0.01, 0.1], inertia: INERTIA };
    for request in [Request::SetNeToEe(frame), Request::SetEeToK(frame), Request::SetLoad(load)] {
        session.panda.request(1, &request);
    }
    assert_eq!(session.panda.take_answers().len(), 3);
    let before_m = session.state().o_t_ee[14];
    session.idle(1);
    let state = session.state();
    assert_eq!((state.m_load, state.f_x_cload, state.i_load), (0.3, [0.0, 0.01, 0.1], INERTIA));
    assert_eq!((state.ne_t_ee, state.ee_t_k), (frame, frame));
    assert!((state.f_t_ee[14] - state.f_t_ne[14] - 0.05).abs() < 1e-15);
    assert!((before_m - state.o_t_ee[14] - 0.05).abs() < 1e-6, "the hand points down");
}

#[test]
fn arm_that_folds_into_itself_stops_for_self_collision() {
    let start_joints_rad = [0.0, 1.0, 0.0, -2.9, 0.0, 1.2, 0.785];
    let free = Settings { start_joints_rad, collision: thresholds(1e6, 1e6), ..settings() };
    let mut session = Session::moving(free, ControllerMode::JointImpedance, Generator::JointVelocity);
    for _ in 0..6000 {
        let speed = &mut session.command.dq_c[5];
        *speed = (*speed - 1e-3).max(-0.3);
        if session.step().robot_mode != RobotMode::Move {
            break;
        }
    }
    session.command.dq_c = [0.0; 7];
    let reasons: Vec<_> = session.state().reflex_reason.names().collect();
    assert_eq!(reasons, ["self_collision_avoidance_violation"], "q6 {}", session.state().q[5]);
}

#[test]
fn cartesian_motion_from_a_stretched_arm_is_refused() {
    // Joint axes 1, 3 and 5 nearly coincide.
    let start_joints_rad = [0.0, 0.0, 0.0, -0.07, 0.0, 0.0, 0.0];
    let mut session = Session::new(Settings { start_joints_rad, ..settings() });
    let refused = session.start(ControllerMode::JointImpedance, Generator::CartesianVelocity);
    assert_eq!(refused, MoveStatus::StartAtSingularPoseRejected);
    session.idle(1);
    assert_eq!(session.state().o_f_ext_hat_k, [0.0; 6]);
}

#[test]
fn fr3_moves_under_torques_without_a_generator_and_a_panda_refuses_that() {
    use crate::fci::Generation;
    let fr3 = Settings { joint_speed_noise_rad_s: 0.0, ..Settings::of(Generation::Fr3) };
    let mut session = Session::moving(fr3, ControllerMode::External, Generator::None);
    session.steps(500);
    assert_eq!((session.state().robot_mode, session.state().control_command_success_rate), (RobotMode::Move, 1.0));
    session.command.finished = true;
    session.step();
    assert_eq!(session.move_status(), Some(MoveStatus::Success));
    let refused = Session::new(settings()).start(ControllerMode::External, Generator::None);
    assert_eq!(refused, MoveStatus::InvalidArgumentRejected);
}

/// libfranka's issue 76: a Panda reports a wrench of zero where the smallest singular value of the Jacobian is below 0.08.
#[test]
fn wrench_is_zero_exactly_where_the_smallest_singular_value_is_below_0_08() {
    let limits = crate::panda::checks::limits::Limits::of(&settings());
    let (mut zeros, mut others) = (0, 0);
    for k in 0..300_u32 {
        // Golden-ratio steps cover the range of the joints evenly.
        let start_joints_rad = std::array::from_fn(|i| {
            let share = (f64::from(k + 1) * 0.618_034 * (1.0 + 0.37 * i as f64)).fract();
            limits.lowest[i] + share * (limits.highest[i] - limits.lowest[i])
        });
        let mut session = Session::new(Settings { start_joints_rad, ..settings() });
        session.panda.request(1, &Request::SetCollisionBehavior(thresholds(1e6, 1e6)));
        session.idle(1);
        let least = session.panda.measured.jacobian_k.svd(false, false).singular_values.min();
        let is_zero = session.state().o_f_ext_hat_k == [0.0; 6];
        assert_eq!(is_zero, least < 0.08, "smallest singular value {least}");
        if is_zero { zeros += 1 } else { others += 1 }
    }
    assert!(zeros > 20 && others > 20, "{zeros} poses with a zero wrench, {others} without");
}

#[test]
fn arm_whose_simulation_diverges_is_put_back_stands_and_moves_again() {
    let mut session = Session::torque(settings());
    session.steps(100);
    let before = session.state().q;
    session.panda.push([1e12, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for _ in 0..50 {
        session.step();
        assert!(session.state().is_finite());
    }
    let moved = before.iter().zip(session.state().q).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(moved < 0.1, "{moved} rad");
    session.assert_reflex(ErrorKind::InstabilityDetected);
    assert_eq!(session.start(ControllerMode::External, Generator::JointVelocity), MoveStatus::MotionStarted);
    session.command.tau_j_d = [0.0; 7];
    session.steps(100);
    assert_eq!(session.state().robot_mode, RobotMode::Move);
}

#[test]
fn state_with_a_number_that_is_not_finite_is_never_reported() {
    let mut session = Session::torque(settings());
    session.panda.external.torques[2] = f64::NAN;
    session.step();
    assert!(session.state().is_finite());
    session.assert_reflex(ErrorKind::InstabilityDetected);
}

#[test]
fn push_and_wall_that_are_not_finite_are_ignored() {
    let mut session = Session::new(settings());
    for number in [f64::NAN, f64::INFINITY] {
        session.panda.push([0.0, number, 0.0, 0.0, 0.0, 0.0]);
        session.panda.set_wall(Some(Wall { x_m: number, stiffness_n_m: 100.0 }));
        session.panda.set_wall(Some(Wall { x_m: 0.1, stiffness_n_m: number }));
        session.idle(50);
        assert_eq!(session.state().robot_mode, RobotMode::Idle);
    }
}
