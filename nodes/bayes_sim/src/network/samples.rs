//! Simulated tracks with their thetas, in the layout that training reads.

use crate::embedding::TrackInput;
use crate::embedding::input::{CHANNELS, POINT_VALUES, PRESENCE};

/// N tracks of F frames over D coordinates.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    frames: usize,
    dimension: usize,
    /// N x F x 4 x 2.
    points: Vec<f32>,
    /// N x F x [`CHANNELS`].
    channels: Vec<f32>,
    /// N x D: unit coordinates of theta.
    theta: Vec<f64>,
}

impl Samples {
    /// None yet, of F = `frames` and D = `dimension`.
    pub fn new(frames: usize, dimension: usize) -> Self {
        Self { frames, dimension, ..Self::default() }
    }

    /// Adds a track and the unit coordinates of the theta that gave it.
    ///
    /// # Panics
    /// Where either has another shape than the others.
    pub fn push(&mut self, track: &TrackInput, theta: &[f64]) {
        assert_eq!((track.frames(), theta.len()), (self.frames, self.dimension), "shape of a sample");
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
        let mut picked = Self::new(self.frames, self.dimension);
        for &i in indices {
            let (p, c) = (self.frames * POINT_VALUES, self.frames * CHANNELS);
            picked.points.extend_from_slice(&self.points[i * p..(i + 1) * p]);
            picked.channels.extend_from_slice(&self.channels[i * c..(i + 1) * c]);
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
