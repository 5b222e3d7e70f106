//! Regression without physics of the present model's residual on shape and speed: a lower bar for every repair.
//!
//! Kernel ridge regression with a Gaussian kernel (Saunders, Gammerman and Vovk 1998). Kernel width and ridge are
//! chosen by cross-validation over stretches of the fitted episodes.

use catenary_core::Track;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use track_fit::data::Offset;

/// Tried kernel widths, in standard deviations of the features times the root of their number.
const WIDTHS: [f64; 3] = [0.5, 1.0, 2.0];
/// Tried ridges, relative to the kernel's diagonal.
const RIDGES: [f64; 3] = [0.01, 0.1, 1.0];
/// Number of folds; each is a contiguous stretch of frames, because neighbouring frames are correlated.
const FOLDS: usize = 8;
/// Number of features: eight keypoint coordinates and their speeds.
const FEATURES: usize = 16;

/// Trained regression.
pub struct BlackBox {
    centre: [f64; FEATURES],
    scale: [f64; FEATURES],
    features: Vec<[f64; FEATURES]>,
    width: f64,
    /// Dual weights, N x 8.
    weights: DMatrix<f64>,
}

impl BlackBox {
    /// Trains on simulated tracks and the offsets of the measured ones from them, a row a frame. None if there are
    /// fewer than two frames a fold.
    pub fn learn(tracks: &[(&Track, Vec<Offset>)]) -> Option<Self> {
        let rows: Vec<([f64; FEATURES], [f64; 8])> = tracks
            .iter()
            .flat_map(|(track, offsets)| features(track).into_iter().zip(offsets))
            .filter_map(|(f, o)| Some((f, (*o)?)))
            .collect();
        let n = rows.len();
        if n < 2 * FOLDS {
            return None;
        }
        let mean = |i: usize| rows.iter().map(|r| r.0[i]).sum::<f64>() / n as f64;
        let centre: [f64; FEATURES] = std::array::from_fn(mean);
        let variance = |i: usize| rows.iter().map(|r| (r.0[i] - centre[i]).powi(2)).sum::<f64>() / n as f64;
        // The floor keeps a feature that never changes from a division by zero.
        let scale: [f64; FEATURES] = std::array::from_fn(|i| variance(i).sqrt().max(1e-9));
        let features: Vec<_> = rows.iter().map(|r| standardised(&r.0, &centre, &scale)).collect();
        let targets = DMatrix::from_fn(n, 8, |i, k| rows[i].1[k]);
        let choices = WIDTHS.iter().flat_map(|w| RIDGES.map(|r| (*w, r)));
        let error = |&(width, ridge): &(f64, f64)| held_out_error(&features, &targets, width, ridge);
        let (width, ridge) = choices.min_by(|a, b| error(a).total_cmp(&error(b)))?;
        let weights = factor(&features, width, ridge)?.solve(&targets);
        Some(Self { centre, scale, features, width, weights })
    }

    /// Predicted offsets of measured keypoints from a simulated track, mm, a row a frame.
    pub fn predict(&self, track: &Track) -> Vec<[f64; 8]> {
        let one = |f: [f64; FEATURES]| {
            let f = standardised(&f, &self.centre, &self.scale);
            let k =
                DVector::from_iterator(self.features.len(), self.features.iter().map(|g| kernel(&f, g, self.width)));
            let sum = self.weights.transpose() * k;
            std::array::from_fn(|i| sum[i])
        };
        features(track).into_iter().map(one).collect()
    }
}

fn standardised(f: &[f64; FEATURES], centre: &[f64; FEATURES], scale: &[f64; FEATURES]) -> [f64; FEATURES] {
    std::array::from_fn(|i| (f[i] - centre[i]) / scale[i])
}

/// Keypoints and their speeds (central differences), a row a frame.
fn features(track: &Track) -> Vec<[f64; FEATURES]> {
    let frames = &track.frames;
    let row = |i: usize| {
        let (a, b) = (&frames[i.saturating_sub(1)], &frames[(i + 1).min(frames.len() - 1)]);
        let duration_s = (b.time_s - a.time_s).max(1e-9);
        std::array::from_fn(|j| {
            let (k, axis) = (j % 8 / 2, j % 2);
            if j < 8 { frames[i].dlo[k][axis] } else { (b.dlo[k][axis] - a.dlo[k][axis]) / duration_s }
        })
    };
    (0..frames.len()).map(row).collect()
}

fn kernel(a: &[f64; FEATURES], b: &[f64; FEATURES], width: f64) -> f64 {
    let square: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    (-0.5 * square / (width * width * FEATURES as f64)).exp()
}

fn factor(features: &[[f64; FEATURES]], width: f64, ridge: f64) -> Option<Cholesky<f64, Dyn>> {
    let n = features.len();
    let own = |i: usize, j: usize| if i == j { ridge } else { 0.0 };
    DMatrix::from_fn(n, n, |i, j| kernel(&features[i], &features[j], width) + own(i, j)).cholesky()
}

/// Mean square error of cross-validation.
fn held_out_error(features: &[[f64; FEATURES]], targets: &DMatrix<f64>, width: f64, ridge: f64) -> f64 {
    let n = features.len();
    let mut sum = 0.0;
    for fold in 0..FOLDS {
        let out = fold * n / FOLDS..(fold + 1) * n / FOLDS;
        let used: Vec<usize> = (0..n).filter(|i| !out.contains(i)).collect();
        let kept: Vec<_> = used.iter().map(|&i| features[i]).collect();
        let Some(factor) = factor(&kept, width, ridge) else { return f64::INFINITY };
        let weights = factor.solve(&targets.select_rows(&used));
        for i in out {
            let k = DVector::from_iterator(kept.len(), kept.iter().map(|g| kernel(&features[i], g, width)));
            sum += (weights.transpose() * k - targets.row(i).transpose()).norm_squared();
        }
    }
    sum / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Frame;
    use catenary_core::track::End;

    fn swing(phase: f64) -> Track {
        let frame = |i: usize| {
            let time_s = 0.1 * i as f64;
            let dlo = std::array::from_fn(|k| [0.1 * (k + 1) as f64 * (3.0 * time_s + phase).sin(), 0.1 * k as f64]);
            Frame { time_s, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None }
        };
        Track { frames: (0..60).map(frame).collect(), end: End::Complete }
    }

    /// Drag pushes against the speed: the regression learns it from one swing and predicts it for another.
    #[test]
    fn a_dependence_on_speed_is_learnt_and_predicted_for_another_swing() {
        let left = |track: &Track| -> Vec<Offset> {
            features(track).iter().map(|f| Some(std::array::from_fn(|i| -20.0 * f[8 + i]))).collect()
        };
        let (seen, new) = (swing(0.0), swing(1.7));
        let learnt = BlackBox::learn(&[(&seen, left(&seen))]).unwrap();
        let predicted = learnt.predict(&new);
        let (mut error, mut size) = (0.0, 0.0);
        for (t, l) in predicted.iter().zip(left(&new)).skip(1).take(58) {
            let l = l.unwrap();
            error += (0..8).map(|i| (t[i] - l[i]).powi(2)).sum::<f64>();
            size += l.iter().map(|v| v * v).sum::<f64>();
        }
        assert!(error < 0.05 * size, "{error} of {size}");
        assert!(BlackBox::learn(&[(&Track { frames: Vec::new(), ..seen }, Vec::new())]).is_none());
    }
}
