//! Synthetic scene with known labels, drawn in image pixels, for tests and benches.
#![allow(dead_code, reason = "each bench and each integration test uses only some of these functions")]

use catenary_core::image::label;
use catenary_core::{LabelMask, RgbImage, seed};
use rand_distr::{Distribution, Normal};

/// Width and height of the image in pixels.
pub const IMAGE_PX: [u32; 2] = [640, 480];
const MASK_PX: u32 = 256;

/// Objects and light in front of the camera. Lengths in image pixels.
#[derive(Clone)]
pub struct Scene {
    /// Centre line of the bar.
    pub bar: Vec<[f64; 2]>,
    pub bar_half_width: f64,
    /// Centre and radius of the target.
    pub target: Option<([f64; 2], f64)>,
    /// Left, top, right and bottom of the gripper, which hides everything behind it.
    pub gripper: Option<[f64; 4]>,
    /// Centre and radius of a soft shadow, and the share of the light that is left in its middle.
    pub shadow: ([f64; 2], f64, f64),
    pub gain: f64,
    /// Angle by which all colours are rotated about the grey axis.
    pub hue_shift_deg: f64,
    pub noise: f64,
}

impl Scene {
    /// Bar that hangs from a gripper over a table, beside a target.
    pub fn hanging() -> Self {
        let bar = (0..=40).map(|i| f64::from(i) / 40.0).map(|t| [270.0 + 130.0 * t, 190.0 + 120.0 * t * t]).collect();
        Self {
            bar,
            bar_half_width: 4.0,
            target: Some(([430.0, 280.0], 14.0)),
            gripper: Some([283.0, 100.0, 305.0, 203.0]),
            shadow: ([360.0, 250.0], 90.0, 0.45),
            gain: 1.0,
            hue_shift_deg: 0.0,
            noise: 4.0,
        }
    }

    /// Image with noise drawn from `seed`.
    pub fn image(&self, seed: u64) -> RgbImage {
        let mut image = RgbImage::new(IMAGE_PX[0], IMAGE_PX[1]);
        let mut rng = seed::rng(seed, 0);
        let noise = Normal::new(0.0, self.noise).expect("the noise of a scene is finite");
        let painter = Painter::new(self);
        for (i, pixel) in image.data.chunks_exact_mut(3).enumerate() {
            let (u, v) = (i as u32 % IMAGE_PX[0], i as u32 / IMAGE_PX[0]);
            let mut sum = [0.0; 3];
            // Four samples a pixel: pixels on an edge get a mixed colour, as behind a lens.
            for [du, dv] in [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]] {
                let colour = painter.colour([f64::from(u) + du, f64::from(v) + dv]);
                (0..3).for_each(|c| sum[c] += 0.25 * colour[c]);
            }
            (0..3).for_each(|c| pixel[c] = (sum[c] + noise.sample(&mut rng)).round() as u8);
        }
        image
    }

    /// True mask: each pixel has the label that covers most of it, counted at 8 x 8 points.
    pub fn truth(&self) -> LabelMask {
        let scale = f64::from(IMAGE_PX[1]) / f64::from(MASK_PX);
        let left = 0.5 * f64::from(IMAGE_PX[0] - IMAGE_PX[1]);
        let mut mask = LabelMask::new(MASK_PX, MASK_PX);
        let painter = Painter::new(self);
        for (i, out) in mask.data.iter_mut().enumerate() {
            let (u, v) = ((i as u32 % MASK_PX) as f64, (i as u32 / MASK_PX) as f64);
            let mut counts = [0; 3];
            for k in 0..64 {
                let (du, dv) = (f64::from(k % 8) / 8.0 + 1.0 / 16.0, f64::from(k / 8) / 8.0 + 1.0 / 16.0);
                let point = [left + scale * (u + du), scale * (v + dv)];
                counts[usize::from(painter.label(point))] += 1;
            }
            *out = (0..3u8).max_by_key(|&l| counts[usize::from(l)]).expect("there are three labels");
        }
        mask
    }
}

/// Scene with the bounding box of its bar.
struct Painter<'a> {
    scene: &'a Scene,
    low: [f64; 2],
    high: [f64; 2],
}

impl<'a> Painter<'a> {
    fn new(scene: &'a Scene) -> Self {
        let reach = scene.bar_half_width;
        let bar = |i: usize| scene.bar.iter().map(move |p| p[i]);
        Self {
            scene,
            low: [0, 1].map(|i| bar(i).fold(f64::INFINITY, f64::min) - reach),
            high: [0, 1].map(|i| bar(i).fold(f64::NEG_INFINITY, f64::max) + reach),
        }
    }

    fn in_gripper(&self, [u, v]: [f64; 2]) -> bool {
        self.scene.gripper.is_some_and(|[left, top, right, bottom]| u > left && u < right && v > top && v < bottom)
    }

    fn label(&self, p: [f64; 2]) -> u8 {
        if self.in_gripper(p) {
            label::BACKGROUND
        } else if self.on_bar(p).is_some() {
            label::DLO
        } else if self.on_target(p).is_some() {
            label::TARGET
        } else {
            label::BACKGROUND
        }
    }

    /// Distance of `p` from the centre line as a share of the half width; none if `p` is not on the bar. The bar's ends are
    /// cut straight.
    fn on_bar(&self, p: [f64; 2]) -> Option<f64> {
        if (0..2).any(|i| p[i] < self.low[i] || p[i] > self.high[i]) {
            return None;
        }
        let [first, second, .., before, last] = *self.scene.bar else { return None };
        let is_beyond = |end: [f64; 2], inner: [f64; 2]| {
            let (out, r) = ([end[0] - inner[0], end[1] - inner[1]], [p[0] - end[0], p[1] - end[1]]);
            r[0].hypot(r[1]) < 2.0 * self.scene.bar_half_width && r[0] * out[0] + r[1] * out[1] > 0.0
        };
        if is_beyond(first, second) || is_beyond(last, before) {
            return None;
        }
        let mut best = f64::INFINITY;
        for pair in self.scene.bar.windows(2) {
            let d = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            let r = [p[0] - pair[0][0], p[1] - pair[0][1]];
            let t = ((r[0] * d[0] + r[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
            best = best.min((r[0] - t * d[0]).hypot(r[1] - t * d[1]));
        }
        (best < self.scene.bar_half_width).then_some(best / self.scene.bar_half_width)
    }

    fn on_target(&self, p: [f64; 2]) -> Option<f64> {
        let (centre, radius) = self.scene.target?;
        let distance = (p[0] - centre[0]).hypot(p[1] - centre[1]);
        (distance < radius).then_some(distance / radius)
    }

    fn colour(&self, p: [f64; 2]) -> [f64; 3] {
        // A round surface lit from the camera is darker towards its outline.
        let round = |across: f64| 0.4 + 0.6 * (1.0 - 0.9 * across * across).sqrt();
        let (albedo, light) = match (self.in_gripper(p), self.on_bar(p), self.on_target(p)) {
            (true, _, _) => ([235.0, 235.0, 230.0], 1.0),
            (_, Some(across), _) => ([40.0, 90.0, 200.0], round(across)),
            (_, _, Some(across)) => ([50.0, 160.0, 70.0], round(across)),
            _ if p[1] > 330.0 => ([150.0, 150.0, 150.0], 0.9),
            _ => ([225.0, 225.0, 220.0], 1.0),
        };
        let (centre, radius, left) = self.scene.shadow;
        let depth = (-((p[0] - centre[0]).powi(2) + (p[1] - centre[1]).powi(2)) / (radius * radius)).exp();
        let light = self.scene.gain * light * (1.0 - (1.0 - left) * depth);
        rotate_hue(albedo, self.scene.hue_shift_deg).map(|c| c * light)
    }
}

/// Rotates `rgb` about the grey axis.
fn rotate_hue(rgb: [f64; 3], angle_deg: f64) -> [f64; 3] {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let (same, side) = ((1.0 - cos) / 3.0, sin / 3f64.sqrt());
    std::array::from_fn(|i| {
        let (next, after) = ((i + 1) % 3, (i + 2) % 3);
        (cos + same) * rgb[i] + (same - side) * rgb[next] + (same + side) * rgb[after]
    })
}
