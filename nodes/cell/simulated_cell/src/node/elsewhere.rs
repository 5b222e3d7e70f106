//! Object and camera of a cell whose arm is elsewhere: the object hangs in a hand whose pose comes over a topic, and the object's
//! wrench on that hand goes back.

use super::camera::{self, Holder, Pictures};
use super::setup::Setup;
use super::still;
use crate::cell::Cell;
use crate::convert;
use anyhow::{Context, Result};
use catenary_core::{Camera, GripPose};
use catenary_msgs::geometry_msgs::msg::{Pose, PoseStamped, WrenchStamped};
use catenary_shell::{Flaw, Names, Node, Service, Time, contract, stamp};
use panda_bridge::gate::BASE_FRAME;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// Topic of the hand's pose, and topic of the wrench on the hand.
const POSE: &str = "panda_emulator/true_pose";
const WRENCH: &str = "panda_emulator/wrench";
/// Silence of the hand that is reported.
const SILENCE: Duration = Duration::from_millis(500);
/// Longest gap between two poses that is no fault, s: 100 poses of an arm at 500 Hz.
const LONGEST_GAP_S: f64 = 0.2;

/// Cell with the time of its first pose.
struct Carried {
    node: Node,
    origin: Time,
    cell: Mutex<Cell>,
}

impl Holder for Carried {
    fn node(&self) -> &Node {
        &self.node
    }

    fn stamp(&self, time_s: f64) -> Time {
        self.origin + Duration::from_secs_f64(time_s.max(0.0))
    }

    fn with<T>(&self, act: impl FnOnce(&mut Cell) -> T) -> T {
        act(&mut self.cell.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Runs the node until shutdown. The cell begins with the first pose of the hand.
pub fn run(node: &Node, setup: Setup, pictures: Pictures) -> Result<()> {
    let wrenches = node.publisher::<WrenchStamped>(WRENCH, contract::CURRENT_POSE.qos)?;
    let names = Names { one: "pose of the hand", many: "poses of the hand" };
    let intake = node.intake::<PoseStamped>(POSE, contract::CURRENT_POSE.qos, names, SILENCE)?;
    intake.need(true);
    let carried: Arc<OnceLock<(Arc<Carried>, Service)>> = Arc::new(OnceLock::new());
    let (own, of) = (Arc::clone(&carried), node.clone());
    let _poses = node.take::<PoseStamped>(&intake, move |received| {
        let message = &received.message;
        let time = stamp::from_msg(&message.header.stamp);
        let grip = grip(&message.pose).map_err(|why| Flaw::new("pose", why))?;
        let Some((carried, _)) = own.get() else {
            let begun = begin(&of, &setup, time, grip, pictures).map_err(|e| Flaw::new("cell", format!("{e:#}")))?;
            // Poses come one after the other, so that nobody else has begun.
            let _ = own.set(begun);
            return Ok(());
        };
        let time_s = time.secs_since(carried.origin);
        let wrench = carried.with(|cell| {
            if time_s - cell.time_s() > LONGEST_GAP_S {
                tracing::warn!("no pose of the hand for {:.2} s: the object jumps", time_s - cell.time_s());
            }
            cell.follow(time_s, grip);
            convert::wrench(&cell.wrench())
        });
        wrenches.send(WrenchStamped { header: stamp::header(time, BASE_FRAME), wrench });
        Ok(())
    })?;
    let reported = Arc::clone(&carried);
    node.report_diagnostics(move |report| {
        let Some((carried, _)) = reported.get() else { return };
        let (time_s, counters) = carried.with(|cell| (cell.time_s(), cell.counters()));
        report.value("simulated_time_s", format!("{time_s:.3}"));
        report.value("unconverged_steps", counters.unconverged_steps);
        report.value("unconverged_equilibria", counters.unconverged_equilibria);
    })?;
    node.wait_for_shutdown()
}

fn begin(
    node: &Node,
    setup: &Setup,
    origin: Time,
    grip: GripPose,
    pictures: Pictures,
) -> Result<(Arc<Carried>, Service)> {
    let cell = setup.cell(Some(grip))?;
    let Camera::Pinhole(calibrated) = setup.model.camera.view else { unreachable!("a cell has a pinhole camera") };
    let carried = Arc::new(Carried { node: node.clone(), origin, cell: Mutex::new(cell) });
    camera::start(&carried, &calibrated, setup.model.camera.rate_hz, pictures).context("camera")?;
    let still = still::serve(&carried)?;
    tracing::info!("the object hangs in the hand at x {:.3} m, z {:.3} m", grip.x_m, grip.z_m);
    Ok((carried, still))
}

/// Returns the pose of the grip in the plane of motion. The object is planar: what leaves the plane is not felt.
fn grip(pose: &Pose) -> Result<GripPose, String> {
    let (p, q) = (&pose.position, &pose.orientation);
    let values = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
    if values.iter().any(|v| !v.is_finite()) {
        return Err(format!("expected finite numbers, got {values:?}"));
    }
    Ok(GripPose { x_m: p.x, z_m: p.z, pitch_rad: GripPose::pitch_from_quaternion([q.x, q.y, q.z, q.w]) })
}
