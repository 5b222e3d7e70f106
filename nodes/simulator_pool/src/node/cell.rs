//! The simulated cell: the robot's and the camera's side of the contract, in real time or faster.
#![allow(
    clippy::disallowed_methods,
    reason = "the ROS side reads the model file that a parameter names, and paces itself"
)]

use super::{cell_arm, cell_camera};
use crate::cell::{Cell, collisions};
use crate::scene::Touch;
use crate::{convert, model_text};
use anyhow::{Context, Result, ensure};
use catenary_core::{Camera, Fidelity, Model, seed};
use catenary_msgs::geometry_msgs::msg::{PoseStamped, TwistStamped, WrenchStamped};
use catenary_msgs::msg::ArmState;
use catenary_msgs::rosgraph_msgs::msg::Clock as ClockMsg;
use catenary_msgs::sensor_msgs::msg::JointState;
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{
    Misconfigured, Node, NodeBuilder, Param, ParamSpec, Publisher, Time, contract, read_model, stamp,
};
use panda_bridge::gate::BASE_FRAME;
use panda_bridge::node::front::{Front, MoveParameters, RECHECK_S, meet_others};
use panda_bridge::{Arm, Mode, kinematics};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time between two measurements of the arm.
const MEASURE_S: f64 = 0.005;
/// Measurements between two messages on arm_state, and between two looks at collisions.
const SLOW: u64 = 4;
/// Random stream of theta, where it is not given.
const THETA_STREAM: u64 = 23;

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("simulated_cell", args, run)
}

/// Parameters of the node.
struct Parameters {
    model_file: Param<String>,
    theta: Param<Vec<f64>>,
    fidelity: Param<String>,
    seed: Param<i64>,
    publish_clock: Param<bool>,
    real_time_factor: Param<f64>,
    image_noise: Param<f64>,
    moves: MoveParameters,
}

fn declare(b: &NodeBuilder) -> Result<Parameters> {
    let text = |t: &str| ParamSpec::new(t).read_only();
    Ok(Parameters {
        model_file: b.declare_string("model_file", "", text("Model file of the cell."))?,
        theta: b.declare(
            "theta",
            Vec::new(),
            text("Values of the model's inferred parameters; empty: its nominal ones, and draws from the prior of others."),
        )?,
        fidelity: b.declare_string(
            "fidelity",
            Fidelity::Standard.name(),
            text("Fidelity of the simulation.").choices(&Fidelity::ALL.map(Fidelity::name)),
        )?,
        seed: b.declare_i64("seed", 1, text("Seed of effects, jitter and noise.").integer_range(0..=i64::MAX))?,
        publish_clock: b.declare_bool(
            "publish_clock",
            false,
            text("Stamp with a simulated time that begins at zero, and publish it on /clock."),
        )?,
        real_time_factor: b.declare_f64(
            "real_time_factor",
            1.0,
            text("Simulated seconds per second, where the cell publishes /clock.").range(0.01..=1000.0),
        )?,
        image_noise: b.declare_f64(
            "image_noise",
            3.0,
            text("Standard deviation of the image noise in grey levels.").range(0.0..=50.0),
        )?,
        moves: MoveParameters::declare(b)?,
    })
}

fn run(builder: NodeBuilder) -> Result<()> {
    let p = declare(&builder)?;
    let node = builder.build()?;
    let (cell, model, cell_seed) = cell(&p).map_err(Misconfigured::new)?;
    // Before the arm's time begins, which would have to be made up for.
    meet_others(&node);
    let factor = if p.publish_clock.get() { p.real_time_factor.get() } else { 1.0 };
    let origin = if p.publish_clock.get() { Time::ZERO } else { node.now() };
    let started = Instant::now();
    let arm = Arm::new(cell, cell_arm::settings(&model));
    let front = Front::new(&node, origin, p.moves, arm)?;
    // The arm model has no gains: good settings are accepted and say so, bad ones are refused as for the real arm.
    let _served = front.serve(|_| Ok("the simulated arm keeps its time constant".to_owned()))?;
    let Camera::Pinhole(calibrated) = model.camera.view else { unreachable!("a cell has a pinhole camera") };
    cell_camera::start(&front, &calibrated, model.camera.rate_hz, p.image_noise.get(), cell_seed)?;
    let reported = Arc::clone(&front);
    node.report_diagnostics(move |report| {
        reported.report(report);
        report.value("simulated_time_s", format!("{:.3}", reported.arm().plant().time_s()));
        let counters = reported.arm().plant().counters();
        report.value("unconverged_steps", counters.unconverged_steps);
        report.value("unconverged_equilibria", counters.unconverged_equilibria);
    })?;
    let clock = p.publish_clock.get().then(|| node.publisher::<ClockMsg>(contract::CLOCK.name, contract::CLOCK.qos));
    Measuring::new(&node, clock.transpose()?)?.run(&front, started, factor)
}

/// The cell that the parameters describe, its model and its seed.
fn cell(p: &Parameters) -> Result<(Cell, Model, u64)> {
    let path = p.model_file.get();
    ensure!(!path.is_empty(), "parameter model_file: expected the path of a model file, got an empty string");
    let model = read_model("model_file", path.as_ref(), model_text::read)?;
    let fidelity = Fidelity::from_name(&p.fidelity.get()).context("parameter fidelity")?;
    let cell_seed = p.seed.get().cast_unsigned();
    let theta = match p.theta.get() {
        given if given.is_empty() => hidden_theta(&model, cell_seed),
        given => given,
    };
    let cell = Cell::new(&model, &theta, fidelity, cell_seed).with_context(|| format!("model_file {path}"))?;
    for (name, value, prior) in model.theta.outside(&theta) {
        tracing::warn!("theta: {name} {value} lies outside its prior in the model, {prior}: no inference finds it");
    }
    Ok((cell, model, cell_seed))
}

/// Theta of a cell that is told none: the object's own values where the model has them, else draws from the prior.
fn hidden_theta(model: &Model, cell_seed: u64) -> Vec<f64> {
    let drawn = model.theta.sample_prior(&mut seed::rng(cell_seed, THETA_STREAM));
    let parameters = model.theta.parameters().iter().zip(drawn);
    parameters.map(|(p, drawn)| model.nominal.get(&p.name).copied().unwrap_or(drawn)).collect()
}

/// The fast loop: time runs on and the arm is measured.
struct Measuring {
    pose: Publisher<PoseStamped>,
    twist: Publisher<TwistStamped>,
    wrench: Publisher<WrenchStamped>,
    joints: Publisher<JointState>,
    tf: Publisher<TFMessage>,
    state: Publisher<ArmState>,
    clock: Option<Publisher<ClockMsg>>,
    angles_rad: [f64; kinematics::JOINTS],
}

impl Measuring {
    fn new(node: &Node, clock: Option<Publisher<ClockMsg>>) -> Result<Self> {
        Ok(Self {
            pose: node.publisher(contract::CURRENT_POSE.name, contract::CURRENT_POSE.qos)?,
            twist: node.publisher(contract::CURRENT_TWIST.name, contract::CURRENT_TWIST.qos)?,
            wrench: node.publisher(contract::EXTERNAL_WRENCH.name, contract::EXTERNAL_WRENCH.qos)?,
            joints: node.publisher(contract::JOINT_STATES.name, contract::JOINT_STATES.qos)?,
            tf: node.publisher(contract::TF.name, contract::TF.qos)?,
            state: node.publisher(contract::ARM_STATE.name, contract::ARM_STATE.qos)?,
            clock,
            angles_rad: kinematics::READY_RAD,
        })
    }

    /// Runs until shutdown. Time follows the wall clock times `factor`; where the machine is too slow, several steps are
    /// taken at once and only the newest is published.
    fn run(mut self, front: &Front<Cell>, started: Instant, factor: f64) -> Result<()> {
        let node = front.node();
        let mut scene = front.arm().plant().scene();
        let mut count: u64 = 0;
        let mut last_mode = None;
        let recheck = (RECHECK_S / MEASURE_S).round() as u64;
        let mut next_check = recheck;
        while !node.is_shutdown() {
            let wanted_s = started.elapsed().as_secs_f64() * factor;
            let next_s = ((wanted_s / MEASURE_S).floor() * MEASURE_S).max((count + 1) as f64 * MEASURE_S);
            let early_s = (next_s - wanted_s) / factor;
            if early_s > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(early_s));
            }
            count = (next_s / MEASURE_S).round() as u64;
            let time = front.stamp(next_s);
            let (state, snapshot) = {
                let mut arm = front.arm();
                arm.steer();
                arm.plant_mut().advance(next_s);
                arm.watch();
                self.publish(arm.plant(), &stamp::header(time, BASE_FRAME));
                (front.state(&arm, 1.0, time), count.is_multiple_of(SLOW).then(|| arm.plant().snapshot()))
            };
            if let Some(snapshot) = snapshot {
                scene.update(snapshot.grip, &snapshot.nodes);
                if let Some(touch) = collisions(&scene.touches(0.0)).next() {
                    collide(&mut front.arm(), touch);
                }
            }
            if count.is_multiple_of(SLOW) || last_mode != Some(state.mode) {
                last_mode = Some(state.mode);
                self.state.send(state);
            }
            if count >= next_check {
                next_check = count + recheck;
                front.recheck();
            }
            if let Some(clock) = &self.clock {
                clock.send(ClockMsg { clock: stamp::to_msg(time) });
            }
        }
        node.wait_for_shutdown()
    }

    fn publish(&mut self, cell: &Cell, header: &catenary_msgs::std_msgs::msg::Header) {
        let grip = cell.grip();
        let pose = catenary_shell::convert::grip_pose_to_msg(&grip);
        let measured = cell_arm::arm_pose(&grip);
        self.pose.send(PoseStamped { header: header.clone(), pose });
        self.twist.send(TwistStamped { header: header.clone(), twist: convert::twist(cell.velocity_m_s()) });
        self.wrench.send(WrenchStamped { header: header.clone(), wrench: convert::wrench(&cell.wrench()) });
        self.tf.send(TFMessage { transforms: vec![convert::hand_transform(&grip, header.clone())] });
        let before = self.angles_rad;
        if let Some(angles) = kinematics::inverse(&measured, &before) {
            self.angles_rad = angles;
        }
        let velocity = self.angles_rad.iter().zip(before).map(|(now, then)| (now - then) / MEASURE_S).collect();
        self.joints.send(JointState {
            header: header.clone(),
            name: (1..=kinematics::JOINTS).map(|i| format!("panda_joint{i}")).collect(),
            position: self.angles_rad.to_vec(),
            velocity,
            effort: Vec::new(),
        });
    }
}

/// The hand touched what it must not touch: a reflex.
fn collide(arm: &mut Arm<Cell>, touch: &Touch) {
    if arm.mode() != Mode::Reflex {
        let what = format!("{:?} touches {:?}", touch.first, touch.second);
        tracing::error!("reflex: {what}");
        arm.reflex(&what);
    }
}
