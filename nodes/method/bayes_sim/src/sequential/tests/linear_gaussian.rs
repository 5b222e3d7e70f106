//! Simulators with posteriors in closed form. The x coordinates of the keypoints are linear in theta - 0.5 with Gaussian noise.
//! A share of the tracks has the opposite sign of this linear term. The prior is uniform on the unit cube. The exact posterior
//! is a Gaussian truncated to the cube, or a mixture of this Gaussian and its mirror image.

use super::*;
use nalgebra::{DMatrix, DVector};

/// Frames of a track.
pub const FRAMES: usize = 6;

/// Linear-Gaussian simulator of `dimension` parameters.
pub struct LinearGaussian {
    pub dimension: usize,
    /// Standard deviation of the noise.
    pub noise: f64,
    /// Share of the tracks whose linear term has the opposite sign. Nothing in a track reveals it.
    pub mirrored: f64,
    /// True if all keypoints of a frame have the same displacement, noise included. Their mean is then sufficient, and the
    /// embedding loses nothing.
    pub rigid: bool,
}

impl LinearGaussian {
    /// Derivative of x of keypoint `k` in frame `f` with respect to `theta[j]`: 0.3 times a fixed normal draw. Unless `rigid`, it
    /// is also multiplied by 0.5 at the first keypoint to 1.25 at the last.
    fn slope(&self, f: usize, k: usize, j: usize) -> f64 {
        0.3 * if self.rigid { 1.0 } else { 0.5 + 0.25 * k as f64 }
            * seed::rng(99, (f * 10 + j) as u64).sample::<f64, _>(StandardNormal)
    }

    /// Height of keypoint `k`, by which the exact posterior recognises it.
    fn height(k: usize) -> f64 {
        -0.75 + 0.5 * k as f64
    }

    /// Track at `theta`. The keypoints of a frame come in one order or its reverse.
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
            Frame {
                time_s: f as f64 * 0.1,
                dlo,
                target: [0.0; 2],
                eef: [0.4, 0.3, 0.0],
                action: [0.0; 2],
                wrench: None,
            }
        });
        Track { frames: frames.collect(), end: End::Complete }
    }

    /// Uniform prior on the unit cube.
    pub fn space(&self) -> ParameterSpace {
        let unit = |j| Parameter { name: format!("theta_{j}"), prior: Prior::Uniform { low: 0.0, high: 1.0 } };
        ParameterSpace::new((0..self.dimension).map(unit).collect()).unwrap()
    }

    /// Exact posterior given `tracks` of one theta, by least squares with a known variance. `tracks` must hold one track if
    /// `mirrored` is above 0.
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
