//! Arc length, resampling and smoothing of open polylines. A polyline has at least one point.

/// Reach of the widest smoothing kernel in points: three standard deviations of 20.
const MAX_REACH: usize = 60;

/// Length from the first point to the last.
pub(crate) fn length(points: &[[f64; 2]]) -> f64 {
    points.windows(2).map(|pair| distance(pair[0], pair[1])).sum()
}

/// Distance of two points.
pub(crate) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// Writes `count` (at least 2) points at equal arc lengths from `from` to `to`, both included. Arc lengths beyond the ends
/// give the ends.
pub(crate) fn resample(points: &[[f64; 2]], from: f64, to: f64, count: usize, out: &mut Vec<[f64; 2]>) {
    out.clear();
    let (mut i, mut before) = (0, 0.0);
    for k in 0..count {
        let arc = from + (to - from) * k as f64 / (count - 1) as f64;
        while i + 2 < points.len() && before + distance(points[i], points[i + 1]) < arc {
            before += distance(points[i], points[i + 1]);
            i += 1;
        }
        out.push(between(points, i, arc - before));
    }
}

/// Point at arc length `arc` and the unit direction there.
pub(crate) fn at(points: &[[f64; 2]], arc: f64) -> ([f64; 2], [f64; 2]) {
    let (mut i, mut before) = (0, 0.0);
    while i + 2 < points.len() && before + distance(points[i], points[i + 1]) < arc {
        before += distance(points[i], points[i + 1]);
        i += 1;
    }
    (between(points, i, arc - before), direction(points[i], points[(i + 1).min(points.len() - 1)]))
}

/// Unit direction from `a` to `b`; to the right if they coincide.
pub(crate) fn direction(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let norm = distance(a, b);
    if norm > 1e-9 { [(b[0] - a[0]) / norm, (b[1] - a[1]) / norm] } else { [1.0, 0.0] }
}

/// Point at the distance `along` from point i on the segment that begins there.
fn between(points: &[[f64; 2]], i: usize, along: f64) -> [f64; 2] {
    let (a, b) = (points[i], points[(i + 1).min(points.len() - 1)]);
    let norm = distance(a, b);
    let t = if norm > 1e-9 { (along / norm).clamp(0.0, 1.0) } else { 0.0 };
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

/// Smooths evenly spaced points with a Gaussian of standard deviation `sigma`, in spacings. The line is continued beyond
/// each end by its reflection through the end point, so that the end point does not move.
pub(crate) fn smooth(points: &mut [[f64; 2]], sigma: f64, scratch: &mut Vec<[f64; 2]>) {
    let last = points.len() as isize - 1;
    let reach = ((3.0 * sigma).ceil() as isize).min(last).min(MAX_REACH as isize);
    if reach < 1 {
        return;
    }
    scratch.clear();
    scratch.extend_from_slice(points);
    let source = &*scratch;
    let mut kernel = [0.0; MAX_REACH + 1];
    for (d, weight) in kernel.iter_mut().enumerate() {
        *weight = (-0.5 * (d as f64 / sigma).powi(2)).exp();
    }
    let mirrored = |i: isize| {
        let through = |end: isize, i: isize| {
            let (end, inner) = (source[end as usize], source[i as usize]);
            [2.0 * end[0] - inner[0], 2.0 * end[1] - inner[1]]
        };
        match i {
            i if i < 0 => through(0, -i),
            i if i > last => through(last, 2 * last - i),
            i => source[i as usize],
        }
    };
    for (k, point) in points.iter_mut().enumerate() {
        let (mut sum, mut total) = ([0.0; 2], 0.0);
        for d in -reach..=reach {
            let weight = kernel[d.unsigned_abs()];
            let p = mirrored(k as isize + d);
            sum = [sum[0] + weight * p[0], sum[1] + weight * p[1]];
            total += weight;
        }
        *point = sum.map(|s| s / total);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Paths that turn by at most 0.3 rad at each of their unequal steps.
    fn paths() -> impl Strategy<Value = Vec<[f64; 2]>> {
        proptest::collection::vec((0.3f64..2.0, -0.3f64..0.3), 8..80).prop_map(|steps| {
            let (mut p, mut heading) = ([100.0, 100.0], 0.0f64);
            let mut points = vec![p];
            for (step, turn) in steps {
                heading += turn;
                p = [p[0] + step * heading.cos(), p[1] + step * heading.sin()];
                points.push(p);
            }
            points
        })
    }

    proptest! {
        #[test]
        fn resampling_keeps_arc_length_and_spacing(path in paths()) {
            let total = length(&path);
            let count = total.ceil() as usize + 1;
            let mut out = vec![];
            resample(&path, 0.0, total, count, &mut out);
            prop_assert_eq!(out.len(), count);
            prop_assert!(distance(out[0], path[0]) < 1e-9 && distance(out[count - 1], path[path.len() - 1]) < 1e-6);
            // Chords cut corners: with turns of 0.3 rad by at most 3 %.
            prop_assert!((length(&out) / total - 1.0).abs() < 0.03, "{} of {}", length(&out), total);
            let step = total / (count - 1) as f64;
            for pair in out.windows(2) {
                let apart = distance(pair[0], pair[1]);
                prop_assert!(apart <= step + 1e-9 && apart > 0.85 * step, "{apart} of {step}");
            }
        }

        #[test]
        fn points_at_an_arc_length_lie_that_far_along(path in paths(), fraction in 0.0f64..1.0) {
            let arc = fraction * length(&path);
            let (p, d) = at(&path, arc);
            let mut out = vec![];
            resample(&path, 0.0, arc, 400, &mut out);
            prop_assert!(distance(out[399], p) < 1e-9);
            prop_assert!((length(&out) - arc).abs() < 0.05 * arc + 1e-9);
            prop_assert!((d[0].hypot(d[1]) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn smoothing_keeps_straight_lines_and_ends_and_removes_steps() {
        let straight: Vec<[f64; 2]> = (0..30).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        let mut smoothed = straight.clone();
        smooth(&mut smoothed, 2.0, &mut vec![]);
        assert!(smoothed.iter().zip(&straight).all(|(&a, &b)| distance(a, b) < 1e-9));
        let mut stairs: Vec<[f64; 2]> = (0..30).map(|i| [f64::from(i), f64::from(i / 2) * 2.0]).collect();
        let ends = [stairs[0], stairs[29]];
        smooth(&mut stairs, 2.0, &mut vec![]);
        assert!(distance(stairs[0], ends[0]) < 1e-9 && distance(stairs[29], ends[1]) < 1e-9);
        assert!(stairs[6..24].iter().all(|p| (p[1] - p[0] + 0.5).abs() < 0.02), "{stairs:?}");
    }

    #[test]
    fn a_polyline_of_one_point_has_no_length_and_a_direction() {
        assert_eq!(at(&[[3.0, 4.0]], 1.0), ([3.0, 4.0], [1.0, 0.0]));
        let mut out = vec![];
        resample(&[[3.0, 4.0]], 0.0, 0.0, 3, &mut out);
        assert_eq!(out, [[3.0, 4.0]; 3]);
    }
}
