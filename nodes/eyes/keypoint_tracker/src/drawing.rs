//! Masks drawn from analytic curves, for tests and benches.
#![allow(dead_code, reason = "each bench and each integration test uses only some of these functions")]

use catenary_core::LabelMask;
use catenary_core::image::label;

/// Side of the masks in pixels.
pub const SIZE: u32 = 256;

/// Polyline of 400 segments along `curve` from 0 to 1.
pub fn polyline(curve: impl Fn(f64) -> [f64; 2]) -> Vec<[f64; 2]> {
    (0..=400).map(|i| curve(f64::from(i) / 400.0)).collect()
}

/// Straight line of `length` with its middle at `middle`.
pub fn straight(middle: [f64; 2], angle: f64, length: f64) -> Vec<[f64; 2]> {
    polyline(|t| [middle[0] + (t - 0.5) * length * angle.cos(), middle[1] + (t - 0.5) * length * angle.sin()])
}

/// Line from `start` in the direction `heading` with the curvature `curvature(s)` in 1/px at arc length s.
pub fn curved(start: [f64; 2], heading: f64, length: f64, curvature: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
    let (mut p, mut heading) = (start, heading);
    let step = length / 400.0;
    let mut points = vec![p];
    for i in 0..400 {
        let bend = curvature((f64::from(i) + 0.5) * step) * step;
        // Half of the bend before and half after the step: the midpoint rule.
        heading += 0.5 * bend;
        p = [p[0] + step * heading.cos(), p[1] + step * heading.sin()];
        heading += 0.5 * bend;
        points.push(p);
    }
    points
}

/// Catenary of parameter `a` (px): v = lowest − a (cosh((u − u0)/a) − 1) for u from `u[0]` to `u[1]`.
pub fn hanging(u: [f64; 2], u0: f64, lowest: f64, a: f64) -> Vec<[f64; 2]> {
    polyline(|t| {
        let u = u[0] + t * (u[1] - u[0]);
        [u, lowest - a * (((u - u0) / a).cosh() - 1.0)]
    })
}

/// Point at `fraction` of the arc length of `points`.
pub fn at_fraction(points: &[[f64; 2]], fraction: f64) -> [f64; 2] {
    let step = |pair: &[[f64; 2]]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
    let mut left = fraction * points.windows(2).map(step).sum::<f64>();
    for pair in points.windows(2) {
        if left <= step(pair) {
            let t = left / step(pair);
            return [0, 1].map(|i| pair[0][i] + t * (pair[1][i] - pair[0][i]));
        }
        left -= step(pair);
    }
    points[points.len() - 1]
}

/// Labels the pixels whose centres lie within `half_width` of `line`. The ends are cut straight.
pub fn draw(mask: &mut LabelMask, line: &[[f64; 2]], half_width: f64) {
    let (width, height) = (mask.width as usize, mask.height as usize);
    for (i, pair) in line.windows(2).enumerate() {
        let range = |k: usize, size: usize| {
            let low = (pair[0][k].min(pair[1][k]) - half_width - 1.0).max(0.0) as usize;
            let high = (pair[0][k].max(pair[1][k]) + half_width + 1.0).max(0.0) as usize;
            low..high.min(size)
        };
        for v in range(1, height) {
            for u in range(0, width) {
                let p = [u as f64 + 0.5, v as f64 + 0.5];
                if nearest(pair, p).1 < half_width && !is_beyond_an_end(line, i, p, half_width) {
                    mask.data[v * width + u] = label::DLO;
                }
            }
        }
    }
}

/// Place along the segment (0 to 1) nearest to `p`, and its distance from `p`.
fn nearest(pair: &[[f64; 2]], p: [f64; 2]) -> (f64, f64) {
    let d = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
    let r = [p[0] - pair[0][0], p[1] - pair[0][1]];
    let t = ((r[0] * d[0] + r[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
    (t, (r[0] - t * d[0]).hypot(r[1] - t * d[1]))
}

/// Returns true if segment `i` lies near an end of `line` and `p` beyond that end.
fn is_beyond_an_end(line: &[[f64; 2]], i: usize, p: [f64; 2], half_width: f64) -> bool {
    let last = line.len() - 1;
    [[0, 1], [last, last - 1]].into_iter().any(|[end, inner]| {
        let (end, inner) = (line[end], line[inner]);
        let is_near = (line[i][0] - end[0]).hypot(line[i][1] - end[1]) < 1.5 * half_width;
        let out = [end[0] - inner[0], end[1] - inner[1]];
        is_near && (p[0] - end[0]) * out[0] + (p[1] - end[1]) * out[1] > 0.0
    })
}

/// Mask of one line.
pub fn mask_of(line: &[[f64; 2]], half_width: f64) -> LabelMask {
    let mut mask = LabelMask::new(SIZE, SIZE);
    draw(&mut mask, line, half_width);
    mask
}

/// Labels the pixels of a disc.
pub fn draw_disc(mask: &mut LabelMask, centre: [f64; 2], radius: f64, label: u8) {
    let width = mask.width as usize;
    for (i, cell) in mask.data.iter_mut().enumerate() {
        let d = [(i % width) as f64 + 0.5 - centre[0], (i / width) as f64 + 0.5 - centre[1]];
        if d[0].hypot(d[1]) < radius {
            *cell = label;
        }
    }
}
