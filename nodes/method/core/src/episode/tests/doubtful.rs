//! Tests of episodes from recordings with bad data.

use super::*;

/// Measured track of the episode after `change` was applied to its poses (x, z, y) in m.
fn posed(change: impl Fn(usize, [f64; 3]) -> [f64; 3]) -> Result<MeasuredTrack, EpisodeError> {
    let mut episode = log().episode(None).unwrap();
    for (i, (_, pose)) in episode.poses.iter_mut().enumerate() {
        let [x_m, z_m, y_m] = change(i, [pose.grip.x_m, pose.grip.z_m, pose.y_m]);
        *pose = MeasuredPose { grip: GripPose { x_m, z_m, ..pose.grip }, y_m };
    }
    episode.measured(&model())
}

#[test]
fn impossible_poses_are_left_out_wherever_they_lie_and_named() {
    let whole = log().episode(None).unwrap().measured(&model()).unwrap();
    let last = log().episode(None).unwrap().poses.len() - 1;
    let faults: [fn([f64; 3]) -> [f64; 3]; 5] = [
        |_| [0.0; 3],
        |[x, z, y]| [x + 0.3, z, y],
        |[x, z, y]| [x, z + 50.0, y],
        |[x, z, y]| [1e3 * x, 1e3 * z, 1e3 * y],
        |[x, z, _]| [x, z, 0.3],
    ];
    let places: [&[usize]; 6] = [&[100], &[0], &[last], &[50, 51, 52], &[0, 1, 90, 91, last], &[20, 22, 24, 26]];
    for (fault, wrong) in faults.iter().flat_map(|f| places.iter().map(move |p| (f, p))) {
        let measured = posed(|i, pose| if wrong.contains(&i) { fault(pose) } else { pose }).unwrap();
        assert_eq!(measured.track, whole.track, "{wrong:?}");
        assert_eq!(measured.grip.times_s().len(), last + 1 - wrong.len());
        let words = format!("/panda/current_pose: {} of {} poses left out", wrong.len(), last + 1);
        assert!(measured.warnings[0].starts_with(&words), "{:?}", measured.warnings);
    }
    let one = posed(|i, pose| if i == 100 { [0.0; 3] } else { pose }).unwrap().warnings;
    assert_eq!(one.len(), 1, "{one:?}");
    assert!(
        one[0].contains("at 3.200 s (stamp 4.200000001) with position (0, 0, 0) m and pitch 0.00 rad, 0.566 m"),
        "{one:?}"
    );
}

#[test]
fn a_hand_that_turns_impossibly_fast_is_left_out_and_one_that_turns_past_half_a_turn_is_not() {
    let mut episode = log().episode(None).unwrap();
    episode.poses[40].1.grip.pitch_rad = std::f64::consts::PI;
    let warnings = episode.measured(&model()).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("turned by 3.14 rad"), "{warnings:?}");
    for (i, (_, pose)) in episode.poses.iter_mut().enumerate() {
        pose.grip.pitch_rad = if i % 2 == 0 { -3.1 } else { 3.1 };
    }
    assert_eq!(episode.measured(&model()).unwrap().warnings, [] as [String; 0]);
}

#[test]
fn a_stream_of_another_unit_or_off_the_plane_is_refused() {
    let refusal = |change: fn([f64; 3]) -> [f64; 3]| posed(|_, pose| change(pose)).unwrap_err().to_string();
    let e = refusal(|pose| pose.map(|v| 1e3 * v));
    assert!(
        e.contains("episode 4: /panda/current_pose: pose.position: expected m") && e.contains("as if in mm"),
        "{e}"
    );
    assert!(refusal(|pose| pose.map(|v| 100.0 * v)).contains("as if in cm"));
    let e = refusal(|[x, z, _]| [x, z, -0.4]);
    assert!(e.contains("pose.position.y: expected 0 m") && e.contains("-0.400 m"), "{e}");
    let near = posed(|_, [x, z, _]| [x, z, 0.03]).unwrap().warnings;
    assert!(near.len() == 1 && near[0].contains("pose.position.y") && near[0].contains("0.030 m"), "{near:?}");
    assert_eq!(posed(|_, [x, z, _]| [x, z, 0.005]).unwrap().warnings, [] as [String; 0]);
    // An ideal simulated arm jumps to its target: it loses one pose, and no other.
    let ideal = posed(|i, [x, z, y]| [if i < 120 { x } else { x + 0.15 }, z, y]).unwrap();
    assert!(
        ideal.warnings.len() == 1 && ideal.warnings[0].starts_with("/panda/current_pose: 1 of "),
        "{:?}",
        ideal.warnings
    );
    // Two halves of the poses contradict each other: it is unknown which half is right.
    let e = posed(|i, [x, z, y]| [if i < 120 { x } else { x + 1.0 }, z, y]).unwrap_err().to_string();
    assert!(e.contains("poses contradict the others") && e.contains("check units, frame and clock"), "{e}");
}

#[test]
fn keypoints_that_jump_are_left_out_and_fractions_of_the_image_refused() {
    let whole = log().episode(None).unwrap().measured(&model()).unwrap();
    let changed = |wrong: &[usize], px: [f64; 2], points: usize| {
        let mut episode = log().episode(None).unwrap();
        wrong.iter().for_each(|i| episode.keypoints[*i].1.dlo_px[..points].fill(px));
        episode.measured(&model()).unwrap()
    };
    let last = log().episode(None).unwrap().keypoints.len() - 1;
    for (px, points) in [([0.0, 0.0], 4), ([250.0, 250.0], 1), ([1e6, -1e6], 2)] {
        for wrong in [&[3][..], &[0, 1], &[last - 1, last], &[40, 41, 42, 60]] {
            let measured = changed(wrong, px, points);
            let words = format!("/dlo/keypoints: {} of {} frames left out", wrong.len(), last + 1);
            assert!(measured.warnings[0].starts_with(&words), "{px:?}: {:?}", measured.warnings);
            assert!(measured.track.frames.iter().all(|f| (f.dlo[0][0] + 0.2).abs() < 0.3), "{px:?}");
            assert_eq!(measured.grip, whole.grip);
        }
    }
    let mut episode = log().episode(None).unwrap();
    for (_, k) in &mut episode.keypoints {
        k.dlo_px = k.dlo_px.map(|p| p.map(|v| v / 256.0));
    }
    let e = episode.measured(&model()).unwrap_err().to_string();
    assert!(e.contains("expected pixels of an image of 256 x 256") && e.contains("fractions"), "{e}");
}

#[test]
fn zeros_in_place_of_missing_keypoints_are_named_as_such() {
    let zeroed = |wrong: &dyn Fn(usize) -> bool| {
        let mut episode = log().episode(None).unwrap();
        let frames = episode.keypoints.iter_mut().enumerate().filter(|(i, _)| wrong(*i));
        frames.for_each(|(_, (_, k))| k.dlo_px[2] = [0.0; 2]);
        (episode.doubts(), episode.measured(&model()))
    };
    // More than a fifth of the frames: contradictions of that number are refused, and missing keypoints are not.
    let (doubts, measured) = zeroed(&|i| i % 3 == 0);
    let warning = measured.unwrap().warnings.remove(0);
    assert!(
        warning.contains("83 of 249 frames left out, whose dlo_u and dlo_v are 0 as if for a missing keypoint"),
        "{warning}"
    );
    assert!(warning.contains("dlo_u[2] at -0.100 s") && warning.contains("expected a score of 0"), "{warning}");
    assert_eq!(doubts, [warning]);
    let refused = zeroed(&|_| true).1.unwrap_err().to_string();
    assert!(refused.contains("249 of 249 frames left out"), "{refused}");
}

#[test]
fn stamps_in_another_unit_are_named() {
    let scaled = |poses: f64, keypoints: f64| {
        let mut episode = log().episode(None).unwrap();
        episode.poses.iter_mut().for_each(|(t, _)| *t *= poses);
        episode.keypoints.iter_mut().for_each(|(t, _)| *t *= keypoints);
        episode.measured(&model()).map(|measured| measured.warnings)
    };
    assert_eq!(scaled(1.0, 1.0).unwrap(), [] as [String; 0]);
    let refused = scaled(1e3, 1e3).unwrap_err().to_string();
    for part in [
        "/panda/current_pose: header.stamp: expected times in s, about 0.017 s apart (camera.rate_hz 60",
        "got 3.300e1 s (the median), as if in milliseconds: divide the times by 1000",
    ] {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    // All frames come within the first frame period: the cause precedes the lack.
    let refused = scaled(1.0, 1e-3).unwrap_err().to_string();
    let named = "/dlo/keypoints: header.stamp: expected times in s, about 0.017 s apart (camera.rate_hz 60 of the model), got 3.300e-5 s";
    assert!(refused.find(named) < refused.find("needs at least two frames"), "{refused}");
    assert!(refused.contains(named) && refused.contains("multiply the times by 1000"), "{refused}");
}

#[test]
fn keypoints_out_of_view_are_named_with_side_and_view() {
    let mut episode = log().episode(None).unwrap();
    for (_, k) in episode.keypoints.iter_mut().filter(|(t, _)| *t > 4.0) {
        // The whole object moves at once: it stays plausible.
        k.dlo_px = k.dlo_px.map(|[u, v]| [u, v + 4.0]);
    }
    assert_eq!(episode.measured(&model()).unwrap().warnings, [] as [String; 0]);
    let mut low = log().episode(None).unwrap();
    for (t, k) in &mut low.keypoints {
        let down = (40.0 * *t).clamp(0.0, 140.0);
        k.dlo_px = k.dlo_px.map(|[u, v]| [u, v + down]);
    }
    let warnings = low.measured(&model()).unwrap().warnings;
    assert!(warnings.len() == 1, "{warnings:?}");
    for part in ["/dlo/keypoints: keypoints outside of the view", "beyond the bottom edge in", "look_at_m ["] {
        assert!(warnings[0].contains(part), "{part}: {warnings:?}");
    }
}

#[test]
fn an_observation_where_no_hand_was_is_refused() {
    let mut model = model();
    model.observation.drive = DriveKind::Actions;
    for value in [0.0, 400.0, 0.7] {
        let mut episode = driven(3).episode(None).unwrap();
        episode.observations[2].1.0[0] = value;
        let e = episode.measured(&model).unwrap_err().to_string();
        assert!(
            e.contains("/policy/observation: values[0..2] of step 2") && e.contains(&format!("({value}, 0.4) m")),
            "{e}"
        );
    }
}

#[test]
fn an_episode_that_a_fault_ended_is_used_only_where_it_is_asked_for() {
    let mut two = log();
    two.push_start(20_000_000_000, 5, start());
    two.push_end(21_000_000_000, 5, "fault: reflex".into());
    let chosen = two.episode(None).unwrap();
    assert_eq!(chosen.number, 4);
    assert!(
        chosen.notes[0].contains("episode 5 ended with \"fault: reflex\" and is passed over"),
        "{:?}",
        chosen.notes
    );
    assert_eq!((two.episode(Some(5)).unwrap().number, two.last().unwrap().number), (5, 5));
    let mut only = log();
    only.push_end(9_000_000_000, 4, "fault: no pose".into());
    let e = only.episode(None).unwrap_err().to_string();
    assert!(
        e.contains("episode 4 ended with \"fault: no pose\"") && e.contains("give the number of an episode"),
        "{e}"
    );
    let asked = only.episode(Some(4)).unwrap().measured(&model()).unwrap();
    assert!(asked.warnings[0].contains("fault: no pose"), "{:?}", asked.warnings);
    for reason in ["cancelled", "success", "left_workspace", "complete", ""] {
        let mut other = log();
        other.push_end(9_000_000_000, 4, reason.into());
        assert_eq!(other.episode(None).unwrap().measured(&model()).unwrap().warnings, [] as [String; 0], "{reason}");
    }
}

#[test]
fn records_without_stamps_are_counted_and_named_first() {
    let mut none = EpisodeLog::default();
    none.push_start(0, 1, start());
    none.push_end(0, 1, "complete".into());
    for i in 0..241 {
        none.push_keypoints(0, keypoints(f64::from(i), false));
    }
    (0..801).for_each(|_| none.push_pose(0, GripPose::default()));
    let e = none.episode(None).unwrap_err().to_string();
    assert!(
        e.starts_with(
            "241 keypoints and 801 poses have the stamp 0, as have 2 episode events: nodes with use_sim_time"
        ),
        "{e}"
    );
    // Only the camera has no clock.
    let mut camera = log();
    for _ in 0..70 {
        camera.push_keypoints(0, keypoints(0.0, false));
    }
    let warnings = camera.episode(None).unwrap().measured(&model()).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].starts_with("70 keypoints have the stamp 0"), "{warnings:?}");
    // Two poses before the first tick of a simulated clock.
    let mut simulated = log();
    simulated.push_pose(0, GripPose::default());
    simulated.push_pose(0, GripPose::default());
    assert_eq!(simulated.notes(), [] as [String; 0], "two of 302");
    // The note must not hide the reason for the missing episode.
    let mut open = EpisodeLog::default();
    (0..100).for_each(|i| open.push_pose(if i < 2 { 0 } else { 5 + i }, GripPose::default()));
    open.push_start(5, 2, start());
    let e = open.episode(None).unwrap_err().to_string();
    assert!(e.starts_with("/episode/event: episode 2 has no end"), "{e}");
    // A live log drops the note together with the records.
    let mut live = EpisodeLog::default();
    (0..100).for_each(|_| live.push_pose(0, GripPose::default()));
    live.push_frame(0, "world");
    assert_eq!(live.notes().len(), 2);
    live.push_pose(60_000_000_000, GripPose::default());
    live.forget_old();
    assert_eq!(live.notes(), [] as [String; 0]);
}

#[test]
fn clocks_and_frames_that_are_not_the_contracts_are_named() {
    let mut back = EpisodeLog::default();
    back.push_start(3_700_000_000_000, 1, start());
    back.push_end(102_000_000_000, 1, "complete".into());
    let e = back.episode(None).unwrap_err().to_string();
    assert!(e.starts_with("/episode/event: the end of episode 1 is stamped 3598.000 s before its start"), "{e}");
    let mut open = EpisodeLog::default();
    open.push_start(5, 2, start());
    assert!(open.episode(None).unwrap_err().to_string().starts_with("/episode/event: episode 2 has no end"));
    let mut late = EpisodeLog::default();
    late.push_end(5, 2, "complete".into());
    assert!(late.episode(None).unwrap_err().to_string().contains("episode 2 ends without a start"));
    let mut world = log();
    let frames = ["world", "panda_link0", "/panda_link0", "", "world"];
    (1_000_000_000..).zip(frames).for_each(|(stamp_ns, frame)| world.push_frame(stamp_ns, frame));
    let warnings = world.episode(None).unwrap().measured(&model()).unwrap().warnings;
    assert!(
        warnings.len() == 1 && warnings[0].contains("expected \"panda_link0\", got \"world\" in 2 poses"),
        "{warnings:?}"
    );
    // The camera stamps with its own clock, which starts at its power-up.
    let whole = log().episode(None).unwrap();
    let mut apart = EpisodeLog::default();
    apart.push_start(1_000_000_000, 4, start());
    apart.push_end(9_100_000_000, 4, "complete".into());
    for (t, pose) in &whole.poses {
        apart.push_pose(1_000_000_000 + (t * 1e9) as i64, *pose);
    }
    for (t, k) in &whole.keypoints {
        apart.push_keypoints(77_000_000_000 + (t * 1e9) as i64, *k);
    }
    let e = apart.episode(None).unwrap().measured(&model()).unwrap_err().to_string();
    assert!(
        e.contains("/dlo/keypoints: header.stamp: expected stamps of the episode") && e.contains("another clock"),
        "{e}"
    );
    assert!(e.find("another clock").unwrap() < e.find("needs").unwrap(), "the cause comes first: {e}");
}
