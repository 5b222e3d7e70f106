//! Centres and scales that bring inputs and thetas to about zero and one.

use super::cut::Support;
use super::{Network, Samples, Shape};
use crate::embedding::input::{POINT_VALUES, PRESENCE};
use serde::{Deserialize, Serialize};

/// Standard deviation under which a column counts as constant.
const LEAST_SPREAD: f64 = 1e-5;

/// Centres and inverse scales of a list of columns; an inverse scale of zero switches a constant column off.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// Subtracted.
    pub centre: Vec<f32>,
    /// Multiplied.
    pub inverse_scale: Vec<f32>,
}

/// All standardisation of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Standardisation {
    /// F x 2: mean keypoint of each frame.
    point_centre: Vec<f32>,
    /// One inverse scale for both coordinates and all frames, so that shapes stay what they are.
    point_inverse_scale: f32,
    /// F x C: of features and channels.
    pub(super) columns: Affine,
    /// X: of plain numbers.
    pub(super) plain: Affine,
    /// Which of the C columns says whether a frame is there; none where it is not looked at.
    pub(super) presence: Option<usize>,
    /// D.
    theta_centre: Vec<f64>,
    /// D.
    theta_scale: Vec<f64>,
}

/// Running weighted mean and variance.
#[derive(Clone, Copy, Default)]
struct Moments {
    weight: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, weight: f64, value: f64) {
        self.weight += weight;
        self.sum += weight * value;
        self.squares += weight * value * value;
    }

    /// Mean and standard deviation; zeros for no values.
    fn finish(&self) -> (f64, f64) {
        if self.weight <= 0.0 {
            return (0.0, 0.0);
        }
        let mean = self.sum / self.weight;
        (mean, (self.squares / self.weight - mean * mean).max(0.0).sqrt())
    }
}

impl Affine {
    /// To zero mean and unit variance.
    fn of(moments: &[Moments]) -> Self {
        let inverse = |spread: f64| if spread < LEAST_SPREAD { 0.0 } else { (1.0 / spread) as f32 };
        Self {
            centre: moments.iter().map(|m| m.finish().0 as f32).collect(),
            inverse_scale: moments.iter().map(|m| inverse(m.finish().1)).collect(),
        }
    }
}

impl Standardisation {
    /// Standardises the keypoints by `samples`; the rest is the identity.
    pub(super) fn of_points(shape: &Shape, samples: &Samples) -> Self {
        let mut by_frame = vec![[Moments::default(); 2]; shape.frames];
        for (row, frame) in samples.points().chunks_exact(POINT_VALUES).enumerate() {
            if samples.present(row) {
                for p in frame.chunks_exact(2) {
                    let slots = &mut by_frame[row % shape.frames];
                    slots.iter_mut().zip(p).for_each(|(m, v)| m.add(1.0, f64::from(*v)));
                }
            }
        }
        let all = by_frame.as_flattened();
        let present: Vec<f64> = all.iter().filter(|m| m.weight > 0.0).map(|m| m.finish().1.powi(2)).collect();
        let spread = (present.iter().sum::<f64>() / present.len().max(1) as f64).sqrt();
        let columns = shape.frames * shape.columns();
        Self {
            point_centre: all.iter().map(|m| m.finish().0 as f32).collect(),
            point_inverse_scale: (1.0 / spread.max(LEAST_SPREAD)) as f32,
            columns: Affine { centre: vec![0.0; columns], inverse_scale: vec![1.0; columns] },
            plain: Affine::default(),
            presence: shape.channels.iter().position(|c| *c == PRESENCE).map(|c| shape.embedding.features() + c),
            theta_centre: vec![0.0; shape.head.dimension],
            theta_scale: vec![1.0; shape.head.dimension],
        }
    }

    /// Whether all lists are as long as `shape` says.
    pub(super) fn is_whole(&self, shape: &Shape) -> bool {
        let columns = shape.frames * shape.columns();
        let affine = |a: &Affine, n| a.centre.len() == n && a.inverse_scale.len() == n;
        self.point_centre.len() == 2 * shape.frames
            && affine(&self.columns, columns)
            && affine(&self.plain, shape.plain)
            && self.presence.is_none_or(|c| c < shape.columns())
            && [&self.theta_centre, &self.theta_scale].iter().all(|list| list.len() == shape.head.dimension)
    }

    /// Centres and scales theta by the weighted mean and standard deviation of `samples`.
    pub(super) fn fit_theta(&mut self, samples: &Samples, weights: &[f64]) {
        let mut moments = vec![Moments::default(); samples.dimension()];
        for (i, weight) in weights.iter().enumerate() {
            moments.iter_mut().zip(samples.theta(i)).for_each(|(m, v)| m.add(*weight, *v));
        }
        self.theta_centre = moments.iter().map(|m| m.finish().0).collect();
        self.theta_scale = moments.iter().map(|m| m.finish().1.max(LEAST_SPREAD)).collect();
    }

    /// Standardised keypoints of `batch`, N x F x 4 x 2.
    pub(super) fn points(&self, batch: &Samples) -> Vec<f32> {
        let mut points = batch.points().to_vec();
        for (row, frame) in points.chunks_exact_mut(POINT_VALUES).enumerate() {
            let at = 2 * (row % batch.frames());
            for p in frame.chunks_exact_mut(2) {
                p[0] = (p[0] - self.point_centre[at]) * self.point_inverse_scale;
                p[1] = (p[1] - self.point_centre[at + 1]) * self.point_inverse_scale;
            }
        }
        points
    }

    /// Standardises the columns of `batch` in place, N x F x C; absent frames stay zero but for their absence.
    pub(super) fn standardise_columns(&self, batch: &Samples, columns: &mut [f32]) {
        let width = self.columns.centre.len() / batch.frames().max(1);
        if width == 0 {
            return;
        }
        for (row, values) in columns.chunks_exact_mut(width).enumerate() {
            let at = width * (row % batch.frames());
            let seen = if batch.present(row) { 0..width } else { self.presence.map_or(0..0, |c| c..c + 1) };
            for c in seen {
                values[c] = (values[c] - self.columns.centre[at + c]) * self.columns.inverse_scale[at + c];
            }
        }
    }

    /// Turns derivatives by standardised columns into derivatives by raw ones; absent frames have none.
    pub(super) fn scale_gradient(&self, batch: &Samples, gradient: &mut [f32]) {
        let width = self.columns.centre.len() / batch.frames().max(1);
        for (row, values) in gradient.chunks_exact_mut(width).enumerate() {
            if batch.present(row) {
                let at = width * (row % batch.frames());
                values.iter_mut().zip(&self.columns.inverse_scale[at..]).for_each(|(v, s)| *v *= s);
            } else {
                values.fill(0.0);
            }
        }
    }

    /// Whitened coordinates of unit coordinates `u`.
    pub fn whiten(&self, u: &[f64]) -> Vec<f64> {
        u.iter().zip(&self.theta_centre).zip(&self.theta_scale).map(|((u, c), s)| (u - c) / s).collect()
    }

    /// Logarithm of the volume of a unit of whitened coordinates.
    pub fn log_scale(&self) -> f64 {
        self.theta_scale.iter().map(|s| s.ln()).sum()
    }

    /// The unit cube in whitened coordinates.
    pub fn support(&self) -> Support {
        let dimension = self.theta_centre.len();
        Support { low: self.whiten(&vec![0.0; dimension]), high: self.whiten(&vec![1.0; dimension]) }
    }

    /// Centre and scale of whitened coordinates.
    pub fn theta(&self) -> (&[f64], &[f64]) {
        (&self.theta_centre, &self.theta_scale)
    }
}

impl Network {
    /// Centres and inverse scales of the columns over the frames of `samples`; that of presence over absent ones too.
    pub(super) fn fitted_columns(&self, samples: &Samples, weights: &[f64]) -> Affine {
        let width = self.shape.columns();
        let mut moments = vec![Moments::default(); self.shape.frames * width];
        let columns = self.raw_columns(samples);
        for (row, values) in columns.chunks_exact(width).enumerate() {
            let at = width * (row % self.shape.frames);
            let weight = weights[row / self.shape.frames];
            let seen = if samples.present(row) { 0..width } else { self.standard.presence.map_or(0..0, |c| c..c + 1) };
            for c in seen {
                moments[at + c].add(weight, f64::from(values[c]));
            }
        }
        Affine::of(&moments)
    }

    /// Centres and inverse scales of the plain numbers of `samples`.
    pub(super) fn fitted_plain(&self, samples: &Samples, weights: &[f64]) -> Affine {
        let mut moments = vec![Moments::default(); self.shape.plain];
        for (row, weight) in samples.rows().chunks_exact(self.shape.plain.max(1)).zip(weights) {
            moments.iter_mut().zip(row).for_each(|(m, v)| m.add(*weight, f64::from(*v)));
        }
        Affine::of(&moments)
    }
}
