//! An imported track is read from the bag with its original values.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::{BagReader, EpisodeTopics, Imported, import_track, read_episodes, read_measured};
use catenary_core::model::StartKind;
use catenary_core::simulator::StartShape;
use catenary_core::{Camera, Model};
use catenary_msgs::geometry_msgs::msg::WrenchStamped;
use std::fmt::Write;
use std::path::Path;

const CABLE: &str = include_str!("../../../launch_configs/models/measured_cable.yaml");
const BAR: &str = include_str!("../../../launch_configs/models/soft_bar.yaml");

/// CSV text of a swinging cable at 30 Hz, from `start_s` on.
fn track(start_s: f64, rows: usize) -> String {
    let mut csv = "t_s,grip_x_m,grip_z_m,grip_pitch_rad,p1_x_m,p1_z_m,p2_x_m,p2_z_m,p3_x_m,p3_z_m,p4_x_m,p4_z_m,\
                   grip_fx_n,grip_fz_n,grip_ty_nm\n"
        .to_owned();
    for i in 0..rows {
        let t = i as f64 / 30.0;
        let (x, z, pitch) = (0.45 + 0.05 * (2.0 * t).sin(), 0.41, 0.1 * (3.0 * t).cos());
        write!(csv, "{},{x},{z},{pitch}", start_s + t).unwrap();
        for k in 1..=4 {
            let angle = 0.3 * (5.0 * t).cos() * f64::from(k) / 4.0;
            write!(csv, ",{},{}", x + 0.05 * f64::from(k) * angle.sin(), z - 0.05 * f64::from(k) * angle.cos())
                .unwrap();
        }
        writeln!(csv, ",{},{},{}", t.sin(), -4.0, 0.01 * t).unwrap();
    }
    csv
}

fn numbers(csv: &str) -> Vec<Vec<f64>> {
    csv.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect()
}

/// Imports `csv` and compares the measured track with its rows: to 1e-9 m, and to 2e-9 s, because stamps are in ns.
fn check_round_trip(csv: &str, model: &Model) {
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
        observation: renamed("/lab/observation"),
        action: renamed("/lab/action"),
        event: renamed("/lab/event"),
    };
    let error = read_episodes(&bag, &topics).unwrap_err().to_string();
    assert!(error.contains("needs /lab/keypoints") && error.contains("found /dlo/keypoints ["), "{error}");
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
        let values: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        let words: Vec<String> =
            values.iter().enumerate().map(|(i, v)| (if i == 0 { *v } else { 1e3 * v }).to_string()).collect();
        words.join(",")
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

/// CSV text of `track(0.0, rows)` after `change` was applied to each row: its index and its numbers.
fn changed(rows: usize, change: impl Fn(usize, &mut [f64])) -> String {
    let csv = track(0.0, rows);
    let mut all = numbers(&csv);
    all.iter_mut().enumerate().for_each(|(i, row)| change(i, row));
    let lines: Vec<String> =
        all.iter().map(|row| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",")).collect();
    format!("{}\n{}\n", csv.lines().next().unwrap(), lines.join("\n"))
}

/// Warnings of the import, and the frames and warnings of a reader of the bag; or the refusal of the import.
fn outcome(csv: &str, model: &Model) -> Result<(Vec<String>, usize, Vec<String>), String> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("track");
    let imported = import_track("track.csv", csv, model, &out).map_err(|e| e.to_string())?;
    let rows = numbers(csv).len();
    let bag = BagReader::open(&out).unwrap();
    let log = read_episodes(&bag, &EpisodeTopics::default()).unwrap();
    assert_eq!(log.episode(None).unwrap().keypoints.len(), rows, "every row is in the bag");
    let measured = read_measured(&[out], &[], model).unwrap().remove(0);
    Ok((imported.warnings, measured.track.frames.len(), measured.warnings))
}

/// Model of the cable with as many frames as rows at 30 Hz.
fn cable(frames: usize) -> Model {
    let mut model = Model::from_yaml(CABLE).unwrap();
    (model.observation.frames, model.observation.frame_period_s) = (frames, 1.0 / 30.0);
    let Camera::Plane(plane) = &mut model.camera.view else { panic!("the cable's camera is a plane") };
    plane.centre_m = [0.45, 0.3];
    model
}

#[test]
fn held_rows_are_named_with_lines_and_times_kept_in_the_bag_and_left_out_by_its_reader() {
    let held = numbers(&track(0.0, 90))[49].clone();
    let csv = changed(90, |i, row| {
        if i >= 50 {
            row[4..12].copy_from_slice(&held[4..12]);
        }
    });
    let (warnings, used, read) = outcome(&csv, &cable(90)).unwrap();
    assert_eq!((used, warnings.len(), read.len()), (50, 1, 1), "{warnings:?} {read:?}");
    for part in [
        "track.csv: columns p1_x_m to p4_z_m: 40 of 90 rows (44 %) repeat the points or the shape of the row before",
        "the longest run 40, lines 52 to 91 (t_s 1.667 to 2.967 after the first row)",
        "left out when the bag is read",
    ] {
        assert!(warnings[0].contains(part), "{part}: {warnings:?}");
    }
    assert!(read[0].contains("40 of 90 frames (44 %)") && read[0].contains("1.67 s to 2.97 s"), "{read:?}");
    // Hand and object at rest before the motion.
    let first = numbers(&track(0.0, 1))[0].clone();
    let rest = changed(90, |i, row| {
        if i < 30 {
            row[1..12].copy_from_slice(&first[1..12]);
        }
    });
    let (warnings, used, read) = outcome(&rest, &cable(90)).unwrap();
    assert_eq!(used, 90, "{warnings:?} {read:?}");
    assert!(warnings[0].contains("29 of 90 rows") && warnings[0].contains("the hand is at rest"), "{warnings:?}");
}

#[test]
fn zeros_in_place_of_missing_points_are_named_and_not_used() {
    let csv = changed(60, |i, row| {
        if (20..25).contains(&i) {
            row[8..10].fill(0.0);
        }
    });
    let (warnings, used, _) = outcome(&csv, &cable(60)).unwrap();
    assert_eq!((used, warnings.len()), (55, 1), "{warnings:?}");
    assert!(
        warnings[0].starts_with("track.csv: columns p3_x_m, p3_z_m: (0, 0) in 5 of 60 rows, the first in line 22"),
        "{warnings:?}"
    );
    let refused = outcome(&changed(60, |_, row| row[8..10].fill(0.0)), &cable(60)).unwrap_err();
    assert!(
        refused.starts_with(
            "track.csv: line 2, column p3_x_m, p3_z_m: expected a point of the object in m, got (0, 0) in all"
        ),
        "{refused}"
    );
    let csv = changed(60, |i, row| {
        if i == 30 {
            row[1..4].fill(0.0);
        }
    });
    let (warnings, _, read) = outcome(&csv, &cable(60)).unwrap();
    assert!(warnings[0].contains("columns grip_x_m, grip_z_m, grip_pitch_rad: 0 in 1 of 60 rows"), "{warnings:?}");
    assert!(read.iter().any(|w| w.contains("/panda/current_pose: 1 of 60 poses left out")), "{read:?}");
}

#[test]
fn times_in_another_unit_are_refused_with_column_and_interval() {
    for (factor, part) in [(1e3, "got 3.333e1 s (the median), as if in milliseconds: divide"), (1e-3, "got 3.333e-5 s")]
    {
        let refused = outcome(&changed(60, |_, row| row[0] *= factor), &cable(60)).unwrap_err();
        let place = "track.csv: lines 2 to 61, column t_s: expected times in s, about 0.033 s apart (camera.rate_hz 30";
        assert!(refused.starts_with(place) && refused.contains(part), "{refused}");
    }
    // Motion capture is faster than a camera, and a slow camera slower.
    for factor in [30.0 / 1000.0, 6.0] {
        outcome(&changed(60, |_, row| row[0] *= factor), &cable(60)).unwrap();
    }
}

#[test]
fn points_out_of_view_are_named_with_line_and_side_and_with_a_view_that_holds_them() {
    let mut model = cable(60);
    let csv = track(0.0, 60);
    assert_eq!(outcome(&csv, &model).unwrap().0, [] as [String; 0]);
    let Camera::Plane(plane) = &mut model.camera.view else { panic!("the cable's camera is a plane") };
    // The last point lies at z = 0.21 m or a little above.
    (plane.centre_m, plane.side_m) = ([0.45, 0.49], 0.5);
    let (warnings, used, read) = outcome(&csv, &model).unwrap();
    assert_eq!((warnings.len(), used), (1, 60), "{warnings:?}");
    for part in [
        "track.csv: keypoints outside of the view",
        "keypoint 4 beyond the bottom edge in ",
        "of 60 frames, the first in line ",
    ] {
        assert!(warnings[0].contains(part), "{part}: {warnings:?}");
    }
    assert!(read.iter().any(|w| w.contains("keypoint 4 beyond the bottom edge")), "{read:?}");
    let (_, fields) = warnings[0].split_once("centre_m [").unwrap();
    let values: Vec<f64> =
        fields.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter_map(|word| word.parse().ok()).collect();
    let Camera::Plane(plane) = &mut model.camera.view else { panic!("the cable's camera is a plane") };
    (plane.centre_m, plane.side_m) = ([values[0], values[1]], values[2]);
    assert_eq!(outcome(&csv, &model).unwrap().0, [] as [String; 0], "{values:?}");
}

#[test]
fn the_held_values_of_a_measured_cable_are_found() {
    let Some(data) = std::env::var_os("CATENARY_DATA").filter(|d| !d.is_empty()) else {
        eprintln!("skipped: CATENARY_DATA does not say where the measured data are");
        return;
    };
    let file = Path::new(&data).join("measured_cable_2").join("swing_bare.csv");
    let (warnings, _, _) = outcome(&std::fs::read_to_string(file).unwrap(), &Model::from_yaml(CABLE).unwrap()).unwrap();
    // Its fit was updated only after a motion of 5 mm, and is frozen at the end.
    assert!(warnings[0].contains("66 of 108 rows (61 %)"), "{warnings:?}");
    assert!(warnings[0].contains("the longest run 55, lines 55 to 109"), "{warnings:?}");
}
