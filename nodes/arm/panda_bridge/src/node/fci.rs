//! Node of the direct transport: the safety gate in front of an arm that this process drives by torques.
#![allow(clippy::disallowed_methods, reason = "the age of a state is measured on a clock that does not step")]

use super::front::{Front, MoveParameters, RECHECK_S, meet_others};
use super::settings::Settings;
use super::topics::{ArmTopics, LawTopic, Measurement};
use crate::arm::{Arm, Plant};
use crate::fci::{End, FciLink, FciSettings, Measured, Phase, tool_pose};
use crate::gate::{Mode, Order};
use crate::kinematics::{self, JOINTS};
use crate::law::Joints;
use crate::pose::ArmPose;
use crate::speed::SpeedLimit;
use anyhow::{Context, Result};
use catenary_shell::{Clock, Health, Node, Report, Time};
use franka::RobotMode;
use nalgebra::{Isometry3, Translation3, Vector6};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Period of the measurements on the topics: 200 Hz, the contract's rate.
const CYCLE: Duration = Duration::from_millis(5);
/// Cycles between two states: 50 Hz.
const SLOW: u64 = 4;
/// Success rate below which the node warns. A Panda aborts the motion at 20 lost commands of 100 in a row.
const POOR_RATE: f64 = 0.9;

/// Arm at the other end of the connection.
struct Panda {
    link: Arc<FciLink>,
    node: Node,
    /// Time 0 of the arm in the node's clock, and in a clock that never steps.
    origin: Time,
    started: Instant,
    measured: Option<(ArmPose, Instant)>,
    /// Posture that a move to the start brings the arm near to, rad.
    rest_joints_rad: [f64; JOINTS],
    speed: SpeedLimit,
    /// Time of the first order of the motion; `None` without a motion.
    ordered: Option<Instant>,
}

impl Plant for Panda {
    fn time_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn stamp_time_s(&self) -> f64 {
        self.node.now().secs_since(self.origin)
    }

    fn measured(&self) -> Option<ArmPose> {
        self.measured.map(|(pose, _)| pose)
    }

    fn measured_age_s(&self) -> f64 {
        self.measured.map_or(f64::INFINITY, |(_, at)| at.elapsed().as_secs_f64())
    }

    fn speed_limit(&self) -> SpeedLimit {
        self.speed
    }

    fn has_begun(&self) -> bool {
        let newest = self.link.measured();
        newest.is_some_and(|m| m.phase == Phase::Following && self.ordered.is_some_and(|ordered| m.at > ordered))
    }

    fn can_begin(&self) -> bool {
        let is_idle = self.link.measured().is_some_and(|m| m.state.robot_mode == RobotMode::Idle);
        is_idle && self.link.unready().is_none()
    }

    fn postures(&self, target: &ArmPose) -> Option<[[f64; JOINTS]; 2]> {
        let measured = self.link.measured()?.state.q;
        let to = kinematics::inverse(target, &self.rest_joints_rad)?;
        self.link.is_clear_of_limits(&to.into()).then_some([measured, to])
    }

    fn set_posture(&mut self, joints_rad: [f64; JOINTS]) {
        self.link.set_posture(joints_rad.into());
    }

    fn obey(&mut self, order: &Order) {
        match order {
            Order::End => self.ordered = None,
            Order::Target(_) | Order::Hold(_) => self.ordered = self.ordered.or(Some(Instant::now())),
        }
        match order {
            Order::Target(pose) => {
                self.link.set_target(Isometry3::from_parts(Translation3::from(pose.position_m), pose.rotation()));
            }
            Order::Hold(_) => self.link.hold(),
            Order::End => self.link.follow(false),
        }
    }
}

/// Runs the node until shutdown. The arm then comes to rest.
pub fn run(node: &Node, settings: Settings, transport: FciSettings, moves: MoveParameters) -> Result<()> {
    meet_others(node);
    let (compliance, collision) = (transport.compliance, transport.collision);
    let (rest_joints_rad, speed) = (transport.rest_joints_rad, transport.law.speed);
    tracing::info!(
        "targets are followed at up to {} m/s and {} rad/s; steady force up to {:.0} N",
        speed.linear_m_s,
        speed.angular_rad_s,
        compliance.stiffness[..3].iter().fold(0.0, |most: f64, k| most.max(*k)) * compliance.error_clip_m
    );
    let link =
        Arc::new(FciLink::start(transport, || catenary_shell::exit(1)).context("the threads of the connection")?);
    let origin = node.now();
    let panda = Panda {
        link: Arc::clone(&link),
        node: node.clone(),
        origin,
        started: Instant::now(),
        measured: None,
        rest_joints_rad,
        speed,
        ordered: None,
    };
    let mut arm = Arm::new(panda, settings.arm);
    arm.connection(false);
    let asked = Arc::clone(&link);
    let front = Front::with_readiness(node, origin, moves, arm, move |_| asked.unready())?;
    let (set, recovered) = (Arc::clone(&link), Arc::clone(&link));
    let (gate, law) = (Arc::clone(&front), LawTopic::new(node));
    law.announce(&compliance.arm_law(&speed))?;
    let _served = front.serve(
        move |compliance| {
            compliance.check_thresholds(&collision.wrench, &collision.torque_n_m).map_err(|e| e.to_string())?;
            set.set_compliance(*compliance);
            law.announce(&compliance.arm_law(&speed)).map_err(|e| e.to_string())?;
            Ok(String::new())
        },
        move || {
            // The arm is unlocked again before the recovery, which takes a second.
            let mode = gate.arm().mode();
            // If nothing is latched, or the gate refuses anyway, the robot is left alone.
            if matches!(mode, Mode::Reflex | Mode::UserStop) { recover(&recovered) } else { Ok(()) }
        },
    )?;
    let (reported, figures) = (Arc::clone(&front), Arc::clone(&link));
    node.report_diagnostics(move |report| {
        reported.report(report);
        describe(report, &figures);
    })?;
    publish(node, &front, &link)?;
    front.arm().disable();
    node.wait_for_shutdown()
}

fn recover(link: &FciLink) -> Result<(), String> {
    match link.measured().map(|m| m.state.robot_mode) {
        Some(RobotMode::UserStopped) => Err("the user stop is still pressed".to_owned()),
        _ => link.recover(),
    }
}

/// Adds the state of the robot and the figures of the control loop to a report.
fn describe(report: &mut Report, link: &FciLink) {
    let problem = link.unready().unwrap_or_default();
    if !problem.is_empty() {
        report.problem(Health::Error, &problem);
    }
    if let Some(measured) = link.measured() {
        let rate = measured.state.control_command_success_rate;
        report.value("fci_version", link.server_version());
        report.value("robot_mode", format!("{:?}", measured.state.robot_mode));
        report.value("control_command_success_rate", format!("{rate:.3}"));
        if measured.state.robot_mode == RobotMode::Move && rate < POOR_RATE && rate > 0.0 {
            report.problem(Health::Warn, &format!("the robot gets {:.0} % of its commands in time", 100.0 * rate));
        }
    }
    let figures = link.figures();
    report.value("control_cycles", figures.computing.count()).value("lost_states", figures.lost_states);
    for (name, share) in [("computing_p50_us", 0.5), ("computing_p99_us", 0.99)] {
        if let Some(us) = figures.computing.quantile_us(share) {
            report.value(name, us);
        }
    }
    report.value("computing_longest_us", figures.computing.longest().as_micros());
}

/// Publishes measurements and states, and supervises the arm, until shutdown.
fn publish(node: &Node, front: &Front<Panda>, link: &FciLink) -> Result<()> {
    let topics = ArmTopics::new(node)?;
    // A wall clock: a /clock that stands still must not stop the supervision of the arm.
    let mut rate = Clock::new(node.shutdown()).rate(CYCLE);
    let recheck = (RECHECK_S / CYCLE.as_secs_f64()).round() as u64;
    let (mut last_mode, mut last_id) = (None, None);
    while let Some(tick) = rate.tick() {
        if tick.index.is_multiple_of(recheck) {
            front.recheck();
        }
        let (state, measured, time) = {
            let mut arm = front.arm();
            // Read while the arm is locked: a state from before a recovery would latch its reflex again.
            let measured = link.measured();
            let time = measured.map_or(node.now(), |m| node.now() - m.at.elapsed());
            supervise(&mut arm, link, measured.as_ref());
            let success = measured.map_or(0.0, |m| m.state.control_command_success_rate);
            (front.state(&arm, success, time), measured, time)
        };
        // A state is published once, even if the next one is late.
        let id = measured.map(|m| m.state.time);
        if let Some(measured) = measured.filter(|_| id != last_id) {
            topics.measured(&measurement(&measured), time);
        }
        last_id = id;
        if tick.index.is_multiple_of(SLOW) || last_mode != Some(state.mode) {
            last_mode = Some(state.mode);
            topics.state(state);
        }
    }
    Ok(())
}

fn measurement(measured: &Measured) -> Measurement {
    let state = &measured.state;
    Measurement {
        pose: pose_of(measured),
        twist: kinematics::jacobian(&state.q) * Joints::from(state.dq),
        // The robot estimates its own force on the world; the contract wants the world's force on the hand.
        wrench: -Vector6::from(state.O_F_ext_hat_K),
        joints_rad: state.q,
        velocities_rad_s: state.dq,
        torques_n_m: state.tau_J.to_vec(),
    }
}

fn pose_of(measured: &Measured) -> ArmPose {
    let pose = tool_pose(&measured.state);
    ArmPose::from_parts(pose.translation.vector.into(), &pose.rotation)
}

/// Passes the newest state to the gate, and the gate's decision to the connection.
fn supervise(arm: &mut Arm<Panda>, link: &FciLink, measured: Option<&Measured>) {
    let Some(measured) = measured else {
        if arm.mode() != Mode::Disconnected {
            tracing::error!("disconnected: {}", link.unready().unwrap_or_default());
            arm.connection(false);
            arm.plant_mut().measured = None;
        }
        link.follow(false);
        return;
    };
    if arm.mode() == Mode::Disconnected {
        tracing::info!("the robot sends its state: connected");
        arm.connection(true);
    }
    arm.plant_mut().measured = Some((pose_of(measured), measured.at));
    latch(arm, link, measured);
    arm.steer();
    arm.watch();
    link.follow(matches!(arm.mode(), Mode::Tracking | Mode::Hold | Mode::Moving));
}

/// Latches stops of the robot.
fn latch(arm: &mut Arm<Panda>, link: &FciLink, measured: &Measured) {
    let mode = measured.state.robot_mode;
    // Guiding is possible only while the user stop is pressed.
    let pressed = matches!(mode, RobotMode::UserStopped | RobotMode::Guiding);
    if pressed && arm.mode() != Mode::UserStop {
        tracing::error!("user stop");
    }
    arm.user_stop(pressed);
    let end = link.take_end();
    if pressed || arm.mode() == Mode::UserStop {
        return;
    }
    let names = measured.state.last_motion_errors.names().join(", ");
    let why = match (mode, end) {
        (RobotMode::Reflex, _) if !names.is_empty() => names,
        // The answer to the motion overtakes the states.
        (_, Some(End::UserStop)) => {
            arm.user_stop(true);
            return;
        }
        (_, Some(End::Fault(why))) => why,
        (RobotMode::Reflex, None) => "the robot is in reflex mode".to_owned(),
        (_, None) => return,
    };
    if arm.mode() != Mode::Reflex {
        tracing::error!("reflex: {why}");
        arm.reflex(&why);
    }
}
