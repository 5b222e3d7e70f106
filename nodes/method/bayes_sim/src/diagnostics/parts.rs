//! Parts of the measured tracks in a posterior predictive check: one keypoint in a third of an episode.

use super::ranks::Coordinate;
use catenary_core::Frame;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Number of phases of an episode. A third holds some fifteen frames of a usual track, and thirds separate the first
/// motion from the rest at the end.
const PHASES: usize = 3;

/// Comparison of one keypoint in one third of an episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Number of the episode among those compared, from 1.
    pub episode: usize,
    /// Number of the keypoint along the object, from 1 at the grip to 4 at the free end.
    pub keypoint: usize,
    /// Number of the third, from 1.
    pub third: usize,
    /// Times in s of its first and last frame.
    pub times_s: [f64; 2],
    /// Root mean square distance of the mean prediction from the measured keypoint in mm.
    pub rmse_mm: f64,
    /// Share of measured coordinates inside of the 5 % to 95 % band of the draws.
    pub coverage: f64,
    /// Root mean square distance from the mean prediction in standard deviations of the draws, by coordinate; 1 if
    /// calibrated.
    pub deviations: f64,
}

/// Sums over coordinates.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    squares: f64,
    widths: f64,
    distances: f64,
    inside: usize,
    count: usize,
    /// Times in s of the first and the last frame.
    times_s: Option<[f64; 2]>,
}

impl Sums {
    fn add(&mut self, time_s: f64, coordinate: &Coordinate) {
        self.squares += coordinate.error.powi(2);
        self.widths += coordinate.half_width.powi(2);
        self.distances += coordinate.distance;
        self.inside += usize::from(coordinate.is_inside);
        self.count += 1;
        self.times_s = Some([self.times_s.map_or(time_s, |[first_s, _]| first_s), time_s]);
    }

    /// Root mean square distance of a keypoint in mm. It has two coordinates: half as many distances as coordinates.
    pub(super) fn rmse_mm(&self) -> f64 {
        1e3 * (2.0 * self.squares / self.count as f64).sqrt()
    }

    /// Root mean square half width of the band in mm.
    pub(super) fn half_width_mm(&self) -> f64 {
        1e3 * (self.widths / self.count as f64).sqrt()
    }

    /// Share of the coordinates inside of the band.
    pub(super) fn coverage(&self) -> f64 {
        self.inside as f64 / self.count as f64
    }
}

/// Sums over all coordinates and over the parts.
#[derive(Debug, Default)]
pub(super) struct Parts {
    whole: Sums,
    /// Sums by episode, third and keypoint, all from 0.
    parts: BTreeMap<[usize; 3], Sums>,
    /// Episode that is being added, and the times in s of its first and last compared frame.
    episode: (usize, [f64; 2]),
}

impl Parts {
    /// Begins an episode with these compared frames.
    pub(super) fn begin(&mut self, episode: usize, frames: &[Frame]) {
        let ends_s = [frames.first(), frames.last()].map(|f| f.map_or(0.0, |f| f.time_s));
        self.episode = (episode, ends_s);
    }

    /// Adds a coordinate of `keypoint` (from 0 at the grip) at `time_s`.
    pub(super) fn add(&mut self, time_s: f64, keypoint: usize, coordinate: &Coordinate) {
        let (episode, [first_s, last_s]) = self.episode;
        // A single frame has no length: it counts as the first third.
        let share = if last_s > first_s { (time_s - first_s) / (last_s - first_s) } else { 0.0 };
        let third = ((PHASES as f64 * share) as usize).min(PHASES - 1);
        self.whole.add(time_s, coordinate);
        self.parts.entry([episode, third, keypoint]).or_default().add(time_s, coordinate);
    }

    /// Sums over all coordinates, and the parts.
    pub(super) fn finish(self) -> (Sums, Vec<Part>) {
        let part = |([episode, third, keypoint], sums): ([usize; 3], Sums)| Part {
            episode: episode + 1,
            keypoint: keypoint + 1,
            third: third + 1,
            times_s: sums.times_s.unwrap_or_default(),
            rmse_mm: sums.rmse_mm(),
            coverage: sums.coverage(),
            deviations: (sums.distances / sums.count as f64).sqrt(),
        };
        (self.whole, self.parts.into_iter().map(part).collect())
    }
}
