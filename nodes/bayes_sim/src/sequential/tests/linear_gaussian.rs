//! Simulators with posteriors in closed form: the keypoints' x are linear in theta, with Gaussian noise, and those of a share
//! of the tracks are mirrored; the prior is uniform on the unit cube, so the exact posterior is a Gaussian truncated to it, or
//! a mixture of it and its mirror image.

use super::*;
use nalgebra::{DMatrix, DVector};

/// Frames of a track.
pub const FRAMES: usize = 6;

/// The simulator, over `dimension` parameters.
pub struct LinearGaussian {
    pub dimension: usize,
    /// Standard deviation of the noise.
    pub noise: f64,
    /// Share of the tracks whose x are mirrored, which nothing tells.
    pub mirrored: f64,
    /// Whether all keypoints of a frame move alike, their noise included, so that their mean tells all: what the embedding
    /// makes of keypoints is then no loss.
    pub rigid: bool,
}

impl LinearGaussian {
    /// Slope of the x of keypoint `k` in frame `f` by theta's coordinate `j`: the object swings, more so towards its end.
    fn slope(&self, f: usize, k: usize, j: usize) -> f64 {
        0.3 * if self.rigid { 1.0 } else { 0.5 + 0.25 * k as f64 }
            * seed::rng(99, (f * 10 + j) as u64).sample::<f64, _>(StandardNormal)
    }

    fn height(k: usize) -> f64 {
        -0.75 + 0.5 * k as f64
    }

    /// A track at `theta`; its keypoints come in either order.
    pub fn track(&self, theta: &[f64], seed: u64) -> Track {
        let mut rng = seed::rng(seed, 0);
        let sign = if self.mirrored > 0.0 && rng.random::<f64>() < self.mirrored { -1.0 } else { 1.0 };
        let frames = (0..FRAMES).map(|f| {
            let common: f64 = if self.rigid { rng.sample(StandardNormal) } else { 0.0 };
            let mut dlo: [[f64; 2]; 4] = std::array::from_fn(|k| {
                let mean: f64 = theta.iter().enumerate().map(|(j, t)| self.slope(f, k, j) * (t - 0.5)).sum();
                let noise = if self.rigid { common } else { rng.sample(StandardNormal) };
                [sign * mean + self.noise * noise, Self::height(k)]
            });
            if rng.random::<bool>() {
                dlo.reverse();
            }
            Frame { time_s: f as f64 * 0.1, dlo, target: [0.0; 2], eef: [0.4, 0.3, 0.0], action: [0.0; 2] }
        });
        Track { frames: frames.collect(), end: End::Complete }
    }

    pub fn space(&self) -> ParameterSpace {
        let unit = |j| Parameter { name: format!("theta_{j}"), prior: Prior::Uniform { low: 0.0, high: 1.0 } };
        ParameterSpace::new((0..self.dimension).map(unit).collect()).unwrap()
    }

    /// The exact posterior given `tracks` of one theta, one where some are mirrored: least squares with a known variance.
    pub fn posterior(&self, tracks: &[&Track]) -> Posterior {
        let d = self.dimension;
        let (mut precision, mut shift) = (DMatrix::zeros(d, d), DVector::zeros(d));
        for (f, frame) in tracks.iter().flat_map(|t| t.frames.iter().enumerate()) {
            for k in 0..if self.rigid { 1 } else { 4 } {
                let [x, _] = frame.dlo.into_iter().find(|p| p[1] == Self::height(k)).unwrap();
                let slopes = DVector::from_fn(d, |j, _| self.slope(f, k, j));
                precision += &slopes * slopes.transpose() / self.noise.powi(2);
                shift += &slopes * (x + 0.5 * slopes.sum()) / self.noise.powi(2);
            }
        }
        let covariance = precision.try_inverse().unwrap();
        let symmetric = (&covariance + covariance.transpose()) * 0.5;
        let mean = &symmetric * shift;
        let mirrored = DVector::from_element(d, 1.0) - &mean;
        let weights = [1.0 - self.mirrored, self.mirrored];
        let parts = 1 + usize::from(self.mirrored > 0.0);
        let means = [mean, mirrored][..parts].to_vec();
        let mixture = Mixture::new(&weights[..parts], means, vec![symmetric; parts]).unwrap();
        Posterior { parameters: self.space(), mixture }
    }
}

impl Simulator for LinearGaussian {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let tracks = (request.first_episode..).zip(&request.thetas);
        Ok(tracks.map(|(i, theta)| self.track(theta, seed::derive(request.seed, i))).collect())
    }
}
