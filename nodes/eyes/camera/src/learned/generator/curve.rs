//! Curves in the picture.

use crate::learned::size::SIDE;
use rand::{Rng, RngExt};

/// Number of points of a curve.
const POINTS: usize = 80;

/// Smooth curve as points at equal distances.
#[derive(Debug, Clone)]
pub(super) struct Curve(Vec<[f32; 2]>);

impl Curve {
    /// Curve whose curvature wanders, most of it in the picture.
    pub(super) fn draw(rng: &mut impl Rng) -> Self {
        loop {
            let start = [0, 1].map(|_| rng.random_range(10.0..SIDE as f32 - 10.0));
            let curve = Self::from(start, rng.random_range(70.0..440.0), rng);
            let inside = |p: &&[f32; 2]| p.iter().all(|&c| (2.0..SIDE as f32 - 2.0).contains(&c));
            if curve.0.iter().filter(inside).count() as f32 > 0.8 * POINTS as f32 {
                return curve;
            }
        }
    }

    /// Long curve through a point, from edge to edge.
    pub(super) fn through(point: [f32; 2], rng: &mut impl Rng) -> Self {
        let angle = rng.random_range(0.0..std::f32::consts::TAU);
        let far = 220.0;
        let bend = rng.random_range(-40.0_f32..40.0);
        let (sin, cos) = angle.sin_cos();
        // One end lies at the point half of the time: an arm that ends in a hand.
        let first = if rng.random_bool(0.5) { 0.0 } else { -1.0 };
        let at = |k: usize| {
            let t = first + (1.0 - first) * k as f32 / (POINTS - 1) as f32;
            let (along, across) = (far * t, bend * t * t);
            [point[0] + along * cos - across * sin, point[1] + along * sin + across * cos]
        };
        Self((0..POINTS).map(at).collect())
    }

    fn from(start: [f32; 2], length: f32, rng: &mut impl Rng) -> Self {
        let step = length / (POINTS - 1) as f32;
        let mut heading = rng.random_range(0.0..std::f32::consts::TAU);
        // Total turn of a smooth part: from straight to more than a loop.
        let turn = rng.random_range(0.0_f32..1.0).powi(2) * 7.0 / POINTS as f32;
        let (mut curvature, mut p, mut points) = (rng.random_range(-turn..=turn), start, vec![start]);
        for _ in 1..POINTS {
            curvature = 0.97 * curvature + 0.25 * rng.random_range(-turn..=turn);
            heading += curvature;
            p = [p[0] + step * heading.cos(), p[1] + step * heading.sin()];
            points.push(p);
        }
        Self(points)
    }

    pub(super) fn moved(&self, offset: [f32; 2]) -> Self {
        Self(self.0.iter().map(|p| [p[0] + offset[0], p[1] + offset[1]]).collect())
    }

    /// Straight continuation of this length beyond the last point, or before the first one.
    pub(super) fn beyond(&self, is_last: bool, length: f32) -> Self {
        let (end, before) = if is_last { (POINTS - 1, POINTS - 3) } else { (0, 2) };
        let (p, q) = (self.0[end], self.0[before]);
        let d = [p[0] - q[0], p[1] - q[1]];
        let step = length / (d[0].hypot(d[1]).max(1e-3) * (POINTS - 1) as f32);
        Self((0..POINTS).map(|k| [0, 1].map(|i| p[i] + k as f32 * step * d[i])).collect())
    }

    /// Point at a fraction of the length.
    pub(super) fn at(&self, fraction: f32) -> [f32; 2] {
        self.0[(fraction.clamp(0.0, 1.0) * (POINTS - 1) as f32).round() as usize]
    }
}

/// Pixels of a curve with a width.
pub(super) struct Strip {
    /// For each pixel of it: place, share of the pixel, distance from the centre line in half widths with its sign, and fraction of the
    /// length.
    pub(super) pixels: Vec<(usize, f32, f32, f32)>,
}

impl Strip {
    pub(super) fn of(curve: &Curve, half_width: f32) -> Self {
        // Nearest segment of each pixel within reach.
        let mut near: Vec<(f32, f32, f32)> = vec![(f32::MAX, 0.0, 0.0); SIDE * SIDE];
        let reach = half_width + 1.0;
        for (k, pair) in curve.0.windows(2).enumerate() {
            let [a, b] = [pair[0], pair[1]];
            let d = [b[0] - a[0], b[1] - a[1]];
            let square = d[0] * d[0] + d[1] * d[1];
            let range = |i: usize| {
                let low = (a[i].min(b[i]) - reach).floor().max(0.0) as usize;
                let high = (a[i].max(b[i]) + reach).ceil().clamp(0.0, SIDE as f32) as usize;
                low..high
            };
            for y in range(1) {
                for x in range(0) {
                    let r = [x as f32 + 0.5 - a[0], y as f32 + 0.5 - a[1]];
                    let t = ((r[0] * d[0] + r[1] * d[1]) / square).clamp(0.0, 1.0);
                    let e = [r[0] - t * d[0], r[1] - t * d[1]];
                    let distance = (e[0] * e[0] + e[1] * e[1]).sqrt();
                    if distance < near[y * SIDE + x].0 {
                        let side = (d[0] * r[1] - d[1] * r[0]).signum();
                        near[y * SIDE + x] = (distance, side, (k as f32 + t) / (POINTS - 1) as f32);
                    }
                }
            }
        }
        let seen = near.into_iter().enumerate().filter(|(_, (distance, ..))| *distance < half_width + 0.5);
        let pixel = |(i, (distance, side, along)): (usize, (f32, f32, f32))| {
            (i, (half_width + 0.5 - distance).min(1.0), side * distance / half_width, along)
        };
        Self { pixels: seen.map(pixel).collect() }
    }
}
