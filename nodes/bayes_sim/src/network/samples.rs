//! Simulated tracks with their thetas, in the layout that training reads.

use crate::embedding::TrackInput;
use crate::embedding::input::{CHANNELS, POINT_VALUES, PRESENCE};
use serde::{Deserialize, Serialize};

/// N samples over D coordinates: tracks of F frames, rows of X plain numbers, or both.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Samples {
    frames: usize,
    plain: usize,
    dimension: usize,
    /// N x F x 4 x 2.
    points: Vec<f32>,
    /// N x F x [`CHANNELS`].
    channels: Vec<f32>,
    /// N x X.
    rows: Vec<f32>,
    /// N x D: unit coordinates of theta.
    theta: Vec<f64>,
}

impl Samples {
    /// Whether the lists are as long as the sizes say, which those of a file may not be.
    pub(crate) fn is_whole(&self) -> bool {
        let n = self.len();
        self.theta.len() == n * self.dimension
            && self.points.len() == n * self.frames * POINT_VALUES
            && self.channels.len() == n * self.frames * CHANNELS
            && self.rows.len() == n * self.plain
    }

    /// None yet, of F = `frames` and D = `dimension`.
    pub fn new(frames: usize, dimension: usize) -> Self {
        Self { frames, dimension, ..Self::default() }
    }

    /// Samples without frames: `rows` (N x X, X = `plain`) and the unit coordinates of the thetas that gave them (N x D).
    ///
    /// # Panics
    /// Where the numbers of rows differ.
    pub fn of_rows(rows: Vec<f32>, plain: usize, theta: Vec<f64>, dimension: usize) -> Self {
        assert_eq!(rows.len() * dimension, theta.len() * plain, "as many rows as thetas");
        Self { plain, dimension, rows, theta, ..Self::default() }
    }

    /// Adds a track and the unit coordinates of the theta that gave it.
    ///
    /// # Panics
    /// Where either has another shape than the others.
    pub fn push(&mut self, track: &TrackInput, theta: &[f64]) {
        assert_eq!((track.frames(), theta.len()), (self.frames, self.dimension), "shape of a sample");
        assert_eq!(self.plain, 0, "a track has no plain numbers");
        self.points.extend_from_slice(&track.points);
        self.channels.extend_from_slice(&track.channels);
        self.theta.extend_from_slice(theta);
    }

    /// N.
    pub fn len(&self) -> usize {
        self.theta.len() / self.dimension.max(1)
    }

    /// Whether N is zero.
    pub fn is_empty(&self) -> bool {
        self.theta.is_empty()
    }

    /// F.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// X.
    pub fn plain(&self) -> usize {
        self.plain
    }

    /// N x X: the plain numbers.
    pub(crate) fn rows(&self) -> &[f32] {
        &self.rows
    }

    /// D.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Unit coordinates of sample `i`.
    pub fn theta(&self, i: usize) -> &[f64] {
        &self.theta[i * self.dimension..(i + 1) * self.dimension]
    }

    /// N x D: unit coordinates of all samples.
    pub fn thetas(&self) -> &[f64] {
        &self.theta
    }

    /// All keypoints, N x F x 4 x 2.
    pub(crate) fn points(&self) -> &[f32] {
        &self.points
    }

    /// Channels of frame `row`, counted over all tracks.
    pub(crate) fn channels(&self, row: usize) -> &[f32] {
        &self.channels[row * CHANNELS..(row + 1) * CHANNELS]
    }

    /// Whether frame `row`, counted over all tracks, is no padding.
    pub(crate) fn present(&self, row: usize) -> bool {
        self.channels[row * CHANNELS + PRESENCE] > 0.0
    }

    /// The samples at `indices`, in that order.
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

    /// The channels that are not the same in all samples, frame by frame.
    pub fn varying_channels(&self) -> Vec<usize> {
        let track = self.frames * CHANNELS;
        let varies = |c: &usize| {
            let of_track = |t: usize| self.channels[t * track..(t + 1) * track].iter().skip(*c).step_by(CHANNELS);
            (1..self.len()).any(|t| of_track(t).ne(of_track(0)))
        };
        (0..CHANNELS).filter(varies).collect()
    }
}
