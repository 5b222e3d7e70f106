//! Tests of an episode, one per rule.

use super::*;
use crate::writers::Source;
use catenary_core::camera::Plane;
use catenary_core::mlp::Layer;
use catenary_core::policy::{Observes, Plan};
use catenary_core::task::{Task, Workspace};
use catenary_core::{Camera, DeltaAnchor, Goal, Mlp};

/// Policy with a constant action, in units of the action limit.
pub(super) fn policy(action: [f32; 2]) -> Policy {
    let layer = Layer { inputs: 12, outputs: 2, weight: vec![0.0; 24], bias: action.to_vec() };
    Policy {
        name: "constant".into(),
        actor: Mlp::new(vec![layer]).unwrap(),
        observes: Observes::default(),
        plan: None,
        observation_mean: [0.0; 12],
        observation_scale: [1.0; 12],
        action_scale: [0.1, 0.1],
        step_period_s: 0.5,
        delta_anchor: DeltaAnchor::LastTarget,
        steps: 16,
        goal: None,
        arm: None,
        start_speed_m_s: None,
    }
}

fn task() -> Task {
    Task {
        goal: Goal::Reach,
        steps: 16,
        rest_steps: 0,
        step_period_s: 0.5,
        delta_anchor: DeltaAnchor::LastTarget,
        workspace: Workspace::default(),
        target_m: [0.5, 0.15],
        target_jitter_m: 0.0,
        success_reward: 0.75,
        ends_at_success: true,
    }
}

/// Judge with a camera that sees a square of 2 m around (0, 0): scaled coordinates are metres.
fn judge(task: Task) -> Judge {
    Judge::new(task, Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 2.0, ..Plane::default() }))
}

fn keypoints(at_px: f64) -> Keypoints {
    Keypoints {
        dlo_px: [[at_px, 100.0]; 4],
        target_px: Some([128.0, 100.0]),
        scores: [1.0; 4],
        target_score: 1.0,
        image_width_px: 256,
        image_height_px: 256,
    }
}

fn inputs(now_s: f64, dlo_px: f64, x_m: f64) -> Inputs {
    Inputs {
        now_s,
        keypoints: Some((now_s - 0.01, keypoints(dlo_px))),
        pose: Some((now_s - 0.005, GripPose { x_m, z_m: 0.4, pitch_rad: 0.0 })),
        arm_fault: None,
        objection: None,
        stranger: None,
    }
}

fn runner(action: [f32; 2], settings: Settings) -> Runner {
    Runner::new(policy(action), judge(task()), settings).unwrap()
}

/// Runs to the end with fixed inputs, and returns the steps.
fn run(runner: &mut Runner, dlo_px: f64, x_m: f64) -> Vec<Step> {
    let (mut now_s, mut steps) = (10.0, Vec::new());
    loop {
        match runner.turn(&inputs(now_s, dlo_px, x_m)) {
            Turn::Wait(until_s) => now_s = until_s,
            Turn::Step(step) => {
                let end = step.end;
                steps.push(*step);
                if end.is_some() {
                    return steps;
                }
            }
            Turn::Fault(fault) => panic!("{fault}"),
        }
    }
}

#[test]
fn a_full_episode_has_17_observations_and_16_actions_half_a_second_apart() {
    let mut r = runner([0.0, 0.0], Settings::default());
    let steps = run(&mut r, 20.0, 0.4);
    assert_eq!(steps.len(), 17);
    assert_eq!(steps.iter().filter(|s| s.action.is_some()).count(), 16);
    assert_eq!(r.rewards().len(), 16);
    assert_eq!(r.end(), Some(End::StepLimit));
    assert!((steps[16].stamps_s[0] - steps[0].stamps_s[0] - 8.0).abs() < 1e-9);
}

#[test]
fn reaching_the_goal_ends_the_episode_unless_all_steps_are_to_run() {
    let steps = run(&mut runner([0.0, 0.0], Settings::default()), 128.0, 0.4);
    assert_eq!((steps.len(), steps[1].end), (2, Some(End::Success)));
    let all = Settings { run_all_steps: true, ..Settings::default() };
    let steps = run(&mut runner([0.0, 0.0], all), 128.0, 0.4);
    assert_eq!((steps.len(), steps[16].end), (17, Some(End::Success)));
}

#[test]
fn a_tip_is_judged_when_the_last_step_has_ended() {
    let place = Task { goal: Goal::PlaceTip { reward_range_m: 0.1 }, ends_at_success: false, ..task() };
    for run_all_steps in [false, true] {
        let settings = Settings { run_all_steps, max_steps: Some(3), ..Settings::default() };
        // 128 px is the column of the target; 135 px is 55 mm beside it.
        for (dlo_px, end, last) in [(128.0, End::Success, 1.0), (135.0, End::StepLimit, 0.453)] {
            let mut r = Runner::new(policy([0.0, 0.0]), judge(place), settings).unwrap();
            let steps = run(&mut r, dlo_px, 0.4);
            assert_eq!((steps.len(), r.end()), (4, Some(end)));
            assert_eq!(r.rewards()[..2], [0.0, 0.0]);
            assert!((r.rewards()[2] - last).abs() < 1e-3, "{:?}", r.rewards());
        }
    }
}

#[test]
fn in_the_rest_the_arm_keeps_its_target_and_the_object_is_watched() {
    let goal = Goal::Settle { reward_range_m: 0.2 };
    let settle = Task { goal, steps: 2, rest_steps: 3, ends_at_success: false, ..task() };
    let policy = Policy { steps: 2, goal: Some(goal), ..policy([0.5, 0.0]) };
    let mut r = Runner::new(policy, judge(settle), Settings::default()).unwrap();
    let steps = run(&mut r, 128.0, 0.4);
    let acts: Vec<bool> = steps.iter().map(|s| s.action.is_some()).collect();
    assert_eq!(acts, [true, true, false, false, false, false]);
    // An arm that hears no target ends its motion: the last one is sent again, until the episode ends.
    let last = steps[1].action.map(|(_, target)| target);
    assert!(last.is_some() && steps[1..5].iter().all(|s| s.target_m == last), "{steps:?}");
    assert_eq!(steps[5].target_m, None);
    assert_eq!((r.end(), r.rewards().len()), (Some(End::StepLimit), 5));
    // Target at x 0, hand at 0.4 m.
    assert_eq!(r.rewards(), [0.0; 5]);
}

#[test]
fn a_policy_of_another_goal_is_refused_and_one_that_names_none_is_not() {
    let new = |goal| Runner::new(Policy { goal, ..policy([0.0; 2]) }, judge(task()), Settings::default());
    assert!(new(Some(Goal::Reach)).is_ok() && new(None).is_ok());
    let message = new(Some(Goal::Whip { reward_range_m: 0.4 })).err().unwrap().to_string();
    assert_eq!(message, "policy `constant`: it was trained for the goal `whip`, the task has `reach`");
}

#[test]
fn a_target_or_a_pose_outside_the_workspace_ends_the_episode_with_minus_one() {
    let mut r = runner([1.0, 0.0], Settings::default());
    let steps = run(&mut r, 20.0, 0.58);
    assert_eq!((steps.len(), steps[1].end, steps[1].reward), (2, Some(End::LeftWorkspace), Some(-1.0)));
    let mut r = runner([0.0, 0.0], Settings::default());
    assert!(matches!(r.turn(&inputs(10.0, 20.0, 0.4)), Turn::Step(_)));
    let Turn::Step(left) = r.turn(&inputs(10.5, 20.0, 0.7)) else { panic!("no step") };
    assert_eq!((left.end, left.reward, left.action), (Some(End::LeftWorkspace), Some(-1.0), None));
}

#[test]
fn no_action_is_taken_from_outside_the_workspace() {
    let mut r = runner([0.0, 0.0], Settings::default());
    assert_eq!(r.turn(&inputs(10.0, 20.0, 0.7)), Turn::Fault(Fault::Outside(0.7, 0.4)));
}

#[test]
fn anchors_decide_what_deltas_add_up_to() {
    let mut last = runner([0.5, 0.0], Settings { max_steps: Some(3), ..Settings::default() });
    let targets: Vec<f64> = run(&mut last, 20.0, 0.4).iter().filter_map(|s| s.action).map(|a| a.1[0]).collect();
    // 0.5 of the limit of 60 mm is 30 mm: three steps from 0.4 m.
    assert!((targets[2] - 0.49).abs() < 1e-9, "{targets:?}");
    let mut p = policy([0.5, 0.0]);
    p.delta_anchor = DeltaAnchor::Measured;
    let t = Task { delta_anchor: DeltaAnchor::Measured, ..task() };
    let mut measured = Runner::new(p, judge(t), Settings { max_steps: Some(3), ..Settings::default() }).unwrap();
    let targets: Vec<f64> = run(&mut measured, 20.0, 0.4).iter().filter_map(|s| s.action).map(|a| a.1[0]).collect();
    assert!(targets.iter().all(|t| (t - 0.43).abs() < 1e-9), "{targets:?}");
}

#[test]
fn stale_or_missing_data_are_waited_for_and_then_end_the_episode() {
    let mut r = runner([0.0, 0.0], Settings::default());
    let mut stale = inputs(10.0, 20.0, 0.4);
    stale.keypoints = Some((9.0, keypoints(20.0)));
    assert!(matches!(r.turn(&stale), Turn::Wait(t) if t > 10.0 && t < 10.1));
    stale.now_s = 11.0;
    let Turn::Fault(fault) = r.turn(&stale) else { panic!("no fault") };
    assert!(fault.to_string().contains("keypoints") && fault.to_string().contains("2.000 s old"), "{fault}");
    let mut r = runner([0.0, 0.0], Settings::default());
    let mut unseen = inputs(10.0, 20.0, 0.4);
    unseen.keypoints.as_mut().unwrap().1.scores = [0.0; 4];
    assert!(matches!(r.turn(&unseen), Turn::Wait(_)));
    assert!(matches!(r.turn(&inputs(10.1, 20.0, 0.4)), Turn::Step(_)), "fresh data let it go on");
}

#[test]
fn a_stamp_from_the_future_is_not_fresh() {
    let mut r = runner([0.0, 0.0], Settings::default());
    let mut ahead = inputs(10.0, 20.0, 0.4);
    ahead.keypoints.as_mut().unwrap().0 = 13.0;
    assert!(matches!(r.turn(&ahead), Turn::Wait(_)));
    ahead.now_s = 11.0;
    ahead.pose.as_mut().unwrap().0 = 11.0;
    let Turn::Fault(fault) = r.turn(&ahead) else { panic!("no fault") };
    assert!(fault.to_string().contains("keypoints") && fault.to_string().contains("2.000 s ahead"), "{fault}");
    ahead = inputs(11.0, 20.0, 0.4);
    // 0.1 s ahead, within the default of 0.15 s.
    ahead.keypoints.as_mut().unwrap().0 = 11.1;
    assert!(matches!(r.turn(&ahead), Turn::Step(_)), "clocks may differ by the age allowed");
}

#[test]
fn a_late_step_is_followed_by_a_whole_period_and_small_delays_do_not_add_up() {
    let mut r = runner([0.0, 0.0], Settings::default());
    let mut due_s = Vec::new();
    // On time, 20 ms late (within 10 % of the period of 0.5 s), and 0.9 s late.
    for now_s in [10.0, 10.52, 11.9] {
        assert!(matches!(r.turn(&inputs(now_s, 20.0, 0.4)), Turn::Step(_)), "{now_s}");
        let Turn::Wait(until_s) = r.turn(&inputs(now_s + 0.005, 20.0, 0.4)) else { panic!("two steps at {now_s}") };
        due_s.push(until_s);
    }
    assert!(due_s.iter().zip([10.5, 11.0, 12.4]).all(|(got, wanted)| (got - wanted).abs() < 1e-9), "{due_s:?}");
}

#[test]
fn a_policy_with_a_plan_ends_after_its_own_steps_whatever_a_goal_asks_for() {
    let many = Settings { max_steps: Some(100), run_all_steps: true, ..Settings::default() };
    let planned = Policy { plan: Some(Plan::default()), ..policy([0.0; 2]) };
    let mut runner = Runner::new(planned, judge(task()), many).unwrap();
    run(&mut runner, 20.0, 0.4);
    assert_eq!(runner.rewards().len(), 16);
}

#[test]
fn the_time_and_the_plan_of_a_policy_count_steps_also_after_lost_frames_and_a_late_step() {
    // The plan gives the number of the step for dx; the network adds a tenth of the time, -1 to 1, to dz.
    let plan = Plan { steps: (0..16).map(|step| [[0.02 * step as f32, 0.0, 0.0], [0.0; 3]]).collect() };
    let mut weight = vec![0.0; 26];
    weight[13 + 12] = 0.1;
    let actor = Mlp::new(vec![Layer { inputs: 13, outputs: 2, weight, bias: vec![0.0; 2] }]).unwrap();
    let observes = Observes { history: 0, time: true };
    let timed = Policy { actor, observes, plan: Some(plan), ..policy([0.0; 2]) };
    let settings = Settings { max_steps: Some(4), ..Settings::default() };
    let mut runner = Runner::new(timed, judge(task()), settings).unwrap();
    let mut actions = Vec::new();
    // Twenty frames and the pose are lost before the step at 10.5 s, the one at 11.2 s is late by a whole period.
    for (now_s, is_lost) in
        [(10.0, false), (10.5, true), (10.6, true), (10.7, false), (11.2, true), (11.7, false), (12.2, false)]
    {
        let seen = inputs(now_s, 20.0, 0.4);
        let inputs = if is_lost { Inputs { keypoints: None, pose: None, ..seen } } else { seen };
        match runner.turn(&inputs) {
            Turn::Step(step) => actions.extend(step.action.map(|(delta, _)| delta)),
            Turn::Wait(_) => assert!(is_lost, "{now_s}"),
            Turn::Fault(fault) => panic!("{fault}"),
        }
    }
    let expected = |step: f64| [0.06 * 0.02 * step, 0.06 * 0.1 * (2.0 * step / 16.0 - 1.0)];
    assert_eq!(actions.len(), 4);
    for (step, action) in actions.iter().enumerate() {
        let expected = expected(step as f64);
        assert!((action[0] - expected[0]).abs() < 1e-8 && (action[1] - expected[1]).abs() < 1e-8, "{step}: {action:?}");
    }
}

#[test]
fn an_occluded_target_stays_where_it_was_seen() {
    let mut r = runner([0.0, 0.0], Settings::default());
    let Turn::Step(first) = r.turn(&inputs(10.0, 20.0, 0.4)) else { panic!("no step") };
    let mut hidden = inputs(10.5, 20.0, 0.4);
    hidden.keypoints.as_mut().unwrap().1.target_px = None;
    let Turn::Step(second) = r.turn(&hidden) else { panic!("no step") };
    assert_eq!(first.observation.target(), second.observation.target());
}

#[test]
fn an_arm_that_refuses_ends_the_episode() {
    let mut r = runner([0.0, 0.0], Settings::default());
    let refusing = Inputs { arm_fault: Some("reflex".into()), ..inputs(10.0, 20.0, 0.4) };
    assert_eq!(r.turn(&refusing), Turn::Fault(Fault::Arm("reflex".into())));
}

#[test]
fn a_second_writer_ends_the_episode_between_two_steps_too() {
    let mut r = runner([0.0, 0.0], Settings::default());
    assert!(matches!(r.turn(&inputs(10.0, 20.0, 0.4)), Turn::Step(_)));
    let stranger = Stranger { source: Source::Pose, writer: [2; 16], bound: [1; 16] };
    let heard = Inputs { stranger: Some(stranger), ..inputs(10.1, 20.0, 0.4) };
    assert_eq!(r.turn(&heard), Turn::Fault(Fault::Stranger(stranger)));
}

#[test]
fn a_target_that_the_arm_rejects_ends_the_episode_before_another_builds_on_it() {
    let mut r = runner([0.5, 0.5], Settings::default());
    assert!(matches!(r.turn(&inputs(10.0, 20.0, 0.4)), Turn::Step(_)));
    let refused = Inputs { objection: Some(Objection::Rejected("a jump".into())), ..inputs(10.02, 20.0, 0.4) };
    assert_eq!(r.turn(&refused), Turn::Fault(Fault::Rejected { step: 0, why: "a jump".into() }));
}

#[test]
fn a_target_that_the_arm_clamps_has_left_the_workspace() {
    let mut r = runner([0.5, 0.0], Settings::default());
    assert!(matches!(r.turn(&inputs(10.0, 20.0, 0.4)), Turn::Step(_)));
    let clipped = Inputs { objection: Some(Objection::Clipped), ..inputs(10.02, 20.0, 0.4) };
    assert!(matches!(r.turn(&clipped), Turn::Wait(_)));
    let Turn::Step(left) = r.turn(&inputs(10.5, 20.0, 0.4)) else { panic!("no step") };
    assert_eq!((left.end, left.reward, left.action), (Some(End::LeftWorkspace), Some(-1.0), None));
}

#[test]
fn a_policy_for_another_pace_or_anchor_is_refused() {
    let mut p = policy([0.0, 0.0]);
    p.step_period_s = 0.1;
    assert!(Runner::new(p, judge(task()), Settings::default()).err().unwrap().to_string().contains("step_period_s"));
    let mut p = policy([0.0; 2]);
    p.steps = 17;
    let words = Runner::new(p.clone(), judge(task()), Settings::default()).err().unwrap().to_string();
    assert_eq!(words, "policy `constant`: `steps` is 17, the task ends after 16");
    p.steps = 3;
    assert!(Runner::new(p, judge(task()), Settings::default()).is_ok());
    let mut p = policy([0.0, 0.0]);
    p.delta_anchor = DeltaAnchor::Measured;
    assert!(Runner::new(p, judge(task()), Settings::default()).err().unwrap().to_string().contains("delta_anchor"));
}

#[test]
fn the_same_seed_gives_the_same_sampled_actions() {
    let actions = |s| {
        let mut r = runner([0.0, 0.0], Settings { stochastic_seed: Some(s), ..Settings::default() });
        run(&mut r, 20.0, 0.4).iter().map(|s| s.action).collect::<Vec<_>>()
    };
    assert_eq!(actions(1), actions(1));
    assert_ne!(actions(1), actions(2));
}
