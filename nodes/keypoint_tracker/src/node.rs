//! The node: keypoints for every mask.

use crate::{GeometricTracker, KeypointTracker, TrackerParams, convert};
use anyhow::Result;
use catenary_msgs::msg::Keypoints;
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::{Deadline, Health, NodeBuilder, ParamSpec, Throttle, contract};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Silence of the camera node that counts as a fault.
const SILENCE: Duration = Duration::from_millis(500);
/// Complaints come at most this often.
const COMPLAIN: Duration = Duration::from_secs(5);

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("keypoint_tracker", args, run)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let mut tracker = GeometricTracker::new(declare(&builder)?)?;
    let node = builder.build()?;
    let keypoints = node.publisher::<Keypoints>(contract::KEYPOINTS.name, contract::KEYPOINTS.qos)?;
    let stream = Arc::new(Mutex::new(Deadline::new(SILENCE)));
    let (seen, clock) = (Arc::clone(&stream), node.clock().clone());
    let mut complaint = Throttle::new(COMPLAIN);
    let _masks = node.subscription::<Image>(contract::MASK.name, contract::MASK.qos, move |received| {
        let now = clock.now();
        seen.lock().unwrap_or_else(PoisonError::into_inner).message(now);
        match convert::mask(&received.message).and_then(|mask| tracker.track(&mask)) {
            Ok(found) => keypoints.send(Keypoints {
                header: received.message.header.clone(),
                ..catenary_shell::convert::keypoints_to_msg(&found)
            }),
            Err(error) => {
                if let Some(held_back) = complaint.pass(now) {
                    tracing::error!("mask dropped: {error} ({held_back} more)");
                }
            }
        }
    })?;
    let clock = node.clock().clone();
    node.report_diagnostics(move |report| {
        let mut stream = stream.lock().unwrap_or_else(PoisonError::into_inner);
        let now = clock.now();
        report.value("mask_rate_hz", format!("{:.1}", stream.rate_hz(now))).value("masks", stream.received());
        if stream.expired(now) {
            report.problem(Health::Stale, "no mask comes");
        }
    })?;
    node.wait_for_shutdown()
}

fn declare(builder: &NodeBuilder) -> Result<TrackerParams> {
    let d = TrackerParams::default();
    let fractions = ParamSpec::new("Places of the keypoints as fractions of the centre line's length, increasing.");
    let fractions = builder.declare("fractions", d.fractions.to_vec(), fractions.range(0.0..=1.0).read_only())?;
    let smoothing = ParamSpec::new("Smoothing of the centre line; larger is steadier and cuts tight bends.");
    let smoothing = smoothing.unit("mask pixel").range(0.0..=20.0).read_only();
    let gap = ParamSpec::new("Longest gap between two pieces that the centre line is led across.");
    let gap = gap.unit("mask pixel").range(0.0..=1000.0).read_only();
    Ok(TrackerParams {
        fractions: fractions.get().try_into().map_err(|got: Vec<f64>| {
            anyhow::anyhow!("parameter fractions: expected four numbers, got {}", got.len())
        })?,
        smoothing_px: builder.declare_f64("smoothing_px", d.smoothing_px, smoothing)?.get(),
        max_gap_px: builder.declare_f64("max_gap_px", d.max_gap_px, gap)?.get(),
        ..d
    })
}
