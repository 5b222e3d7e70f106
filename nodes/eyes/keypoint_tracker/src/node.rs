//! ROS node: publishes keypoints for every mask.

use crate::learned::{NetworkKind, Weights, weights_of};
use crate::{Backend, Error, TrackerParams, TrackingParams, convert};
use anyhow::{Context, Result};
use catenary_msgs::msg::Keypoints;
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::{Flaw, Names, NodeBuilder, ParamSpec, StampCheck, contract, stamp};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Time without a mask after which the node reports a fault: the time that a policy waits for fresh data by default.
const SILENCE: Duration = Duration::from_secs(1);
/// Largest difference between a mask's stamp and the node's clock. It is only reported; policies discard data that are far
/// younger (`max_age_s`).
const STAMP_LIMIT: Duration = Duration::from_secs(1);

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("keypoint_tracker", args, run)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let builder = builder.declare_lock_step()?;
    let mut tracker = declare(&builder)?.build()?;
    let node = builder.build()?;
    let keypoints = node.publisher::<Keypoints>(contract::KEYPOINTS.name, contract::KEYPOINTS.qos)?;
    let names = Names { one: "mask", many: "masks" };
    let intake = node.intake::<Image>(contract::MASK.name, contract::MASK.qos, names, SILENCE)?;
    intake.need(true);
    let doubted = intake.clone();
    let mut stamps = StampCheck::new(STAMP_LIMIT);
    let _masks = node.take::<Image>(&intake, move |received| {
        let flaw = |error: Error| Flaw::new(error.kind(), error);
        let mask = convert::mask(&received.message).map_err(flaw)?;
        let found = tracker.track(&mask).map_err(flaw)?;
        // Keypoints of a mask of unusual size are published with a warning: they may be right.
        if let Some(detail) = convert::unusual_size(&mask) {
            doubted.doubt(&Flaw::new("size", detail));
        }
        doubted.check_stamp(&mut stamps, stamp::from_msg(&received.message.header.stamp));
        keypoints.send(Keypoints {
            header: received.message.header.clone(),
            ..catenary_shell::convert::keypoints_to_msg(&found)
        });
        Ok(())
    })?;
    node.report_diagnostics(|_| {})?;
    node.wait_for_shutdown()
}

/// Declares the tracker's parameters, fixed at the start, and returns their values.
///
/// # Errors
/// A value out of its range; a file of weights that cannot be used.
pub fn declare(builder: &NodeBuilder) -> Result<TrackingParams> {
    let spec =
        "Tracker: geometric, transporter (the paper's, without labels), or ordered (trained to look behind covers).";
    let spec = ParamSpec::new(spec).choices(&Backend::ALL.map(Backend::name)).read_only();
    let name = builder.declare_string("tracker", Backend::default().name(), spec)?.get();
    let backend = Backend::from_name(&name).context("parameter tracker")?;
    let weights = "File of the network's weights, as `catenary train-tracker` writes; empty: those that are shipped.";
    let file = builder.declare_string("weights", "", ParamSpec::new(weights).read_only())?.get();
    let weights = match backend.network() {
        _ if file.is_empty() => None,
        Some(kind) => Some(read_weights(kind, &file)?),
        None => {
            anyhow::bail!("parameter weights: expected none with the tracker {name}, which has no network, got {file}")
        }
    };
    Ok(TrackingParams { backend, geometry: geometry(builder)?, weights })
}

/// Weights in a file.
///
/// # Errors
/// A file that cannot be read, or that holds weights of another network.
fn read_weights(kind: NetworkKind, file: impl AsRef<Path>) -> Result<Weights> {
    let file = file.as_ref();
    let bytes = catenary_shell::files::read_bytes("weights", file)?;
    weights_of(kind, &bytes).with_context(|| format!("weights {}", file.display()))
}

fn geometry(builder: &NodeBuilder) -> Result<TrackerParams> {
    let d = TrackerParams::default();
    let fractions = ParamSpec::new("Places of the keypoints as fractions of the centre line's length, increasing.");
    let fractions = builder.declare("fractions", d.fractions.to_vec(), fractions.range(0.0..=1.0).read_only())?;
    let smoothing = ParamSpec::new("Smoothing of the centre line; larger is steadier and cuts tight bends.");
    let smoothing = smoothing.unit("mask pixel").range(0.0..=20.0).read_only();
    let gap = ParamSpec::new("Longest gap between two pieces that the centre line is led across.");
    let gap = gap.unit("mask pixel").range(0.0..=1000.0).read_only();
    let score = ParamSpec::new("Least score of a keypoint; a mask with a lower one counts as one without the object.");
    let score = score.range(0.0..=1.0).read_only();
    Ok(TrackerParams {
        fractions: fractions.get().try_into().map_err(|got: Vec<f64>| {
            anyhow::anyhow!("parameter fractions: expected four numbers, got {}", got.len())
        })?,
        smoothing_px: builder.declare_f64("smoothing_px", d.smoothing_px, smoothing)?.get(),
        max_gap_px: builder.declare_f64("max_gap_px", d.max_gap_px, gap)?.get(),
        min_score: builder.declare_f64("min_score", d.min_score, score)?.get(),
        ..d
    })
}
