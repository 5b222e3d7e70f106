//! Pictures in JPEG or PNG. A picture is decoded whole or refused: the usual decoders fill what is missing of a JPEG with grey,
//! and an object in half a picture would be taken for a short one.

use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Longest side of a picture in pixels; a larger one is no camera's.
pub const LONGEST_SIDE_PX: u32 = 8192;

/// Decodes a picture, whatever its name or message says of the format. A JPEG that lost bytes in its middle alone is not
/// recognised: nothing in it tells their number.
///
/// # Errors
/// Reason in words: neither JPEG nor PNG, damaged, cut short, or larger than [`LONGEST_SIDE_PX`].
pub fn decode(data: &[u8]) -> Result<DynamicImage, String> {
    match image::guess_format(data) {
        Ok(ImageFormat::Jpeg) => jpeg(data),
        Ok(format) => image::load_from_memory_with_format(data, format).map_err(|e| e.to_string()),
        Err(e) => Err(e.to_string()),
    }
}

fn jpeg(data: &[u8]) -> Result<DynamicImage, String> {
    let side = LONGEST_SIDE_PX as usize;
    let options = DecoderOptions::default().set_max_width(side).set_max_height(side).set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(data), options);
    let damaged = |e: &dyn std::fmt::Display| format!("a JPEG that is damaged or cut short: {e}");
    decoder.decode_headers().map_err(|e| damaged(&e))?;
    let is_grey = matches!(decoder.input_colorspace(), Some(ColorSpace::Luma | ColorSpace::LumaA));
    let out = if is_grey { ColorSpace::Luma } else { ColorSpace::RGB };
    decoder.set_options(options.jpeg_set_out_colorspace(out));
    let pixels = decoder.decode().map_err(|e| damaged(&e))?;
    let (width, height) = decoder
        .dimensions()
        .and_then(|(w, h)| Some((u32::try_from(w).ok()?, u32::try_from(h).ok()?)))
        .unwrap_or_default();
    let decoded = match is_grey {
        true => GrayImage::from_raw(width, height, pixels).map(DynamicImage::from),
        false => RgbImage::from_raw(width, height, pixels).map(DynamicImage::from),
    };
    decoded.ok_or_else(|| "a JPEG without pixels".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// Picture whose every part differs, so that no part can be guessed from another.
    fn picture() -> RgbImage {
        RgbImage::from_fn(160, 120, |u, v| image::Rgb([(u * 7 % 256) as u8, (v * 5 % 256) as u8, (u * v % 251) as u8]))
    }

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let mut data = Cursor::new(Vec::new());
        picture().write_to(&mut data, format).unwrap();
        data.into_inner()
    }

    /// Frame of motion JPEG as some cameras send it: with the mark `AVI1`, and without the tables of codes, which every receiver
    /// knows.
    fn motion_frame(jpeg: &[u8]) -> Vec<u8> {
        let [tables, pixels] = [0xC4, 0xDA];
        let (mut out, mut at) = (jpeg[..2].to_vec(), 2);
        out.extend([0xFF, 0xE0, 0, 16]);
        out.extend(b"AVI1\0\0\0\0\0\0\0\0\0\0");
        loop {
            let (mark, length) = (jpeg[at + 1], 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]])));
            if mark == pixels {
                out.extend_from_slice(&jpeg[at..]);
                return out;
            }
            if mark != tables && mark != 0xE0 {
                out.extend_from_slice(&jpeg[at..at + length]);
            }
            at += length;
        }
    }

    #[test]
    fn whole_pictures_are_decoded() {
        let whole = image::load_from_memory(&encoded(ImageFormat::Jpeg)).unwrap();
        assert_eq!(decode(&encoded(ImageFormat::Jpeg)).unwrap(), whole);
        assert_eq!(decode(&encoded(ImageFormat::Png)).unwrap().into_rgb8(), picture());
        let mut grey = Cursor::new(Vec::new());
        DynamicImage::from(picture()).into_luma8().write_to(&mut grey, ImageFormat::Jpeg).unwrap();
        assert!(!decode(&grey.into_inner()).unwrap().color().has_color());
        // Bytes behind the end are a buffer's, and a lost mark of the end costs no pixel.
        let mut longer = encoded(ImageFormat::Jpeg);
        longer.extend([0; 100]);
        assert_eq!(decode(&longer).unwrap(), whole);
        longer.truncate(longer.len() - 102);
        assert_eq!(decode(&longer).unwrap(), whole);
    }

    #[test]
    fn a_picture_that_is_cut_short_is_refused() {
        for format in [ImageFormat::Jpeg, ImageFormat::Png] {
            let whole = encoded(format);
            for share in [0.1, 0.3, 0.5, 0.75, 0.9, 0.97] {
                let part = &whole[..(whole.len() as f64 * share) as usize];
                assert!(decode(part).is_err(), "{format:?}: {share} of the bytes");
            }
        }
        for nothing in [&[][..], &encoded(ImageFormat::Jpeg)[..2], &[0; 500]] {
            assert!(decode(nothing).is_err());
        }
    }

    #[test]
    fn a_frame_of_motion_jpeg_is_decoded_whole_or_refused() {
        let frame = motion_frame(&encoded(ImageFormat::Jpeg));
        assert_eq!(decode(&frame).unwrap(), decode(&encoded(ImageFormat::Jpeg)).unwrap());
        for share in [0.3, 0.6, 0.95] {
            assert!(decode(&frame[..(frame.len() as f64 * share) as usize]).is_err(), "{share} of the bytes");
        }
    }
}
