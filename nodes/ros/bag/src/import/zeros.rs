//! Zeros in place of values that were not measured.
//!
//! Tables have zeros in place of missing values, and a motion may pass through zero. An exact zero counts as missing if the
//! values around it are farther off than the motion goes from row to row.

use super::table::{COLUMNS, Row};
use crate::error::BagError;
use catenary_core::Model;
use catenary_core::statistics::{QuantileMethod, quantile};

/// Rank of a large step among the steps of a value from row to row, and the factor on it above which a step is no motion.
/// Single faults are among the largest steps.
const LARGE: f64 = 0.95;
const FACTOR: f64 = 3.0;
/// Least distance from zero of the values around a missing one, in m or rad: a hand at rest may jitter by it about zero.
const LEAST: f64 = 2e-3;
/// Factor on the length of the object between two keypoints above which the object cannot reach.
const REACH: f64 = 1.5;

/// Points that are missing in each row, and the warnings about zeros.
pub(super) struct Zeros {
    /// True for each of the four points of each row that is missing.
    pub(super) missing: Vec<[bool; 4]>,
    /// Warnings, one sentence each.
    pub(super) warnings: Vec<String>,
}

/// Finds zeros in place of points and poses.
///
/// # Errors
/// [`BagError::Csv`] if a point is missing in all rows.
pub(super) fn zeros(file: &str, rows: &[Row], model: &Model) -> Result<Zeros, BagError> {
    let mut missing = vec![[false; 4]; rows.len()];
    let mut warnings = Vec::new();
    let rounding = rounding_m(rows);
    for k in 0..4 {
        let both: Vec<bool> = pair(rows, k, rounding);
        let axes = [0, 1].map(|axis| (axis, one_axis(rows, k, axis, rounding, model)));
        let of_both = (format!("{}, {}", COLUMNS[4 + 2 * k], COLUMNS[5 + 2 * k]), "(0, 0)", both);
        let of_one = axes.map(|(axis, flags)| (COLUMNS[4 + 2 * k + axis].to_owned(), "0", flags));
        let mut named = vec![false; rows.len()];
        for (columns, value, flags) in [of_both].into_iter().chain(of_one) {
            let flags: Vec<bool> = flags.iter().zip(&named).map(|(flag, named)| *flag && !*named).collect();
            let lines = lines(rows, &flags);
            let Some(first) = lines.first().copied() else { continue };
            if lines.len() == rows.len() {
                return Err(BagError::Csv {
                    file: file.to_owned(),
                    line: first,
                    column: columns,
                    expected: "a point of the object in m".to_owned(),
                    got: format!("{value} in all rows, as if the point was not measured"),
                });
            }
            warnings.push(format!(
                "{file}: columns {columns}: {value} in {} of {} rows, {}, as if for a missing point: expected the place of the point in m; imported as not seen (score 0), so that these frames are not used",
                lines.len(),
                rows.len(),
                places(&lines)
            ));
            named.iter_mut().zip(&flags).for_each(|(named, flag)| *named |= *flag);
        }
        missing.iter_mut().zip(&named).for_each(|(missing, named)| missing[k] = *named);
    }
    warnings.extend(poses(file, rows));
    Ok(Zeros { missing, warnings })
}

/// Flags of the rows in which the point `k` is (0, 0), without those of a point that passes there.
fn pair(rows: &[Row], k: usize, rounding: f64) -> Vec<bool> {
    let sizes: Vec<f64> = rows.iter().map(|r| r.points_m[k][0].hypot(r.points_m[k][1])).collect();
    runs(&sizes).into_iter().fold(vec![false; rows.len()], |mut flags, run| {
        let ends = [run.before, run.after];
        // The distance from the origin changes by at most the point's step.
        let is_near = ends.iter().flatten().any(|v| v.abs() <= large_step(&sizes, rounding));
        flags[run.first..=run.last].fill(!is_near);
        flags
    })
}

/// Flags of the rows in which one coordinate of the point `k` is 0 in place of a value.
fn one_axis(rows: &[Row], k: usize, axis: usize, rounding: f64, model: &Model) -> Vec<bool> {
    let values: Vec<f64> = rows.iter().map(|r| r.points_m[k][axis]).collect();
    if values.iter().all(|v| *v == 0.0) {
        let torn = rows.iter().filter(|row| is_torn(row, k, model)).count();
        return vec![2 * torn > rows.len(); rows.len()];
    }
    let limit = large_step(&values, rounding);
    runs(&values).into_iter().fold(vec![false; rows.len()], |mut flags, run| {
        let ends = [run.before, run.after];
        let is_far = ends.iter().flatten().all(|v| v.abs() > limit);
        // A row at either end of the table has one neighbour only: an object that hangs at 0 below a hand at 0 may begin there.
        let grip = rows[run.first].grip;
        let is_sure = ends.iter().all(Option::is_some) || [grip.x_m, grip.z_m][axis].abs() > LEAST;
        flags[run.first..=run.last].fill(is_far && is_sure);
        flags
    })
}

/// True if the point `k` of a row is farther from one of its neighbours than the object is long between them. False if the
/// model says nothing about the length.
fn is_torn(row: &Row, k: usize, model: &Model) -> bool {
    let parameter = model.theta.parameters().iter().find(|p| p.name == "length_m");
    let fixed = model.parameters.get("length_m").copied();
    let Some(length_m) = fixed.or_else(|| parameter.map(|p| p.prior.bounds().1)) else { return false };
    let fractions = model.object.keypoint_fractions;
    let chain: Vec<(f64, [f64; 2])> =
        std::iter::once((0.0, [row.grip.x_m, row.grip.z_m])).chain(fractions.into_iter().zip(row.points_m)).collect();
    let is_apart = |w: &[(f64, [f64; 2])]| {
        let ((a, p), (b, q)) = (w[0], w[1]);
        (p[0] - q[0]).hypot(p[1] - q[1]) > REACH * length_m * (b - a).abs()
    };
    // The point k is entry k + 1 of the chain.
    chain[k..].windows(2).take(2).any(is_apart)
}

/// Warnings about zeros in place of poses of the hand. They are imported as they are: a pose has no score.
fn poses(file: &str, rows: &[Row]) -> Vec<String> {
    let values: Vec<[f64; 3]> = rows.iter().map(|r| [r.grip.x_m, r.grip.z_m, r.grip.pitch_rad]).collect();
    let whole: Vec<bool> = values.iter().map(|v| *v == [0.0; 3]).collect();
    let column = |i: usize| -> Vec<bool> {
        let values: Vec<f64> = values.iter().map(|v| v[i]).collect();
        let limit = large_step(&values, 0.0);
        runs(&values).into_iter().fold(vec![false; rows.len()], |mut flags, run| {
            // A hand may be at 0 before or after a motion: a missing value comes back.
            let is_far = run.before.zip(run.after).is_some_and(|(a, b)| a.abs().min(b.abs()) > limit);
            flags[run.first..=run.last].fill(is_far);
            flags
        })
    };
    let all_rows = rows.len();
    let of_whole = (COLUMNS[1..4].join(", "), whole.clone());
    let of_one = (0..3).map(|i| {
        let flags = column(i).iter().zip(&whole).map(|(flag, whole)| *flag && !*whole).collect();
        (COLUMNS[1 + i].to_owned(), flags)
    });
    let said = |(columns, flags): (String, Vec<bool>)| {
        let lines = lines(rows, &flags);
        // A hand that is the origin of all points is zero in every row.
        (!lines.is_empty() && lines.len() < all_rows).then(|| {
            format!(
                "{file}: columns {columns}: 0 in {} of {all_rows} rows, {}, as if for a missing pose: expected the pose of the hand in m and rad; imported as it is; poses that no arm reaches are left out when the bag is read, with a warning",
                lines.len(),
                places(&lines)
            )
        })
    };
    std::iter::once(of_whole).chain(of_one).filter_map(said).collect()
}

/// Run of zeros in a column, with the values before and after it.
struct Run {
    first: usize,
    last: usize,
    before: Option<f64>,
    after: Option<f64>,
}

fn runs(values: &[f64]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (i, _) in values.iter().enumerate().filter(|(_, v)| **v == 0.0) {
        match runs.last_mut() {
            Some(run) if run.last + 1 == i => (run.last, run.after) = (i, values.get(i + 1).copied()),
            _ => runs.push(Run {
                first: i,
                last: i,
                before: i.checked_sub(1).map(|before| values[before]),
                after: values.get(i + 1).copied(),
            }),
        }
    }
    runs
}

/// Least difference in m between the coordinates of all points: their rounding, or less.
fn rounding_m(rows: &[Row]) -> f64 {
    let mut values: Vec<f64> = rows.iter().flat_map(|r| r.points_m).flatten().collect();
    values.sort_by(f64::total_cmp);
    values.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > 1e-6).reduce(f64::min).unwrap_or_default()
}

/// Distance above which a value, rounded to `rounding`, does not come from one row to the next.
fn large_step(values: &[f64], rounding: f64) -> f64 {
    let apart = values.windows(2).filter(|w| w[0] != 0.0 && w[1] != 0.0).map(|w| (w[1] - w[0]).abs());
    let mut steps: Vec<f64> = apart.collect();
    steps.sort_by(f64::total_cmp);
    let large = if steps.is_empty() { 0.0 } else { quantile(&steps, LARGE, QuantileMethod::Lower) };
    LEAST.max(FACTOR * large.max(rounding))
}

/// Lines of the flagged rows.
fn lines(rows: &[Row], flags: &[bool]) -> Vec<u64> {
    rows.iter().zip(flags).filter(|(_, flag)| **flag).map(|(row, _)| row.line).collect()
}

/// First and last line, as text.
fn places(lines: &[u64]) -> String {
    match lines {
        [line] => format!("line {line}"),
        [first, .., last] => format!("lines {first} to {last}"),
        [] => String::new(),
    }
}
