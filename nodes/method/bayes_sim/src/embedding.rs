//! RKHS embedding of one frame: the mean of random Fourier features over its set of keypoints.
//!
//! Shapes: N frames (of any number of tracks), 4 keypoints each, M random features.
//! `cos_only`: feature m of a frame is the mean over its keypoints p of `cos(w_m . (s * p) + b_m)`; the frequencies w
//! (2 x M), the phases b (M) and the inverse length scales s (2, as logarithms) are parameters of the network.
//! `cos_sin`: features m and M + m are the means of `cos(w_m . (s * p))` and `sin(w_m . (s * p))`; no phases.
//! The mean embedding is that of Antonova, Yang, Sundaresan, Fox, Ramos and Bohg (2022), "A Bayesian treatment of
//! real-to-sim for deformable object manipulation"; the features are those of Rahimi and Recht (2007).

pub mod input;
#[cfg(test)]
mod tests;
mod trig;

pub use input::{InputError, TrackInput};

use input::POINT_VALUES;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;
use trig::cos_sin;

/// Kind of the features of a frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fourier {
    /// One feature: a cosine with a trained phase.
    #[default]
    CosOnly,
    /// Two features: a cosine and a sine without a phase.
    CosSin,
}

/// Shape of the embedding. Its parameters lie in one slice: M frequencies along x, M along y, M phases (cosines only), and
/// the logarithms of the two inverse length scales.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Embedding {
    /// M, number of frequencies.
    pub frequencies: usize,
    /// Kind of the features of each frequency.
    pub fourier: Fourier,
}

impl Embedding {
    /// Number of features of a frame.
    pub fn features(&self) -> usize {
        match self.fourier {
            Fourier::CosOnly => self.frequencies,
            Fourier::CosSin => 2 * self.frequencies,
        }
    }

    /// Number of parameters.
    pub fn parameter_count(&self) -> usize {
        let phases = if self.fourier == Fourier::CosOnly { self.frequencies } else { 0 };
        2 * self.frequencies + phases + 2
    }

    /// Initial parameters: frequencies of a Gaussian kernel of `length_scale`, in the coordinates of the points, and uniform
    /// phases.
    pub fn initial<R: Rng>(&self, length_scale: f64, rng: &mut R) -> Vec<f32> {
        let m = self.frequencies;
        let mut parameters: Vec<f32> = (0..2 * m).map(|_| rng.sample(StandardNormal)).collect();
        if self.fourier == Fourier::CosOnly {
            parameters.extend((0..m).map(|_| TAU * rng.random::<f32>()));
        }
        parameters.extend([-(length_scale.ln()) as f32; 2]);
        parameters
    }

    /// Frequencies times inverse length scales along x and along y, and the phases (zeros for cosines and sines).
    fn unpack(&self, parameters: &[f32]) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
        assert_eq!(parameters.len(), self.parameter_count(), "parameters of the embedding");
        let m = self.frequencies;
        let scale = [parameters[parameters.len() - 2].exp(), parameters[parameters.len() - 1].exp()];
        let along = |axis: usize| parameters[axis * m..(axis + 1) * m].iter().map(|w| w * scale[axis]).collect();
        let phases = match self.fourier {
            Fourier::CosOnly => parameters[2 * m..3 * m].to_vec(),
            Fourier::CosSin => vec![0.0; m],
        };
        (along(0), along(1), phases)
    }

    /// Writes the features of each frame of `points` (N x 4 x 2) to the head of each row of `out` (N rows of `stride`).
    pub fn forward(&self, parameters: &[f32], points: &[f32], out: &mut [f32], stride: usize) {
        let (wx, wy, phase) = self.unpack(parameters);
        for (frame, row) in points.chunks_exact(POINT_VALUES).zip(out.chunks_exact_mut(stride)) {
            let (cosines, rest) = row.split_at_mut(self.frequencies);
            cosines.fill(0.0);
            match self.fourier {
                Fourier::CosOnly => {
                    for p in frame.chunks_exact(2) {
                        add_cos((p[0], p[1]), (&wx, &wy, &phase), cosines);
                    }
                }
                Fourier::CosSin => {
                    let sines = &mut rest[..self.frequencies];
                    sines.fill(0.0);
                    for p in frame.chunks_exact(2) {
                        add_cos_sin((p[0], p[1]), (&wx, &wy), cosines, sines);
                    }
                }
            }
        }
    }

    /// Adds to `gradient` (one value for each parameter) the gradient of a loss. Its derivatives with respect to the
    /// features are at the head of each row of `by_feature` (N rows of `stride`).
    pub fn backward(
        &self,
        parameters: &[f32],
        points: &[f32],
        by_feature: &[f32],
        stride: usize,
        gradient: &mut [f32],
    ) {
        let m = self.frequencies;
        let (wx, wy, phase) = self.unpack(parameters);
        let (mut by_x, mut by_y, mut by_phase) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
        for (frame, row) in points.chunks_exact(POINT_VALUES).zip(by_feature.chunks_exact(stride)) {
            for p in frame.chunks_exact(2) {
                let sums = (&mut by_x[..], &mut by_y[..], &mut by_phase[..]);
                match self.fourier {
                    Fourier::CosOnly => add_gradient((p[0], p[1]), (&wx, &wy, &phase), &row[..m], None, sums),
                    Fourier::CosSin => {
                        add_gradient((p[0], p[1]), (&wx, &wy, &phase), &row[..m], Some(&row[m..2 * m]), sums);
                    }
                }
            }
        }
        let n = parameters.len();
        for (axis, (by_scaled, scaled)) in [(&by_x, &wx), (&by_y, &wy)].into_iter().enumerate() {
            // The scale is the exponential of its parameter, so that its derivative is the scale itself.
            let scale = parameters[n - 2 + axis].exp();
            gradient[axis * m..(axis + 1) * m].iter_mut().zip(by_scaled).for_each(|(g, d)| *g += d * scale);
            gradient[n - 2 + axis] += by_scaled.iter().zip(scaled).map(|(d, w)| d * w).sum::<f32>();
        }
        if self.fourier == Fourier::CosOnly {
            gradient[2 * m..3 * m].iter_mut().zip(&by_phase).for_each(|(g, d)| *g += d);
        }
    }
}

/// Share of one keypoint in the mean.
const SHARE: f32 = 0.25;

/// Adds the features of one keypoint.
fn add_cos((x, y): (f32, f32), (wx, wy, phase): (&[f32], &[f32], &[f32]), out: &mut [f32]) {
    for (((o, wx), wy), b) in out.iter_mut().zip(wx).zip(wy).zip(phase) {
        *o += SHARE * cos_sin(x * wx + y * wy + b).0;
    }
}

/// Adds the features of one keypoint to the cosines and the sines.
fn add_cos_sin((x, y): (f32, f32), (wx, wy): (&[f32], &[f32]), cosines: &mut [f32], sines: &mut [f32]) {
    for (((c, s), wx), wy) in cosines.iter_mut().zip(sines).zip(wx).zip(wy) {
        let (cos, sin) = cos_sin(x * wx + y * wy);
        *c += SHARE * cos;
        *s += SHARE * sin;
    }
}

/// Adds the contribution of one keypoint to the derivatives with respect to `w_x s_x`, `w_y s_y` and the phase.
fn add_gradient(
    (x, y): (f32, f32),
    (wx, wy, phase): (&[f32], &[f32], &[f32]),
    by_cos: &[f32],
    by_sin: Option<&[f32]>,
    (by_x, by_y, by_phase): (&mut [f32], &mut [f32], &mut [f32]),
) {
    let sums = by_x.iter_mut().zip(by_y).zip(by_phase);
    let weights = wx.iter().zip(wy).zip(phase).zip(by_cos);
    let add = |((wx, wy), b): ((&f32, &f32), &f32), slots: ((&mut f32, &mut f32), &mut f32), gc: f32, gs: f32| {
        let (cos, sin) = cos_sin(x * wx + y * wy + b);
        let by_angle = SHARE * (gs * cos - gc * sin);
        *slots.0.0 += by_angle * x;
        *slots.0.1 += by_angle * y;
        *slots.1 += by_angle;
    };
    match by_sin {
        None => sums.zip(weights).for_each(|(slots, (w, gc))| add(w, slots, *gc, 0.0)),
        Some(by_sin) => {
            sums.zip(weights).zip(by_sin).for_each(|((slots, (w, gc)), gs)| add(w, slots, *gc, *gs));
        }
    }
}
