//! Node of the simulated cell: the robot's and the camera's side of the contract, in real time, faster, or in lock step.
#![allow(
    clippy::disallowed_methods,
    reason = "the ROS side reads the model file that a parameter names, and paces itself"
)]

mod arm;
mod camera;
mod elsewhere;
mod lock_step;
mod measuring;
mod setup;
mod still;

use anyhow::{Context, Result, ensure};
use camera::{Frames, Pictures};
use catenary_core::{Camera, Fidelity, Model, seed};
use catenary_msgs::rosgraph_msgs::msg::Clock as ClockMsg;
use catenary_shell::{Misconfigured, NodeBuilder, Param, ParamSpec, Time, contract, read_model};
use catenary_simulator::model_text;
use lock_step::LockStep;
use measuring::Measuring;
use panda_bridge::Arm;
use panda_bridge::node::front::{Front, MoveParameters, meet_others};
use panda_bridge::node::topics::LawTopic;
use setup::Setup;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

/// Random stream of theta, if the parameter `theta` is empty.
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
    laboratory: Param<i64>,
    hand: Param<String>,
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
            text("Stamp with a simulated time that begins at zero, and publish it on /clock. In lock step always."),
        )?,
        real_time_factor: b.declare_f64(
            "real_time_factor",
            1.0,
            text("Simulated seconds per second, where the cell publishes /clock; in lock step the most.")
                .range(0.01..=1000.0),
        )?,
        image_noise: b.declare_f64(
            "image_noise",
            3.0,
            text("Standard deviation of the image noise in grey levels.").range(0.0..=50.0),
        )?,
        laboratory: b.declare_i64(
            "laboratory",
            -1,
            text("Seed of the laboratory that the pictures show: textures, lamp, shadows, clutter, exposure; -1: the plain look.")
                .integer_range(-1..=i64::MAX),
        )?,
        hand: b.declare_string(
            "hand",
            "simulated",
            text(
                "Hand that holds the object: simulated (with the arm's side of the contract), or elsewhere (its pose comes from panda_emulator/true_pose, and the object's wrench goes to panda_emulator/wrench; no publish_clock, real_time_factor, start_speed_m_s or settle_time_s then).",
            )
            .choices(&["simulated", "elsewhere"]),
        )?,
        moves: MoveParameters::declare(b)?,
    })
}

fn run(builder: NodeBuilder) -> Result<()> {
    let builder = builder.declare_lock_step()?;
    let p = declare(&builder)?;
    let node = builder.build()?;
    let setup = setup(&p).map_err(Misconfigured::new)?;
    // Made in any case, so that a wrong parameter is reported before the node waits for a hand.
    let cell = setup.cell(None).map_err(Misconfigured::new)?;
    for (name, value, prior) in setup.model.theta.outside(&setup.theta) {
        tracing::warn!("theta: {name} {value} lies outside its prior in the model, {prior}: no inference finds it");
    }
    let pictures = Pictures {
        noise_levels: p.image_noise.get(),
        noise_seed: setup.seed,
        laboratory: u64::try_from(p.laboratory.get()).ok(),
    };
    if p.hand.get() == "elsewhere" {
        drop(cell);
        ensure!(
            !p.publish_clock.get(),
            "parameter publish_clock: expected false for hand elsewhere, whose time is real"
        );
        ensure!(!node.is_in_lock_step(), "parameter lock_step: expected false for hand elsewhere, whose time is real");
        return elsewhere::run(&node, setup, pictures);
    }
    let Setup { model, .. } = setup;
    // Discovery takes time. It comes before the arm's time begins, or the loop would have to catch up.
    meet_others(&node);
    let is_simulated = p.publish_clock.get() || node.is_in_lock_step();
    let factor = if is_simulated { p.real_time_factor.get() } else { 1.0 };
    let origin = if is_simulated { Time::ZERO } else { node.now() };
    let started = Instant::now();
    let arm = Arm::new(cell, arm::settings(&model));
    let front = Front::new(&node, origin, p.moves, arm)?;
    // Kept: a later subscriber gets the law from it.
    let law = LawTopic::new(&node);
    law.announce(&model.arm.law)?;
    // The arm model has no gains: valid settings are accepted with this answer, invalid ones are refused as on the real
    // arm.
    let _served = front.serve(|_| Ok("the simulated arm keeps its time constant".to_owned()), || Ok(()))?;
    let Camera::Pinhole(calibrated) = model.camera.view else { unreachable!("a cell has a pinhole camera") };
    let clock = is_simulated.then(|| node.publisher::<ClockMsg>(contract::CLOCK.name, contract::CLOCK.qos));
    let measuring = Measuring::new(&front, clock.transpose()?)?;
    let _still = still::serve(&front)?;
    let reported = Arc::clone(&front);
    node.report_diagnostics(move |report| {
        reported.report(report);
        report.value("simulated_time_s", format!("{:.3}", reported.arm().plant().time_s()));
        let counters = reported.arm().plant().counters();
        report.value("unconverged_steps", counters.unconverged_steps);
        report.value("unconverged_equilibria", counters.unconverged_equilibria);
    })?;
    if node.is_in_lock_step() {
        let frames = Frames::new(&*front, &calibrated, model.camera.rate_hz, pictures)?;
        return LockStep::new(&front, measuring, frames, factor)?.run();
    }
    camera::start(&front, &calibrated, model.camera.rate_hz, pictures)?;
    measuring.run(&front, started, factor)
}

fn setup(p: &Parameters) -> Result<Setup> {
    let path = p.model_file.get();
    ensure!(!path.is_empty(), "parameter model_file: expected the path of a model file, got an empty string");
    let model = read_model("model_file", path.as_ref(), model_text::read)?;
    let fidelity = Fidelity::from_name(&p.fidelity.get()).context("parameter fidelity")?;
    let seed = p.seed.get().cast_unsigned();
    let theta = match p.theta.get() {
        given if given.is_empty() => hidden_theta(&model, seed),
        given => given,
    };
    Ok(Setup { path, model, theta, fidelity, seed })
}

/// Returns theta of a cell without given values: the model's nominal values, and draws from the prior for the others.
fn hidden_theta(model: &Model, cell_seed: u64) -> Vec<f64> {
    let drawn = model.theta.sample_prior(&mut seed::rng(cell_seed, THETA_STREAM));
    let parameters = model.theta.parameters().iter().zip(drawn);
    parameters.map(|(p, drawn)| model.nominal.get(&p.name).copied().unwrap_or(drawn)).collect()
}
