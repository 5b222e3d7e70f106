//! Doubts about a track in CSV: times in another unit, zeros for missing values, held values, points out of view.

use super::table::Row;
use crate::error::BagError;
use catenary_core::episode::{MANY_STILL, PlacedFrame, Repeats, interval_doubt, pixel_m, repeats, view_warning};
use catenary_core::{Camera, GripPose, Keypoints, Model};

/// True for a point at exactly (0, 0) m: tables have zeros in place of missing points. A measured point does not lie there
/// to the last digit, inside of the arm's base.
pub(super) fn is_missing(point_m: [f64; 2]) -> bool {
    point_m == [0.0, 0.0]
}

/// Refuses times in another unit than seconds.
pub(super) fn check_interval(file: &str, rows: &[Row], model: &Model) -> Result<(), BagError> {
    let times_s: Vec<f64> = rows.iter().map(|r| r.time_ns as f64 * 1e-9).collect();
    match interval_doubt(&times_s, model) {
        None => Ok(()),
        Some(doubt) => {
            let lines = rows.first().zip(rows.last()).map_or([0; 2], |(a, b)| [a.line, b.line]);
            Err(BagError::Unit { file: file.to_owned(), lines, column: "t_s", doubt })
        }
    }
}

/// Warnings about zeros in place of points and poses.
///
/// # Errors
/// [`BagError::Csv`] if a point is zero in all rows.
pub(super) fn zeros(file: &str, rows: &[Row]) -> Result<Vec<String>, BagError> {
    let mut warnings = Vec::new();
    for k in 0..4 {
        let zeros: Vec<u64> = rows.iter().filter(|r| is_missing(r.points_m[k])).map(|r| r.line).collect();
        let Some(first) = zeros.first() else { continue };
        let columns = format!("p{0}_x_m, p{0}_z_m", k + 1);
        if zeros.len() == rows.len() {
            return Err(BagError::Csv {
                file: file.to_owned(),
                line: *first,
                column: columns,
                expected: "a point of the object in m".to_owned(),
                got: "(0, 0) in all rows, as if the point was not measured".to_owned(),
            });
        }
        warnings.push(format!(
            "{file}: columns {columns}: (0, 0) in {} of {} rows, the first in line {first}, as if for a missing point: imported as not seen (score 0), so that these frames are not used",
            zeros.len(),
            rows.len()
        ));
    }
    let zeros: Vec<u64> = rows.iter().filter(|r| r.grip == GripPose::default()).map(|r| r.line).collect();
    // A hand that is the origin of all points is zero in every row.
    if let Some(first) = zeros.first().filter(|_| zeros.len() < rows.len()) {
        warnings.push(format!(
            "{file}: columns grip_x_m, grip_z_m, grip_pitch_rad: 0 in {} of {} rows, the first in line {first}, as if for a missing pose: imported as it is; poses that no arm reaches are left out later, with a warning",
            zeros.len(),
            rows.len()
        ));
    }
    Ok(warnings)
}

/// Warning about points outside of the image of the model's camera.
pub(super) fn out_of_view(file: &str, rows: &[Row], keypoints: &[Keypoints], camera: &Camera) -> Option<String> {
    // A missing point is nowhere.
    let seen: Vec<(&Row, &Keypoints)> = rows.iter().zip(keypoints).filter(|(_, k)| k.dlo_seen()).collect();
    let frames: Vec<[[f64; 2]; 4]> = seen.iter().map(|(_, k)| k.dlo_scaled()).collect();
    let points_m: Vec<[[f64; 2]; 4]> = seen.iter().map(|(r, _)| r.points_m).collect();
    view_warning(file, camera, &frames, &points_m, |i| format!("in line {}", seen[i].0.line))
}

/// Warnings about rows that repeat the row before, in the plane or relative to the hand.
pub(super) fn held(file: &str, rows: &[Row], camera: &Camera) -> Vec<String> {
    let frame = |r: &Row| PlacedFrame { time_s: r.time_ns as f64 * 1e-9, points_m: r.points_m, grip: r.grip };
    let frames: Vec<PlacedFrame> = rows.iter().map(frame).collect();
    let runs = pixel_m(camera).map(|pixel_m| repeats(&frames, pixel_m)).unwrap_or_default();
    let words = |is_held: bool, least: f64, meaning: &str| {
        let runs: Vec<&Repeats> = runs.iter().filter(|r| r.is_held == is_held).collect();
        let longest = runs.iter().max_by_key(|r| r.count())?;
        let count: usize = runs.iter().map(|r| r.count()).sum();
        if count as f64 <= least * rows.len() as f64 {
            return None;
        }
        let [from, to] = [longest.first + 1, longest.last];
        Some(format!(
            "{file}: columns p1_x_m to p4_z_m: {count} of {} rows ({:.0} %) repeat the points or the shape of the row before, the longest run {}, lines {} to {} (t_s {:.3} to {:.3} after the first row): {meaning}",
            rows.len(),
            100.0 * count as f64 / rows.len() as f64,
            longest.count(),
            rows[from].line,
            rows[to].line,
            frames[from].time_s,
            frames[to].time_s
        ))
    };
    let held = words(
        true,
        0.0,
        "hand or object move meanwhile, so that the values are held; imported, and left out when the bag is read",
    );
    let still =
        words(false, MANY_STILL, "the hand is at rest meanwhile, and the object may be, too; imported and used");
    held.into_iter().chain(still).collect()
}
