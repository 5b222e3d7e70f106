//! Series of keypoints over time, without repeated frames.

use crate::data::MeasuredEpisode;
use catenary_core::{Frame, KeypointOrder, Track};

/// Greatest difference in scaled coordinates of a keypoint that repeats its place: far below the rounding of any tracker.
const EQUAL: f64 = 1e-12;

/// Series of the four keypoints of an episode, or of their residuals, in scaled image coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Times in s, increasing.
    pub times_s: Vec<f64>,
    /// Coordinates of each frame: (x, y) of keypoints 0 to 3.
    pub values: Vec<[[f64; 2]; 4]>,
    /// Marks of keypoints that are not where they were in the frame before. A repeated place is no observation.
    pub fresh: Vec<[bool; 4]>,
    /// Least difference between two successive measured coordinates that differ; none without any.
    step: Option<f64>,
}

impl Series {
    /// Series of a recorded track. Keypoints are followed from frame to frame in the `order` that moves them least.
    pub fn of(track: &Track, order: KeypointOrder) -> Self {
        let mut values: Vec<[[f64; 2]; 4]> = Vec::with_capacity(track.frames.len());
        for frame in &track.frames {
            let before = values.last().unwrap_or(&frame.dlo);
            let order = order.closest(&frame.dlo, before);
            values.push(order.map(|k| frame.dlo[k]));
        }
        Self::new(&track.frames, &values, values.clone())
    }

    /// Series of the measured less the `simulated` keypoints of an episode. The simulation carries its correction.
    pub fn of_residuals(episode: &MeasuredEpisode, simulated: &Track) -> Self {
        let (mut measured, mut values) = (Vec::new(), Vec::new());
        let frames = &episode.measured.frames;
        for (i, seen) in frames.iter().enumerate() {
            let Some(last) = simulated.frames.len().checked_sub(1) else { break };
            let predicted = &simulated.frames[i.min(last)].dlo;
            let ordered = episode.order.closest(&seen.dlo, predicted).map(|k| seen.dlo[k]);
            values.push(std::array::from_fn(|k| std::array::from_fn(|i| ordered[k][i] - predicted[k][i])));
            measured.push(ordered);
        }
        Self::new(frames, &measured, values)
    }

    /// Series of `values` at the times of `frames`. Frames in which no `measured` keypoint moved are left out.
    fn new(frames: &[Frame], measured: &[[[f64; 2]; 4]], values: Vec<[[f64; 2]; 4]>) -> Self {
        let mut series = Self { times_s: Vec::new(), values: Vec::new(), fresh: Vec::new(), step: None };
        let mut last: Option<&[[f64; 2]; 4]> = None;
        for ((frame, seen), value) in frames.iter().zip(measured).zip(values) {
            let moved = |k: usize, i: usize| last.map_or(f64::INFINITY, |last| (seen[k][i] - last[k][i]).abs());
            let fresh: [bool; 4] = std::array::from_fn(|k| (0..2).any(|i| moved(k, i) > EQUAL));
            if fresh == [false; 4] {
                continue;
            }
            let moves = (0..4).flat_map(|k| [moved(k, 0), moved(k, 1)]);
            let least = moves.filter(|m| *m > EQUAL && m.is_finite()).fold(f64::INFINITY, f64::min);
            series.step = Some(series.step.unwrap_or(f64::INFINITY).min(least)).filter(|s| s.is_finite());
            series.times_s.push(frame.time_s);
            series.values.push(value);
            series.fresh.push(fresh);
            last = Some(seen);
        }
        series
    }

    /// Least difference between two successive measured coordinates that differ: the step of rounded coordinates. None
    /// if nothing moves.
    pub fn step(&self) -> Option<f64> {
        self.step
    }
}
