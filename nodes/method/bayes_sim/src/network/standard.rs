//! Standardisation of inputs and thetas to a mean of about zero and a standard deviation of about one.

use super::truncation::Support;
use super::{Samples, Shape};
use crate::embedding::input::{POINT_VALUES, PRESENCE};
use crate::unit_map::UnitMap;
use serde::{Deserialize, Serialize};

/// Standard deviation below which a column counts as constant.
const LEAST_SPREAD: f64 = 1e-5;

/// Centres and inverse scales of a list of columns. The inverse scale of a constant column is zero, which switches it off.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// Subtracted from a value.
    pub centre: Vec<f32>,
    /// Multiplied with the difference.
    pub inverse_scale: Vec<f32>,
}

/// Standardisation of a network's inputs and thetas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Standardisation {
    /// Mean keypoint of each frame, F x 2.
    point_centre: Vec<f32>,
    /// Inverse scale of keypoints, one for both coordinates and all frames, which preserves shapes.
    point_inverse_scale: f32,
    /// Standardisation of features and channels, F x C.
    pub(super) columns: Affine,
    /// Standardisation of plain numbers, X.
    pub(super) plain: Affine,
    /// Index of the presence column among the C columns; none if it does not enter the network.
    pub(super) presence: Option<usize>,
    /// Centre of whitened coordinates in unit coordinates, D.
    theta_centre: Vec<f64>,
    /// Scale of whitened coordinates in unit coordinates, D.
    theta_scale: Vec<f64>,
}

/// Weighted sums for a mean and a variance.
#[derive(Clone, Copy, Default)]
struct Moments {
    weight: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    /// Adds a value.
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
    /// Standardisation to zero mean and unit variance.
    fn of(moments: &[Moments]) -> Self {
        let inverse = |spread: f64| if spread < LEAST_SPREAD { 0.0 } else { (1.0 / spread) as f32 };
        Self {
            centre: moments.iter().map(|m| m.finish().0 as f32).collect(),
            inverse_scale: moments.iter().map(|m| inverse(m.finish().1)).collect(),
        }
    }
}

impl Standardisation {
    /// Standardisation of the keypoints by `samples`; identity for everything else.
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

    /// Returns true if all lists have the lengths that `shape` requires.
    pub(super) fn is_whole(&self, shape: &Shape) -> bool {
        let columns = shape.frames * shape.columns();
        let affine = |a: &Affine, n| a.centre.len() == n && a.inverse_scale.len() == n;
        self.point_centre.len() == 2 * shape.frames
            && affine(&self.columns, columns)
            && affine(&self.plain, shape.plain)
            && self.presence.is_none_or(|c| c < shape.columns())
            && [&self.theta_centre, &self.theta_scale].iter().all(|list| list.len() == shape.head.dimension)
    }

    /// Sets the centre and the scale of theta to the weighted mean and standard deviation of `samples`.
    pub(super) fn fit_theta(&mut self, samples: &Samples, weights: &[f64]) {
        let mut moments = vec![Moments::default(); samples.dimension()];
        for (i, weight) in weights.iter().enumerate() {
            moments.iter_mut().zip(samples.theta(i)).for_each(|(m, v)| m.add(*weight, *v));
        }
        self.theta_centre = moments.iter().map(|m| m.finish().0).collect();
        self.theta_scale = moments.iter().map(|m| m.finish().1.max(LEAST_SPREAD)).collect();
    }

    /// Converts the centre and the scale of theta to other unit coordinates: whitened coordinates stay the same.
    pub(super) fn map_theta(&mut self, map: &UnitMap) {
        self.theta_centre = map.apply(&self.theta_centre);
        self.theta_scale.iter_mut().zip(map.scale()).for_each(|(s, by)| *s *= by);
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

    /// Standardises the columns of `batch` (N x F x C) in place. Of an absent frame only the presence column changes.
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

    /// Converts derivatives with respect to standardised columns to derivatives with respect to raw ones. The latter are zero in
    /// absent frames.
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

    /// Logarithm of the volume of the whitened unit cube in unit coordinates.
    pub fn log_scale(&self) -> f64 {
        self.theta_scale.iter().map(|s| s.ln()).sum()
    }

    /// Unit cube in whitened coordinates.
    pub fn support(&self) -> Support {
        let dimension = self.theta_centre.len();
        Support { low: self.whiten(&vec![0.0; dimension]), high: self.whiten(&vec![1.0; dimension]) }
    }

    /// Centre and scale of whitened coordinates in unit coordinates.
    pub fn theta(&self) -> (&[f64], &[f64]) {
        (&self.theta_centre, &self.theta_scale)
    }
}

impl Affine {
    /// Standardisation of `columns`, B x F x C of the tracks `samples`, over present frames. The column `presence` is averaged
    /// over absent frames as well.
    pub(super) fn of_columns(
        columns: &[f32],
        samples: &Samples,
        weights: &[f64],
        shape: &Shape,
        presence: Option<usize>,
    ) -> Self {
        let width = shape.columns();
        let mut moments = vec![Moments::default(); shape.frames * width];
        for (row, values) in columns.chunks_exact(width).enumerate() {
            let at = width * (row % shape.frames);
            let weight = weights[row / shape.frames];
            let seen = if samples.present(row) { 0..width } else { presence.map_or(0..0, |c| c..c + 1) };
            for c in seen {
                moments[at + c].add(weight, f64::from(values[c]));
            }
        }
        Self::of(&moments)
    }

    /// Standardisation of the plain numbers of `samples`.
    pub(super) fn of_plain(samples: &Samples, weights: &[f64], shape: &Shape) -> Self {
        let mut moments = vec![Moments::default(); shape.plain];
        for (row, weight) in samples.rows().chunks_exact(shape.plain.max(1)).zip(weights) {
            moments.iter_mut().zip(row).for_each(|(m, v)| m.add(*weight, f64::from(*v)));
        }
        Self::of(&moments)
    }
}
