//! ROS node: publishes a mask for every image.

mod onnx;

use self::onnx::OnnxNetwork;
use crate::learned::{Weights, weights_of};
use crate::yolo::{YoloNetwork, YoloParams};
use crate::{
    Backend, ColourParams, ColourRange, Converter, Crop, Error, LightReference, Segmenter, SegmenterParams, Sight,
    convert,
};
use anyhow::{Context, Result};
use catenary_core::{LabelMask, RgbView};
use catenary_msgs::sensor_msgs::msg::{CompressedImage, Image};
use catenary_msgs::std_msgs::msg::Header;
use catenary_shell::{
    Clock, Flaw, Health, Intake, Names, NodeBuilder, ParamSpec, Publisher, StampCheck, Throttle, contract, stamp,
};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time without an image after which the node reports a fault: the time that a policy waits for fresh data by default.
const SILENCE: Duration = Duration::from_secs(1);
/// Largest difference between an image's stamp and the node's clock. It is only reported; policies discard data that are
/// far younger (`max_age_s`).
const STAMP_LIMIT: Duration = Duration::from_secs(1);
/// Shortest time between two warnings about the same thing.
const COMPLAIN: Duration = Duration::from_secs(5);

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("camera", args, run)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let builder = builder.declare_lock_step()?;
    let params = declare(&builder)?;
    let (segmenter, needs_colour) = (build(&params)?, params.backend.needs_colour());
    let compressed =
        ParamSpec::new("Take compressed images (JPEG or PNG), of the topic's name with /compressed behind it.");
    let compressed = builder.declare_bool("compressed", false, compressed.read_only())?.get();
    let node = builder.build()?;
    let names = Names { one: "image", many: "images" };
    let topic = if compressed { &format!("{}/compressed", contract::IMAGE.name) } else { contract::IMAGE.name };
    let intake = if compressed {
        node.intake::<CompressedImage>(topic, contract::IMAGE.qos, names, SILENCE)?
    } else {
        node.intake::<Image>(topic, contract::IMAGE.qos, names, SILENCE)?
    };
    intake.need(true);
    let sight = Arc::new(Mutex::new(Sight::default()));
    let mut eye = Eye {
        segmenter,
        mask: LabelMask::new(1, 1),
        masks: node.publisher::<Image>(contract::MASK.name, contract::MASK.qos)?,
        intake: intake.clone(),
        clock: node.clock().clone(),
        stamps: StampCheck::new(STAMP_LIMIT),
        nothing: Throttle::new(COMPLAIN),
        sight: Arc::clone(&sight),
    };
    let flaw = |error: Error| Flaw::new(error.kind(), error);
    let mut converter = Converter::default();
    let _images = if compressed {
        node.take::<CompressedImage>(&intake, move |received| {
            let image = convert::decompressed(&received.message, needs_colour).map_err(flaw)?;
            eye.see(&received.message.header, image.view()).map_err(flaw)
        })?
    } else {
        node.take::<Image>(&intake, move |received| {
            let view = convert::view(&received.message, needs_colour).map_err(flaw)?;
            eye.see(&received.message.header, converter.rgb(view).map_err(flaw)?).map_err(flaw)
        })?
    };
    node.report_diagnostics(move |report| {
        let Some(seen) = sight.lock().unwrap_or_else(PoisonError::into_inner).take() else { return };
        let share = |share: f64| format!("{share:.4}");
        report.value("object_found_share", share(seen.found)).value("object_pieces", format!("{:.2}", seen.pieces));
        report.value("object_share_of_mask", share(seen.object)).value("target_found_share", share(seen.target));
        report.value("dropped_share_of_mask", share(seen.dropped));
        for doubt in &seen.doubts {
            report.problem(Health::Warn, doubt);
        }
    })?;
    node.wait_for_shutdown()
}

/// Segmenter between the images and the masks.
struct Eye {
    segmenter: Box<dyn Segmenter + Send>,
    mask: LabelMask,
    masks: Publisher<Image>,
    intake: Intake,
    clock: Clock,
    stamps: StampCheck,
    /// Warnings about images without the object.
    nothing: Throttle,
    sight: Arc<Mutex<Sight>>,
}

impl Eye {
    /// Publishes the mask of an image.
    fn see(&mut self, header: &Header, image: RgbView<'_>) -> Result<(), Error> {
        let report = self.segmenter.segment(image, &mut self.mask)?;
        // A mask with a doubtful stamp is still published: consumers judge its age themselves.
        self.intake.check_stamp(&mut self.stamps, stamp::from_msg(&header.stamp));
        self.sight.lock().unwrap_or_else(PoisonError::into_inner).add(&report, self.mask.data.len());
        if report.dlo_area_px == 0
            && let Some(held_back) = self.nothing.pass(self.clock.now())
        {
            tracing::warn!("no object in the image ({held_back} more images without one)");
        }
        self.masks.send(convert::mask_message(&self.mask, header.clone()));
        Ok(())
    }
}

/// Declares the segmenter's parameters, and returns their values. They are read-only: new colours in the middle of an episode would
/// change the meaning of its measurements.
///
/// # Errors
/// A value out of its range.
pub fn declare(builder: &NodeBuilder) -> Result<SegmenterParams> {
    let d = SegmenterParams::default();
    let names = Backend::ALL.map(Backend::name);
    let spec =
        "Segmenter: `colour` by thresholds, `learned` by a network that is told the colour, `yolo` by one of yours.";
    let spec = ParamSpec::new(spec).choices(&names).read_only();
    let name = builder.declare_string("segmenter", d.backend.name(), spec)?.get();
    let clicked = [("dlo", d.clicked[0]), ("target", d.clicked[1])].map(|(label, d)| clicked(builder, label, d));
    let [object, target] = clicked;
    let least =
        ParamSpec::new("Least probability of a label, for the learned segmenter.").range(0.01..=0.99).read_only();
    let least = builder.declare_f64("min_probability", f64::from(d.min_probability), least)?.get();
    let certain = ParamSpec::new(
        "Least certainty of the object's mask, for the learned segmenter; an object with less counts as not found.",
    );
    let certain =
        builder.declare_f64("min_certainty", f64::from(d.min_certainty), certain.range(0.0..=1.0).read_only())?.get();
    let weights =
        "File of the learned segmenter's weights, as `catenary train-segmenter` writes; empty: those that are shipped.";
    let weights = builder.declare_string("weights", "", ParamSpec::new(weights).read_only())?.get();
    Ok(SegmenterParams {
        backend: Backend::from_name(&name).context("parameter segmenter")?,
        colours: colours(builder)?,
        clicked: [object?, target?],
        light: light(builder)?,
        min_probability: least as f32,
        min_certainty: certain as f32,
        yolo: yolo(builder)?,
        weights: if weights.is_empty() { None } else { Some(read_weights(&weights)?) },
    })
}

/// Builds the chosen segmenter, with the network of `yolo` from its file.
///
/// # Errors
/// A value out of its range; a file of weights, of a network or of its runtime that cannot be used.
pub fn build(params: &SegmenterParams) -> Result<Box<dyn Segmenter + Send>> {
    params.build(|yolo| Ok(Box::new(OnnxNetwork::load(yolo)?) as Box<dyn YoloNetwork + Send>))
}

/// Weights in a file.
///
/// # Errors
/// A file that cannot be read, or that holds weights of another network.
pub fn read_weights(file: impl AsRef<Path>) -> Result<Weights> {
    let file = file.as_ref();
    let bytes = catenary_shell::files::read_bytes("weights", file)?;
    weights_of(&bytes).with_context(|| format!("weights {}", file.display()))
}

/// Colour of a label for the learned segmenter, 0 to 1.
fn clicked(builder: &NodeBuilder, label: &str, default: [f32; 3]) -> Result<[f32; 3]> {
    let spec = format!("Colour of the {label} for the learned segmenter: red, green and blue.");
    let spec = ParamSpec::new(spec).unit("of 255").range(0.0..=255.0).read_only();
    let default: Vec<f64> = default.iter().map(|c| f64::from((255.0 * c).round())).collect();
    let given = builder.declare(&format!("{label}.clicked_rgb"), default, spec)?.get();
    let rgb: [f64; 3] = given.try_into().map_err(|got: Vec<f64>| {
        anyhow::anyhow!("parameter {label}.clicked_rgb: expected red, green and blue, got {} numbers", got.len())
    })?;
    Ok(rgb.map(|c| (c / 255.0) as f32))
}

/// Light in which the colours were taken.
fn light(builder: &NodeBuilder) -> Result<Option<LightReference>> {
    let spec = "Light in which the colours were taken, as `catenary mask` writes it: 7 levels of red, then of green, then of blue. \
                Exposure and white balance of an image then do not matter. Empty: they are taken to be those of the colours.";
    let spec = ParamSpec::new(spec).unit("of 255").range(0.0..=255.0).read_only();
    let given = builder.declare("light_reference", Vec::<f64>::new(), spec)?.get();
    if given.is_empty() {
        return Ok(None);
    }
    let expected = || format!("parameter light_reference: expected 7 rising levels of each channel, got {given:?}");
    LightReference::from_values(&given).map(Some).with_context(expected)
}

/// Declares the parameters of the colour segmenter, and those that all segmenters share.
fn colours(builder: &NodeBuilder) -> Result<ColourParams> {
    let d = ColourParams::default();
    let range = |label: &str, d: ColourRange| -> Result<ColourRange> {
        let hue =
            ParamSpec::new(format!("Sector of the {label}'s hue, from the first to the second angle.")).unit("degree");
        let hue =
            builder.declare(&format!("{label}.hue_deg"), d.hue_deg.to_vec(), hue.range(0.0..=360.0).read_only())?;
        let saturation = ParamSpec::new("Least saturation; larger keeps pale edges out.").range(0.0..=1.0).read_only();
        let saturation = builder.declare_f64(&format!("{label}.min_saturation"), d.min_saturation, saturation)?;
        let chroma =
            ParamSpec::new("Least chroma; larger keeps noise in dark areas out.").integer_range(0..=255).read_only();
        let chroma = builder.declare_i64(&format!("{label}.min_chroma"), i64::from(d.min_chroma), chroma)?;
        let hue: [f64; 2] = hue.get().try_into().map_err(|got: Vec<f64>| {
            anyhow::anyhow!("parameter {label}.hue_deg: expected two angles, got {}", got.len())
        })?;
        Ok(ColourRange { hue_deg: hue, min_saturation: saturation.get(), min_chroma: u8::try_from(chroma.get())? })
    };
    let whole = |name: &str, default: u32, text: &str, limits: RangeInclusive<i64>| -> Result<u32> {
        let spec = ParamSpec::new(text).unit("mask pixel").integer_range(limits).read_only();
        Ok(u32::try_from(builder.declare_i64(name, i64::from(default), spec)?.get())?)
    };
    let area = |name: &str, default: usize, text: &str| whole(name, default as u32, text, 1..=65_536);
    let close = "Radius of the closing, which fills small gaps.";
    let open = "Radius of the opening, which drops thin specks.";
    let near = "Pieces of the object this near to one another are kept, whatever lies between.";
    Ok(ColourParams {
        dlo: range("dlo", d.dlo)?,
        target: range("target", d.target)?,
        crop: crop(builder)?,
        mask_size_px: d.mask_size_px,
        close_radius_px: whole("close_radius_px", d.close_radius_px, close, 0..=16)?,
        open_radius_px: whole("open_radius_px", d.open_radius_px, open, 0..=16)?,
        min_area_px: area("min_area_px", d.min_area_px, "Least area of the object and of the target.")? as usize,
        max_occlusion_px: whole("max_occlusion_px", d.max_occlusion_px, near, 0..=255)?,
        min_piece_area_px: area("min_piece_area_px", d.min_piece_area_px, "Least area of a further piece.")? as usize,
    })
}

/// Declares the parameters of the YOLOv8-seg segmenter.
fn yolo(builder: &NodeBuilder) -> Result<YoloParams> {
    let d = YoloParams::default();
    let file = |name: &str, default: &Path, about: &str| -> Result<PathBuf> {
        let default = default.to_str().context("a default path is no text")?;
        Ok(builder.declare_string(name, default, ParamSpec::new(about).read_only())?.get().into())
    };
    let class = |name: &str, default: Option<usize>, about: &str| -> Result<Option<usize>> {
        let default = default.map_or(-1, |class| class as i64);
        let number = builder.declare_i64(name, default, ParamSpec::new(about).integer_range(-1..=999).read_only())?;
        Ok(usize::try_from(number.get()).ok())
    };
    let share = |name: &str, default: f32, about: &str| -> Result<f32> {
        let spec = ParamSpec::new(about).range(0.01..=0.99).read_only();
        Ok(builder.declare_f64(name, f64::from(default), spec)?.get() as f32)
    };
    Ok(YoloParams {
        network: file("yolo.network", &d.network, "YOLOv8-seg network as ONNX file, for the segmenter `yolo`.")?,
        runtime: file("yolo.runtime", &d.runtime, "Shared library of the ONNX Runtime, from version 1.17 on.")?,
        classes: [
            class("yolo.object_class", d.classes[0], "Number of the object's class; -1: the network knows none.")?,
            class("yolo.target_class", d.classes[1], "Number of the target's class; -1: the network knows none.")?,
        ],
        min_confidence: share("yolo.min_confidence", d.min_confidence, "Least confidence of a detection.")?,
        max_overlap: share(
            "yolo.max_overlap",
            d.max_overlap,
            "Overlap of boxes from which the less sure one is dropped.",
        )?,
    })
}

/// Square of the image that becomes the mask.
fn crop(builder: &NodeBuilder) -> Result<Crop> {
    let spec = "Left edge, upper edge and side of the square of the image that becomes the mask; empty: the largest one in the middle. \
                The model file's camera is then that of the square.";
    let spec = ParamSpec::new(spec).unit("image pixel").range(0.0..=1e5).read_only();
    let given = builder.declare("crop_px", Vec::<f64>::new(), spec)?.get();
    match *given.as_slice() {
        [] => Ok(Crop::CentredSquare),
        [left_px, top_px, side_px] => Ok(Crop::Square { left_px, top_px, side_px }),
        ref other => anyhow::bail!("parameter crop_px: expected left edge, upper edge and side, got {other:?}"),
    }
}
