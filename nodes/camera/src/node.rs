//! ROS node: publishes a mask for every image.

use crate::{ColourParams, ColourRange, ColourSegmenter, Segmenter, convert};
use anyhow::Result;
use catenary_core::LabelMask;
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::{Flaw, Names, NodeBuilder, ParamSpec, StampCheck, Throttle, contract, stamp};
use std::process::ExitCode;
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
    let mut segmenter = ColourSegmenter::new(declare(&builder)?)?;
    let node = builder.build()?;
    let masks = node.publisher::<Image>(contract::MASK.name, contract::MASK.qos)?;
    let names = Names { one: "image", many: "images" };
    let intake = node.intake::<Image>(contract::IMAGE.name, contract::IMAGE.qos, names, SILENCE)?;
    intake.need(true);
    // A mask with a doubtful stamp is still published: consumers judge its age themselves.
    let (doubted, clock) = (intake.clone(), node.clock().clone());
    let mut mask = LabelMask::new(1, 1);
    let mut stamps = StampCheck::new(STAMP_LIMIT);
    let mut nothing = Throttle::new(COMPLAIN);
    let _images = node.take::<Image>(&intake, move |received| {
        let image = &received.message;
        let segmented = convert::rgb_view(image).and_then(|view| segmenter.segment(view, &mut mask));
        let report = segmented.map_err(|error| Flaw::new(error.kind(), error))?;
        doubted.check_stamp(&mut stamps, stamp::from_msg(&image.header.stamp));
        if report.dlo_area_px == 0
            && let Some(held_back) = nothing.pass(clock.now())
        {
            tracing::warn!("no object in the image ({held_back} more images without one)");
        }
        masks.send(convert::mask_message(&mask, image.header.clone()));
        Ok(())
    })?;
    node.report_diagnostics(|_| {})?;
    node.wait_for_shutdown()
}

/// Declares the segmenter's parameters. They are read-only: new colours in the middle of an episode would change the
/// meaning of its measurements.
fn declare(builder: &NodeBuilder) -> Result<ColourParams> {
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
    let whole = |name: &str, default: u32, text: &str, greatest: i64| -> Result<u32> {
        let spec = ParamSpec::new(text).unit("mask pixel").integer_range(0..=greatest).read_only();
        Ok(u32::try_from(builder.declare_i64(name, i64::from(default), spec)?.get())?)
    };
    Ok(ColourParams {
        dlo: range("dlo", d.dlo)?,
        target: range("target", d.target)?,
        close_radius_px: whole(
            "close_radius_px",
            d.close_radius_px,
            "Radius of the closing, which fills small gaps.",
            16,
        )?,
        open_radius_px: whole(
            "open_radius_px",
            d.open_radius_px,
            "Radius of the opening, which drops thin specks.",
            16,
        )?,
        max_occlusion_px: whole(
            "max_occlusion_px",
            d.max_occlusion_px,
            "Pieces of the object this near to one another across an occluder are kept together.",
            255,
        )?,
        ..d
    })
}
