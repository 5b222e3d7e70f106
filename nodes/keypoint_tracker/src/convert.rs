//! From wire images to the tracker's masks. Keypoints go out by the shell's conversion.

use crate::Error;
use catenary_core::LabelMask;
use catenary_msgs::sensor_msgs::msg::Image;

/// The label mask of a `mono8` message without padding.
///
/// # Errors
/// [`Error::Parameter`] naming the field that does not fit.
pub fn mask(message: &Image) -> Result<LabelMask, Error> {
    if message.encoding != "mono8" {
        return Err(Error::Parameter { field: "encoding", expected: "mono8", got: message.encoding.clone() });
    }
    if message.step != message.width {
        let got = format!("{} for {} columns", message.step, message.width);
        return Err(Error::Parameter { field: "step", expected: "one byte a column", got });
    }
    LabelMask::from_data(message.width, message.height, message.data.clone()).map_err(|e| Error::Parameter {
        field: "data",
        expected: "as many bytes as width and height ask for",
        got: e.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_mono8_images_are_masks() {
        let good =
            Image { width: 3, height: 2, step: 3, encoding: "mono8".into(), data: vec![1; 6], ..Image::default() };
        assert_eq!(mask(&good).unwrap().at(2, 1), 1);
        let error = |change: fn(&mut Image)| {
            let mut bad = good.clone();
            change(&mut bad);
            mask(&bad).unwrap_err().to_string()
        };
        assert!(error(|i| i.encoding = "rgb8".into()).contains("rgb8"));
        assert!(error(|i| i.step = 4).contains("step"));
        assert!(error(|i| i.data.push(0)).contains("data"));
    }
}
