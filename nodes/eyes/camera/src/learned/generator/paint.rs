//! Drawing on a canvas with labels.

use super::colours::any_colour;
use super::curve::Strip;
use crate::learned::size::SIDE;
use catenary_core::image::label;
use rand::{Rng, RngExt};

/// Colours as reflected by the things, before light and camera, and labels.
pub(super) struct Canvas {
    pub(super) pixels: Vec<[f32; 3]>,
    pub(super) labels: Vec<u8>,
}

/// Look of a line's surface.
pub(super) struct Fill {
    colour: [f32; 3],
    /// Second colour, and the place across from which it covers the line; 1: nowhere.
    second: [f32; 3],
    second_from: f32,
    /// Share of the light at the edge, and direction of the light across.
    edge: f32,
    slant: f32,
    /// Strength of a bright line along, and its place across.
    gloss: f32,
    gloss_at: f32,
    /// Depth and number of stripes along.
    stripes: f32,
    count: f32,
}

impl Fill {
    pub(super) fn of_line(colour: [f32; 3], rng: &mut impl Rng) -> Self {
        Self {
            colour,
            second: any_colour(rng),
            second_from: if rng.random_bool(0.15) { rng.random_range(0.2..0.8) } else { 1.0 },
            edge: rng.random_range(0.3..1.0),
            slant: rng.random_range(-0.4..0.4),
            gloss: if rng.random_bool(0.3) { rng.random_range(0.1..0.8) } else { 0.0 },
            gloss_at: rng.random_range(-0.5..0.5),
            stripes: if rng.random_bool(0.2) { rng.random_range(0.05..0.35) } else { 0.0 },
            count: rng.random_range(10.0..60.0),
        }
    }

    fn at(&self, across: f32, along: f32) -> [f32; 3] {
        let round = self.edge + (1.0 - self.edge) * (1.0 - across * across).max(0.0).sqrt();
        let light = round
            * (1.0 + self.slant * across)
            * (1.0 - self.stripes * (0.5 + 0.5 * (self.count * std::f32::consts::TAU * along).sin()));
        let gloss = self.gloss * (-(across - self.gloss_at).powi(2) / 0.03).exp();
        let colour = if across > self.second_from { self.second } else { self.colour };
        colour.map(|c| (c * light * (1.0 - gloss) + gloss).min(1.2))
    }
}

impl Canvas {
    /// Background: a colour with a gradient, clouds and perhaps grain.
    pub(super) fn background(rng: &mut impl Rng) -> Self {
        // Tables, walls and paper are bright and grey more often than not.
        let base = if rng.random_bool(0.5) {
            let grey = rng.random_range(0.45_f32..1.0);
            [0, 1, 2].map(|_| grey * rng.random_range(0.85..1.0))
        } else {
            any_colour(rng)
        };
        let slope = [0, 1].map(|_| rng.random_range(-0.25_f32..0.25));
        let cells = rng.random_range(2..24_usize);
        let depth = rng.random_range(0.0_f32..1.0).powi(2) * 0.35;
        let grid: Vec<[f32; 3]> = (0..(cells + 1) * (cells + 1))
            .map(|_| {
                let grey = rng.random_range(-1.0..1.0_f32);
                [0, 1, 2].map(|_| grey + rng.random_range(-0.3..0.3_f32))
            })
            .collect();
        let grain = if rng.random_bool(0.3) { rng.random_range(0.02..0.15) } else { 0.0_f32 };
        let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
        let pitch = rng.random_range(0.05..0.8_f32);
        let pixels = (0..SIDE * SIDE).map(|i| {
            let (x, y) = ((i % SIDE) as f32 / SIDE as f32, (i / SIDE) as f32 / SIDE as f32);
            let (gx, gy) = (x * cells as f32, y * cells as f32);
            let (cx, cy) = (gx as usize, gy as usize);
            let (fx, fy) = (gx - cx as f32, gy - cy as f32);
            let corner = |dx: usize, dy: usize| grid[(cy + dy) * (cells + 1) + cx + dx];
            let light = 1.0 + slope[0] * (x - 0.5) + slope[1] * (y - 0.5);
            let across = (i % SIDE) as f32 * sin - (i / SIDE) as f32 * cos;
            let wave = grain * (pitch * across + 3.0 * corner(0, 0)[0]).sin();
            std::array::from_fn(|c| {
                let top = corner(0, 0)[c] * (1.0 - fx) + corner(1, 0)[c] * fx;
                let bottom = corner(0, 1)[c] * (1.0 - fx) + corner(1, 1)[c] * fx;
                (base[c] * light * (1.0 + wave) + depth * (top * (1.0 - fy) + bottom * fy)).clamp(0.0, 1.1)
            })
        });
        Self { pixels: pixels.collect(), labels: vec![label::BACKGROUND; SIDE * SIDE] }
    }

    /// Draws round holes in rows, as of a perforated board.
    pub(super) fn holes(&mut self, colour: [f32; 3], rng: &mut impl Rng) {
        let (pitch, share) = (rng.random_range(8.0..28.0_f32), rng.random_range(0.15..0.4_f32));
        let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
        for i in 0..SIDE * SIDE {
            let (x, y) = ((i % SIDE) as f32, (i / SIDE) as f32);
            let [a, b] = [x * cos - y * sin, x * sin + y * cos].map(|c| (c / pitch).rem_euclid(1.0) - 0.5);
            let inside = (pitch * (share - a.hypot(b)) + 0.5).clamp(0.0, 1.0);
            self.blend(i, colour, inside, None);
        }
    }

    fn blend(&mut self, i: usize, colour: [f32; 3], share: f32, label: Option<u8>) {
        for (to, from) in self.pixels[i].iter_mut().zip(colour) {
            *to += share * (from - *to);
        }
        if let Some(label) = label
            && share >= 0.5
        {
            self.labels[i] = label;
        }
    }

    /// Draws a line; `label` is written where it covers most of a pixel.
    pub(super) fn strip(&mut self, strip: &Strip, fill: &Fill, label: Option<u8>, rng: &mut impl Rng) {
        // Light that changes along the line, as from a lamp on one side.
        let (first, last) = (rng.random_range(0.6..1.1_f32), rng.random_range(0.6..1.1_f32));
        for &(i, share, across, along) in &strip.pixels {
            let light = first + (last - first) * along;
            self.blend(i, fill.at(across.clamp(-1.0, 1.0), along).map(|c| c * light), share, label);
        }
    }

    /// Darkens what lies below a line.
    pub(super) fn shadow(&mut self, strip: &Strip, left: f32) {
        for &(i, share, across, _) in &strip.pixels {
            let depth = share * (1.0 - left) * (1.0 - 0.6 * across.abs().min(1.0));
            self.pixels[i].iter_mut().for_each(|c| *c *= 1.0 - depth);
        }
    }

    /// Darkens everything on one side of a line across the picture: the shadow of a thing that is not seen. Labels stay.
    pub(super) fn shade(&mut self, through: [f32; 2], rng: &mut impl Rng) {
        let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
        // Light of the sky is bluer than that of the lamp that is hidden.
        let left = rng.random_range(0.2_f32..0.75);
        let left = [left, left, left * rng.random_range(1.0..1.15)];
        let soft = rng.random_range(0.3_f32..12.0);
        // A band is the shadow of a narrow thing.
        let width = if rng.random_bool(0.4) { rng.random_range(10.0..80.0) } else { f32::MAX };
        for (i, pixel) in self.pixels.iter_mut().enumerate() {
            let (x, y) = ((i % SIDE) as f32 - through[0], (i / SIDE) as f32 - through[1]);
            let inside = x * cos + y * sin;
            let depth = (0.5 + inside / soft).clamp(0.0, 1.0).min((0.5 + (width - inside) / soft).clamp(0.0, 1.0));
            (0..3).for_each(|c| pixel[c] *= 1.0 - depth * (1.0 - left[c]));
        }
    }

    /// Draws a ball lit from above.
    pub(super) fn ball(&mut self, centre: [f32; 2], radius: f32, colour: [f32; 3], label: Option<u8>) {
        self.disc(centre, radius, label, |x, y| {
            let light = 0.45 + 0.55 * (1.0 - x * x - y * y).max(0.0).sqrt() - 0.2 * y;
            colour.map(|c| c * light)
        });
    }

    /// Draws a reflection; labels stay.
    pub(super) fn glint(&mut self, centre: [f32; 2], radius: f32) {
        self.disc(centre, radius, None, |_, _| [1.1; 3]);
    }

    fn disc(&mut self, centre: [f32; 2], radius: f32, label: Option<u8>, colour: impl Fn(f32, f32) -> [f32; 3]) {
        let range = |c: f32| (c - radius - 1.0).max(0.0) as usize..(c + radius + 2.0).clamp(0.0, SIDE as f32) as usize;
        for y in range(centre[1]) {
            for x in range(centre[0]) {
                let r = [(x as f32 + 0.5 - centre[0]) / radius, (y as f32 + 0.5 - centre[1]) / radius];
                let share = (radius + 0.5 - radius * r[0].hypot(r[1])).clamp(0.0, 1.0);
                if share > 0.0 {
                    self.blend(y * SIDE + x, colour(r[0], r[1]), share, label);
                }
            }
        }
    }

    /// Draws a convex polygon of four corners.
    pub(super) fn polygon(&mut self, corners: &[[f32; 2]; 4], colour: [f32; 3], label: Option<u8>) {
        let range = |i: usize| {
            let low = corners.iter().map(|c| c[i]).fold(f32::MAX, f32::min).max(0.0) as usize;
            let high = corners.iter().map(|c| c[i]).fold(f32::MIN, f32::max).ceil().clamp(0.0, SIDE as f32) as usize;
            low..high
        };
        for y in range(1) {
            for x in range(0) {
                let p = [x as f32 + 0.5, y as f32 + 0.5];
                let side = |k: usize| {
                    let (a, b) = (corners[k], corners[(k + 1) % 4]);
                    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
                };
                let sides = [0, 1, 2, 3].map(side);
                if sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0) {
                    self.blend(y * SIDE + x, colour, 1.0, label);
                }
            }
        }
    }
}
