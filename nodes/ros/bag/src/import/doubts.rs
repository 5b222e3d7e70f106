//! Doubts about a track in CSV: times in another unit, held values, points out of view.

use super::table::{COLUMNS, Row};
use crate::error::BagError;
use catenary_core::episode::{HeldSummary, PlacedFrame, held_runs, held_summaries, interval_doubt, view_warning};
use catenary_core::{Camera, Keypoints, Model};

/// Refuses times in another unit than seconds.
pub(super) fn check_interval(file: &str, rows: &[Row], model: &Model) -> Result<(), BagError> {
    let times_s: Vec<f64> = rows.iter().map(Row::time_s).collect();
    match interval_doubt(&times_s, model) {
        None => Ok(()),
        Some(doubt) => {
            let lines = rows.first().zip(rows.last()).map_or([0; 2], |(a, b)| [a.line, b.line]);
            Err(BagError::Unit { file: file.to_owned(), lines, column: "t_s", doubt })
        }
    }
}

/// Warning about points outside of the image of the model's camera.
pub(super) fn out_of_view(file: &str, rows: &[Row], keypoints: &[Keypoints], camera: &Camera) -> Option<String> {
    // A missing point is nowhere.
    let seen: Vec<(&Row, &Keypoints)> = rows.iter().zip(keypoints).filter(|(_, k)| k.dlo_seen()).collect();
    let frames: Vec<[[f64; 2]; 4]> = seen.iter().map(|(_, k)| k.dlo_scaled()).collect();
    let points_m: Vec<[[f64; 2]; 4]> = seen.iter().map(|(r, _)| r.points_m).collect();
    view_warning(file, camera, &frames, &points_m, |i| format!("in line {}", seen[i].0.line))
}

/// Warnings about rows that hold the value of the row before, of all points or of one. Rows with a missing point are no
/// part of the comparison.
pub(super) fn held(file: &str, rows: &[Row], keypoints: &[Keypoints]) -> Vec<String> {
    let seen: Vec<&Row> = rows.iter().zip(keypoints).filter(|(_, k)| k.dlo_seen()).map(|(row, _)| row).collect();
    let frame = |r: &&Row| PlacedFrame { time_s: r.time_s(), points_m: r.points_m, grip: r.grip };
    let runs = held_runs(&seen.iter().map(frame).collect::<Vec<_>>());
    let words = |HeldSummary { keypoint, count, longest }| {
        let (from, to) = (seen[longest.first + 1], seen[longest.last]);
        let (columns, what, meanwhile) = match keypoint {
            None => (format!("{} to {}", COLUMNS[4], COLUMNS[11]), "the points or the shape", "hand or object move"),
            Some(k) => {
                (format!("{}, {}", COLUMNS[4 + 2 * k], COLUMNS[5 + 2 * k]), "the point", "the other points move")
            }
        };
        let k = keypoint.unwrap_or(3);
        let [x, z] = from.points_m[k];
        format!(
            "{file}: columns {columns}: {count} of {} rows ({:.0} %) hold {what} of the row before, the longest run {}, lines {} to {} (t_s {:.3} to {:.3} after the first row) with p{} at ({x}, {z}) m, while {meanwhile}: expected a new measurement in each row; imported, and left out when the bag is read",
            rows.len(),
            100.0 * count as f64 / rows.len() as f64,
            longest.count(),
            from.line,
            to.line,
            from.time_s(),
            to.time_s(),
            k + 1
        )
    };
    held_summaries(&runs).into_iter().map(words).collect()
}
