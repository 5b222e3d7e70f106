//! Conversion of ROS images to masks. The shell converts keypoints to messages.

use crate::Error;
use catenary_core::LabelMask;
use catenary_core::camera::MASK_SIZE_PX;
use catenary_msgs::sensor_msgs::msg::Image;

/// Label mask of a square `mono8` message without padding.
///
/// Keypoint messages hold fractions of the mask's sides. A mask that is not square would distort them.
///
/// # Errors
/// [`Error::Parameter`] with the field that does not fit.
pub fn mask(message: &Image) -> Result<LabelMask, Error> {
    if message.encoding != "mono8" {
        return Err(Error::Parameter { field: "encoding", expected: "mono8", got: message.encoding.clone() });
    }
    if message.step != message.width {
        let got = format!("{} for {} columns", message.step, message.width);
        return Err(Error::Parameter { field: "step", expected: "one byte a column", got });
    }
    if message.width != message.height {
        let got = format!("{} x {}", message.width, message.height);
        return Err(Error::Parameter { field: "size", expected: "a square mask", got });
    }
    LabelMask::from_data(message.width, message.height, message.data.clone()).map_err(|e| Error::Parameter {
        field: "data",
        expected: "as many bytes as width and height ask for",
        got: e.to_string(),
    })
}

/// Warning about a mask of an unusual size; none for the usual one. The tracker's parameters are in pixels and were chosen
/// for masks of [`MASK_SIZE_PX`].
#[must_use]
pub fn unusual_size(mask: &LabelMask) -> Option<String> {
    let (width, height) = (mask.width, mask.height);
    (width != MASK_SIZE_PX || height != MASK_SIZE_PX)
        .then(|| format!("size: expected {MASK_SIZE_PX} x {MASK_SIZE_PX} pixels, got {width} x {height}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_complete_square_mono8_images_are_masks() {
        let good =
            Image { width: 3, height: 3, step: 3, encoding: "mono8".into(), data: vec![1; 9], ..Image::default() };
        assert_eq!(mask(&good).unwrap().at(2, 1), 1);
        assert!(unusual_size(&mask(&good).unwrap()).unwrap().contains("got 3 x 3"));
        assert_eq!(unusual_size(&LabelMask::new(MASK_SIZE_PX, MASK_SIZE_PX)), None);
        let error = |change: fn(&mut Image)| {
            let mut bad = good.clone();
            change(&mut bad);
            mask(&bad).unwrap_err().to_string()
        };
        assert!(error(|i| i.encoding = "rgb8".into()).contains("rgb8"));
        assert!(error(|i| i.step = 4).contains("step"));
        assert!(error(|i| i.data.push(0)).contains("data"));
        assert!(error(|i| i.height = 2).contains("got 3 x 2"));
    }
}
