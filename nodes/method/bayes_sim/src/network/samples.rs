//! Simulated tracks with their thetas, in the memory layout of the training.

use crate::embedding::TrackInput;
use crate::embedding::input::{CHANNELS, POINT_VALUES, PRESENCE};
use crate::unit_map::UnitMap;
use serde::{Deserialize, Serialize};

/// N samples of D coordinates each, with tracks of F frames, rows of X plain numbers, or both.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Samples {
    frames: usize,
    plain: usize,
    dimension: usize,
    /// Keypoints, N x F x 4 x 2.
    points: Vec<f32>,
    /// Channels, N x F x [`CHANNELS`].
    channels: Vec<f32>,
    /// Plain numbers, N x X.
    rows: Vec<f32>,
    /// Unit coordinates of theta, N x D.
    theta: Vec<f64>,
}

impl Samples {
    /// Returns true if the lists have the lengths that the sizes require. Those from a file may not.
    pub(crate) fn is_whole(&self) -> bool {
        let n = self.len();
        self.theta.len() == n * self.dimension
            && self.points.len() == n * self.frames * POINT_VALUES
            && self.channels.len() == n * self.frames * CHANNELS
            && self.rows.len() == n * self.plain
    }

    /// No samples yet, with F = `frames` and D = `dimension`.
    pub fn new(frames: usize, dimension: usize) -> Self {
        Self { frames, dimension, ..Self::default() }
    }

    /// Samples without frames: `rows` (N x X, X = `plain`) with the unit coordinates of their thetas (N x D).
    ///
    /// # Panics
    /// If the numbers of rows and thetas differ.
    pub fn of_rows(rows: Vec<f32>, plain: usize, theta: Vec<f64>, dimension: usize) -> Self {
        assert_eq!(rows.len() * dimension, theta.len() * plain, "as many rows as thetas");
        Self { plain, dimension, rows, theta, ..Self::default() }
    }

    /// Adds a track with the unit coordinates of its theta.
    ///
    /// # Panics
    /// If either has another shape than earlier samples.
    pub fn push(&mut self, track: &TrackInput, theta: &[f64]) {
        assert_eq!((track.frames(), theta.len()), (self.frames, self.dimension), "shape of a sample");
        assert_eq!(self.plain, 0, "a track has no plain numbers");
        self.points.extend_from_slice(&track.points);
        self.channels.extend_from_slice(&track.channels);
        self.theta.extend_from_slice(theta);
    }

    /// N, number of samples.
    pub fn len(&self) -> usize {
        self.theta.len() / self.dimension.max(1)
    }

    /// Returns true if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.theta.is_empty()
    }

    /// F, number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// X, number of plain numbers of a sample.
    pub fn plain(&self) -> usize {
        self.plain
    }

    /// Plain numbers, N x X.
    pub(crate) fn rows(&self) -> &[f32] {
        &self.rows
    }

    /// D, number of coordinates of theta.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Unit coordinates of sample `i`.
    pub fn theta(&self, i: usize) -> &[f64] {
        &self.theta[i * self.dimension..(i + 1) * self.dimension]
    }

    /// Unit coordinates of all samples, N x D.
    pub fn thetas(&self) -> &[f64] {
        &self.theta
    }

    /// Converts the unit coordinates of all samples.
    pub(crate) fn map_thetas(&mut self, map: &UnitMap) {
        if self.dimension > 0 {
            self.theta.chunks_exact_mut(self.dimension).for_each(|u| u.copy_from_slice(&map.apply(u)));
        }
    }

    /// Keypoints of all samples, N x F x 4 x 2.
    pub(crate) fn points(&self) -> &[f32] {
        &self.points
    }

    /// Channels of frame `row` in the frames of all tracks.
    pub(crate) fn channels(&self, row: usize) -> &[f32] {
        &self.channels[row * CHANNELS..(row + 1) * CHANNELS]
    }

    /// Returns true if frame `row` in the frames of all tracks is no padding.
    pub(crate) fn present(&self, row: usize) -> bool {
        self.channels[row * CHANNELS + PRESENCE] > 0.0
    }

    /// Samples at `indices`, in that order.
    pub fn gather(&self, indices: &[usize]) -> Self {
        let mut picked = Self { plain: self.plain, ..Self::new(self.frames, self.dimension) };
        for &i in indices {
            let (p, c) = (self.frames * POINT_VALUES, self.frames * CHANNELS);
            picked.points.extend_from_slice(&self.points[i * p..(i + 1) * p]);
            picked.channels.extend_from_slice(&self.channels[i * c..(i + 1) * c]);
            picked.rows.extend_from_slice(&self.rows[i * self.plain..(i + 1) * self.plain]);
            picked.theta.extend_from_slice(self.theta(i));
        }
        picked
    }

    /// Channels that differ between samples in at least one frame.
    pub fn varying_channels(&self) -> Vec<usize> {
        let track = self.frames * CHANNELS;
        let varies = |c: &usize| {
            let of_track = |t: usize| self.channels[t * track..(t + 1) * track].iter().skip(*c).step_by(CHANNELS);
            (1..self.len()).any(|t| of_track(t).ne(of_track(0)))
        };
        (0..CHANNELS).filter(varies).collect()
    }
}
