//! Videos: GIF written by this program, MP4 by ffmpeg.

mod ffmpeg;
mod gif_file;

pub use gif_file::GifFile;

use crate::exit::WrongInput;
use anyhow::Result;
use catenary_core::RgbImage;
use std::path::Path;

/// Video that is being written.
pub enum Video {
    /// Animated GIF.
    Gif(Box<GifFile>),
    /// Process that takes raw frames.
    Ffmpeg(ffmpeg::Ffmpeg),
}

impl Video {
    /// Starts a video of this size in `file`. The extension of `named`, the name in messages, selects the format.
    ///
    /// # Errors
    /// Another extension, `.mp4` without ffmpeg, a frame rate that GIF does not support.
    pub fn create(file: &Path, named: &Path, [width, height]: [u32; 2], rate_hz: f64) -> Result<Self> {
        match named.extension().and_then(|e| e.to_str()) {
            Some("gif") => Ok(Self::Gif(Box::new(GifFile::create(file, [width, height], rate_hz)?))),
            Some("mp4") => Ok(Self::Ffmpeg(ffmpeg::Ffmpeg::start(file, named, [width, height], rate_hz)?)),
            _ => Err(WrongInput::error(format!(
                "--video {}: expected a name that ends in .gif or .mp4",
                named.display()
            ))),
        }
    }

    /// Adds a frame.
    pub fn push(&mut self, frame: &RgbImage) -> Result<()> {
        match self {
            Self::Gif(gif) => gif.push(&frame.data),
            Self::Ffmpeg(ffmpeg) => ffmpeg.push(&frame.data),
        }
    }

    /// Ends the video.
    pub fn finish(self) -> Result<()> {
        match self {
            Self::Gif(gif) => gif.finish(),
            Self::Ffmpeg(ffmpeg) => ffmpeg.finish(),
        }
    }
}
