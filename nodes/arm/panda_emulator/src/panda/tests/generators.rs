//! Generators: a command at a limit passes, and one beyond it names its error.

use super::*;

const DT: f64 = 1e-3;

/// Settings whose arm-side checks do not hide those of the generator.
fn open() -> Settings {
    Settings { collision: thresholds(1e6, 1e6), power_limit_w: 1e6, checks_torque_range: false, ..settings() }
}

fn moving(generator: Generator) -> Session {
    Session::moving(open(), ControllerMode::JointImpedance, generator)
}

/// Speeds of a ramp with a jerk and a top acceleration, up to a top speed.
fn ramp(jerk: f64, acceleration: f64, speed: f64) -> impl Iterator<Item = f64> {
    let (mut v, mut a) = (0.0_f64, 0.0_f64);
    std::iter::from_fn(move || {
        // Acceleration that may still fall to zero before the top speed.
        let braking = (2.0 * jerk * (speed - v).max(0.0)).sqrt() - jerk * DT;
        a = (a + jerk * DT).min(acceleration).min(braking.max(0.0)).max(a - jerk * DT).max(0.0);
        v += a * DT;
        Some(v)
    })
}

/// Commands speeds along one channel until the motion ends or `cycles` are over.
fn drive(
    session: &mut Session,
    speeds: impl Iterator<Item = f64>,
    cycles: usize,
    set: impl Fn(&mut RobotCommand, f64),
) {
    for v in speeds.take(cycles) {
        set(&mut session.command, v);
        if session.step().robot_mode != RobotMode::Move {
            return;
        }
    }
}

fn turn(command: &mut RobotCommand, v: f64) {
    command.q_c[0] += v * DT;
}

fn spin(command: &mut RobotCommand, v: f64) {
    command.dq_c[0] = v;
}

fn slide(command: &mut RobotCommand, v: f64) {
    command.o_t_ee_c[13] += v * DT;
}

fn glide(command: &mut RobotCommand, v: f64) {
    command.o_dp_ee_c[1] = v;
}

#[test]
fn joint_positions_name_errors_one_derivative_above() {
    for (jerk, acceleration, speed, kind) in [
        (7000.0, 14.0, 2.3, ErrorKind::JointMotionGeneratorVelocityLimitsViolation),
        (7000.0, 15.5, 2.0, ErrorKind::JointMotionGeneratorVelocityDiscontinuity),
        (7600.0, 14.0, 2.0, ErrorKind::JointMotionGeneratorAccelerationDiscontinuity),
    ] {
        let mut session = moving(Generator::JointPosition);
        drive(&mut session, ramp(jerk, acceleration, speed), 400, turn);
        session.assert_reflex(kind);
    }
    let mut session = moving(Generator::JointPosition);
    drive(&mut session, ramp(7499.0, 14.99, 2.17), 400, turn);
    assert_eq!(session.state().robot_mode, RobotMode::Move, "{:?}", session.state().reflex_reason);
}

#[test]
fn joint_position_out_of_range_and_wrong_start_are_named() {
    let mut session = Session::moving(
        Settings { start_joints_rad: [2.89, -0.78, 0.0, -2.35, 0.0, 1.57, 0.78], ..open() },
        ControllerMode::JointImpedance,
        Generator::JointPosition,
    );
    drive(&mut session, ramp(500.0, 1.0, 0.05), 400, turn);
    session.assert_reflex(ErrorKind::JointMotionGeneratorPositionLimitsViolation);

    let mut session = Session::new(open());
    session.start(ControllerMode::JointImpedance, Generator::JointPosition);
    session.command.q_c[3] += 0.01;
    session.step();
    session.assert_reflex(ErrorKind::JointPositionMotionGeneratorStartPoseInvalid);
}

#[test]
fn joint_speeds_name_jumps_as_acceleration() {
    for (jerk, acceleration, speed, kind) in [
        (7000.0, 14.0, 2.3, ErrorKind::JointMotionGeneratorVelocityLimitsViolation),
        (7000.0, 15.5, 2.0, ErrorKind::JointMotionGeneratorAccelerationDiscontinuity),
        (7600.0, 14.0, 2.0, ErrorKind::JointMotionGeneratorAccelerationDiscontinuity),
    ] {
        let mut session = moving(Generator::JointVelocity);
        drive(&mut session, ramp(jerk, acceleration, speed), 400, spin);
        session.assert_reflex(kind);
    }
}

#[test]
fn poses_name_errors_of_the_hand() {
    for (jerk, acceleration, speed, kind) in [
        (400.0, 1.5, 0.35, ErrorKind::CartesianMotionGeneratorVelocityLimitsViolation),
        (400.0, 13.5, 0.3, ErrorKind::CartesianMotionGeneratorVelocityDiscontinuity),
        (6600.0, 1.0, 0.3, ErrorKind::CartesianMotionGeneratorAccelerationDiscontinuity),
    ] {
        let mut session = moving(Generator::CartesianPosition);
        // Tighter limits of the hand, so that its checks are met before those of the joints.
        session.panda.limits.translation.speed = 0.32;
        if kind == ErrorKind::CartesianMotionGeneratorVelocityDiscontinuity {
            session.panda.limits.translation.acceleration = 1.2;
        }
        if kind == ErrorKind::CartesianMotionGeneratorAccelerationDiscontinuity {
            session.panda.limits.translation.jerk = 900.0;
            drive(&mut session, ramp(950.0, acceleration, speed), 200, slide);
        } else {
            drive(&mut session, ramp(jerk, acceleration.min(1.5), speed), 600, slide);
        }
        session.assert_reflex(kind);
    }
}

#[test]
fn wrong_start_pose_and_broken_matrix_are_named() {
    let mut session = Session::new(open());
    session.start(ControllerMode::JointImpedance, Generator::CartesianPosition);
    session.command.o_t_ee_c[12] += 0.01;
    session.step();
    session.assert_reflex(ErrorKind::CartesianPositionMotionGeneratorStartPoseInvalid);

    let mut session = moving(Generator::CartesianPosition);
    session.command.o_t_ee_c[0] += 1e-4;
    session.step();
    session.assert_reflex(ErrorKind::CartesianPositionMotionGeneratorInvalidFrame);
}

#[test]
fn poses_are_checked_in_joint_space_as_on_a_panda() {
    // Recorded on a Panda at its ready pose, +x: 2.5 m/s^2 with 500 m/s^3 is refused with error 29 alone, 1.5 and 200 pass.
    let x = |command: &mut RobotCommand, v: f64| command.o_t_ee_c[12] += v * DT;
    let mut session = moving(Generator::CartesianPosition);
    drive(&mut session, ramp(500.0, 2.5, 0.3), 150, x);
    session.assert_reflex(ErrorKind::CartesianMotionGeneratorJointVelocityDiscontinuity);
    let mut session = moving(Generator::CartesianPosition);
    drive(&mut session, ramp(200.0, 1.5, 0.3), 300, x);
    assert_eq!(session.state().robot_mode, RobotMode::Move, "{:?}", session.state().reflex_reason);
    let mut session = moving(Generator::CartesianPosition);
    drive(&mut session, ramp(6400.0, 12.9, 0.3), 150, x);
    let reasons = session.state().reflex_reason;
    assert!(reasons.contains(ErrorKind::CartesianMotionGeneratorJointAccelerationDiscontinuity), "{reasons:?}");
}

#[test]
fn twists_name_jumps_as_acceleration() {
    for (limit, kind) in [
        (0, ErrorKind::CartesianMotionGeneratorVelocityLimitsViolation),
        (1, ErrorKind::CartesianMotionGeneratorAccelerationDiscontinuity),
        (2, ErrorKind::CartesianMotionGeneratorAccelerationDiscontinuity),
    ] {
        let mut session = moving(Generator::CartesianVelocity);
        let translation = &mut session.panda.limits.translation;
        *[&mut translation.speed, &mut translation.acceleration, &mut translation.jerk][limit] *=
            [0.1, 0.05, 0.05][limit];
        drive(&mut session, ramp(400.0, 1.0, 0.3), 600, glide);
        session.assert_reflex(kind);
    }
}

#[test]
fn elbow_is_checked_for_start_sign_and_speed() {
    let start = |elbow: [f64; 2]| {
        let mut session = Session::new(open());
        session.start(ControllerMode::JointImpedance, Generator::CartesianPosition);
        session.command.elbow_c = Some(elbow);
        session.step();
        session
    };
    start([0.1, -1.0]).assert_reflex(ErrorKind::CartesianMotionGeneratorStartElbowInvalid);
    start([0.0, 1.0]).assert_reflex(ErrorKind::StartElbowSignInconsistent);
    let mut flipped = start([0.0, -1.0]);
    flipped.command.elbow_c = Some([0.0, 1.0]);
    flipped.step();
    flipped.assert_reflex(ErrorKind::CartesianMotionGeneratorElbowSignInconsistent);
    let mut jumped = start([0.0, -1.0]);
    jumped.command.elbow_c = Some([1e-4, -1.0]);
    jumped.step();
    jumped.assert_reflex(ErrorKind::CartesianMotionGeneratorElbowLimitViolation);
    let mut slow = start([0.0, -1.0]);
    drive(&mut slow, ramp(50.0, 0.5, 0.1), 1000, |command, v| {
        if let Some([position, _]) = &mut command.elbow_c {
            *position += v * DT;
        }
    });
    assert_eq!(slow.state().robot_mode, RobotMode::Move, "{:?}", slow.state().reflex_reason);
    assert!((slow.state().elbow_d[0] - slow.command.elbow_c.unwrap()[0]).abs() < 1e-9);
}

#[test]
fn lost_positions_go_on_at_the_last_acceleration() {
    let mut session = moving(Generator::JointPosition);
    drive(&mut session, ramp(5000.0, 5.0, 2.0), 100, turn);
    let (v, a) = (session.state().dq_d[0], session.state().ddq_d[0]);
    assert!((a - 5.0).abs() < 1e-6);
    session.idle(10);
    assert!((session.state().dq_d[0] - (v + a * 10.0 * DT)).abs() < 1e-9);
}
