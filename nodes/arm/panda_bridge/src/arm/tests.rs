use super::*;

/// Arm that covers the share `follows` of the remaining distance to its target in each step of 20 ms.
struct Lag {
    time_s: f64,
    at: ArmPose,
    target: Option<ArmPose>,
    follows: f64,
    orders: Vec<Order>,
    age_s: f64,
    /// Joint angles now and at the start, if the arm has any, and the newest posture.
    postures: Option<[[f64; JOINTS]; 2]>,
    posture: Option<[f64; JOINTS]>,
    speed: SpeedLimit,
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

    fn speed_limit(&self) -> SpeedLimit {
        self.speed
    }

    fn postures(&self, _target: &ArmPose) -> Option<[[f64; JOINTS]; 2]> {
        self.postures
    }

    fn set_posture(&mut self, joints_rad: [f64; JOINTS]) {
        self.posture = Some(joints_rad);
    }
}

fn pose(x_m: f64) -> ArmPose {
    ArmPose { position_m: [x_m, 0.0, 0.3], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] }
}

fn arm(follows: f64) -> Arm<Lag> {
    let plant = Lag {
        time_s: 10.0,
        at: pose(0.3),
        target: None,
        follows,
        orders: Vec::new(),
        age_s: 0.0,
        postures: None,
        posture: None,
        speed: SpeedLimit::NONE,
    };
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

#[test]
fn a_move_takes_the_elbow_along_and_lasts_long_enough_for_it() {
    let mut a = arm(0.2);
    let (mut from, mut to) = ([0.1; JOINTS], [0.2; JOINTS]);
    (from[2], to[2]) = (0.0, 1.4);
    a.plant_mut().postures = Some([from, to]);
    a.begin_move(&alone(), None, 0.15, 1.0, false).unwrap();
    let mut last = from;
    while run(&mut a, 0.02) != Progress::Arrived {
        let Some(posture) = a.plant().posture else { continue };
        // 0.35 rad/s and a cycle of 20 ms, twice as long for a test that skips one.
        assert!((posture[2] - last[2]).abs() <= 2.0 * 0.35 * 0.02, "{posture:?} after {last:?}");
        last = posture;
    }
    assert!(last.iter().zip(to).all(|(got, wanted)| (got - wanted).abs() < 1e-9), "{last:?}");
    // 1.4 rad at a peak of 0.35 rad/s take 7.5 s, longer than the hand's 3.1 s.
    assert!((a.plant().time_s - 10.0 - 7.5 - 1.0).abs() < 0.2, "{} s", a.plant().time_s - 10.0);
}

#[test]
fn a_move_is_no_faster_than_the_plant_follows() {
    let mut a = arm(0.9);
    a.plant_mut().speed = SpeedLimit { linear_m_s: 0.05, angular_rad_s: 0.1 };
    a.begin_move(&alone(), None, 0.5, 0.5, false).unwrap();
    let mut before = a.plant().at;
    while run(&mut a, 0.02) != Progress::Arrived {
        let at = a.plant().at;
        assert!(at.distance_m(&before) <= 2.0 * 0.05 * 0.02 + 1e-9, "{at:?} after {before:?}");
        before = at;
    }
}

#[test]
fn a_stranger_ends_a_move_and_an_episode_at_once() {
    let command = |writer| Command {
        writer,
        age_s: 0.0,
        simulated_time: false,
        frame_id: "panda_link0".into(),
        pose: pose(0.31),
    };
    let around = Surroundings { rivals: Rivals { writer: Some([1; 16]), ..alone().rivals }, unready: None };
    let mut a = arm(0.2);
    a.begin_move(&around, None, 0.15, 1.0, false).unwrap();
    run(&mut a, 0.5);
    a.command(&command([2; 16]));
    assert_eq!((a.mode(), a.plant().orders.last()), (Mode::Idle, Some(&Order::End)));
    assert!(matches!(run(&mut a, 0.5), Progress::Stopped(why) if why.contains("a target came from")));
    let mut a = arm(0.2);
    a.enable(&around, false).unwrap();
    assert!(matches!(a.command(&command([1; 16])), Verdict::Accepted { .. }));
    a.command(&command([2; 16]));
    assert_eq!((a.mode(), a.plant().orders.last()), (Mode::Idle, Some(&Order::End)));
    let mut a = arm(0.2);
    a.enable(&around, false).unwrap();
    a.admit_event([1; 16], true).unwrap();
    let stranger = a.admit_event([2; 16], false).unwrap_err();
    assert!(a.stranger(&stranger) && !a.stranger(&stranger), "a motion ends once");
    assert_eq!((a.mode(), a.plant().orders.last()), (Mode::Idle, Some(&Order::End)));
}
