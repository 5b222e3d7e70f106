//! Requests with values that a control box refuses, and configurations that do not fit the arm.

use super::*;
use crate::fci::{Load, SetterStatus};

/// Load without flaws: 0.5 kg between the fingers.
fn load() -> Load {
    Load { mass_kg: 0.5, centre_m: [0.0, 0.0, 0.17], inertia: [1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3] }
}

fn frame_at(x_m: f64) -> [f64; 16] {
    let mut frame = IDENTITY;
    frame[12] = x_m;
    frame
}

fn status(session: &mut Session, request: Request) -> SetterStatus {
    session.panda.request(3, &request);
    match session.panda.take_answers().pop() {
        Some((3, Answer::Setter(_, status))) => status,
        other => panic!("{other:?}"),
    }
}

/// Replaces one number of an array.
fn with<const N: usize>(mut numbers: [f64; N], at: usize, number: f64) -> [f64; N] {
    numbers[at] = number;
    numbers
}

fn refused_loads() -> Vec<Load> {
    let diagonal = |xx, yy, zz| [xx, 0.0, 0.0, 0.0, yy, 0.0, 0.0, 0.0, zz];
    let mut loads: Vec<_> = [-1e-9, 3.1, 1000.0, 1e6].map(|mass_kg| Load { mass_kg, ..load() }).into();
    loads.extend([0, 1, 2].map(|axis| Load { centre_m: with([0.0; 3], axis, -1.1), ..load() }));
    loads.extend(
        [
            // Larger than 0.5 kg can have within a metre.
            diagonal(1e3, 1e3, 1e3),
            diagonal(0.6, 0.6, 0.6),
            // Not symmetric.
            with(load().inertia, 1, 1e-4),
            // A negative principal inertia, though the diagonal is positive.
            [1e-3, 2e-3, 0.0, 2e-3, 1e-3, 0.0, 0.0, 0.0, 1e-3],
            // Against the triangle inequality.
            diagonal(1e-3, 1e-3, 2.1e-3),
        ]
        .map(|inertia| Load { inertia, ..load() }),
    );
    loads
}

#[test]
fn every_setter_refuses_values_out_of_its_range_and_changes_nothing() {
    let mut refused: Vec<Request> = refused_loads().into_iter().map(Request::SetLoad).collect();
    let mirrored = with(IDENTITY, 0, -1.0);
    let skewed = with(IDENTITY, 4, 1e-3);
    let projective = with(IDENTITY, 3, 0.1);
    for frame in [mirrored, skewed, projective, [0.0; 16], frame_at(1.1), frame_at(1e6)] {
        refused.extend([Request::SetNeToEe(frame), Request::SetEeToK(frame)]);
    }
    refused.extend([-1.0, 14_250.1].map(|k| Request::SetJointImpedance(with([2000.0; 7], 3, k))));
    refused.extend([9.9, 3000.1].map(|k| Request::SetCartesianImpedance(with([100.0; 6], 2, k))));
    refused.extend([0.9, 300.1].map(|k| Request::SetCartesianImpedance(with([100.0; 6], 3, k))));
    refused.extend([0.0, 0.9, 1000.1].map(|hz| Request::SetFilters(with([100.0; 5], 4, hz))));
    let high_lower = CollisionThresholds { lower_forces_nominal: [21.0; 6], ..thresholds(20.0, 20.0) };
    refused.extend([high_lower, thresholds(-1.0, 20.0), thresholds(20.0, -1.0)].map(Request::SetCollisionBehavior));
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        refused.extend([
            Request::SetLoad(Load { mass_kg: number, ..load() }),
            Request::SetLoad(Load { centre_m: [number, 0.0, 0.0], ..load() }),
            Request::SetLoad(Load { inertia: with(load().inertia, 8, number), ..load() }),
            Request::SetNeToEe(frame_at(number)),
            Request::SetEeToK(with(IDENTITY, 5, number)),
            Request::SetJointImpedance(with([2000.0; 7], 6, number)),
            Request::SetCartesianImpedance(with([100.0; 6], 5, number)),
            Request::SetFilters(with([100.0; 5], 0, number)),
            Request::SetCollisionBehavior(thresholds(number, 20.0)),
            Request::SetCollisionBehavior(thresholds(20.0, number)),
        ]);
    }
    let mut session = Session::new(settings());
    let before = format!("{:?}", session.panda.configuration);
    for request in refused {
        let text = format!("{request:?}");
        assert_eq!(status(&mut session, request), SetterStatus::InvalidArgumentRejected, "{text}");
        assert_eq!(format!("{:?}", session.panda.configuration), before, "{text}");
    }
}

#[test]
fn values_at_the_ends_of_the_ranges_are_accepted() {
    let rod = [0.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0];
    let mut accepted = vec![
        Request::SetLoad(load()),
        Request::SetLoad(crate::panda::rigid_body::NO_LOAD),
        Request::SetLoad(Load { mass_kg: 3.0, inertia: [0.0; 9], ..load() }),
        Request::SetLoad(Load { inertia: rod, ..load() }),
        Request::SetJointImpedance([0.0; 7]),
        Request::SetJointImpedance([14_250.0; 7]),
        Request::SetFilters([1.0; 5]),
        Request::SetFilters([1000.0; 5]),
        Request::SetCollisionBehavior(thresholds(1e6, 1e6)),
    ];
    accepted.extend([10.0, 3000.0].map(|k| Request::SetCartesianImpedance(with([100.0; 6], 0, k))));
    accepted.extend([1.0, 300.0].map(|k| Request::SetCartesianImpedance(with([100.0; 6], 4, k))));
    accepted.extend([-1.0, 0.0, 1.0].map(|x_m| Request::SetNeToEe(frame_at(x_m))));
    accepted.extend([-1.0, 0.0, 1.0].map(|x_m| Request::SetEeToK(frame_at(x_m))));
    let mut session = Session::new(settings());
    for request in accepted {
        let text = format!("{request:?}");
        assert_eq!(status(&mut session, request), SetterStatus::Success, "{text}");
    }
}

/// Sets what does not fit the arm, which ends in a reflex; recovers, sets what fits, and moves.
fn reflex_that_a_setter_heals(wrong: Request, right: Request) {
    let text = format!("{wrong:?}");
    let mut session = Session::new(settings());
    assert_eq!(status(&mut session, wrong), SetterStatus::Success, "{text}");
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Reflex, "{text}");
    assert_eq!(session.recover(), RecoveryStatus::Success, "{text}");
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Idle, "{text}: the setter must have its chance");
    // A motion ends at once: the arm seems to be in collision.
    session.start(ControllerMode::JointImpedance, Generator::JointVelocity);
    session.step();
    assert_eq!(session.move_status(), Some(MoveStatus::ReflexAborted), "{text}");
    session.idle(300);
    assert_eq!(session.recover(), RecoveryStatus::Success, "{text}");
    assert_eq!(status(&mut session, right), SetterStatus::Success, "{text}");
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Idle, "{text}");
    assert_eq!(session.start(ControllerMode::JointImpedance, Generator::JointVelocity), MoveStatus::MotionStarted);
    let before = session.state().q[6];
    for _ in 0..500 {
        session.command.dq_c[6] = (session.command.dq_c[6] + 1e-3).min(0.2);
        session.step();
    }
    assert_eq!(session.state().robot_mode, RobotMode::Move, "{text}");
    assert!(session.state().q[6] - before > 0.05, "{text}: {}", session.state().q[6] - before);
}

#[test]
fn a_load_that_the_hand_does_not_hold_is_a_reflex_that_the_right_load_heals() {
    let wrong = Load { mass_kg: 3.0, inertia: [0.0; 9], ..load() };
    reflex_that_a_setter_heals(Request::SetLoad(wrong), Request::SetLoad(crate::panda::rigid_body::NO_LOAD));
}

#[test]
fn thresholds_below_the_errors_of_the_sensors_are_a_reflex_that_higher_ones_heal() {
    let wrong = Request::SetCollisionBehavior(thresholds(0.01, 0.01));
    reflex_that_a_setter_heals(wrong, Request::SetCollisionBehavior(thresholds(20.0, 20.0)));
}

#[test]
fn a_push_after_the_recovery_is_a_reflex_again_once_the_old_one_has_gone() {
    let mut session = Session::new(settings());
    let push = [60.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    session.panda.push(push);
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Reflex);
    assert_eq!(session.recover(), RecoveryStatus::Success);
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Idle, "the hand that still pushes is known");
    session.panda.push([0.0; 6]);
    session.idle(1000);
    session.panda.push(push);
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Reflex);
}
