//! A track as numbers of fixed shape.

use catenary_core::Track;
use thiserror::Error;

/// Numbers of one frame's keypoints: four of (x, y).
pub const POINT_VALUES: usize = 8;
/// Numbers of a frame besides its keypoints: end effector x, z, pitch; action dx, dz; target x, y; presence.
pub const CHANNELS: usize = 8;
/// The channel that is 1 where the track has the frame, 0 where it is padding.
pub const PRESENCE: usize = 7;

/// A track, padded with zeros to F frames.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackInput {
    /// F x 4 x 2: keypoints (x, y) scaled to -1 .. 1, in each frame sorted by y, then x.
    ///
    /// The trackers' order means nothing; sorted, every sum over the set runs in the same order, so that what follows
    /// does not depend on it to the last bit.
    pub points: Vec<f32>,
    /// F x [`CHANNELS`].
    pub channels: Vec<f32>,
}

/// Why a track cannot be taken.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum InputError {
    /// More frames than the network was made for, or none.
    #[error("track: expected 1 to {most} frames, got {got}")]
    Frames {
        /// F.
        most: usize,
        /// Frames of the track.
        got: usize,
    },
    /// A number that is NaN or infinite, in single precision.
    #[error("track: frame {frame} (at {time_s} s) holds a number that is not finite")]
    NotFinite {
        /// Index of the frame.
        frame: usize,
        /// Its time in s.
        time_s: f64,
    },
}

impl TrackInput {
    /// Pads `track` to `frames` frames.
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

    /// Several episodes as one track: the frames of the first, then those of the second, and so on.
    pub fn join(episodes: Vec<Self>) -> Self {
        let mut joined = Self { points: Vec::new(), channels: Vec::new() };
        for episode in episodes {
            joined.points.extend(episode.points);
            joined.channels.extend(episode.channels);
        }
        joined
    }

    /// F.
    pub fn frames(&self) -> usize {
        self.points.len() / POINT_VALUES
    }

    /// Whether frame `index` is in the track.
    pub fn present(&self, index: usize) -> bool {
        self.channels[index * CHANNELS + PRESENCE] > 0.0
    }
}
