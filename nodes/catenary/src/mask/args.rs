//! Arguments of `mask`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// Images from pictures, a bag or the running camera.
#[derive(Debug, Args)]
pub struct SourceArgs {
    /// Pictures, PNG or JPEG
    #[arg(value_name = "PICTURE", required_unless_present_any = ["bag", "live"])]
    pub pictures: Vec<PathBuf>,
    /// Bag with images, in place of pictures
    #[arg(long, conflicts_with_all = ["pictures", "live"])]
    pub bag: Option<PathBuf>,
    /// Images of the running camera, in place of pictures
    #[arg(long, conflicts_with = "pictures")]
    pub live: bool,
    /// Topic of a bag or of the camera; compressed images are known by their type, or by a name that ends in /compressed
    #[arg(long, default_value = catenary_shell::contract::IMAGE.name)]
    pub topic: String,
    /// Number of images of a bag, spread over it, or of the camera
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub frames: u32,
    /// Seconds to wait for an image of the camera
    #[arg(long, default_value_t = 10.0, requires = "live")]
    pub wait_s: f64,
}

/// `catenary mask`.
#[derive(Debug, Args)]
pub struct MaskArgs {
    /// Images to look at
    #[command(flatten)]
    pub source: SourceArgs,
    /// Parameter file with the present colours, as `launch` reads it; default: those of the nodes
    #[arg(long)]
    pub params: Option<PathBuf>,
    /// Segmenter; default: that of the parameter file
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(camera::Backend::ALL.map(camera::Backend::name)))]
    pub segmenter: Option<String>,
    /// Tracker; default: that of the parameter file
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(keypoint_tracker::Backend::ALL.map(keypoint_tracker::Backend::name)))]
    pub tracker: Option<String>,
    /// Pixel on the object in the first image, as U,V: fits the object's colours; several may be given
    #[arg(long, value_name = "U,V", value_parser = place)]
    pub click: Vec<[u32; 2]>,
    /// Pixel on the target in the first image: fits the target's colours
    #[arg(long, value_name = "U,V", value_parser = place)]
    pub click_target: Vec<[u32; 2]>,
    /// Picture of the size of the first image that is white where the object is: fits the object's colours
    #[arg(long, conflicts_with = "click")]
    pub labels: Option<PathBuf>,
    /// Folder for the images with mask and keypoints, and for the fitted parameters
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Video of the images with mask and keypoints: NAME.gif, or NAME.mp4 if ffmpeg is installed
    #[arg(long)]
    pub video: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// Parses a place in an image.
fn place(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once(',').and_then(|(u, v)| Some([u.trim().parse().ok()?, v.trim().parse().ok()?]));
    parts.ok_or_else(|| "expected U,V: column and row of a pixel, as whole numbers from 0".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_two_whole_numbers() {
        assert_eq!(place("12, 7"), Ok([12, 7]));
        for bad in ["", "12", "1.5,2", "-1,2", "1,2,3"] {
            assert!(place(bad).is_err(), "{bad}");
        }
    }
}
