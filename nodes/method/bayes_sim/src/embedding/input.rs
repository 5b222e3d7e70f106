//! Track as numbers of a fixed shape.

use catenary_core::Track;
use thiserror::Error;

/// Number of values of one frame's keypoints: four times (x, y).
pub const POINT_VALUES: usize = 8;
/// Number of channels of a frame: end effector x, z, pitch; action dx, dz; target x, y; presence.
pub const CHANNELS: usize = 8;
/// Index of the presence channel: 1 for a frame of the track, 0 for padding.
pub const PRESENCE: usize = 7;

/// Track padded with zeros to F frames.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackInput {
    /// F x 4 x 2: keypoints (x, y) scaled to -1 .. 1, sorted by y and then x in each frame.
    ///
    /// The tracker's order has no meaning. Sorted keypoints make every sum over the set run in one order, so that results do
    /// not depend on the tracker's order to the last bit.
    pub points: Vec<f32>,
    /// F x [`CHANNELS`].
    pub channels: Vec<f32>,
}

/// Reason for which a track is unusable.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum InputError {
    /// The track has more frames than the networks take, or none.
    #[error("track: expected 1 to {most} frames, got {got}")]
    Frames {
        /// F, number of frames of the networks' input.
        most: usize,
        /// Number of frames of the track.
        got: usize,
    },
    /// A number is NaN or infinite in single precision.
    #[error("track: frame {frame} (at {time_s} s) holds a number that is not finite")]
    NotFinite {
        /// Index of the frame.
        frame: usize,
        /// Time of the frame in s.
        time_s: f64,
    },
}

impl TrackInput {
    /// Pads `track` to `frames` frames.
    ///
    /// # Errors
    /// [`InputError`] if the track is empty, too long or not finite.
    pub fn new(track: &Track, frames: usize) -> Result<Self, InputError> {
        let got = track.frames.len();
        if got == 0 || got > frames {
            return Err(InputError::Frames { most: frames, got });
        }
        let mut points = vec![0.0; frames * POINT_VALUES];
        let mut channels = vec![0.0; frames * CHANNELS];
        let rows = points.chunks_exact_mut(POINT_VALUES).zip(channels.chunks_exact_mut(CHANNELS));
        for (index, (frame, (point_row, channel_row))) in track.frames.iter().zip(rows).enumerate() {
            let mut set = frame.dlo;
            set.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
            let [x, z, pitch] = frame.eef;
            let ([dx, dz], [target_x, target_y]) = (frame.action, frame.target);
            let values = [x, z, pitch, dx, dz, target_x, target_y, 1.0];
            if !set.as_flattened().iter().chain(&values).all(|v| (*v as f32).is_finite()) {
                return Err(InputError::NotFinite { frame: index, time_s: frame.time_s });
            }
            point_row.iter_mut().zip(set.as_flattened()).for_each(|(slot, v)| *slot = *v as f32);
            channel_row.iter_mut().zip(values).for_each(|(slot, v)| *slot = v as f32);
        }
        Ok(Self { points, channels })
    }

    /// Joins several episodes into one track: the frames of the first episode, then of the second, and so on.
    pub fn join(episodes: Vec<Self>) -> Self {
        let mut joined = Self { points: Vec::new(), channels: Vec::new() };
        for episode in episodes {
            joined.points.extend(episode.points);
            joined.channels.extend(episode.channels);
        }
        joined
    }

    /// F, number of frames.
    pub fn frames(&self) -> usize {
        self.points.len() / POINT_VALUES
    }

    /// Returns true if frame `index` is no padding.
    pub fn present(&self, index: usize) -> bool {
        self.channels[index * CHANNELS + PRESENCE] > 0.0
    }
}
