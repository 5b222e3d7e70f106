//! Conversion between ROS images and the segmenter's images.

use crate::Error;
use catenary_core::{LabelMask, RgbView};
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_msgs::std_msgs::msg::Header;

/// View of the pixels of an `rgb8` message.
///
/// # Errors
/// [`Error::Image`] with the field that does not fit: the encoding, or fewer bytes than width, height and step need.
pub fn rgb_view(message: &Image) -> Result<RgbView<'_>, Error> {
    if message.encoding != "rgb8" {
        return Err(Error::Image { field: "encoding", expected: "rgb8", got: message.encoding.clone() });
    }
    RgbView::new(message.width, message.height, message.step as usize, &message.data).map_err(|e| Error::Image {
        field: "data",
        expected: "as many bytes as width, height and step ask for",
        got: e.to_string(),
    })
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
    fn only_complete_rgb8_images_are_accepted() {
        let mut image =
            Image { width: 2, height: 1, step: 6, encoding: "rgb8".into(), data: vec![0; 6], ..Image::default() };
        assert_eq!(rgb_view(&image).unwrap().width(), 2);
        image.data.pop();
        assert!(rgb_view(&image).unwrap_err().to_string().contains("data"));
        image.encoding = "bgr8".into();
        assert!(rgb_view(&image).unwrap_err().to_string().contains("bgr8"));
    }

    #[test]
    fn a_mask_has_the_header_of_its_image() {
        let mut header = Header::default();
        header.stamp.sec = 7;
        let message = mask_message(&LabelMask::new(4, 3), header.clone());
        assert_eq!((message.header, message.step, message.data.len()), (header, 4, 12));
    }
}
