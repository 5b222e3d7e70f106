//! Conversion between ROS images and the segmenter's images.

use crate::{EncodedView, Encoding, Error, picture};
use catenary_core::{LabelMask, RgbImage};
use catenary_msgs::sensor_msgs::msg::{CompressedImage, Image};
use catenary_msgs::std_msgs::msg::Header;

/// View of the pixels of a message.
///
/// # Errors
/// [`Error::Image`] with the field that does not fit: an unknown encoding, or one without colours if these are needed.
pub fn view(message: &Image, needs_colour: bool) -> Result<EncodedView<'_>, Error> {
    let encoding = Encoding::of(&message.encoding)?;
    if needs_colour && !encoding.has_colour() {
        let got = message.encoding.clone();
        return Err(Error::Image { field: "encoding", expected: "colours, by which the object is told apart", got });
    }
    let (width, height, step) = (message.width, message.height, message.step as usize);
    Ok(EncodedView { encoding, width, height, step, data: &message.data })
}

/// Pixels of a compressed message, JPEG or PNG.
///
/// # Errors
/// [`Error::Image`] for data that are neither, are damaged or cut short, or hold no colours if these are needed.
pub fn decompressed(message: &CompressedImage, needs_colour: bool) -> Result<RgbImage, Error> {
    let expected = if needs_colour { "a JPEG or PNG image with colours" } else { "a JPEG or PNG image" };
    let bad = |got: String| Error::Image { field: "data", expected, got };
    let decoded = picture::decode(&message.data).map_err(|e| bad(format!("{}: {e}", message.format)))?;
    if needs_colour && !decoded.color().has_color() {
        return Err(bad(format!("{}: brightness alone", message.format)));
    }
    let pixels = decoded.into_rgb8();
    let (width, height) = pixels.dimensions();
    Ok(RgbImage { width, height, data: pixels.into_raw() })
}

/// Mask as a `mono8` message. `header` is that of the segmented image.
#[must_use]
pub fn mask_message(mask: &LabelMask, header: Header) -> Image {
    Image {
        header,
        height: mask.height,
        width: mask.width,
        encoding: "mono8".to_owned(),
        is_bigendian: 0,
        step: mask.width,
        data: mask.data.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_compressed_image_is_decoded_and_a_damaged_one_refused() {
        let pixels = image::RgbImage::from_pixel(4, 2, image::Rgb([40, 90, 200]));
        let mut png = std::io::Cursor::new(Vec::new());
        pixels.write_to(&mut png, image::ImageFormat::Png).unwrap();
        let mut message = CompressedImage {
            format: "rgb8; png compressed".into(),
            data: png.into_inner(),
            ..CompressedImage::default()
        };
        let decoded = decompressed(&message, true).unwrap();
        assert_eq!((decoded.width, decoded.height, &decoded.data[..3]), (4, 2, &[40, 90, 200][..]));
        message.data.truncate(20);
        assert!(decompressed(&message, true).unwrap_err().to_string().starts_with("data: expected a JPEG or PNG"));
    }

    #[test]
    fn an_image_without_colours_is_refused() {
        let mut image =
            Image { width: 2, height: 1, step: 6, encoding: "bgr8".into(), data: vec![0; 6], ..Image::default() };
        assert_eq!(view(&image, true).unwrap().width, 2);
        for encoding in ["mono8", "16UC1"] {
            image.encoding = encoding.into();
            let message = view(&image, true).unwrap_err().to_string();
            assert!(message.starts_with("encoding: expected") && message.ends_with(encoding), "{message}");
        }
        image.encoding = "mono8".into();
        assert_eq!(view(&image, false).unwrap().encoding, Encoding::Mono8);
    }

    #[test]
    fn a_mask_has_the_header_of_its_image() {
        let mut header = Header::default();
        header.stamp.sec = 7;
        let message = mask_message(&LabelMask::new(4, 3), header.clone());
        assert_eq!((message.header, message.step, message.data.len()), (header, 4, 12));
    }
}
