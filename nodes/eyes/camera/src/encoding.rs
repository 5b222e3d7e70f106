//! Encodings of images, and their conversion to RGB.

use crate::Error;
use catenary_core::{RgbImage, RgbView};

/// Names of all encodings that are taken, for messages.
const TAKEN: &str = "rgb8, bgr8, rgba8, bgra8, mono8, uyvy (yuv422) or yuyv (yuv422_yuy2)";

/// Order of the bytes of a pixel, by the names of `sensor_msgs/image_encodings`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Red, green, blue.
    Rgb8,
    /// Blue, green, red.
    Bgr8,
    /// Red, green, blue, opacity, which is ignored.
    Rgba8,
    /// Blue, green, red, opacity, which is ignored.
    Bgra8,
    /// Brightness alone.
    Mono8,
    /// Two pixels in four bytes: U Y V Y. `yuv422` is its old name.
    Uyvy,
    /// Two pixels in four bytes: Y U Y V. `yuv422_yuy2` is its old name.
    Yuyv,
}

impl Encoding {
    /// Encoding of this name.
    ///
    /// # Errors
    /// [`Error::Image`] for any other name.
    pub fn of(name: &str) -> Result<Self, Error> {
        Ok(match name {
            "rgb8" => Self::Rgb8,
            "bgr8" => Self::Bgr8,
            "rgba8" => Self::Rgba8,
            "bgra8" => Self::Bgra8,
            "mono8" => Self::Mono8,
            "uyvy" | "yuv422" => Self::Uyvy,
            "yuyv" | "yuv422_yuy2" => Self::Yuyv,
            _ => return Err(Error::Image { field: "encoding", expected: TAKEN, got: name.to_owned() }),
        })
    }

    /// Returns true if the encoding tells colours.
    #[must_use]
    pub fn has_colour(self) -> bool {
        self != Self::Mono8
    }

    fn bytes_of_row(self, width: usize) -> usize {
        match self {
            Self::Rgb8 | Self::Bgr8 => 3 * width,
            Self::Rgba8 | Self::Bgra8 => 4 * width,
            Self::Mono8 => width,
            // A row of an odd number of pixels ends with a whole pair.
            Self::Uyvy | Self::Yuyv => 4 * width.div_ceil(2),
        }
    }
}

/// Borrowed image of any encoding.
#[derive(Debug, Clone, Copy)]
pub struct EncodedView<'a> {
    /// Order of the bytes.
    pub encoding: Encoding,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Bytes from one row to the next.
    pub step: usize,
    /// Rows of pixels.
    pub data: &'a [u8],
}

/// Converter of images to RGB. Reuses its buffer, and passes an RGB image on as it is.
#[derive(Debug, Clone)]
pub struct Converter {
    image: RgbImage,
}

impl Default for Converter {
    fn default() -> Self {
        Self { image: RgbImage::new(0, 0) }
    }
}

impl Converter {
    /// Image in RGB. YUV is that of ITU-R BT.601 with brightness from 16 to 235, as cameras and OpenCV have it.
    ///
    /// # Errors
    /// [`Error::Image`] for an image without pixels, a step that is shorter than a row, and fewer bytes than these ask for.
    pub fn rgb<'a>(&'a mut self, from: EncodedView<'a>) -> Result<RgbView<'a>, Error> {
        let size = |got: String| Error::Image {
            field: "data",
            expected: "as many bytes as width, height and step ask for",
            got,
        };
        let (w, h, row) = (from.width, from.height, from.encoding.bytes_of_row(from.width as usize));
        if w == 0 || h == 0 {
            let got = format!("{w} x {h} pixels");
            return Err(Error::Image { field: "size", expected: "a width and a height of at least one pixel", got });
        }
        if from.step < row {
            let got = format!("{} for a row of {w} pixels, which has {row} bytes", from.step);
            return Err(Error::Image { field: "step", expected: "at least the bytes of a row", got });
        }
        if from.encoding == Encoding::Rgb8 {
            return RgbView::new(from.width, from.height, from.step, from.data).map_err(|e| size(e.to_string()));
        }
        let (width, height) = (from.width as usize, from.height as usize);
        let needed = (height - 1).saturating_mul(from.step).saturating_add(row);
        if from.data.len() < needed {
            let (got, step) = (from.data.len(), from.step);
            return Err(size(format!("{got} bytes for {w} x {h} pixels with a row step of {step}")));
        }
        (self.image.width, self.image.height) = (from.width, from.height);
        self.image.data.resize(3 * width * height, 0);
        let rows = self.image.data.chunks_exact_mut(3 * width);
        for (out, start) in rows.zip((0..).step_by(from.step)) {
            convert_row(from.encoding, &from.data[start..start + row], out);
        }
        Ok(self.image.view())
    }
}

fn convert_row(encoding: Encoding, row: &[u8], out: &mut [u8]) {
    let out = out.as_chunks_mut::<3>().0;
    match encoding {
        Encoding::Rgb8 => out.as_flattened_mut().copy_from_slice(row),
        Encoding::Bgr8 => out.iter_mut().zip(row.as_chunks::<3>().0).for_each(|(out, &[b, g, r])| *out = [r, g, b]),
        Encoding::Rgba8 => out.iter_mut().zip(row.as_chunks::<4>().0).for_each(|(out, &[r, g, b, _])| *out = [r, g, b]),
        Encoding::Bgra8 => out.iter_mut().zip(row.as_chunks::<4>().0).for_each(|(out, &[b, g, r, _])| *out = [r, g, b]),
        Encoding::Mono8 => out.iter_mut().zip(row).for_each(|(out, &grey)| *out = [grey; 3]),
        Encoding::Uyvy => convert_pairs(row, out, |[u, y0, v, y1]| ([y0, y1], u, v)),
        Encoding::Yuyv => convert_pairs(row, out, |[y0, u, y1, v]| ([y0, y1], u, v)),
    }
}

fn convert_pairs(row: &[u8], out: &mut [[u8; 3]], order: impl Fn([u8; 4]) -> ([u8; 2], u8, u8)) {
    for (out, &pair) in out.chunks_mut(2).zip(row.as_chunks::<4>().0) {
        let (brightness, u, v) = order(pair);
        for (out, y) in out.iter_mut().zip(brightness) {
            *out = rgb_of_yuv(y, u, v);
        }
    }
}

/// ITU-R BT.601 with 16 to 235 for brightness and 16 to 240 for chroma, in fixed point with eight fractional bits.
fn rgb_of_yuv(y: u8, u: u8, v: u8) -> [u8; 3] {
    let [y, u, v] = [(y, 16), (u, 128), (v, 128)].map(|(c, zero)| i32::from(c) - zero);
    let y = 298 * y + 128;
    [y + 409 * v, y - 100 * u - 208 * v, y + 516 * u].map(|c| (c >> 8).clamp(0, 255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rgb(name: &str, width: u32, step: usize, data: &[u8]) -> Result<Vec<u8>, Error> {
        let encoding = Encoding::of(name)?;
        let mut converter = Converter::default();
        let view = converter.rgb(EncodedView { encoding, width, height: 1, step, data })?;
        Ok(view.row(0).to_vec())
    }

    #[test]
    fn every_encoding_gives_the_same_colours() {
        for (name, data) in [
            ("rgb8", &[1, 2, 3, 4, 5, 6][..]),
            ("bgr8", &[3, 2, 1, 6, 5, 4]),
            ("rgba8", &[1, 2, 3, 9, 4, 5, 6, 9]),
            ("bgra8", &[3, 2, 1, 9, 6, 5, 4, 9]),
        ] {
            assert_eq!(rgb(name, 2, data.len(), data).unwrap(), [1, 2, 3, 4, 5, 6], "{name}");
        }
        assert_eq!(rgb("mono8", 2, 2, &[7, 8]).unwrap(), [7, 7, 7, 8, 8, 8]);
    }

    #[test]
    fn yuv_is_that_of_bt_601() {
        // Colours of the standard's bars at full level: white, black, red and blue.
        let colours = [[235, 128, 128], [16, 128, 128], [81, 90, 240], [41, 240, 110]];
        let expected = [[255; 3], [0; 3], [254, 0, 0], [0, 0, 255]];
        for ([y, u, v], expected) in colours.into_iter().zip(expected) {
            for (name, data) in [("uyvy", [u, y, v, y]), ("yuv422", [u, y, v, y]), ("yuyv", [y, u, y, v])] {
                let found = rgb(name, 2, 4, &data).unwrap();
                let off = found.iter().zip([expected, expected].concat()).map(|(a, b)| a.abs_diff(b)).max();
                assert!(off <= Some(2), "{name} {found:?} {expected:?}");
            }
        }
        // The last pair of an odd row holds one pixel.
        assert_eq!(rgb("yuv422_yuy2", 1, 4, &[16, 128, 99, 128]).unwrap(), [0, 0, 0]);
    }

    #[test]
    fn an_unknown_encoding_and_a_short_image_are_refused() {
        let message = rgb("bayer_rggb8", 2, 2, &[0; 2]).unwrap_err().to_string();
        assert_eq!(message, format!("encoding: expected {TAKEN}, got bayer_rggb8"));
        for (name, step, bytes) in [("bgr8", 6, 5), ("uyvy", 4, 3), ("mono8", 2, 1), ("rgb8", 6, 5)] {
            let message = rgb(name, 2, step, &vec![0; bytes]).unwrap_err().to_string();
            assert!(message.starts_with("data: expected as many bytes"), "{message}");
        }
        for (name, step) in [("bgr8", 5), ("rgb8", 0), ("rgb8", 2)] {
            let message = rgb(name, 2, step, &[0; 6]).unwrap_err().to_string();
            let got = format!("got {step} for a row of 2 pixels, which has 6 bytes");
            assert_eq!(message, format!("step: expected at least the bytes of a row, {got}"));
        }
        let message = rgb("rgb8", 0, 0, &[]).unwrap_err().to_string();
        assert_eq!(message, "size: expected a width and a height of at least one pixel, got 0 x 1 pixels");
    }
}
