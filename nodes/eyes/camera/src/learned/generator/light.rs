//! Light and camera: from reflected colours to the picture's levels.

use crate::learned::size::SIDE;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

/// Light and camera of one picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light {
    /// Gain of each channel: exposure times white balance.
    gains: [f32; 3],
    gamma: f32,
    /// Standard deviation of the noise of a pixel, 0 to 1.
    noise: f32,
    /// Standard deviation of a blur in pixels, and steps of a motion in pixels along x and y.
    blur: f32,
    motion: [f32; 2],
    /// Side of the blocks whose colour detail is lost, as in strong compression; 1: none.
    block: usize,
}

impl Light {
    pub(super) fn draw(rng: &mut impl Rng) -> Self {
        // Two fifths of the pictures are what a camera that is set up well sees.
        if rng.random_bool(0.4) {
            let noise = rng.random_range(0.0..0.03);
            return Self { noise, blur: rng.random_range(0.3..0.9), ..Self::draw_mild(rng) };
        }
        let exposure = rng.random_range(-1.2_f32..1.2).exp();
        let balance = if rng.random_bool(0.5) { 0.4_f32 } else { 0.08 };
        let gains = [0, 1, 2].map(|_| exposure * rng.random_range(-balance..balance).exp());
        let angle = rng.random_range(0.0..std::f32::consts::TAU);
        let length = if rng.random_bool(0.35) { rng.random_range(1.0..14.0) } else { 0.0_f32 };
        Self {
            gains,
            gamma: rng.random_range(0.75..1.35),
            noise: rng.random_range(0.0_f32..1.0).powi(2) * 0.1,
            blur: if rng.random_bool(0.5) { rng.random_range(0.3..2.4) } else { 0.0 },
            motion: [length * angle.cos(), length * angle.sin()],
            block: if rng.random_bool(0.35) { [2, 4, 8][rng.random_range(0..3)] } else { 1 },
        }
    }

    /// This light with a small error of exposure and white balance.
    pub(super) fn nearly(&self, rng: &mut impl Rng) -> Self {
        let exposure = rng.random_range(-0.12_f32..0.12).exp();
        let gains = self.gains.map(|g| g * exposure * rng.random_range(-0.06_f32..0.06).exp());
        Self { gains, noise: 0.01, ..*self }
    }

    /// Light of the moment of a click.
    pub(super) fn draw_mild(rng: &mut impl Rng) -> Self {
        let exposure = rng.random_range(-0.3_f32..0.3).exp();
        let gains = [0, 1, 2].map(|_| exposure * rng.random_range(-0.1_f32..0.1).exp());
        Self { gains, gamma: rng.random_range(0.9..1.1), noise: 0.01, blur: 0.0, motion: [0.0; 2], block: 1 }
    }

    /// Level of a colour.
    fn level(&self, colour: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| (self.gains[c] * colour[c]).clamp(0.0, 1.0).powf(self.gamma))
    }

    /// Colour as a click on it gives it.
    pub(super) fn of_colour(&self, colour: [f32; 3], rng: &mut impl Rng) -> [f32; 3] {
        let shade = rng.random_range(0.7..1.0_f32);
        self.level(colour.map(|c| shade * c)).map(|v| (v + self.noise * normal(rng)).clamp(0.0, 1.0))
    }

    /// Picture of the reflected colours.
    pub(super) fn seen(&self, colours: &[[f32; 3]], rng: &mut impl Rng) -> Vec<[f32; 3]> {
        let mut pixels = colours.to_vec();
        if self.motion != [0.0; 2] {
            pixels = self.moved(&pixels);
        }
        if self.blur > 0.0 {
            pixels = blurred(&blurred(&pixels, self.blur, 1), self.blur, SIDE);
        }
        for pixel in &mut pixels {
            let level = self.level(*pixel);
            *pixel = level.map(|v| (v + self.noise * normal(rng)).clamp(0.0, 1.0));
        }
        if self.block > 1 {
            lose_colour_detail(&mut pixels, self.block);
        }
        // Levels of eight bits.
        pixels.iter_mut().flatten().for_each(|v| *v = (255.0 * *v).round() / 255.0);
        pixels
    }

    fn moved(&self, pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let steps = 1 + self.motion[0].hypot(self.motion[1]).ceil() as usize;
        let last = SIDE as i64 - 1;
        let mut out = vec![[0.0; 3]; pixels.len()];
        for k in 0..steps {
            let t = k as f32 / (steps - 1).max(1) as f32 - 0.5;
            let [du, dv] = self.motion.map(|m| (t * m).round() as i64);
            for (i, out) in out.iter_mut().enumerate() {
                let u = ((i % SIDE) as i64 + du).clamp(0, last) as usize;
                let v = ((i / SIDE) as i64 + dv).clamp(0, last) as usize;
                (0..3).for_each(|c| out[c] += pixels[v * SIDE + u][c] / steps as f32);
            }
        }
        out
    }
}

fn normal(rng: &mut impl Rng) -> f32 {
    StandardNormal.sample(rng)
}

/// Half of the number of pixels of a blur's kernel.
const REACH: usize = 5;

/// Gaussian blur along rows (`step` 1) or columns (`step` SIDE).
fn blurred(pixels: &[[f32; 3]], deviation: f32, step: usize) -> Vec<[f32; 3]> {
    let kernel: [f32; 2 * REACH + 1] =
        std::array::from_fn(|k| (-0.5 * ((k as f32 - REACH as f32) / deviation).powi(2)).exp());
    let sum: f32 = kernel.iter().sum();
    let at = |i: usize, k: usize| {
        let along = (if step == 1 { i % SIDE } else { i / SIDE }) as i64;
        let shift = (along + k as i64 - REACH as i64).clamp(0, SIDE as i64 - 1) - along;
        (i as i64 + shift * step as i64) as usize
    };
    let mean =
        |i: usize| std::array::from_fn(|c| (0..=2 * REACH).map(|k| kernel[k] * pixels[at(i, k)][c]).sum::<f32>() / sum);
    (0..pixels.len()).map(mean).collect()
}

/// Replaces the colour of each block by its mean, and keeps the brightness of pixels in coarse steps.
fn lose_colour_detail(pixels: &mut [[f32; 3]], side: usize) {
    let grey = |p: [f32; 3]| 0.3 * p[0] + 0.59 * p[1] + 0.11 * p[2];
    let coarse = 0.01 * side as f32;
    for v in (0..SIDE).step_by(side) {
        for u in (0..SIDE).step_by(side) {
            let places: Vec<usize> = (0..side * side).map(|k| (v + k / side) * SIDE + u + k % side).collect();
            let mean: [f32; 3] =
                std::array::from_fn(|c| places.iter().map(|&i| pixels[i][c]).sum::<f32>() / places.len() as f32);
            for i in places {
                let step = ((grey(pixels[i]) - grey(mean)) / coarse).round() * coarse;
                pixels[i] = mean.map(|c| (c + step).clamp(0.0, 1.0));
            }
        }
    }
}
