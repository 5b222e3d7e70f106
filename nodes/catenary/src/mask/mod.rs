//! `catenary mask`: what the camera node and the tracker make of images, and colours from a click.

pub mod args;
mod fit;
pub mod frames;
mod other_settings;
mod overlay;
mod plausible;

use crate::exit::{Given, Unseen, WrongInput};
use crate::simulate::video::Video;
use crate::terminal::output;
use anyhow::{Context, Result};
use args::MaskArgs;
use camera::{Backend, SegmentationReport, Segmenter, SegmenterParams};
use catenary_core::{Keypoints, LabelMask, RgbImage};
use catenary_shell::{NodeBuilder, RosArgs, files};
use fit::{Fitted, Kept, fit, parameter_file};
use frames::Frame;
use keypoint_tracker::{KeypointTracker, TrackingParams};
use other_settings::Found;
use plausible::is_sure;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Frames per second of the video.
const VIDEO_RATE_HZ: f64 = 10.0;

/// Result of the command.
#[derive(Debug, Serialize)]
struct Answer {
    images: Vec<Seen>,
    /// Fitted colours by label, `dlo` or `target`.
    fits: Vec<Fitted>,
    /// Other parameters that find the object in images without a sure one.
    other: Option<Found>,
    /// Parameter file that was written.
    params: Option<PathBuf>,
}

/// What was seen in one image. Areas are in mask pixels.
#[derive(Debug, Serialize)]
struct Seen {
    image: String,
    object_found: bool,
    /// Reason for which no object was found.
    reason: Option<String>,
    target_found: bool,
    pieces: usize,
    area_px: usize,
    dropped_px: usize,
    /// Certainty of the object's mask, 0 to 1; 1 for segmenters without probabilities.
    certainty: f32,
    /// Scores of the four keypoints, 0 to 1.
    scores: [f32; 4],
    /// (u, v) of the keypoints in pixels of the image; none if the object was not found.
    keypoints_px: Option<[[f64; 2]; 4]>,
    /// Image with mask and keypoints over it.
    picture: Option<PathBuf>,
}

impl Seen {
    fn is_sure(&self) -> bool {
        is_sure(&self.scores)
    }
}

/// Segments, tracks and draws the images.
pub fn run(arguments: &MaskArgs) -> Result<()> {
    let (mut params, mut tracking, mut kept) = parameters(arguments.params.as_deref())?;
    if let Some(backend) = &arguments.segmenter {
        params.backend = Backend::from_name(backend).context("--segmenter")?;
    }
    if let Some(backend) = &arguments.tracker {
        tracking.backend = keypoint_tracker::Backend::from_name(backend).context("--tracker")?;
    }
    let frames = frames::read(&arguments.source)?;
    let first = frames.first().context("no image")?;
    let mut fits = fit(arguments, first, &mut params)?;
    let (mut segmenter, mut tracker) = build(arguments.params.as_deref(), &params, &tracking)?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string()).given()?;
    }
    let size = [first.image.width, first.image.height];
    let mut video =
        arguments.video.as_deref().map(|file| Video::create(file, file, size, VIDEO_RATE_HZ)).transpose()?;
    let (mut mask, mut images) = (LabelMask::new(1, 1), Vec::new());
    for (number, frame) in frames.iter().enumerate() {
        let in_frame = || frame.name.clone();
        let report = segmenter.segment(frame.image.view(), &mut mask).with_context(in_frame).given()?;
        let keypoints = tracker.track(&mask)?;
        let square =
            params.colours.crop.square(frame.image.width, frame.image.height).with_context(in_frame).given()?;
        if number == 0 {
            fits.iter_mut().for_each(|fit| fit.judge(arguments, &mask, square));
        }
        let drawn = overlay::draw(&frame.image, square, &mask, &keypoints);
        let picture = arguments.out.as_deref().map(|folder| write(&drawn, folder, number, frame)).transpose()?;
        if let Some(video) = &mut video {
            push(video, &drawn, size, &frame.name)?;
        }
        let seen = seen(frame, &report, &keypoints, square, mask.width);
        images.push(Seen { picture, ..seen });
    }
    if let Some(video) = video {
        video.finish()?;
    }
    let other_build = |params: &SegmenterParams| {
        build(arguments.params.as_deref(), params, &tracking).map(|(segmenter, _)| segmenter)
    };
    for (image, frame) in images.iter_mut().zip(&frames).filter(|(image, _)| !image.object_found) {
        image.reason = Some(other_settings::reason(frame, &params, other_build));
    }
    let unsure: Vec<&Frame> =
        images.iter().zip(&frames).filter(|(image, _)| !image.is_sure()).map(|(_, frame)| frame).collect();
    let other = other_settings::search(&unsure, &params, other_build, &mut *tracker);
    // A setting that finds the object surely in some images stays.
    let replaces = unsure.len() == frames.len();
    if let Some(other) = other.as_ref().filter(|_| replaces) {
        other.apply(&mut params, &mut kept);
    }
    let written = parameter_file(&params, tracking.backend, &kept);
    let file = match &arguments.out {
        Some(folder) if !fits.is_empty() || (other.is_some() && replaces) => {
            let file = folder.join("params.yaml");
            files::write(&file, &written)?;
            Some(file)
        }
        _ => None,
    };
    let answer = Answer { images, fits, other, params: file };
    output::result(&arguments.output, &answer, |answer| words(answer, &written))?;
    answer.verdict()
}

/// Adds a drawn image to the video.
fn push(video: &mut Video, drawn: &RgbImage, size: [u32; 2], name: &str) -> Result<()> {
    if [drawn.width, drawn.height] != size {
        let [w, h] = size;
        return Err(WrongInput::error(format!(
            "--video: expected images of {w} x {h} pixels as the first, got another in {name}"
        )));
    }
    video.push(drawn)
}

/// Contents of an image, without a picture.
fn seen(frame: &Frame, report: &SegmentationReport, keypoints: &Keypoints, square: [f64; 3], mask_px: u32) -> Seen {
    let scale = square[2] / f64::from(mask_px);
    Seen {
        image: frame.name.clone(),
        object_found: report.dlo_area_px > 0,
        reason: None,
        target_found: report.target_area_px > 0,
        pieces: report.dlo_pieces,
        area_px: report.dlo_area_px,
        dropped_px: report.dropped_px,
        certainty: report.certainty,
        scores: keypoints.scores,
        keypoints_px: keypoints
            .dlo_seen()
            .then(|| keypoints.dlo_px.map(|[u, v]| [square[0] + scale * u, square[1] + scale * v])),
        picture: None,
    }
}

impl Answer {
    /// Fails if the object was found in no image, or if the fitted colours are hardly those of an object.
    fn verdict(&self) -> Result<()> {
        let doubt = self.fits.iter().find_map(Fitted::doubt);
        let reason = if self.images.iter().any(|image| image.object_found) {
            doubt
        } else {
            Some(format!("no object in {} of {} images", self.images.len(), self.images.len()))
        };
        reason.map_or(Ok(()), |reason| Err(Unseen(reason).into()))
    }
}

/// Values of the two nodes' parameters in a file, or their defaults. Also returns what the file itself gives.
pub fn parameters(file: Option<&Path>) -> Result<(SegmenterParams, TrackingParams, Kept)> {
    let words: Vec<String> = match file {
        Some(file) => vec!["--ros-args".to_owned(), "--params-file".to_owned(), file.display().to_string()],
        None => Vec::new(),
    };
    let (arguments, _) = RosArgs::parse(words).given()?;
    let params = named(file, camera::node::declare(&NodeBuilder::new("camera", &arguments)?))?;
    let tracking = named(file, keypoint_tracker::node::declare(&NodeBuilder::new("keypoint_tracker", &arguments)?))?;
    let given = |node| arguments.params_for("", node).into_iter().map(|p| (p.name.clone(), p.value.clone())).collect();
    Ok((params, tracking, ["camera", "keypoint_tracker"].map(given)))
}

/// Segmenter and tracker of the parameters from a file, or of the defaults.
pub fn build(
    file: Option<&Path>,
    params: &SegmenterParams,
    tracking: &TrackingParams,
) -> Result<(Box<dyn Segmenter + Send>, Box<dyn KeypointTracker + Send>)> {
    let segmenter = named(file, camera::node::build(params))?;
    Ok((segmenter, named(file, tracking.build().map_err(Into::into))?))
}

/// Names the file of the parameters in an error that does not say it.
fn named<T>(file: Option<&Path>, result: Result<T>) -> Result<T> {
    let name = file.map(|f| f.display().to_string());
    result
        .map_err(|error| match name {
            Some(name) if !format!("{error:#}").contains(&name) => error.context(name),
            _ => error,
        })
        .given()
}

/// Writes an image to the folder, and returns its path.
fn write(image: &RgbImage, folder: &Path, number: usize, frame: &Frame) -> Result<PathBuf> {
    let stem = Path::new(&frame.name).file_stem().map(|s| s.to_string_lossy().replace(' ', "_")).unwrap_or_default();
    let file = folder.join(format!("{number:03}_{stem}.png"));
    image::save_buffer(&file, &image.data, image.width, image.height, image::ExtendedColorType::Rgb8)
        .with_context(|| file.display().to_string())?;
    Ok(file)
}

/// Text for the terminal.
fn words(answer: &Answer, params: &str) -> String {
    let mut lines = Vec::new();
    lines.extend(answer.fits.iter().map(Fitted::words));
    match &answer.params {
        Some(file) => lines.push(format!("parameters: {}", file.display())),
        // Without a folder, the file is shown.
        None if !answer.fits.is_empty() || answer.images.iter().all(|s| !s.is_sure()) && answer.other.is_some() => {
            lines.push(params.trim_end().to_owned())
        }
        None => {}
    }
    for seen in &answer.images {
        let found = match seen.object_found {
            false => format!("NO OBJECT: {}", seen.reason.as_deref().unwrap_or("no reason is known")),
            true => {
                let pieces = if seen.pieces == 1 { "1 piece".to_owned() } else { format!("{} pieces", seen.pieces) };
                let scores: Vec<String> = seen.scores.iter().map(|s| format!("{s:.2}")).collect();
                let doubt = if seen.is_sure() { "" } else { ", DOUBTFUL" };
                format!("object in {pieces}, {} px, scores {}{doubt}", seen.area_px, scores.join(" "))
            }
        };
        let target = if seen.target_found { "target" } else { "no target" };
        let picture = seen.picture.as_ref().map(|p| format!("; {}", p.display())).unwrap_or_default();
        lines.push(format!(
            "{}: {found}; {target}; {} px of the same colours dropped{picture}",
            seen.image, seen.dropped_px
        ));
    }
    let found = answer.images.iter().filter(|s| s.object_found).count();
    let sure = answer.images.iter().filter(|s| s.is_sure()).count();
    if answer.images.len() > 1 {
        lines.push(format!("object in {found} of {} images, keypoints sure in {sure}", answer.images.len()));
    }
    lines.extend(answer.other.as_ref().map(Found::words));
    lines.join("\n")
}
