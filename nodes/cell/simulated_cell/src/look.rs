//! Look of the cell: light, colours, textures and clutter.

use crate::scene::Solid;
use catenary_core::seed;
use nalgebra::Vector3;
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

/// Random streams of a look.
const DRAWS: u64 = 0;
const TEXTURE: u64 = 1;
/// Least difference of a colour of the clutter from those of object and target, in levels.
const LEAST_DIFFERENCE: f64 = 70.0;

/// Light, colours, textures and clutter of the cell, and the camera's exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Unit direction to the lamp.
    pub(crate) lamp: [f64; 3],
    /// Share of light on surfaces turned away from the lamp.
    pub(crate) ambient: f64,
    /// Share of light in the shadow.
    pub(crate) shadow: f64,
    /// Way of a shadow along x and y for each metre of height.
    pub(crate) slant: [f64; 2],
    /// Largest share of reflected lamp light on object and target.
    pub(crate) gloss: f64,
    /// Colours of wall and table, in levels.
    pub(crate) wall: [f64; 3],
    pub(crate) table: [f64; 3],
    /// Largest relative change of wall, table and clutter by texture.
    texture: f64,
    /// Size of the texture's largest spots in pixels.
    grain_px: f64,
    /// Gains of red, green and blue.
    gains: [f64; 3],
    /// Loss of light in the corners of the picture.
    vignette: f64,
    /// Boxes behind the object, with their colours in levels, above a table at height 0.
    pub(crate) clutter: Vec<(Solid, [f64; 3])>,
    seed: u64,
}

impl Default for Look {
    fn default() -> Self {
        Self::plain()
    }
}

impl Look {
    /// One lamp, and surfaces of one colour.
    #[must_use]
    pub fn plain() -> Self {
        Self {
            lamp: Vector3::new(0.3, -0.5, 0.81).normalize().into(),
            ambient: 0.55,
            shadow: 0.7,
            slant: [0.0; 2],
            gloss: 0.0,
            wall: [176.0, 182.0, 186.0],
            table: [120.0, 118.0, 115.0],
            texture: 0.0,
            grain_px: 1.0,
            gains: [1.0; 3],
            vignette: 0.0,
            clutter: Vec::new(),
            seed: 0,
        }
    }

    /// A laboratory, drawn by a seed. Object, target and gripper keep their colours, seen in its light; the clutter has others.
    #[must_use]
    pub fn of_laboratory(seed: u64, kept_colours: &[[f64; 3]]) -> Self {
        let mut rng = seed::rng(seed, DRAWS);
        let lamp = Vector3::new(rng.random_range(-0.7..0.7), rng.random_range(-0.8..-0.1), rng.random_range(0.5..1.0));
        let lamp = lamp.normalize();
        let exposure = rng.random_range(0.75..1.25);
        let dull = |rng: &mut ChaCha8Rng, least: f64, most: f64| {
            let grey = rng.random_range(least..most);
            [0, 1, 2].map(|_| grey * rng.random_range(0.88..1.12))
        };
        let mut look = Self {
            lamp: lamp.into(),
            ambient: rng.random_range(0.4..0.75),
            shadow: rng.random_range(0.5..0.85),
            slant: [-lamp.x / lamp.z, -lamp.y / lamp.z],
            gloss: rng.random_range(0.0..0.35),
            wall: dull(&mut rng, 90.0, 230.0),
            table: dull(&mut rng, 60.0, 200.0),
            texture: rng.random_range(0.03..0.25),
            grain_px: rng.random_range(6.0..60.0),
            gains: [0, 1, 2].map(|_| exposure * rng.random_range(0.88..1.12)),
            vignette: rng.random_range(0.0..0.3),
            clutter: Vec::new(),
            seed,
        };
        for _ in 0..rng.random_range(0..5) {
            look.clutter.push((standing_box(&mut rng), other_colour(kept_colours, &mut rng)));
        }
        for _ in 0..rng.random_range(0..3) {
            let colour = other_colour(kept_colours, &mut rng);
            look.clutter.extend(cable(&mut rng).into_iter().map(|piece| (piece, colour)));
        }
        look
    }

    /// Brightness of wall, table and clutter by pixel, from their texture.
    pub(crate) fn texture(&self, width: u32, height: u32) -> Vec<f32> {
        if self.texture == 0.0 {
            return Vec::new();
        }
        let at =
            |i: u32| 1.0 + self.texture * spots(self.seed, [f64::from(i % width), f64::from(i / width)], self.grain_px);
        (0..width * height).map(|i| at(i) as f32).collect()
    }

    /// Gains of red, green and blue by pixel, from exposure, white balance and lens; none for gains of one.
    pub(crate) fn gains(&self, width: u32, height: u32) -> Vec<[f32; 3]> {
        if self.gains == [1.0; 3] && self.vignette == 0.0 {
            return Vec::new();
        }
        let gain = |i: u32| {
            let [x, y] =
                [[i % width, width], [i / width, height]].map(|[k, n]| 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0);
            let lens = 1.0 - self.vignette * 0.5 * (x * x + y * y);
            self.gains.map(|g| (g * lens) as f32)
        };
        (0..width * height).map(gain).collect()
    }
}

/// Colour that differs from the kept ones.
fn other_colour(kept: &[[f64; 3]], rng: &mut impl Rng) -> [f64; 3] {
    loop {
        let colour = [0, 1, 2].map(|_| rng.random_range(25.0..235.0));
        let far = |k: &[f64; 3]| (0..3).map(|c| (k[c] - colour[c]).powi(2)).sum::<f64>().sqrt() > LEAST_DIFFERENCE;
        if kept.iter().all(far) {
            return colour;
        }
    }
}

/// Box that stands on a table at height 0, behind hand, object and target as a camera on the side of -y sees them.
fn standing_box(rng: &mut impl Rng) -> Solid {
    let half = [rng.random_range(0.01..0.08), rng.random_range(0.01..0.05), rng.random_range(0.01..0.16)];
    let middle = [rng.random_range(0.1..0.8), rng.random_range(0.2..0.3), half[2]];
    turned_box(middle, half, rng.random_range(-0.6..0.6))
}

/// Cable behind the object, as a chain of boxes.
fn cable(rng: &mut impl Rng) -> Vec<Solid> {
    let half_m = rng.random_range(0.002..0.008);
    let (mut x, mut z) = (rng.random_range(0.1..0.8), rng.random_range(0.03..0.5));
    let y = rng.random_range(0.12..0.3);
    let (mut heading, turn) = (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(-0.12..0.12));
    (0..24)
        .map(|_| {
            heading += turn;
            (x, z) = (x + 0.015 * f64::cos(heading), f64::max(half_m, z + 0.015 * f64::sin(heading)));
            let (sin, cos) = heading.sin_cos();
            // The corners of a box that is turned in the plane of x and z.
            let corner = |bits: usize| {
                let sign = |axis: usize| if bits >> axis & 1 == 1 { 1.0 } else { -1.0 };
                let (a, b, c) = (0.009 * sign(0), half_m * sign(1), half_m * sign(2));
                [x + a * cos - c * sin, y + b, z + a * sin + c * cos]
            };
            Solid::Cuboid(std::array::from_fn(corner))
        })
        .collect()
}

/// Box that is turned about the vertical.
fn turned_box(middle: [f64; 3], half: [f64; 3], angle: f64) -> Solid {
    let (sin, cos) = angle.sin_cos();
    let corner = |bits: usize| {
        let sign = |axis: usize| if bits >> axis & 1 == 1 { 1.0 } else { -1.0 };
        let (a, b) = (half[0] * sign(0), half[1] * sign(1));
        [middle[0] + a * cos - b * sin, middle[1] + a * sin + b * cos, middle[2] + half[2] * sign(2)]
    };
    Solid::Cuboid(std::array::from_fn(corner))
}

/// Spots of random brightness from -1 to 1: values on lattices of halving size, interpolated (value noise in three octaves).
fn spots(seed: u64, p: [f64; 2], size_px: f64) -> f64 {
    let (mut sum, mut weight, mut size) = (0.0, 0.5, size_px);
    for octave in 0..3_u64 {
        let q = p.map(|v| v / size);
        let cell = q.map(f64::floor);
        let t = [0, 1].map(|i| {
            let f = q[i] - cell[i];
            f * f * (3.0 - 2.0 * f)
        });
        let value = |du: i64, dv: i64| {
            let index = ((cell[0] as i64 + du) as u64).wrapping_mul(0x1_0001) ^ ((cell[1] as i64 + dv) as u64) << 32;
            seed::derive(seed::derive(seed, TEXTURE + octave), index) as f64 / u64::MAX as f64
        };
        let row = |dv: i64| value(0, dv) + t[0] * (value(1, dv) - value(0, dv));
        sum += weight * (2.0 * (row(0) + t[1] * (row(1) - row(0))) - 1.0);
        (weight, size) = (0.5 * weight, (0.5 * size).max(1.0));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_look_is_that_of_its_seed_and_its_clutter_has_other_colours() {
        let kept = [[40.0, 90.0, 200.0], [50.0, 160.0, 70.0]];
        let look = Look::of_laboratory(3, &kept);
        assert_eq!(look, Look::of_laboratory(3, &kept));
        assert_ne!(look, Look::of_laboratory(4, &kept));
        for (_, colour) in (0..40).flat_map(|seed| Look::of_laboratory(seed, &kept).clutter) {
            let distance = |k: &[f64; 3]| (0..3).map(|c| (k[c] - colour[c]).powi(2)).sum::<f64>().sqrt();
            assert!(kept.iter().all(|k| distance(k) > LEAST_DIFFERENCE), "{colour:?}");
        }
        let texture = look.texture(64, 48);
        let [least, most] = [f32::min, f32::max].map(|f| texture.iter().copied().reduce(f).unwrap());
        assert!(least > 0.7 && least < 1.0 && most > 1.0 && most < 1.3, "{least} {most}");
        assert!(Look::plain().texture(64, 48).is_empty() && Look::plain().gains(64, 48).is_empty());
    }
}
