//! Tests of episodes and tracks from logs.

mod doubtful;
mod wrench;

use super::*;
use crate::model::{DriveKind, StartKind};
use crate::simulator::StartShape;
use crate::task::DeltaAnchor;
use crate::{GripPose, Keypoints, Model, Observation};

fn keypoints(shift: f64, flip: bool) -> Keypoints {
    let mut dlo_px = [0.0, 1.0, 2.0, 3.0].map(|i: f64| [100.0 + shift, 100.0 + 10.0 * i]);
    if flip {
        dlo_px.reverse();
    }
    Keypoints {
        dlo_px,
        target_px: Some([150.0, 160.0]),
        scores: [1.0; 4],
        target_score: 1.0,
        image_width_px: 256,
        image_height_px: 256,
    }
}

fn start() -> EpisodeStart {
    EpisodeStart { policy: "recorded".into(), seed: 1, step_period_s: 0.5, delta_anchor: DeltaAnchor::LastTarget }
}

fn log() -> EpisodeLog {
    let mut log = EpisodeLog::default();
    log.push_start(1_000_000_000, 4, start());
    for i in 0..300 {
        let stamp = 900_000_000 + i * 33_000_000;
        log.push_keypoints(stamp, keypoints(i as f64 * 0.1, i % 2 == 0));
        log.push_pose(stamp + 1, GripPose { x_m: 0.4, z_m: 0.4, pitch_rad: 0.0 });
    }
    log.push_end(9_100_000_000, 4, "complete".into());
    log
}

fn model() -> Model {
    Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap()
}

#[test]
fn track_takes_the_frames_nearest_to_the_models_times() {
    let measured = log().episode(None).unwrap().measured(&model()).unwrap();
    let frames = &measured.track.frames;
    assert_eq!(frames.len(), 33);
    let late_s = |i: usize| frames[i].time_s - 0.25 * i as f64;
    assert!((1..33).all(|i| late_s(i).abs() <= 0.0166), "{frames:?}");
    assert!((0.0..=0.033).contains(&late_s(0)), "a frame from before the start: {frames:?}");
    assert!(measured.target_m.is_some());
}

#[test]
fn the_target_stands_still_though_frames_mistake_something_else_for_it() {
    let steady = log().episode(None).unwrap().measured(&model()).unwrap();
    let mut episode = log().episode(None).unwrap();
    for (_, k) in episode.keypoints.iter_mut().enumerate().filter(|(i, _)| i % 7 == 0 || *i > 200).map(|(_, k)| k) {
        k.target_px = Some([90.0, 40.0]);
    }
    let measured = episode.measured(&model()).unwrap();
    assert_eq!((&measured.track, measured.target_m), (&steady.track, steady.target_m));
    let told: Vec<&String> = measured.warnings.iter().filter(|w| w.contains("target")).collect();
    assert!(told.len() == 1 && told[0].contains("% of the frames"), "{told:?}");
    assert!(steady.warnings.iter().all(|w| !w.contains("target")), "{:?}", steady.warnings);
}

#[test]
fn the_order_of_arrival_does_not_matter() {
    let forward = log().episode(None).unwrap();
    let mut backward = EpisodeLog::default();
    backward.push_end(9_100_000_000, 4, "complete".into());
    let stamp = |time_s: f64| 1_000_000_000 + (time_s * 1e9).round() as i64;
    for (t, k) in forward.keypoints.iter().rev() {
        backward.push_keypoints(stamp(*t), *k);
    }
    for (t, p) in forward.poses.iter().rev() {
        backward.push_pose(stamp(*t), *p);
    }
    backward.push_start(1_000_000_000, 4, start());
    assert_eq!(forward, backward.episode(Some(4)).unwrap());
}

#[test]
fn missing_streams_and_episodes_are_named() {
    let empty = EpisodeLog::default().episode(None).unwrap_err().to_string();
    assert!(empty.contains("0 keypoints") && empty.contains("/episode/event"), "{empty}");
    let other = log().episode(Some(9)).unwrap_err();
    assert_eq!(other, EpisodeError::NoSuchEpisode { number: 9, complete: vec![4] });
    let no_pose = Episode { poses: Vec::new(), ..log().episode(None).unwrap() };
    let e = no_pose.measured(&model()).unwrap_err().to_string();
    assert!(e.contains("/panda/current_pose"), "{e}");
}

#[test]
fn measured_start_is_ordered_from_the_grip_and_moves() {
    let mut m = model();
    m.observation.start = StartKind::Measured;
    let measured = log().episode(None).unwrap().measured(&m).unwrap();
    let StartShape::Measured { points_m, velocities_m_s } = measured.start else { panic!("{:?}", measured.start) };
    assert!(points_m.windows(2).all(|w| w[0][1] > w[1][1]), "{points_m:?}");
    assert!(velocities_m_s.iter().all(|v| v[0] > 0.0 && v[1].abs() < 1e-9), "{velocities_m_s:?}");
    // A mask of twice the size must give an equal shape.
    let mut episode = log().episode(None).unwrap();
    for (_, k) in &mut episode.keypoints {
        k.dlo_px = k.dlo_px.map(|p| p.map(|v| 2.0 * v));
        (k.image_width_px, k.image_height_px) = (512, 512);
    }
    assert_eq!(episode.measured(&m).unwrap().start, measured.start);
}

/// Adds step `step` of a policy. The values `run` tell its runs apart.
fn push_step(log: &mut EpisodeLog, stamp_ns: i64, episode: u32, step: u32, run: f64) {
    log.push_observation(stamp_ns, episode, step, Observation([run; 12]));
    log.push_action(stamp_ns + 1, episode, step, [run, 0.0]);
}

#[test]
fn a_number_that_comes_twice_names_two_episodes() {
    let mut log = EpisodeLog::default();
    // The second run is shorter, and its records arrive first, as from a graph whose topics are read one by one.
    for (start_ns, steps, run) in [(20_000_000_000, 2, 2.0), (1_000_000_000, 4, 1.0)] {
        log.push_start(start_ns, 1, start());
        for step in 0..steps {
            push_step(&mut log, start_ns + i64::from(step) * 500_000_000, 1, step, run);
        }
        log.push_end(start_ns + i64::from(steps) * 500_000_000, 1, format!("run {run}"));
    }
    assert_eq!(log.complete(), [1, 1]);
    let last = log.episode(Some(1)).unwrap();
    assert_eq!((last.start_ns, last.duration_s, last.end.as_str()), (20_000_000_000, 1.0, "run 2"));
    assert_eq!(last.actions, [(0, [2.0, 0.0]), (1, [2.0, 0.0])]);
    assert_eq!(last.observations, [0, 1].map(|step| (step, Observation([2.0; 12]))));
    assert_eq!(last.namesakes, 1);
    // A killed run has no end; the end of the next run must not be taken for it.
    log.push_start(30_000_000_000, 1, start());
    push_step(&mut log, 30_000_000_000, 1, 0, 3.0);
    assert_eq!(log.episode(None).unwrap(), last);
    log.push_start(40_000_000_000, 1, start());
    log.push_end(41_000_000_000, 1, "run 4".into());
    let fourth = log.episode(None).unwrap();
    assert_eq!((fourth.start_ns, fourth.actions.len(), fourth.namesakes), (40_000_000_000, 0, 2));
}

#[test]
fn an_ambiguous_number_gives_a_warning() {
    let mut twice = log();
    assert_eq!(twice.episode(None).unwrap().measured(&model()).unwrap().warnings, [] as [String; 0]);
    twice.push_start(100, 4, start());
    twice.push_end(200, 4, "complete".into());
    let warnings = twice.episode(Some(4)).unwrap().measured(&model()).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("2 complete episodes called 4"), "{warnings:?}");
}

/// Log of a policy of `steps` steps with a final observation. Observation and action of step i carry the value i.
fn driven(steps: u32) -> EpisodeLog {
    let mut log = log();
    for step in 0..=steps {
        let stamp_ns = 1_000_000_000 + i64::from(step) * 500_000_000;
        // The hand stands still, at the measured pose.
        let mut values = [f64::from(step); 12];
        values[..2].fill(0.4);
        log.push_observation(stamp_ns, 4, step, Observation(values));
        if step < steps {
            log.push_action(stamp_ns, 4, step, [f64::from(step), 0.0]);
        }
    }
    log
}

#[test]
fn a_lost_step_is_named_and_shifts_nothing() {
    for drive in [DriveKind::Actions, DriveKind::Policy] {
        let mut model = model();
        model.observation.drive = drive;
        let whole = driven(3).episode(None).unwrap();
        let measured = whole.measured(&model).unwrap();
        assert_eq!(measured.actions, [0.0, 1.0, 2.0].map(|x| [x, 0.0]));
        let at: Vec<[f64; 2]> = measured.track.frames.iter().map(|f| [f.time_s, f.dlo[0][0]]).collect();
        assert_eq!(at, [[0.0, 0.0], [0.5, 1.0], [1.0, 2.0], [1.5, 3.0]]);
        let refusal = |change: fn(&mut Episode)| {
            let mut episode = whole.clone();
            change(&mut episode);
            episode.measured(&model).unwrap_err().to_string()
        };
        let e = refusal(|e| e.actions.retain(|(step, _)| *step != 0));
        assert!(e.contains("/policy/action") && e.contains("step 1 in place of step 0"), "{e}");
        let e = refusal(|e| e.observations.retain(|(step, _)| *step != 2));
        assert!(e.contains("/policy/observation") && e.contains("step 3 in place of step 2"), "{e}");
        let e = refusal(|e| e.actions.insert(1, (0, [0.0; 2])));
        assert!(e.contains("step 0 in place of step 1"), "{e}");
        let e = refusal(|e| e.actions.truncate(2));
        assert!(e.contains("4 observations, 2 actions"), "{e}");
        let stopped = Episode { observations: whole.observations[..3].to_vec(), ..whole.clone() };
        assert_eq!(
            stopped.measured(&model).unwrap().track.frames.len(),
            3,
            "the episode was cancelled in its last step"
        );
    }
}

#[test]
fn a_measured_path_needs_no_actions() {
    let mut episode = driven(3).episode(None).unwrap();
    episode.actions.remove(0);
    assert_eq!(episode.measured(&model()).unwrap().track.frames.len(), 33);
}

/// Episode of 8.1 s without the records at times for which `poses` and `keypoints` return true.
fn without(poses: fn(f64) -> bool, keypoints: fn(f64) -> bool) -> Episode {
    let mut episode = log().episode(None).unwrap();
    episode.poses.retain(|(t, _)| !poses(*t));
    episode.keypoints.retain(|(t, _)| !keypoints(*t));
    episode
}

fn none(_: f64) -> bool {
    false
}

#[test]
fn a_grip_that_nobody_measured_is_not_simulated() {
    let model = model();
    let times = |episode: Episode| {
        let measured = episode.measured(&model).unwrap();
        let times: Vec<f64> = measured.track.frames.iter().map(|f| f.time_s).collect();
        (times, measured.warnings)
    };
    let (all, warnings) = times(without(none, none));
    assert_eq!((all.len(), warnings.len()), (33, 0), "{warnings:?}");
    let (used, warnings) = times(without(|t| t > 2.0, none));
    assert!(used.len() == 9 && used[8] < 2.1, "{used:?}");
    assert!(
        warnings[0].contains("from 1.98 s to 8.10 s of 8.10 s") && warnings[0].contains("not used"),
        "{warnings:?}"
    );
    assert!(warnings[1].contains("the track has 9 frames, fewer than 10"), "{warnings:?}");
    let (used, warnings) = times(without(|t| (3.0..5.0).contains(&t), none));
    assert!(used.len() == 13 && warnings[0].contains("from 2.97 s to 5.02 s"), "{used:?}: {warnings:?}");
    let (used, warnings) = times(without(|t| (3.0..3.3).contains(&t), none));
    assert_eq!((used, warnings.len()), (all.clone(), 1), "a short gap costs nothing but a word");
    assert!(warnings[0].contains("from 2.97 s to 3.33 s") && warnings[0].contains("straight"), "{warnings:?}");
    let (used, warnings) = times(without(|t| t < 0.3, none));
    assert!(used == all && warnings[0].contains("from 0.00 s to 0.33 s"), "{warnings:?}");
    let e = without(|t| t < 0.7, none).measured(&model).unwrap_err().to_string();
    assert!(e.contains("when the grip's pose is known"), "{e}");
}

#[test]
fn a_thin_track_says_so() {
    let mut model = model();
    let thin = without(none, |t| t > 0.3).measured(&model).unwrap();
    assert_eq!(thin.track.frames.len(), 2);
    assert!(thin.warnings[0].contains("only 2 of 33 frames"), "{:?}", thin.warnings);
    assert!(thin.warnings.len() == 2 && thin.warnings[1].contains("the track has 2 frames"), "{:?}", thin.warnings);
    let some = without(none, |t| (1.0..1.4).contains(&t)).measured(&model).unwrap();
    assert_eq!((some.track.frames.len(), some.warnings.len()), (32, 0), "a lost image or two: {:?}", some.warnings);
    let short = Episode { duration_s: 1.0, ..without(|t| t > 1.0, |t| t > 1.0) }.measured(&model).unwrap();
    assert_eq!(short.warnings.len(), 1, "{:?}", short.warnings);
    assert!(short.warnings[0].contains("the track has 5 frames, fewer than 10"), "{:?}", short.warnings);
    assert!(short.warnings[0].contains("expect a posterior near the prior"), "{:?}", short.warnings);
    model.observation.start = StartKind::Measured;
    assert_eq!(without(none, none).measured(&model).unwrap().warnings, [] as [String; 0]);
    let late = without(none, |t| t < 0.2).measured(&model).unwrap();
    assert!(
        late.warnings.len() == 1 && late.warnings[0].contains("7 frames between 0.23 s and 0.43 s"),
        "{:?}",
        late.warnings
    );
}

#[test]
fn a_track_that_ends_before_the_models_last_frame_has_no_warning_by_that_alone() {
    let mut model = model();
    // The recording has room for 33 of them.
    model.observation.frames = 150;
    let measured = log().episode(None).unwrap().measured(&model).unwrap();
    assert_eq!((measured.track.frames.len(), measured.warnings), (33, vec![]));
}

#[test]
fn a_track_of_less_than_a_swing_or_without_motion_has_a_warning() {
    let mut model = model();
    model.observation.frame_period_s = 0.033;
    let short = Episode { duration_s: 0.4, ..without(|t| t > 0.4, |t| t > 0.4) }.measured(&model).unwrap();
    // The four keypoints lie 0.1 m apart in all, 0.2 m below the hand: 2 pi sqrt(2 L / 3 g) is 0.9 s or so.
    assert!(short.warnings.len() == 1 && short.track.frames.len() > 10, "{:?}", short.warnings);
    assert!(short.warnings[0].contains("less than a free swing of an object of its length"), "{:?}", short.warnings);
    let mut still = log().episode(None).unwrap();
    for (i, (_, k)) in still.keypoints.iter_mut().enumerate() {
        *k = keypoints(if i % 3 == 0 { 0.3 } else { 0.0 }, false);
    }
    let warnings = still.measured(&model).unwrap().warnings;
    assert!(warnings.iter().any(|w| w.contains("only its shape at rest can be inferred")), "{warnings:?}");
}

/// Poses at 10 Hz from `from_s` to `to_s`.
fn push_poses(log: &mut EpisodeLog, from_s: u32, to_s: u32) {
    for i in 10 * i64::from(from_s)..10 * i64::from(to_s) {
        log.push_pose(100_000_000 * i, GripPose::default());
    }
}

#[test]
fn an_idle_live_log_stays_small() {
    let mut log = EpisodeLog::default();
    for minute in 0..60 {
        push_poses(&mut log, 60 * minute, 60 * minute + 60);
        log.forget_old();
        let held = log.summary();
        assert!(held.contains(" 20 poses") || held.contains(" 21 poses"), "after minute {minute}: {held}");
    }
}

#[test]
fn a_live_log_keeps_the_last_complete_episode_while_the_next_one_runs() {
    let mut live = log();
    push_poses(&mut live, 10, 60);
    live.push_start(60_000_000_000, 5, start());
    push_poses(&mut live, 60, 100);
    live.forget_old();
    assert_eq!(live.episode(None).unwrap(), log().episode(None).unwrap());
    live.push_end(99_950_000_000, 5, "complete".into());
    live.forget_old();
    let next = live.episode(None).unwrap();
    assert_eq!((next.number, next.poses.len()), (5, 2 + 400), "the whole of it, with its lead");
    push_poses(&mut live, 100, 110);
    live.forget_old();
    assert_eq!(live.episode(None).unwrap(), next);
    assert_eq!(live.complete(), [5], "one complete episode is enough");
}

#[test]
fn a_live_log_waits_for_no_end_for_ever() {
    let mut live = EpisodeLog::default();
    live.push_start(0, 1, start());
    push_poses(&mut live, 0, 3500);
    live.forget_old();
    assert!(live.summary().contains(" 35000 poses"), "{}", live.summary());
    push_poses(&mut live, 3500, 3700);
    live.forget_old();
    assert!(live.summary().contains(" 21 poses") && live.summary().contains(" 0 episode starts"), "{}", live.summary());
}

#[test]
fn a_live_log_takes_a_replay_whose_stamps_run_back() {
    let mut live = EpisodeLog::default();
    push_poses(&mut live, 1000, 1010);
    let recorded = log().episode(None).unwrap().poses;
    let (lead, rest) = recorded.split_at(recorded.partition_point(|(t, _)| *t < 0.0));
    let replay = |live: &mut EpisodeLog, poses: &[(f64, MeasuredPose)]| {
        for (t, pose) in poses {
            live.push_pose(1_000_000_000 + (t * 1e9).round() as i64, *pose);
            live.forget_old();
        }
    };
    replay(&mut live, lead);
    live.push_start(1_000_000_000, 4, start());
    replay(&mut live, rest);
    live.push_end(9_100_000_000, 4, "complete".into());
    live.forget_old();
    assert_eq!((live.episode(None).unwrap().poses, lead.len()), (recorded, 4));
}
