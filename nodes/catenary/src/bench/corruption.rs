//! Errors of a keypoint tracker, applied to simulated tracks.

use catenary_core::Track;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::Serialize;
use std::fmt;

/// One kind of keypoint error, and its size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Corruption {
    /// No error.
    None,
    /// The keypoints of each frame come in random order.
    Shuffled,
    /// Each keypoint is lost with this probability and replaced by its nearest neighbour.
    Dropped(f64),
    /// Each keypoint is replaced with this probability by another keypoint, drawn uniformly.
    Duplicated(f64),
    /// Gaussian noise of this standard deviation (mask pixels) is added to both coordinates.
    NoisePx(f64),
}

impl Corruption {
    /// Corruptions that the networks are tested on, from none to gross.
    pub const ALL: [Corruption; 14] = [
        Corruption::None,
        Corruption::Shuffled,
        Corruption::Dropped(0.05),
        Corruption::Dropped(0.1),
        Corruption::Dropped(0.2),
        Corruption::Dropped(0.4),
        Corruption::Duplicated(0.05),
        Corruption::Duplicated(0.1),
        Corruption::Duplicated(0.2),
        Corruption::Duplicated(0.4),
        Corruption::NoisePx(1.0),
        Corruption::NoisePx(2.0),
        Corruption::NoisePx(4.0),
        Corruption::NoisePx(8.0),
    ];

    /// Returns `track` with this corruption; `pixels` is the width of the mask.
    pub fn apply<R: Rng>(self, track: &Track, pixels: f64, rng: &mut R) -> Track {
        let mut seen = track.clone();
        for frame in &mut seen.frames {
            let whole = frame.dlo;
            match self {
                Corruption::None => {}
                Corruption::Shuffled => frame.dlo.shuffle(rng),
                Corruption::Dropped(share) => {
                    let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
                    for (k, place) in frame.dlo.iter_mut().enumerate().filter(|_| rng.random::<f64>() < share) {
                        let others = (0..whole.len()).filter(|other| *other != k).map(|other| whole[other]);
                        let nearest = others.min_by(|a, b| apart(*a, whole[k]).total_cmp(&apart(*b, whole[k])));
                        *place = nearest.unwrap_or(whole[k]);
                    }
                }
                Corruption::Duplicated(share) => {
                    for (k, place) in frame.dlo.iter_mut().enumerate() {
                        if rng.random::<f64>() < share {
                            *place = whole[(k + rng.random_range(1..whole.len())) % whole.len()];
                        }
                    }
                }
                Corruption::NoisePx(sd) => {
                    // Scaled coordinates run from -1 to 1 over the width of the image.
                    let scaled = 2.0 * sd / pixels;
                    let noisy = |v: &mut f64| *v += scaled * rng.sample::<f64, _>(StandardNormal);
                    frame.dlo.as_flattened_mut().iter_mut().for_each(noisy);
                }
            }
        }
        seen
    }
}

impl fmt::Display for Corruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Corruption::None => write!(f, "as tracked"),
            Corruption::Shuffled => write!(f, "shuffled"),
            Corruption::Dropped(share) => write!(f, "dropped {:.0} %", 100.0 * share),
            Corruption::Duplicated(share) => write!(f, "duplicated {:.0} %", 100.0 * share),
            Corruption::NoisePx(sd) => write!(f, "noise {sd:.0} px"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::track::End;
    use catenary_core::{Frame, seed};

    const POINTS: [[f64; 2]; 4] = [[0.0, 0.1], [0.0, 0.3], [0.0, 0.6], [0.0, 1.0]];

    fn seen(corruption: Corruption) -> Vec<[[f64; 2]; 4]> {
        let frame = Frame { time_s: 0.0, dlo: POINTS, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None };
        let track = Track { frames: vec![frame; 500], end: End::Complete };
        corruption.apply(&track, 256.0, &mut seed::rng(1, 0)).frames.iter().map(|f| f.dlo).collect()
    }

    #[test]
    fn each_corruption_does_what_it_is_called() {
        assert!(seen(Corruption::None).iter().all(|f| *f == POINTS));
        let sorted = |mut f: [[f64; 2]; 4]| {
            f.sort_by(|a, b| a[1].total_cmp(&b[1]));
            f
        };
        let shuffled = seen(Corruption::Shuffled);
        assert!(shuffled.iter().all(|f| sorted(*f) == POINTS) && shuffled.iter().any(|f| *f != POINTS));
        // Nearest neighbours of the four points: 0.3, 0.1, 0.3 and 0.6.
        let nearest = [0.3, 0.1, 0.3, 0.6];
        let share = |moved: &[[[f64; 2]; 4]]| {
            let changed = moved.iter().flat_map(|f| f.iter().zip(&POINTS)).filter(|(a, b)| a != b).count();
            changed as f64 / (4 * moved.len()) as f64
        };
        let dropped = seen(Corruption::Dropped(0.25));
        assert!(dropped.iter().all(|f| (0..4).all(|k| f[k] == POINTS[k] || f[k][1] == nearest[k])));
        // 2,000 keypoints, a quarter changed: the standard error is 1 %, the bound four of them.
        assert!((share(&dropped) - 0.25).abs() < 0.04, "{}", share(&dropped));
        let duplicated = seen(Corruption::Duplicated(0.25));
        assert!(duplicated.iter().flatten().all(|p| POINTS.contains(p)));
        assert!((share(&duplicated) - 0.25).abs() < 0.04, "{}", share(&duplicated));
        let noisy = seen(Corruption::NoisePx(2.0));
        let squares: f64 = noisy.iter().flat_map(|f| f.iter().zip(&POINTS)).map(|(a, b)| (a[0] - b[0]).powi(2)).sum();
        let sd_px = 128.0 * (squares / 2_000.0).sqrt();
        // 4,000 squares: the relative standard error of the deviation is 1.1 %, the bound 7 %.
        assert!((sd_px - 2.0).abs() < 0.15, "{sd_px}");
    }
}
