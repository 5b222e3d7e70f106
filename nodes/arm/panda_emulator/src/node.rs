//! ROS node: the emulated arm behind FCI, and what a person beside a real arm would do, as services.
#![allow(clippy::disallowed_methods, reason = "the node reads the model library, and paces itself")]

mod parameters;

use crate::fci::RobotMode;
use crate::panda::Wall;
use crate::server::{Event, Fault, Handle, Server};
use anyhow::{Context, Result, bail};
use catenary_msgs::geometry_msgs::msg::{Point, Pose, PoseStamped, Quaternion, WrenchStamped};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolResponse};
use catenary_shell::{Clock, Flaw, Health, Misconfigured, Names, Node, NodeBuilder, Service, contract, stamp};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Frame of all poses and wrenches: the arm's base.
const BASE_FRAME: &str = "panda_link0";
/// Period of the true pose: 500 Hz, above the rate of every sensor of the graph.
const PERIOD: Duration = Duration::from_millis(2);
/// Silence of the wrench after which the hand is free again. Chosen: two hundred messages of an object at 500 Hz.
const WRENCH_SILENCE: Duration = Duration::from_millis(400);

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("panda_emulator", args, run)
}

fn run(builder: NodeBuilder) -> Result<()> {
    let (address, options) = parameters::declare(&builder).map_err(Misconfigured::new)?;
    let wall = parameters::wall(&builder)?;
    let node = builder.build()?;
    let generation = options.settings.generation;
    let server = Server::bind(address, options).with_context(|| {
        format!("parameter address: {address}: expected a free address of this machine, such as 127.0.0.1 or 127.1.2.3")
    })?;
    tracing::info!("{generation:?} with FCI version {} at {address}", generation.fci_version());
    let handle = server.handle();
    let _services = [
        serve(&node, "~/user_stop", &handle, "user stop", Handle::set_user_stop)?,
        serve(&node, "~/brakes", &handle, "brakes open", Handle::set_brakes)?,
        serve_guiding(&node, &handle)?,
        serve(&node, "~/network_cut", &handle, "network cut", |handle, cut| handle.inject(Fault::Cut(cut)))?,
    ];
    let names = Names { one: "wrench", many: "wrenches" };
    let intake = node.intake::<WrenchStamped>("~/wrench", contract::EXTERNAL_WRENCH.qos, names, WRENCH_SILENCE)?;
    let pushed = handle.clone();
    let heard: Arc<Mutex<Option<Instant>>> = Arc::default();
    let hearing = Arc::clone(&heard);
    let _wrenches = node.take::<WrenchStamped>(&intake, move |received| {
        let wrench = wrench(&received.message)?;
        pushed.push(wrench);
        *hearing.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        Ok(())
    })?;
    let reported = handle.clone();
    let mut reported_cycles = 0;
    node.report_diagnostics(move |report| {
        let snapshot = reported.snapshot();
        let client = snapshot.client.map_or("none".to_owned(), |address| address.to_string());
        report.value("robot_mode", format!("{:?}", snapshot.mode)).value("client", client);
        report.value("cycles_left_out", snapshot.cycles_left_out);
        if snapshot.cycles_left_out > reported_cycles {
            let more = snapshot.cycles_left_out - reported_cycles;
            report.problem(
                Health::Warn,
                &format!("{more} cycles of 1 ms were left out: the machine is too slow for 1 kHz"),
            );
            reported_cycles = snapshot.cycles_left_out;
        }
    })?;
    publish(&node, &handle, &heard, wall)
}

fn serve(node: &Node, name: &str, handle: &Handle, what: &'static str, set: fn(&Handle, bool)) -> Result<Service> {
    let (inside, handle) = (node.clone(), handle.clone());
    Ok(node.serve_to::<SetBool>(name, move |request, requester| {
        let on = request.data;
        set(&handle, on);
        inside.identify(requester.endpoint(), move |peer| tracing::info!("{what}: {on}, asked for by {peer}"));
        SetBoolResponse { success: true, message: String::new() }
    })?)
}

/// Serves the buttons for guiding, which act only while the user stop is pressed.
fn serve_guiding(node: &Node, handle: &Handle) -> Result<Service> {
    let (inside, handle) = (node.clone(), handle.clone());
    Ok(node.serve_to::<SetBool>("~/guiding", move |request, requester| {
        let mode = handle.snapshot().mode;
        let allowed = !request.data || matches!(mode, RobotMode::UserStopped | RobotMode::Guiding);
        if allowed {
            handle.set_guiding(request.data);
        }
        let (on, outcome) = (request.data, if allowed { "" } else { ": refused" });
        inside
            .identify(requester.endpoint(), move |peer| tracing::info!("guiding: {on}, asked for by {peer}{outcome}"));
        let message = if allowed { String::new() } else { format!("expected a pressed user stop, got mode {mode:?}") };
        SetBoolResponse { success: allowed, message }
    })?)
}

/// Publishes the true pose of the hand, logs events, and keeps the wall where the parameters want it, until shutdown.
fn publish(
    node: &Node,
    handle: &Handle,
    heard: &Mutex<Option<Instant>>,
    wall: impl Fn() -> Option<Wall>,
) -> Result<()> {
    let mut standing = None;
    let poses = node.publisher::<PoseStamped>("~/true_pose", contract::CURRENT_POSE.qos)?;
    let mut rate = Clock::new(node.shutdown()).rate(PERIOD);
    while rate.tick().is_some() {
        if let Some(panic) = handle.failure() {
            bail!("the FCI server's thread has ended: {panic}");
        }
        for (id, event) in handle.take_events() {
            match event {
                Event::Reflex(_) | Event::Restored | Event::ClientTooSlow { .. } => tracing::warn!("{id} ms: {event}"),
                _ => tracing::info!("{id} ms: {event}"),
            }
        }
        let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
        // The sender of the wrench has ended: the hand must not be pushed on for ever.
        if heard.is_some_and(|at| at.elapsed() > WRENCH_SILENCE) {
            *heard = None;
            handle.push([0.0; 6]);
        }
        drop(heard);
        let wanted = wall();
        if standing != wanted {
            standing = wanted;
            tracing::info!("wall: {standing:?}");
            handle.set_wall(standing);
        }
        let snapshot = handle.snapshot();
        poses.send(PoseStamped { header: stamp::header(node.now(), BASE_FRAME), pose: pose(&snapshot.hand_pose) });
    }
    node.wait_for_shutdown()
}

/// Converts a column-major matrix 4x4.
fn pose(matrix: &[f64; 16]) -> Pose {
    let rotation = Matrix3::from_fn(|row, column| matrix[4 * column + row]);
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Pose {
        position: Point { x: matrix[12], y: matrix[13], z: matrix[14] },
        orientation: Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
    }
}

fn wrench(message: &WrenchStamped) -> Result<[f64; 6], Flaw> {
    let (f, m) = (&message.wrench.force, &message.wrench.torque);
    let wrench = [f.x, f.y, f.z, m.x, m.y, m.z];
    if message.header.frame_id != BASE_FRAME {
        return Err(Flaw::new("frame", format!("expected frame {BASE_FRAME}, got `{}`", message.header.frame_id)));
    }
    if wrench.iter().any(|v| !v.is_finite()) {
        return Err(Flaw::new("not finite", format!("expected finite numbers, got {wrench:?}")));
    }
    Ok(wrench)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::ServerOptions;
    use catenary_shell::{Discovery, DomainClaim, RosArgs};

    #[test]
    fn node_ends_with_an_error_when_its_server_has_died() {
        let domain = DomainClaim::any(|_| Ok(true)).unwrap();
        let builder = NodeBuilder::new("panda_emulator", &RosArgs::default()).unwrap();
        let node = builder.domain(domain.id(), Discovery::Localhost).build().unwrap();
        let server = Server::bind("127.0.0.1:0".parse().unwrap(), ServerOptions::default()).unwrap();
        let handle = server.handle();
        handle.crash();
        // Without the look at the server it would publish until shutdown.
        let error = publish(&node, &handle, &Mutex::default(), || None).unwrap_err();
        assert!(error.to_string().contains("server's thread has ended: Handle::crash"), "{error}");
    }
}
