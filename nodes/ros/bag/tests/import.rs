//! An imported track is read from the bag with its original values.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

mod tables;

use catenary_bag::{BagReader, EpisodeTopics, Imported, import_track, read_episodes};
use catenary_core::model::StartKind;
use catenary_core::simulator::StartShape;
use catenary_core::{Camera, Model};
use catenary_msgs::geometry_msgs::msg::WrenchStamped;
use std::path::Path;
use tables::{BAR, CABLE, numbers, track};

/// Imports `csv` and compares the measured track with its rows: to 1e-9 m, and to 2e-9 s, because stamps are in ns.
fn check_round_trip(csv: &str, model: &Model) {
    // A path that is smoothed by its noise is another path.
    let mut model = model.clone();
    model.observation.grip_position_sd_m = 0.0;
    let model = &model;
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("track");
    import_track("track.csv", csv, model, &out).unwrap();
    let bag = BagReader::open(&out).unwrap();
    let log = read_episodes(&bag, &EpisodeTopics::default()).unwrap();
    let episode = log.episode(None).unwrap();
    assert_eq!((episode.start.policy.as_str(), episode.end.as_str()), ("recorded", "complete"));
    let rows = numbers(csv);
    assert_eq!((episode.keypoints.len(), episode.poses.len()), (rows.len(), rows.len()));
    let measured = episode.measured(model).unwrap();
    let camera: &Camera = &model.camera.view;
    // A track with a measured start begins at the middle of its first frames: times count from there.
    let begin_s = -measured.grip.times_s()[0];
    let at = |time_s: f64| rows.iter().find(|r| (r[0] - rows[0][0] - begin_s - time_s).abs() < 2e-9).unwrap();
    assert_eq!(begin_s > 0.0, model.observation.start == StartKind::Measured);
    let check_points = |scaled: &[[f64; 2]; 4], row: &[f64]| {
        for (k, scaled) in scaled.iter().enumerate() {
            let [x, z] = camera.plane_from_scaled(*scaled).unwrap();
            assert!((x - row[4 + 2 * k]).abs() < 1e-9 && (z - row[5 + 2 * k]).abs() < 1e-9, "{row:?}: {x}, {z}");
        }
    };
    for ((time_s, keypoints), row) in episode.keypoints.iter().zip(&rows) {
        assert!((time_s - (row[0] - rows[0][0])).abs() < 2e-9);
        check_points(&keypoints.dlo_scaled(), row);
    }
    for frame in &measured.track.frames {
        let row = at(frame.time_s);
        check_points(&frame.dlo, row);
        assert!((0..3).all(|i| (frame.eef[i] - row[1 + i]).abs() < 1e-9), "{:?} for {row:?}", frame.eef);
    }
    // A frame lies within half a period of its time.
    let lasting = ((episode.duration_s - begin_s) / model.observation.frame_period_s).round() as usize + 1;
    let possible = model.observation.frames.min(lasting);
    // Frames that hold an earlier value are left out, and named.
    let has_held = measured.warnings.iter().any(|w| w.contains("a held value is no observation"));
    let used = measured.track.frames.len();
    assert!(used == possible || has_held && used < possible, "{used} of {possible}: {:?}", measured.warnings);
    for ((time_s, pose), row) in episode.poses.iter().zip(&rows) {
        assert!((time_s - (row[0] - rows[0][0])).abs() < 2e-9);
        assert!((pose.grip.x_m - row[1]).abs() < 1e-12 && (pose.grip.pitch_rad - row[3]).abs() < 1e-12);
    }
    assert_eq!(measured.grip.poses().len(), rows.len());
    if model.observation.start == StartKind::Measured {
        let StartShape::Measured { points_m, .. } = measured.start else { panic!("{:?}", measured.start) };
        // The first frames are smoothed: the points of a measured cable jitter by some millimetres.
        let first = at(0.0);
        assert!((0..4).all(|k| (points_m[k][0] - first[4 + 2 * k]).abs() < 5e-3), "{points_m:?} for {first:?}");
    }
}

#[test]
fn a_track_survives_the_bag() {
    let mut bar = Model::from_yaml(BAR).unwrap();
    bar.observation.drive = catenary_core::model::DriveKind::Grip;
    check_round_trip(&track(0.0, 120), &bar);
    check_round_trip(&track(-3.7, 120), &Model::from_yaml(CABLE).unwrap());
}

#[test]
fn measured_tracks_survive_the_bag() {
    let Some(data) = std::env::var_os("CATENARY_DATA").filter(|d| !d.is_empty()) else {
        eprintln!("skipped: CATENARY_DATA does not say where the measured data are");
        return;
    };
    let folder = Path::new(&data).join("measured_cable");
    let model = Model::from_yaml(CABLE).unwrap();
    for name in ["swing_bare", "swing_tip_mass", "moving_grip_bare", "moving_grip_tip_mass"] {
        check_round_trip(&std::fs::read_to_string(folder.join(format!("{name}.csv"))).unwrap(), &model);
    }
}

#[test]
fn topics_frames_and_stamps_are_those_of_the_contract() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("track");
    let Imported { bag: summary, warnings } =
        import_track("track.csv", &track(0.0, 50), &Model::from_yaml(CABLE).unwrap(), &out).unwrap();
    assert_eq!((summary.messages, warnings), (152, vec![]));
    let bag = BagReader::open(&out).unwrap();
    assert_eq!(
        bag.describe_topics(),
        "/dlo/keypoints [catenary_msgs/msg/Keypoints] 50, /episode/event [catenary_msgs/msg/EpisodeEvent] 2, \
         /panda/current_pose [geometry_msgs/msg/PoseStamped] 50, /panda/external_wrench [geometry_msgs/msg/WrenchStamped] 50"
    );
    let wrenches: Vec<WrenchStamped> =
        bag.messages_of(&["/panda/external_wrench"]).map(|m| m.unwrap().decode().unwrap()).collect();
    assert_eq!(wrenches[0].header.frame_id, "panda_link0");
    assert_eq!((wrenches[0].wrench.force.z, wrenches[30].wrench.torque.y), (-4.0, 0.01));
    let stamps: Vec<(i32, u32)> = wrenches.iter().map(|w| (w.header.stamp.sec, w.header.stamp.nanosec)).collect();
    assert!(stamps.is_sorted() && stamps[0] == (1, 0) && stamps[30] == (2, 0), "{stamps:?}");
    let without: String = track(0.0, 50).lines().map(|l| l.rsplitn(4, ',').last().unwrap().to_owned() + "\n").collect();
    let bare = folder.path().join("bare");
    import_track("track.csv", &without, &Model::from_yaml(CABLE).unwrap(), &bare).unwrap();
    assert!(BagReader::open(&bare).unwrap().topic("/panda/external_wrench").is_none());
}

#[test]
fn a_track_behind_the_camera_is_refused_and_leaves_nothing() {
    let mut model = Model::from_yaml(BAR).unwrap();
    let Camera::Pinhole(camera) = &mut model.camera.view else { panic!("the bar's camera is a pinhole") };
    (camera.position_m, camera.look_at_m) = ([0.44, 1.0, 0.3], [0.44, 2.0, 0.3]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("track");
    let error = import_track("track.csv", &track(0.0, 10), &model, &out).unwrap_err().to_string();
    assert!(error.contains("track.csv: line 2, column p1_x_m") && error.contains("camera"), "{error}");
    assert!(!out.exists());
}

#[test]
fn a_bag_without_episode_topics_says_what_is_needed_and_found() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("track");
    import_track("track.csv", &track(0.0, 50), &Model::from_yaml(CABLE).unwrap(), &out).unwrap();
    let bag = BagReader::open(&out).unwrap();
    let renamed = |name: &str| name.to_owned();
    let topics = EpisodeTopics {
        keypoints: renamed("/lab/keypoints"),
        pose: renamed("/lab/pose"),
        wrench: renamed("/lab/wrench"),
        observation: renamed("/lab/observation"),
        action: renamed("/lab/action"),
        event: renamed("/lab/event"),
    };
    let error = read_episodes(&bag, &topics).unwrap_err().to_string();
    assert!(error.contains("needs /lab/keypoints") && !error.contains("/lab/wrench"), "{error}");
    assert!(error.contains("found /dlo/keypoints ["), "{error}");
    let swapped =
        EpisodeTopics { pose: renamed("/dlo/keypoints"), keypoints: renamed("/k"), ..EpisodeTopics::default() };
    let error = read_episodes(&bag, &swapped).unwrap_err().to_string();
    assert!(error.contains("/dlo/keypoints: expected geometry_msgs/msg/PoseStamped"), "{error}");
}

#[test]
fn a_track_of_which_the_camera_sees_nothing_is_refused_and_leaves_no_bag() {
    let (folder, model) = (tempfile::tempdir().unwrap(), Model::from_yaml(BAR).unwrap());
    let out = folder.path().join("track");
    let metres = track(0.0, 20);
    let (header, rows) = metres.split_once('\n').unwrap();
    let scaled = |line: &str| {
        let in_millimetres = |(column, value): (&str, &str)| {
            let value: f64 = value.parse().unwrap();
            (if column.ends_with("_m") { 1e3 * value } else { value }).to_string()
        };
        header.split(',').zip(line.split(',')).map(in_millimetres).collect::<Vec<_>>().join(",")
    };
    let millimetres = format!("{header}\n{}\n", rows.lines().map(scaled).collect::<Vec<_>>().join("\n"));
    let error = import_track("track.csv", &millimetres, &model, &out).unwrap_err().to_string();
    assert!(
        error.starts_with("track.csv: expected points in metres") && error.contains("got all 80 outside"),
        "{error}"
    );
    assert!(error.contains("line 2") && !out.exists(), "{error}");
    import_track("track.csv", &metres, &model, &out).unwrap();
}
