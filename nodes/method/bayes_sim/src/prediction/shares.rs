//! Sources of the variance of predictions: the parameters, what is drawn for each episode, and the noise.

use catenary_core::Track;
use catenary_core::statistics::{mean, variance};
use serde::Serialize;

/// Shares of the variance of predicted keypoints, summed over all coordinates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shares {
    /// From the parameters, as uncertain as the posterior leaves them.
    pub parameters: f64,
    /// From what is drawn for each episode.
    pub episode: f64,
    /// From the noise of keypoints.
    pub noise: f64,
    /// Share of the parameters' part that goes in proportion with each parameter's unit coordinate. Parameters that depend on each other
    /// under the posterior share theirs, so that the sum may exceed 1.
    pub by_parameter: Vec<f64>,
}

impl Shares {
    /// Shares from pairs of tracks in their first `frames` frames: tracks of both sets with one index have the parameters of
    /// that row of `units`, and nothing else in common, so that their covariance is the parameters' variance (Saltelli 2002).
    /// `noise` holds the standard deviations of the noise that the tracks have, and of the noise that is missing in them.
    pub(super) fn of([first, second]: [&[Track]; 2], frames: usize, units: &[Vec<f64>], noise: [f64; 2]) -> Self {
        let is_whole = |t: &Track| t.frames.len() >= frames && coordinates(t, frames).all(f64::is_finite);
        let pairs: Vec<usize> =
            (0..first.len().min(second.len())).filter(|i| is_whole(&first[*i]) && is_whole(&second[*i])).collect();
        let parameters = units.first().map_or(0, Vec::len);
        let columns: Vec<Vec<f64>> = (0..parameters).map(|p| pairs.iter().map(|i| units[*i][p]).collect()).collect();
        let row = |track: &Track| coordinates(track, frames).collect::<Vec<f64>>();
        let table = |tracks: &[Track]| pairs.iter().map(|i| row(&tracks[*i])).collect::<Vec<_>>();
        let (first, second) = (table(first), table(second));
        let [mut total, mut common] = [0.0; 2];
        let mut along = vec![0.0; parameters];
        for c in 0..8 * frames {
            let column = |table: &[Vec<f64>]| table.iter().map(|row| row[c]).collect::<Vec<f64>>();
            let (a, b) = (column(&first), column(&second));
            let both: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
            total += 0.5 * (variance(&a) + variance(&b)) + noise[1].powi(2);
            common += covariance(&a, &b);
            for (sum, u) in along.iter_mut().zip(&columns) {
                // Chance alone makes a squared covariance.
                let chance = variance(&both) / (pairs.len() as f64 - 1.0);
                *sum += covariance(u, &both).powi(2) / variance(u).max(f64::MIN_POSITIVE) - chance;
            }
        }
        // Without two pairs there is no variance, and with few of them the estimates may leave their range.
        let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 };
        let noise = share((8 * frames) as f64 * (noise[0].powi(2) + noise[1].powi(2)), total);
        let parameters = share(common, total).min(1.0 - noise);
        Self {
            parameters,
            episode: 1.0 - noise - parameters,
            noise,
            by_parameter: along.into_iter().map(|part| share(part, common)).collect(),
        }
    }
}

/// Keypoint coordinates of the first `frames` frames.
fn coordinates(track: &Track, frames: usize) -> impl Iterator<Item = f64> + '_ {
    track.frames.iter().take(frames).flat_map(|f| f.dlo.as_flattened().iter().copied())
}

/// Sample covariance.
fn covariance(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b)).sum::<f64>() / (a.len() as f64 - 1.0)
}
