//! Measured streams at low rates: no sample of a real motion is taken for a fault, and a fault at an edge is found.
//! A failure here would cut real motions, or simulate from a pose that never was.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of measured data reads files")]

use catenary_core::episode::EpisodeStart;
use catenary_core::{DeltaAnchor, Episode, EpisodeLog, GripPose, Keypoints, Model};
use std::path::PathBuf;

const START_NS: i64 = 1_000_000_000;

/// Row of a measured track: time in s, pose of the grip, and four points (x, z) in m.
type Row = (f64, GripPose, [[f64; 2]; 4]);

/// Tracks of a cable at 30 Hz; none without the measured data.
fn tracks() -> Vec<Vec<Row>> {
    let Some(data) = std::env::var_os("CATENARY_DATA").filter(|d| !d.is_empty()) else {
        eprintln!("skipped: CATENARY_DATA does not say where the measured data are");
        return Vec::new();
    };
    let mut tracks = Vec::new();
    for folder in ["measured_cable", "measured_cable_2"] {
        for name in ["swing_bare", "swing_tip_mass", "moving_grip_bare", "moving_grip_tip_mass"] {
            let path = PathBuf::from(&data).join(folder).join(format!("{name}.csv"));
            let Ok(text) = std::fs::read_to_string(path) else { continue };
            tracks.push(text.lines().skip(1).map(row).collect());
        }
    }
    assert!(tracks.len() >= 4, "{} tracks", tracks.len());
    tracks
}

fn row(line: &str) -> Row {
    let v: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
    let grip = GripPose { x_m: v[1], z_m: v[2], pitch_rad: v[3] };
    (v[0], grip, std::array::from_fn(|k| [v[4 + 2 * k], v[5 + 2 * k]]))
}

fn model() -> Model {
    Model::from_yaml(include_str!("../../../../launch_configs/models/measured_cable.yaml")).unwrap()
}

/// Episode of these rows, in the camera of `model`.
fn episode(rows: &[Row], model: &Model) -> Episode {
    let start =
        EpisodeStart { policy: "recorded".into(), seed: 0, step_period_s: 0.5, delta_anchor: DeltaAnchor::LastTarget };
    let stamp = |row: &Row| START_NS + ((row.0 - rows[0].0) * 1e9).round() as i64;
    let mut log = EpisodeLog::default();
    log.push_start(START_NS - 1, 1, start);
    for row in rows {
        let dlo_px = row.2.map(|[x, z]| model.camera.view.mask_from_world([x, 0.0, z]).unwrap());
        let keypoints = Keypoints {
            dlo_px,
            target_px: None,
            scores: [1.0; 4],
            target_score: 0.0,
            image_width_px: 256,
            image_height_px: 256,
        };
        log.push_keypoints(stamp(row), keypoints);
        log.push_pose(stamp(row), row.1);
    }
    log.push_end(stamp(&rows[rows.len() - 1]) + 1, 1, "complete".into());
    log.episode(None).unwrap()
}

/// Warnings about samples that were left out, but for held ones: the published fits of these tracks do repeat.
fn left_out(episode: &Episode, model: &Model) -> Vec<String> {
    let warnings = match episode.measured(model) {
        Ok(measured) => measured.warnings,
        // A short window of held frames alone holds too few observations.
        Err(error) if error.to_string().contains("repeat the frame before") => return Vec::new(),
        Err(error) => panic!("{error}"),
    };
    warnings.into_iter().filter(|w| w.contains("left out") && !w.contains("repeat the frame before")).collect()
}

#[test]
fn no_window_of_a_measured_motion_has_a_fault_at_any_rate() {
    let model = model();
    let mut windows = 0;
    for track in tracks() {
        // From 30 Hz down to 3 Hz: at 2 Hz the gaps between poses are too long to simulate across.
        for every in [1, 2, 3, 4, 6, 10] {
            let rows: Vec<Row> = track.iter().copied().step_by(every).collect();
            // An episode may begin and end at any moment of a motion.
            for length in [20, 40, rows.len()] {
                for window in rows.windows(length).step_by(3) {
                    assert_eq!(left_out(&episode(window, &model), &model), [] as [String; 0], "every {every}");
                    windows += 1;
                }
            }
        }
    }
    eprintln!("{windows} windows");
}

#[test]
fn a_fault_at_an_edge_of_a_slow_stream_is_found_and_named() {
    let model = model();
    for track in tracks() {
        // 7.5 Hz: the limits of speed allow 0.47 m between two samples.
        let rows: Vec<Row> = track.iter().copied().step_by(4).collect();
        if rows.len() < 20 {
            continue;
        }
        for (index, which) in [(0, "first"), (rows.len() - 1, "last")] {
            let mut wrong = episode(&rows, &model);
            wrong.poses[index].1.grip.z_m -= 0.45;
            let said = left_out(&wrong, &model);
            let words = format!("/panda/current_pose: {which} pose left out, at ");
            assert!(said.len() == 1 && said[0].starts_with(&words), "{said:?}");
        }
    }
}
