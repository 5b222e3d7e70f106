//! `catenary label` and `catenary train-segmenter`: weights of the learned segmenter.

pub mod args;
mod dataset;
mod frames;
mod outline;

use crate::exit::Given;
use crate::kept::Kept;
use crate::mask;
use crate::terminal::{output, training};
use anyhow::{Context, Result};
use args::{LabelArgs, TrainSegmenterArgs};
use camera::learned::{SHIPPED_TRAINING, Start, Stopped, TrainingSettings, bytes_of, shipped_weights};
use camera::{Crop, Error};
use catenary_core::{LabelMask, RgbImage, identity};
use catenary_shell::Shutdown;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Version of the training method. A change of it invalidates saved states.
const METHOD: u32 = 1;
/// Steps and greatest rate of a further training.
const FURTHER_STEPS: u32 = 400;
const FURTHER_RATE: f32 = 5e-4;

/// Result of `catenary label`.
#[derive(Debug, Serialize)]
struct Labelled {
    folder: PathBuf,
    frames: usize,
    /// Frames in which the segmenter found no object.
    empty: usize,
}

/// Form of labelled frames.
struct Form {
    prepare: fn(&Path) -> Result<()>,
    /// Adds a frame of this number.
    add: fn(&Path, usize, &RgbImage, &LabelMask) -> Result<()>,
    /// Next work of the user in FOLDER.
    next: &'static str,
}

/// Frames for `train-segmenter`.
const FRAMES: Form = Form {
    prepare: frames::prepare,
    add: frames::write,
    next: "correct NNN_mask.png in a paint program: white is the object, grey the target, black the rest\nthen: catenary train-segmenter --frames FOLDER --out weights.bin",
};

/// Data set for the training of a YOLOv8-seg network.
const YOLO: Form = Form {
    prepare: dataset::prepare,
    add: dataset::add,
    next: "correct the polygons, in a program that reads YOLO labels, before a training",
};

/// Writes the square in the middle of each image, and its labels by the chosen segmenter.
pub fn label(arguments: &LabelArgs) -> Result<()> {
    let (mut params, ..) = mask::parameters(arguments.params.as_deref())?;
    // The written frames are the crop.
    let crop = std::mem::replace(&mut params.colours.crop, Crop::CentredSquare);
    let mut segmenter = camera::node::build(&params).given()?;
    let out = &arguments.out;
    let form = if arguments.yolo { YOLO } else { FRAMES };
    (form.prepare)(out)?;
    let (mut mask, mut empty) = (LabelMask::new(1, 1), 0);
    let read = mask::frames::read(&arguments.source)?;
    for (number, frame) in read.iter().enumerate() {
        let named = || frame.name.clone();
        let square = crop.square(frame.image.width, frame.image.height).with_context(named).given()?;
        let image = frames::cut(&frame.image, square);
        let report = segmenter.segment(image.view(), &mut mask).with_context(named).given()?;
        empty += usize::from(report.dlo_area_px == 0);
        (form.add)(out, number, &image, &mask)?;
    }
    let labelled = Labelled { folder: arguments.out.clone(), frames: read.len(), empty };
    output::result(&arguments.output, &labelled, |l| {
        let folder = l.folder.display();
        let empty = if l.empty > 0 { format!("; the segmenter found no object in {}", l.empty) } else { String::new() };
        format!("{} frames in {folder}{empty}\n{}", l.frames, form.next.replace("FOLDER", &folder.to_string()))
    })
}

/// Result of `catenary train-segmenter`.
#[derive(Debug, Serialize)]
struct Trained {
    weights: PathBuf,
    steps: usize,
    frames: usize,
    /// Mean loss of the last tenth of the steps.
    loss: f64,
    wall_s: f64,
}

/// Trains the segmenter. Ctrl-C ends the training, and keeps the state from which `--resume` goes on.
pub fn train(arguments: &TrainSegmenterArgs) -> Result<()> {
    let began = Instant::now();
    let frames = arguments.frames.as_deref().map(frames::read).transpose()?.unwrap_or_default();
    let start = match &arguments.start {
        Some(file) => Some(camera::node::read_weights(file).given()?),
        None => (!frames.is_empty()).then(shipped_weights),
    };
    let usual = SHIPPED_TRAINING;
    let steps = arguments.steps.unwrap_or(if frames.is_empty() { usual.steps as u32 } else { FURTHER_STEPS }) as usize;
    // A high rate would forget the start.
    let rate = if start.is_some() { FURTHER_RATE } else { usual.rate };
    let threads = arguments.threads.map_or_else(catenary_simulator::workers::available, |t| t as usize);
    let settings = TrainingSettings { steps, rate, threads, seed: arguments.seed, ..usual };
    output::prepare(&arguments.out)?;
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    // The number of threads changes no bit.
    let asked = (env!("CARGO_PKG_VERSION"), METHOD, format!("{:?}", TrainingSettings { threads: 0, ..settings }));
    let kept = Kept::beside(&arguments.out, identity::fingerprint(&(asked, &start, &frames)));
    let start = match (training::begun(arguments.resume, &kept, settings.steps)?, start) {
        (Some(begun), _) => Start::Begun(begun),
        (None, Some(weights)) => Start::Weights(weights),
        (None, None) => Start::Random,
    };
    let (weights, loss) = training::watch(settings.steps, &kept, &shutdown, |tell| {
        match camera::learned::train(&settings, start, &frames, tell) {
            Err(Error::Training(Stopped::Interrupted(begun))) => Ok(Err(begun)),
            other => other.given().map(Ok),
        }
    })?;
    catenary_shell::files::write(&arguments.out, bytes_of(&weights))?;
    kept.remove();
    let trained = Trained {
        weights: arguments.out.clone(),
        steps: settings.steps,
        frames: frames.len(),
        loss,
        wall_s: began.elapsed().as_secs_f64(),
    };
    output::result(&arguments.output, &trained, |t| {
        format!(
            "{} steps in {:.0} s, loss {:.3}\nweights: {}\nuse: parameters `segmenter: learned` and `weights` of the camera node",
            t.steps,
            t.wall_s,
            t.loss,
            t.weights.display()
        )
    })
}
