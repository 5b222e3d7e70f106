//! Views of simulated objects, from which masks are drawn for a training.

use super::grid::SIDE;
use super::square::Square;
use catenary_core::LabelMask;
use catenary_core::camera::MASK_SIZE_PX;
use catenary_core::image::label;
use rand::{Rng, RngExt};

/// Object as a camera sees it, in pixels of a mask.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectView {
    /// Points of the visible part of its centre line, from the fingers on, (u, v).
    pub line: Vec<[f64; 2]>,
    /// Half of its width.
    pub half_width: f64,
}

/// Views of one episode, in their order.
pub type Rollout = Vec<ObjectView>;

/// Something in front of the object: a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cover {
    middle: [f64; 2],
    /// Unit direction of its first side.
    along: [f64; 2],
    half: [f64; 2],
}

impl Cover {
    /// A strip across the line of a view: `share` of its length wide, with its middle at a fraction of the length.
    #[must_use]
    pub fn across(view: &ObjectView, at: f64, share: f64) -> Self {
        let (p, q) = (view.at(at - 0.01), view.at(at + 0.01));
        let d = [q[0] - p[0], q[1] - p[1]];
        let norm = d[0].hypot(d[1]).max(1e-9);
        let half = [0.5 * share * view.length(), 4.0 * view.half_width + 8.0];
        Self { middle: view.at(at), along: d.map(|c| c / norm), half }
    }

    fn hides(&self, p: [f64; 2]) -> bool {
        let r = [p[0] - self.middle[0], p[1] - self.middle[1]];
        let [x, y] = [r[0] * self.along[0] + r[1] * self.along[1], r[1] * self.along[0] - r[0] * self.along[1]];
        x.abs() < self.half[0] && y.abs() < self.half[1]
    }
}

impl ObjectView {
    /// Length of the line in pixels.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.line.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum()
    }

    /// Point at a fraction of the length.
    #[must_use]
    pub fn at(&self, fraction: f64) -> [f64; 2] {
        let mut left = fraction.clamp(0.0, 1.0) * self.length();
        for pair in self.line.windows(2) {
            let d = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            let step = d[0].hypot(d[1]);
            if left <= step {
                let t = if step > 0.0 { left / step } else { 0.0 };
                return [0, 1].map(|i| pair[0][i] + t * d[i]);
            }
            left -= step;
        }
        self.line.last().copied().unwrap_or_default()
    }

    /// Square around what is not hidden; none if everything is.
    pub(super) fn square(&self, covers: &[Cover]) -> Option<Square> {
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        let last = self.line.len() - 1;
        for (k, p) in self.line.iter().enumerate().filter(|(_, p)| !covers.iter().any(|c| c.hides(**p))) {
            let (a, b) = (self.line[k.saturating_sub(1)], self.line[(k + 1).min(last)]);
            let norm = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-9);
            // The borders beside the point.
            let reach = [(b[1] - a[1]).abs() / norm, (b[0] - a[0]).abs() / norm].map(|c| c * self.half_width);
            (0..2).for_each(|i| (low[i], high[i]) = (low[i].min(p[i] - reach[i]), high[i].max(p[i] + reach[i])));
        }
        (low[0] <= high[0]).then(|| Square::around(low, high))
    }

    /// Label mask of the object behind covers, as the camera node makes it.
    #[must_use]
    pub fn mask(&self, covers: &[Cover]) -> LabelMask {
        let mut mask = LabelMask::new(MASK_SIZE_PX, MASK_SIZE_PX);
        let square = Square::whole(&mask);
        let shares = self.coverage(&square, MASK_SIZE_PX as usize, covers);
        mask.data.iter_mut().zip(shares).filter(|(_, share)| *share >= 0.5).for_each(|(l, _)| *l = label::DLO);
        mask
    }

    /// Fraction of the length at which the line is nearest to a place, and the distance there in pixels.
    #[must_use]
    pub fn nearest(&self, place: [f64; 2]) -> (f64, f64) {
        let (mut best, mut arc) = ((0.0, f64::MAX), 0.0);
        for pair in self.line.windows(2) {
            let d = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            let r = [place[0] - pair[0][0], place[1] - pair[0][1]];
            let step = d[0].hypot(d[1]);
            let t = ((r[0] * d[0] + r[1] * d[1]) / (step * step).max(1e-12)).clamp(0.0, 1.0);
            let distance = (r[0] - t * d[0]).hypot(r[1] - t * d[1]);
            if distance < best.1 {
                best = (arc + t * step, distance);
            }
            arc += step;
        }
        (best.0 / arc.max(1e-12), best.1)
    }

    /// Share of each pixel of a square, with `side` pixels along it, that the object covers.
    pub(super) fn coverage(&self, square: &Square, side: usize, covers: &[Cover]) -> Vec<f32> {
        let scale = side as f64 / square.side;
        let half = self.half_width * scale;
        let line: Vec<[f64; 2]> = self.line.iter().map(|p| [0, 1].map(|i| (p[i] - square.corner[i]) * scale)).collect();
        let mut distance = vec![f64::MAX; side * side];
        let mut is_beyond = vec![false; side * side];
        for (k, pair) in line.windows(2).enumerate() {
            let d = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            let length = (d[0] * d[0] + d[1] * d[1]).max(1e-12);
            let reach = half + 1.0;
            let range = |i: usize| {
                let low = (pair[0][i].min(pair[1][i]) - reach).clamp(0.0, side as f64) as usize;
                low..(pair[0][i].max(pair[1][i]) + reach).clamp(0.0, side as f64) as usize
            };
            for (v, u) in range(1).flat_map(|v| range(0).map(move |u| (v, u))) {
                let r = [u as f64 + 0.5 - pair[0][0], v as f64 + 0.5 - pair[0][1]];
                let t = (r[0] * d[0] + r[1] * d[1]) / length;
                let near = [r[0] - t.clamp(0.0, 1.0) * d[0], r[1] - t.clamp(0.0, 1.0) * d[1]];
                let away = near[0].hypot(near[1]);
                if away < distance[v * side + u] {
                    distance[v * side + u] = away;
                    // The object ends straight: a pixel whose nearest point is an end of the line lies beyond it.
                    is_beyond[v * side + u] = (k == 0 && t < 0.0) || (k + 2 == line.len() && t > 1.0);
                }
            }
        }
        let share = |(i, d): (usize, &f64)| {
            let p = [(i % side) as f64 + 0.5, (i / side) as f64 + 0.5];
            let in_mask = [0, 1].map(|k| square.corner[k] + p[k] / scale);
            if is_beyond[i] || covers.iter().any(|c| c.hides(in_mask)) {
                return 0.0;
            }
            // Width of the strip's part in a pixel at this distance.
            ((half + 0.5 - d).clamp(0.0, 1.0) - (0.5 - half - d).clamp(0.0, 1.0)) as f32
        };
        distance.iter().enumerate().map(share).collect()
    }

    /// The view of an object that is larger by `px` at both ends, and by half of that on each side.
    pub(super) fn grown(&self, px: f64) -> Self {
        let mut line = self.line.clone();
        let last = line.len() - 1;
        for (end, next) in [(0, 1), (last, last - 1)] {
            let (p, q) = (self.line[end], self.line[next]);
            let norm = (p[0] - q[0]).hypot(p[1] - q[1]).max(1e-9);
            line[end] = [0, 1].map(|i| p[i] + px * (p[i] - q[i]) / norm);
        }
        Self { line, half_width: self.half_width + 0.5 * px }
    }

    /// The view turned, mirrored, moved and scaled by a random change.
    pub(super) fn changed(&self, change: &Change) -> Self {
        let line = self.line.iter().map(|p| change.of(*p)).collect();
        Self { line, half_width: self.half_width * change.scale }
    }
}

/// Change of the place and the size of a view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    about: [f64; 2],
    scale: f64,
    angle: f64,
    shift: [f64; 2],
    mirrored: bool,
}

impl Change {
    /// Draws a change about the middle of a view: up to `shift` pixels, `angle` rad, and a tenth of the size.
    pub(super) fn draw(view: &ObjectView, shift: f64, angle: f64, rng: &mut impl Rng) -> Self {
        Self {
            about: view.at(0.5),
            scale: rng.random_range(0.9..1.1),
            angle: rng.random_range(-angle..angle),
            shift: [0, 1].map(|_| rng.random_range(-shift..shift)),
            mirrored: rng.random_bool(0.5),
        }
    }

    fn of(&self, p: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.angle.sin_cos();
        let x = (p[0] - self.about[0]) * if self.mirrored { -1.0 } else { 1.0 };
        let y = p[1] - self.about[1];
        [
            self.about[0] + self.shift[0] + self.scale * (cos * x - sin * y),
            self.about[1] + self.shift[1] + self.scale * (sin * x + cos * y),
        ]
    }
}

/// Writes a coverage to the input of a network.
pub(super) fn fill(shape: convnet::Shape, input: &mut [f32], coverage: &[f32]) {
    for (v, row) in coverage.chunks_exact(SIDE).enumerate() {
        input[shape.row(0, v)].copy_from_slice(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bar() -> ObjectView {
        ObjectView { line: (0..=40).map(|k| [128.0, 60.0 + 2.0 * f64::from(k)]).collect(), half_width: 3.0 }
    }

    #[test]
    fn a_bar_covers_its_area_and_a_cover_hides_a_part() {
        let view = bar();
        let square = Square { corner: [0.0, 0.0], side: 256.0 };
        let area = |side: usize, covers: &[Cover]| -> f32 {
            let pixel = (256.0 / side as f64).powi(2) as f32;
            view.coverage(&square, side, covers).iter().sum::<f32>() * pixel
        };
        assert!((area(256, &[]) - 480.0).abs() < 30.0 && (area(64, &[]) - 480.0).abs() < 40.0);
        let cover = Cover::across(&view, 0.5, 0.25);
        assert!((area(256, &[cover]) - 0.75 * 480.0).abs() < 30.0);
        assert_eq!(view.at(0.25), [128.0, 80.0]);
        assert_eq!(view.nearest([131.0, 100.0]), (0.5, 3.0));
        // The square around the view is that around its mask.
        let (of_view, of_mask) = (view.square(&[]).unwrap(), Square::around_object(&view.mask(&[])).unwrap());
        assert!((of_view.side - of_mask.side).abs() <= 1.5 && (of_view.corner[1] - of_mask.corner[1]).abs() <= 1.0);
        let labelled = view.mask(&[]).data.iter().filter(|l| **l == label::DLO).count();
        assert!((460..520).contains(&labelled), "{labelled}");
        // A larger mask of the same object: one pixel more at both ends, and half a pixel on each side.
        let grown = view.grown(1.0);
        assert_eq!((grown.length(), grown.half_width), (view.length() + 2.0, view.half_width + 0.5));
        assert_eq!((grown.line[0], grown.line[40], grown.line[20]), ([128.0, 59.0], [128.0, 141.0], view.line[20]));
    }
}
