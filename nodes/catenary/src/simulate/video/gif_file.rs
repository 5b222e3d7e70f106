//! Animated GIF with exact colours if a frame has at most 255. Each frame holds only its changed rectangle.

use anyhow::{Context, Result, ensure};
use gif::{Encoder, Frame, Repeat};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Colours of a frame. The last of the 256 indices marks unchanged pixels.
const MOST_COLOURS: usize = 255;
/// Frame rates that GIF viewers play unchanged. Most viewers slow faster rates down.
const RATES_HZ: Range<f64> = 0.1..50.1;

/// GIF that is being written.
pub struct GifFile {
    /// Path, for messages.
    file: PathBuf,
    encoder: Encoder<BufWriter<File>>,
    size: [u32; 2],
    rate_hz: f64,
    /// Number of frames pushed so far.
    frames: u64,
    /// Frame that waits for its duration, and its start in 1/100 s.
    waiting: Option<(Frame<'static>, u64)>,
    /// Last pushed picture.
    shown: Vec<u8>,
}

impl GifFile {
    /// Creates a file that loops for ever.
    pub fn create(file: &Path, size: [u32; 2], rate_hz: f64) -> Result<Self> {
        ensure!(
            RATES_HZ.contains(&rate_hz),
            "--video-rate: expected 0.1 to 50 frames per second for a GIF, got {rate_hz}"
        );
        let [width, height] = [u16::try_from(size[0])?, u16::try_from(size[1])?];
        let out = BufWriter::new(File::create(file).with_context(|| file.display().to_string())?);
        let begin = || {
            let mut encoder = Encoder::new(out, width, height, &[])?;
            encoder.set_repeat(Repeat::Infinite)?;
            Ok::<_, gif::EncodingError>(encoder)
        };
        let encoder = begin().with_context(|| file.display().to_string())?;
        Ok(Self { file: file.to_owned(), encoder, size, rate_hz, frames: 0, waiting: None, shown: Vec::new() })
    }

    /// Adds a picture of RGB bytes.
    pub fn push(&mut self, rgb: &[u8]) -> Result<()> {
        let now_cs = (100.0 * self.frames as f64 / self.rate_hz).round() as u64;
        self.frames += 1;
        // An unchanged picture only lengthens the previous frame.
        let Some(area) = self.changed(rgb) else { return Ok(()) };
        self.write_waiting(now_cs)?;
        self.waiting = Some((self.frame(rgb, area), now_cs));
        self.shown = rgb.to_vec();
        Ok(())
    }

    /// Ends the file.
    pub fn finish(mut self) -> Result<()> {
        let end_cs = (100.0 * self.frames as f64 / self.rate_hz).round() as u64;
        self.write_waiting(end_cs)?;
        let Self { file, encoder, .. } = self;
        let mut out = encoder.into_inner().with_context(|| file.display().to_string())?;
        std::io::Write::flush(&mut out).with_context(|| file.display().to_string())
    }

    fn write_waiting(&mut self, until_cs: u64) -> Result<()> {
        if let Some((mut frame, since_cs)) = self.waiting.take() {
            // A still of eleven minutes and more is cut to the longest delay of the format.
            frame.delay = u16::try_from(until_cs - since_cs).unwrap_or(u16::MAX);
            self.encoder.write_frame(&frame).with_context(|| self.file.display().to_string())?;
        }
        Ok(())
    }

    /// Columns and rows of the rectangle around all changed pixels; `None` if nothing has changed.
    fn changed(&self, rgb: &[u8]) -> Option<[Range<usize>; 2]> {
        let [width, height] = self.size.map(|v| v as usize);
        if self.shown.is_empty() {
            return Some([0..width, 0..height]);
        }
        let mut area: Option<[Range<usize>; 2]> = None;
        for (i, (new, old)) in rgb.chunks_exact(3).zip(self.shown.chunks_exact(3)).enumerate() {
            if new != old {
                let (u, v) = (i % width, i / width);
                let [columns, rows] = area.get_or_insert([u..u + 1, v..v + 1]);
                *columns = columns.start.min(u)..columns.end.max(u + 1);
                rows.end = v + 1;
            }
        }
        area
    }

    fn frame(&self, rgb: &[u8], [columns, rows]: [Range<usize>; 2]) -> Frame<'static> {
        let width = self.size[0] as usize;
        let places: Vec<usize> = rows.clone().flat_map(|v| columns.clone().map(move |u| 3 * (v * width + u))).collect();
        let is_new = |i: usize| self.shown.is_empty() || rgb[i..i + 3] != self.shown[i..i + 3];
        let (palette, indices) = palette(places.iter().map(|&i| is_new(i).then(|| [rgb[i], rgb[i + 1], rgb[i + 2]])));
        let (w, h) = ((columns.end - columns.start) as u16, (rows.end - rows.start) as u16);
        let mut frame = Frame::from_palette_pixels(w, h, indices, palette, Some(MOST_COLOURS as u8));
        (frame.left, frame.top) = (columns.start as u16, rows.start as u16);
        frame.dispose = gif::DisposalMethod::Keep;
        frame
    }
}

/// Palette of 256 colours, and the indices of the pixels in it; `None` is an unchanged pixel. Colours are exact if
/// there are few enough, else quantised as finely as the palette allows.
fn palette(pixels: impl Iterator<Item = Option<[u8; 3]>> + Clone) -> (Vec<u8>, Vec<u8>) {
    let coarse = |bits: u32, c: [u8; 3]| c.map(|v| (v >> bits << bits) | ((1u16 << bits) >> 1) as u8);
    let mut bits = 0;
    let colours = loop {
        let mut colours: BTreeMap<[u8; 3], u8> = BTreeMap::new();
        let fits = pixels.clone().flatten().all(|c| {
            let next = colours.len();
            colours.entry(coarse(bits, c)).or_insert(next.min(MOST_COLOURS) as u8);
            colours.len() <= MOST_COLOURS
        });
        // With six bits removed, at most 64 colours are left.
        if fits || bits == 6 {
            break colours;
        }
        bits += 1;
    };
    let index = |c: [u8; 3]| colours.get(&coarse(bits, c)).copied().unwrap_or_default();
    let indices = pixels.map(|c| c.map_or(MOST_COLOURS as u8, index)).collect();
    let mut palette = vec![0; 3 * (MOST_COLOURS + 1)];
    for (colour, i) in &colours {
        palette[3 * usize::from(*i)..][..3].copy_from_slice(colour);
    }
    (palette, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures of a GIF with their delays in 1/100 s.
    fn played(file: &Path) -> Vec<(Vec<u8>, u16)> {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(File::open(file).unwrap()).unwrap();
        let width = usize::from(decoder.width());
        let mut screen = vec![0u8; 3 * width * usize::from(decoder.height())];
        let mut out = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            let w = usize::from(frame.width);
            for (i, pixel) in frame.buffer.chunks_exact(4).enumerate().filter(|(_, p)| p[3] > 0) {
                let (u, v) = (usize::from(frame.left) + i % w, usize::from(frame.top) + i / w);
                screen[3 * (v * width + u)..][..3].copy_from_slice(&pixel[..3]);
            }
            out.push((screen.clone(), frame.delay));
        }
        out
    }

    #[test]
    fn pictures_come_back_with_their_times_and_exact_colours() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.gif");
        let mut pictures = vec![vec![200u8; 3 * 8 * 6]; 4];
        pictures[1][3 * (8 * 2 + 5)] = 17;
        pictures[2] = pictures[1].clone();
        pictures[3][3 * (8 * 4 + 1) + 2] = 93;
        let mut gif = GifFile::create(&file, [8, 6], 30.0).unwrap();
        pictures.iter().for_each(|p| gif.push(p).unwrap());
        gif.finish().unwrap();
        // Frames start at 0, 3.3, 6.7 and 10 hundredths of a second.
        let expected = [(pictures[0].clone(), 3), (pictures[1].clone(), 7), (pictures[3].clone(), 3)];
        assert_eq!(played(&file), expected, "the third frame is the second one shown longer");
    }

    #[test]
    fn too_many_colours_are_quantised_evenly() {
        let pixels: Vec<Option<[u8; 3]>> = (0..4096u32).map(|i| Some([(i / 16) as u8, (i % 256) as u8, 128])).collect();
        let (palette, indices) = palette(pixels.iter().copied());
        for (pixel, index) in pixels.iter().flatten().zip(indices) {
            let shown = &palette[3 * usize::from(index)..][..3];
            let off = pixel.iter().zip(shown).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(off <= 16, "{pixel:?} became {shown:?}");
        }
    }
}
