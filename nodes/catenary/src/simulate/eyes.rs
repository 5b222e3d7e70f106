//! Keypoints of pictures, by segmenter and tracker as the nodes run them.

use crate::exit::WrongInput;
use crate::mask;
use anyhow::Result;
use camera::{Crop, Segmenter};
use catenary_core::statistics::{mean, median};
use catenary_core::{Camera, KeypointOrder, Keypoints, LabelMask, Model, RgbImage};
use keypoint_tracker::KeypointTracker;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Distance of a wrong keypoint from its place, in lengths of the object.
const WRONG: f64 = 0.05;
/// Score from which keypoints count as sure.
const SURE: f32 = 0.5;

/// Keypoints of a frame beside the exact ones: their greatest error in lengths, and their least score.
type Seen = (f64, f32);

/// Segmenter and tracker of a parameter file.
pub struct Eyes {
    segmenter: Box<dyn Segmenter + Send>,
    tracker: Box<dyn KeypointTracker + Send>,
    mask: LabelMask,
    /// True if the bag holds the pictures, too.
    pub are_recorded: bool,
    /// Part of the length between the first and the last keypoint.
    span: f64,
    times_s: Vec<[f64; 2]>,
    /// Each frame; none if the object was not found.
    frames: Vec<Option<Seen>>,
}

/// Agreement of the keypoints of the pictures with those of the object.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Sight {
    /// Frames of the camera.
    pub frames: usize,
    /// Share of the frames in which the object was not found, or a keypoint was more than 5 % of the length off.
    pub failures: f64,
    /// Share of the frames with a wrong keypoint and scores of 0.5 or more.
    pub silent: f64,
    /// Median of the frames' greatest errors, in lengths.
    pub median_error_lengths: f64,
    /// Mean time of segmentation and of tracking in ms, on this machine beside the simulation.
    pub ms: [f64; 2],
}

impl Eyes {
    /// Builds segmenter and tracker for a model.
    pub fn new(file: &Path, are_recorded: bool, model: &Model) -> Result<Self> {
        let (params, tracking, _) = mask::parameters(Some(file))?;
        if params.colours.crop != Crop::CentredSquare {
            return Err(WrongInput::error(format!(
                "{}: crop_px: expected none: the pictures of a simulation are cropped to the square in their middle",
                file.display()
            )));
        }
        if let Camera::Plane(p) = model.camera.view
            && (p.roll_rad, p.distortion_k1) != (0.0, 0.0)
        {
            return Err(WrongInput::error(format!(
                "--eyes: expected a camera without roll_rad and distortion_k1 in the plane view of model `{}`, which the pictures do not show",
                model.name
            )));
        }
        let fractions = model.object.keypoint_fractions;
        let (segmenter, tracker) = mask::build(Some(file), &params, &tracking)?;
        let mask = LabelMask::new(1, 1);
        let span = fractions[3] - fractions[0];
        Ok(Self { segmenter, tracker, mask, are_recorded, span, times_s: Vec::new(), frames: Vec::new() })
    }

    /// Keypoints of a picture. `exact_px` are the true ones in mask pixels; a frame without them does not count.
    pub fn keypoints(&mut self, picture: &RgbImage, exact_px: Option<[[f64; 2]; 4]>) -> Result<Keypoints> {
        let began = Instant::now();
        self.segmenter.segment(picture.view(), &mut self.mask)?;
        let segmented = began.elapsed().as_secs_f64();
        let seen = self.tracker.track(&self.mask)?;
        self.times_s.push([segmented, began.elapsed().as_secs_f64() - segmented]);
        if let Some(exact) = exact_px {
            self.frames.push(seen.dlo_seen().then(|| self.error(&seen, exact)));
        }
        Ok(seen)
    }

    /// Greatest error of the keypoints in lengths, and their least score.
    fn error(&self, seen: &Keypoints, exact: [[f64; 2]; 4]) -> Seen {
        let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let length = exact.windows(2).map(|p| distance(p[0], p[1])).sum::<f64>() / self.span;
        let order = KeypointOrder::Unknown.closest(&seen.dlo_px, &exact);
        let off = order.iter().zip(exact).map(|(&i, p)| distance(seen.dlo_px[i], p)).fold(0.0, f64::max);
        (off / length, seen.scores.iter().copied().fold(f32::MAX, f32::min))
    }

    /// Agreement in the frames until now; none without a frame.
    pub fn sight(&self) -> Option<Sight> {
        let share = |is: &dyn Fn(&Option<Seen>) -> bool| {
            self.frames.iter().filter(|f| is(f)).count() as f64 / self.frames.len() as f64
        };
        let wrong = |f: &Option<Seen>| !f.is_some_and(|(error, _)| error <= WRONG);
        let mut errors: Vec<f64> = self.frames.iter().flatten().map(|(error, _)| *error).collect();
        let time = |k: usize| 1e3 * mean(&self.times_s.iter().map(|t| t[k]).collect::<Vec<f64>>());
        (!self.frames.is_empty()).then(|| Sight {
            frames: self.frames.len(),
            failures: share(&wrong),
            silent: share(&|f| wrong(f) && f.is_some_and(|(_, score)| score >= SURE)),
            median_error_lengths: median(&mut errors),
            ms: [time(0), time(1)],
        })
    }
}
