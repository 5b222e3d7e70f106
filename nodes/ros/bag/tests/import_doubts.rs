//! Doubts about an imported table are named, and the reader of the bag uses no doubtful row.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

mod tables;

use catenary_bag::{BagReader, EpisodeTopics, import_track, read_episodes, read_measured};
use catenary_core::model::StartKind;
use catenary_core::{Camera, Model};
use std::path::Path;
use tables::{CABLE, numbers, track};

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

/// Model of the cable with as many frames as rows at 30 Hz, from the first row on.
fn cable(frames: usize) -> Model {
    let mut model = Model::from_yaml(CABLE).unwrap();
    (model.observation.frames, model.observation.frame_period_s) = (frames, 1.0 / 30.0);
    model.observation.start = StartKind::HangingAtRest;
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
        "track.csv: columns p1_x_m to p4_z_m: 40 of 90 rows (44 %) hold the points or the shape of the row before",
        "the longest run 40, lines 52 to 91 (t_s 1.667 to 2.967 after the first row) with p4 at (",
        "left out when the bag is read",
    ] {
        assert!(warnings[0].contains(part), "{part}: {warnings:?}");
    }
    assert!(read[0].contains("40 of 90 frames (44 %)") && read[0].contains("1.67 s to 2.97 s"), "{read:?}");
}

#[test]
fn a_hand_and_an_object_at_rest_before_the_motion_are_used() {
    let rows = numbers(&track(0.0, 90));
    for digits in [3, 6, 17] {
        // Points in whole millimetres, in micrometres and in full.
        let csv = changed(90, |i, row| {
            row[1..12].copy_from_slice(&rows[i.saturating_sub(45)][1..12]);
            let scale = 10f64.powi(digits);
            row[4..12].iter_mut().for_each(|v| *v = (*v * scale).round() / scale);
        });
        let (warnings, used, read) = outcome(&csv, &cable(90)).unwrap();
        assert_eq!((used, warnings, read), (90, vec![], vec![]), "{digits}");
    }
}

#[test]
fn one_held_point_is_named_with_its_columns() {
    let held = numbers(&track(0.0, 90))[40].clone();
    let csv = changed(90, |i, row| {
        if (41..53).contains(&i) {
            row[8..10].copy_from_slice(&held[8..10]);
        }
    });
    let (warnings, used, read) = outcome(&csv, &cable(90)).unwrap();
    assert_eq!((used, warnings.len(), read.len()), (78, 1, 1), "{warnings:?} {read:?}");
    let part = "track.csv: columns p3_x_m, p3_z_m: 12 of 90 rows (13 %) hold the point of the row before, the longest run 12, lines 43 to 54";
    assert!(warnings[0].starts_with(part) && warnings[0].contains("with p3 at ("), "{warnings:?}");
    assert!(read[0].contains("repeat dlo_u[2], dlo_v[2]"), "{read:?}");
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
        warnings[0].starts_with("track.csv: columns p3_x_m, p3_z_m: (0, 0) in 5 of 60 rows, lines 22 to 26"),
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
    assert!(
        warnings[0].contains("columns grip_x_m, grip_z_m, grip_pitch_rad: 0 in 1 of 60 rows, line 32"),
        "{warnings:?}"
    );
    assert!(read.iter().any(|w| w.contains("/panda/current_pose: 1 of 60 poses left out")), "{read:?}");
}

#[test]
fn a_zero_in_one_coordinate_is_told_from_a_motion_through_zero() {
    for (column, name) in [(8, "p3_x_m"), (11, "p4_z_m")] {
        for (zero, lines) in [(20..25, "lines 22 to 26"), (0..5, "lines 2 to 6"), (57..60, "lines 59 to 61")] {
            let csv = changed(60, |i, row| {
                if zero.contains(&i) {
                    row[column] = 0.0;
                }
            });
            let (warnings, used, _) = outcome(&csv, &cable(60)).unwrap();
            assert_eq!(warnings.len(), 1, "{warnings:?}");
            assert!(used <= 60 - zero.len() && used >= 50, "{used}");
            let named = format!("track.csv: columns {name}: 0 in {} of 60 rows, {lines}", zero.len());
            assert!(warnings[0].starts_with(&named) && warnings[0].contains("score 0"), "{warnings:?}");
        }
        let refused = outcome(&changed(60, |_, row| row[column] = 0.0), &cable(60)).unwrap_err();
        assert!(
            refused.contains(&format!("column {name}: expected a point of the object in m, got 0 in all")),
            "{refused}"
        );
    }
    // The origin lies in the middle of the motion, below the hand, and the points come in whole centimetres.
    let csv = changed(60, |_, row| {
        [1, 4, 6, 8, 10].into_iter().for_each(|column| row[column] -= 0.47);
        row[4..12].iter_mut().for_each(|v| *v = (*v * 100.0).round() / 100.0);
    });
    assert!(numbers(&csv).iter().any(|row| row[10] == 0.0));
    let mut model = cable(60);
    let Camera::Plane(plane) = &mut model.camera.view else { panic!("the cable's camera is a plane") };
    plane.centre_m = [0.0, 0.3];
    assert_eq!(outcome(&csv, &model).unwrap().0, [] as [String; 0]);
    // A point at rest, whose coordinate is rounded to zero in some rows.
    let first = numbers(&track(0.0, 1))[0].clone();
    let csv = changed(60, |i, row| {
        row[1..12].copy_from_slice(&first[1..12]);
        for column in [1, 4, 6, 8, 10] {
            row[column] = ((row[column] - first[8] + 0.0005 * (i % 7) as f64) * 200.0).round() / 200.0;
        }
    });
    assert!((1..59).contains(&numbers(&csv).iter().filter(|row| row[8] == 0.0).count()));
    assert_eq!(outcome(&csv, &model).unwrap().0, [] as [String; 0]);
    // A hand at a pitch of 0 that begins to turn.
    let csv = changed(60, |i, row| row[3] = 0.01 * i.saturating_sub(30) as f64);
    assert_eq!(outcome(&csv, &cable(60)).unwrap().0, [] as [String; 0]);
    let csv = changed(60, |i, row| {
        if i == 30 {
            row[2] = 0.0
        }
    });
    let (warnings, ..) = outcome(&csv, &cable(60)).unwrap();
    assert!(warnings[0].starts_with("track.csv: columns grip_z_m: 0 in 1 of 60 rows, line 32"), "{warnings:?}");
}

#[test]
fn times_in_another_unit_are_refused_with_column_and_interval() {
    for (factor, part) in [(1e3, "got 3.333e1 s (the median), as if in milliseconds: divide"), (1e-3, "got 3.333e-5 s")]
    {
        let refused = outcome(&changed(60, |_, row| row[0] *= factor), &cable(60)).unwrap_err();
        let place = "track.csv: lines 2 to 61, column t_s: expected times in s, about 0.033 s apart (camera.rate_hz 30";
        assert!(refused.starts_with(place) && refused.contains(part), "{refused}");
    }
    let numbered = outcome(&changed(60, |i, row| row[0] = i as f64), &cable(60)).unwrap_err();
    assert!(numbered.contains("as if frame numbers: multiply them by the interval, 0.033 s"), "{numbered}");
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
    assert!(warnings.len() == 1 && warnings[0].contains("66 of 108 rows (61 %)"), "{warnings:?}");
    assert!(warnings[0].contains("the longest run 55, lines 55 to 109"), "{warnings:?}");
    let file = Path::new(&data).join("measured_cable_2").join("moving_grip_bare.csv");
    let (warnings, ..) = outcome(&std::fs::read_to_string(file).unwrap(), &Model::from_yaml(CABLE).unwrap()).unwrap();
    assert_eq!(warnings, [] as [String; 0], "a recording without held values");
}
