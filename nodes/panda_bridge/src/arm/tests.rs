use super::*;

/// Arm that covers the share `follows` of the remaining distance to its target in each step of 20 ms.
struct Lag {
    time_s: f64,
    at: ArmPose,
    target: Option<ArmPose>,
    follows: f64,
    orders: Vec<Order>,
    age_s: f64,
}

impl Plant for Lag {
    fn time_s(&self) -> f64 {
        self.time_s
    }

    fn measured(&self) -> Option<ArmPose> {
        Some(self.at)
    }

    fn measured_age_s(&self) -> f64 {
        self.age_s
    }

    fn obey(&mut self, order: &Order) {
        self.target = match order {
            Order::Target(pose) | Order::Hold(pose) => Some(*pose),
            Order::End => None,
        };
        self.orders.push(order.clone());
    }
}

fn pose(x_m: f64) -> ArmPose {
    ArmPose { position_m: [x_m, 0.0, 0.3], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] }
}

fn arm(follows: f64) -> Arm<Lag> {
    let plant = Lag { time_s: 10.0, at: pose(0.3), target: None, follows, orders: Vec::new(), age_s: 0.0 };
    let settings =
        ArmSettings { gate: GateSettings::default(), start: Some(pose(0.55)), real: true, start_tolerance_m: 0.03 };
    Arm::new(plant, settings)
}

/// Graph with one publisher of targets and no other arm.
fn alone() -> Surroundings {
    let rivals = Rivals { publishers: vec!["/policy_runner".to_owned()], ..Rivals::default() };
    Surroundings { rivals, unready: None }
}

/// Runs for `duration_s` of the plant's time, or until the move has ended.
fn run(arm: &mut Arm<Lag>, duration_s: f64) -> Progress {
    let end_s = arm.plant().time_s + duration_s;
    loop {
        arm.steer();
        let lag = arm.plant_mut();
        lag.time_s += 0.02;
        if let Some(target) = lag.target {
            for (at, to) in lag.at.position_m.iter_mut().zip(target.position_m) {
                *at += lag.follows * (to - *at);
            }
        }
        arm.watch();
        match arm.move_progress() {
            Progress::Moving(_) if arm.plant().time_s < end_s => {}
            other => return other,
        }
    }
}

#[test]
fn a_move_arrives_and_settles_at_the_start_pose() {
    let mut a = arm(0.2);
    a.begin_move(&alone(), None, 0.15, 1.0, false).unwrap();
    assert_eq!(a.mode(), Mode::Moving);
    assert_eq!(run(&mut a, 60.0), Progress::Arrived);
    // A minimum-jerk path of 0.25 m with a peak speed of 0.15 m/s takes 1.875 * 0.25 / 0.15 = 3.125 s; the rest takes 1 s.
    assert!((a.plant().time_s - 10.0 - 3.125 - 1.0).abs() < 0.1, "{} s", a.plant().time_s - 10.0);
    assert!(a.plant().at.distance_m(&pose(0.55)) < 1e-3);
    assert_eq!((a.mode(), a.target()), (Mode::Idle, Some(pose(0.55))), "nobody enabled it");
    assert_eq!(a.plant().target, Some(pose(0.55)), "it stays there");
}

#[test]
fn a_move_needs_no_time_once_only_its_end_is_to_be_told() {
    let mut a = arm(0.2);
    assert!(!a.is_moving_on());
    a.begin_move(&alone(), None, 0.15, 0.5, false).unwrap();
    assert!(a.is_moving_on());
    while a.is_moving_on() {
        a.steer();
        let lag = a.plant_mut();
        lag.time_s += 0.02;
        if let Some(target) = lag.target {
            lag.at = target;
        }
        a.watch();
        assert!(a.plant().time_s < 60.0);
    }
    // Path and rest are over, and the move ends with the next look at it, without any further time.
    assert_eq!((a.mode(), a.move_progress(), a.mode()), (Mode::Moving, Progress::Arrived, Mode::Idle));
    a.begin_move(&alone(), None, 0.15, 0.5, false).unwrap();
    a.disable();
    assert!(!a.is_moving_on());
}

#[test]
fn the_path_waits_for_an_arm_that_lags_and_never_runs_ahead_of_it() {
    // 1 % of the distance in 20 ms: far too slow for the 0.5 m/s of the path.
    let mut a = arm(0.01);
    a.begin_move(&alone(), None, 0.5, 8.0, false).unwrap();
    assert_eq!(run(&mut a, 60.0), Progress::Arrived);
    let mut at = pose(0.3);
    for order in &a.plant().orders {
        let Order::Target(target) = order else { continue };
        // 0.1 m is the gate's default `max_jump_m`.
        assert!(target.distance_m(&at) <= 0.1 + 1e-9, "{target:?} with the arm at {at:?}");
        at.position_m[0] += 0.01 * (target.position_m[0] - at.position_m[0]);
    }
}

#[test]
fn a_step_of_the_clock_does_not_make_the_target_jump() {
    let mut a = arm(0.2);
    a.begin_move(&alone(), None, 0.15, 1.0, false).unwrap();
    run(&mut a, 0.5);
    let before = a.plant().target.unwrap();
    // An hour forward, then two back: a clock that is set.
    a.plant_mut().time_s += 3600.0;
    a.steer();
    assert!(a.plant().target.unwrap().distance_m(&before) <= 0.1);
    a.plant_mut().time_s -= 7200.0;
    let before = a.plant().target.unwrap();
    a.steer();
    assert_eq!(a.plant().target, Some(before));
}

#[test]
fn an_arm_that_is_stuck_ends_the_move_where_it_is() {
    let mut a = arm(0.0);
    a.enable(&alone(), false).unwrap();
    a.begin_move(&alone(), None, 0.15, 1.0, false).unwrap();
    let Progress::Stopped(why) = run(&mut a, 60.0) else { panic!("not stopped") };
    assert!(why.contains("does not follow: 0.250 m"), "{why}");
    assert_eq!((a.mode(), a.plant().target), (Mode::Hold, Some(pose(0.3))));
}

#[test]
fn hold_reflex_and_a_lost_arm_end_a_move() {
    let stop = |how: &dyn Fn(&mut Arm<Lag>)| {
        let mut a = arm(0.2);
        a.enable(&alone(), false).unwrap();
        a.begin_move(&alone(), None, 0.15, 1.0, false).unwrap();
        run(&mut a, 1.0);
        how(&mut a);
        let orders = a.plant().orders.len();
        let Progress::Stopped(why) = run(&mut a, 1.0) else { panic!("not stopped") };
        assert_eq!(a.plant().orders.len(), orders, "no order after the stop");
        (a.mode(), why)
    };
    assert_eq!(stop(&|a| a.hold().unwrap()), (Mode::Hold, "by a request".to_owned()));
    assert_eq!(stop(&|a| a.reflex("touched")), (Mode::Reflex, "touched".to_owned()));
    assert_eq!(stop(&|a| a.connection(false)), (Mode::Disconnected, "no connection to the arm".to_owned()));
}

#[test]
fn a_move_ends_when_another_node_takes_the_controller() {
    let mut a = arm(0.2);
    a.begin_move(&alone(), None, 0.15, 1.0, false).unwrap();
    run(&mut a, 1.0);
    assert_eq!(a.recheck(&alone()), None);
    let taken = Surroundings { unready: Some("1 more on /target_pose".to_owned()), ..alone() };
    assert_eq!(a.recheck(&taken), Some("1 more on /target_pose"));
    assert_eq!(a.plant().orders.last(), Some(&Order::End));
    assert_eq!(run(&mut a, 1.0), Progress::Stopped("1 more on /target_pose".to_owned()));
}

#[test]
fn a_move_begins_only_under_the_conditions_of_enabling() {
    let mut a = arm(0.2);
    let publishers = vec!["/a".to_owned(), "/b".to_owned()];
    let refused = Err(ArmError::Refused(Refusal::Publishers(publishers.clone())));
    let beside = Surroundings { rivals: Rivals { publishers, ..Rivals::default() }, unready: None };
    assert_eq!(a.begin_move(&beside, None, 0.15, 1.0, false), refused);
    assert_eq!(a.enable(&beside, false), refused);
    a.plant_mut().age_s = 0.4;
    let old = Err(ArmError::OldPose { age_s: 0.4, limit_s: 0.2 });
    assert_eq!(a.begin_move(&alone(), None, 0.15, 1.0, false), old);
    assert_eq!(a.enable(&alone(), false), old);
    assert!(a.plant().orders.is_empty(), "no order to an arm that was refused");
}

#[test]
fn invalid_moves_are_refused() {
    let mut a = arm(0.2);
    assert_eq!(a.begin_move(&alone(), Some(pose(0.7)), 0.15, 1.0, false), Err(ArmError::Outside([0.7, 0.0, 0.3])));
    assert!(matches!(a.begin_move(&alone(), Some(pose(f64::NAN)), 0.15, 1.0, false), Err(ArmError::NoPose(_))));
    assert_eq!(a.begin_move(&alone(), None, 0.15, 1.0, true), Err(ArmError::Refused(Refusal::Replay)));
    // The orientation of a message that nobody filled.
    let turned = ArmPose { quaternion_xyzw: [0.0, 0.0, 0.0, 1.0], ..pose(0.45) };
    assert!(matches!(a.begin_move(&alone(), Some(turned), 0.15, 1.0, false), Err(ArmError::Turn { .. })));
    a.settings.start = None;
    assert_eq!(a.begin_move(&alone(), None, 0.15, 1.0, false), Err(ArmError::NoStart));
    assert_eq!(a.mode(), Mode::Idle);
}
