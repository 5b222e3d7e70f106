//! Relay: the safety gate in front of a ROS 2 Cartesian impedance controller that follows target poses and publishes its pose.
#![allow(clippy::disallowed_methods, reason = "the silence of a controller is measured on a clock that does not step")]

use super::controller::{self, Controller};
use super::front::{Front, MoveParameters, RECHECK_S, meet_others};
use super::parameters;
use super::settings::{ControllerNames, Settings};
use super::topics::LawTopic;
use crate::arm::Arm;
use crate::compliance::Compliance;
use crate::convert;
use crate::gate::{BASE_FRAME, Heard, Mode, Stranger, Writer};
use crate::pose::ArmPose;
use anyhow::{Result, bail};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::ArmState;
use catenary_msgs::sensor_msgs::msg::JointState;
use catenary_shell::{
    Clock, Deadline, Flaw, GraphSnapshot, Names, Node, StampCheck, Subscription, Time, contract, stamp,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Period of the control cycle: 200 Hz, the rate of the arm's pose.
const CYCLE: Duration = Duration::from_millis(5);
/// Cycles between two targets and between two states: 50 Hz.
const SLOW: u64 = 4;
/// Tolerated distance of a pose's stamp from the node's clock. Policies never use data as old as this.
const STAMP_LIMIT: Duration = Duration::from_secs(1);
/// Weight of one cycle in the share of cycles in time: an exponential average over about a second (200 cycles).
const SHARE_WEIGHT: f64 = 0.005;
/// Time without a cycle after which a motion ends. Chosen: far beyond what a busy machine takes, and shorter than anyone stops a process.
const STANDSTILL: Duration = Duration::from_secs(1);

/// State of the controller's stream of poses.
struct Link {
    /// Start of the relay, in a clock that never steps.
    started: Instant,
    poses: Deadline,
    /// Stamp of the newest measurement.
    measured: Time,
    /// Writer of the poses, as long as they come.
    writer: Option<Writer>,
}

impl Link {
    fn now(&self) -> Time {
        Time::ZERO + self.started.elapsed()
    }

    /// Binds to the writer of a pose, unless another one is heard.
    ///
    /// # Errors
    /// [`Stranger`]: the pose must not be used.
    fn bind(&mut self, writer: Writer) -> Result<(), Stranger> {
        match self.writer.filter(|bound| self.is_alive() && *bound != writer) {
            Some(bound) => Err(Stranger { heard: Heard::ControllerPose, writer, bound }),
            None => {
                self.writer = Some(writer);
                Ok(())
            }
        }
    }

    fn is_alive(&self) -> bool {
        self.poses.received() > 0 && !self.poses.expired(self.now())
    }
}

/// Front end and link to the controller. A thread that locks both locks the arm of the front end first.
struct Relay {
    front: Arc<Front<Controller>>,
    link: Mutex<Link>,
}

/// Runs the relay until shutdown.
pub fn run(node: &Node, settings: Settings, moves: MoveParameters) -> Result<()> {
    let (names, known_law, speed) = (settings.controller, settings.law, settings.speed);
    refuse_collisions(node, &names)?;
    meet_others(node);
    let origin = node.now();
    let targets = node.publisher::<PoseStamped>(&names.target_pose, contract::TARGET_POSE.qos)?;
    let controller = Controller::new(node, origin, targets.clone(), &names, speed);
    // Disconnected until the controller's first pose.
    let mut arm = Arm::new(controller, settings.arm);
    arm.connection(false);
    let link = Link { started: Instant::now(), poses: Deadline::new(settings.silence), measured: origin, writer: None };
    let topic = names.target_pose.clone();
    let readiness = move |graph: &GraphSnapshot<'_>| controller::unready(&targets, &topic, graph);
    let front = Front::with_readiness(node, origin, moves, arm, readiness)?;
    let relay = Arc::new(Relay { front: Arc::clone(&front), link: Mutex::new(link) });
    let _measuring = relay.subscribe(node, &names, settings.silence)?;
    let (law, mut set) = (LawTopic::new(node), parameters::setter(node, &names.node)?);
    // The relay cannot see the controller's law. A wrong one would be worse than none.
    known_law.map_or(Ok(()), |known| law.announce(&known))?;
    let set_and_announce = move |compliance: &Compliance| {
        let answer = set(compliance)?;
        law.announce(&compliance.arm_law(&speed)).map_err(|e| e.to_string())?;
        Ok(answer)
    };
    let _served = front.serve(set_and_announce, || Ok(()))?;
    relay.report(node)?;
    relay.run(node)
}

/// Refuses a controller's topic that is also a topic of the bridge: the relay would receive its own messages.
fn refuse_collisions(node: &Node, names: &ControllerNames) -> Result<()> {
    let theirs = [
        ("controller.target_pose_topic", &names.target_pose),
        ("controller.current_pose_topic", &names.current_pose),
        ("controller.joint_states_topic", &names.joint_states),
    ];
    for (parameter, name) in theirs {
        for ours in [contract::TARGET_POSE, contract::CURRENT_POSE, contract::JOINT_STATES] {
            let resolved = node.resolve(name)?;
            if resolved == node.resolve(ours.name)? {
                bail!(
                    "parameter {parameter}: {resolved} is the bridge's own topic; remap that topic or the controller's"
                );
            }
        }
    }
    Ok(())
}

impl Relay {
    fn link(&self) -> MutexGuard<'_, Link> {
        self.link.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Subscribes to the controller's pose and joint states, and republishes both under the arm's names.
    fn subscribe(
        self: &Arc<Self>,
        node: &Node,
        names: &ControllerNames,
        silence: Duration,
    ) -> Result<[Subscription; 2]> {
        let out = node.publisher::<PoseStamped>(contract::CURRENT_POSE.name, contract::CURRENT_POSE.qos)?;
        let (relay, frame_id) = (Arc::clone(self), names.frame_id.clone());
        let spoken = Names { one: "pose", many: "poses" };
        let intake = node.intake::<PoseStamped>(&names.current_pose, contract::CURRENT_POSE.qos, spoken, silence)?;
        // Needed at all times: without the controller's pose the bridge has no arm.
        intake.need(true);
        let (doubted, mut stamps) = (intake.clone(), StampCheck::new(STAMP_LIMIT));
        let poses = node.take::<PoseStamped>(&intake, move |received| {
            let message = &received.message;
            let bound = relay.link().bind(received.publisher);
            if let Err(stranger) = bound {
                relay.front.on_stranger(stranger);
                return Err(Flaw::new("stranger", stranger));
            }
            let pose = measurement(message, &frame_id)?;
            let time = stamp::from_msg(&message.header.stamp);
            doubted.check_stamp(&mut stamps, time);
            relay.on_pose(pose, time);
            let header = stamp::header(time, BASE_FRAME);
            out.send(PoseStamped { header, pose: message.pose.clone() });
            Ok(())
        })?;
        let out = node.publisher::<JointState>(contract::JOINT_STATES.name, contract::JOINT_STATES.qos)?;
        let joints =
            node.subscription::<JointState>(&names.joint_states, contract::JOINT_STATES.qos, move |received| {
                out.send(JointState::clone(&received.message));
            })?;
        Ok([poses, joints])
    }

    fn on_pose(&self, pose: ArmPose, time: Time) {
        let mut arm = self.front.arm();
        {
            let mut link = self.link();
            let now = link.now();
            link.poses.message(now);
            link.measured = time;
        }
        if arm.mode() == Mode::Disconnected {
            tracing::info!("the controller tells its pose: connected");
            arm.connection(true);
        }
        arm.plant_mut().measure(pose);
        arm.watch();
    }

    /// Runs the control cycle until shutdown, and then leaves the arm holding.
    fn run(&self, node: &Node) -> Result<()> {
        let states = node.publisher::<ArmState>(contract::ARM_STATE.name, contract::ARM_STATE.qos)?;
        // A wall clock: a /clock that stands still must not stop the supervision of the controller.
        let mut rate = Clock::new(node.shutdown()).rate(CYCLE);
        let recheck = (RECHECK_S / CYCLE.as_secs_f64()).round() as u64;
        let (mut share, mut missed, mut last_mode) = (1.0, 0, None);
        while let Some(tick) = rate.tick() {
            // Missed cycles count as late. After 1000 of them the share is below 1 % anyway.
            let late = (tick.missed - missed).min(1000) as i32;
            share = (share * (1.0 - SHARE_WEIGHT).powi(late)) * (1.0 - SHARE_WEIGHT) + SHARE_WEIGHT;
            missed = tick.missed;
            if CYCLE * late.unsigned_abs() > STANDSTILL {
                self.end_after_standstill();
            }
            let slow = tick.index.is_multiple_of(SLOW);
            if tick.index.is_multiple_of(recheck) {
                self.front.recheck();
            }
            let (alive, measured) = {
                let link = self.link();
                (link.is_alive(), link.measured)
            };
            let state = {
                let mut arm = self.front.arm();
                self.cycle(&mut arm, alive, slow);
                self.front.state(&arm, share, measured)
            };
            if slow || last_mode != Some(state.mode) {
                last_mode = Some(state.mode);
                states.send(state);
            }
        }
        let mut arm = self.front.arm();
        // An enabled arm gets its measured pose as the last target, so that it stops with the relay.
        if is_enabled(arm.mode()) {
            arm.disable();
        }
        drop(arm);
        node.wait_for_shutdown()
    }

    /// Ends a motion that this process has not supervised, because it was stopped and continues. It cannot know what it has missed.
    fn end_after_standstill(&self) {
        let mut arm = self.front.arm();
        if is_enabled(arm.mode()) {
            tracing::error!("the bridge stood still for more than {} s: disabled", STANDSTILL.as_secs());
            arm.disable();
        }
    }

    /// Runs one cycle; in a `slow` one targets are sent.
    fn cycle(&self, arm: &mut Arm<Controller>, alive: bool, slow: bool) {
        if !alive {
            if arm.mode() != Mode::Disconnected {
                tracing::error!("the controller is silent: disconnected");
                arm.connection(false);
                arm.plant_mut().lose();
            }
            return;
        }
        if slow {
            arm.steer();
        }
        arm.watch();
        if slow && is_enabled(arm.mode()) {
            arm.plant_mut().repeat();
        }
    }

    fn report(self: &Arc<Self>, node: &Node) -> Result<()> {
        let front = Arc::clone(&self.front);
        node.report_diagnostics(move |report| front.report(report))?;
        Ok(())
    }
}

fn is_enabled(mode: Mode) -> bool {
    matches!(mode, Mode::Tracking | Mode::Hold | Mode::Moving)
}

/// Returns the pose of the arm in a message of the controller.
///
/// # Errors
/// [`Flaw`]: another frame, numbers that are not finite, a quaternion without unit norm.
fn measurement(message: &PoseStamped, frame_id: &str) -> Result<ArmPose, Flaw> {
    let pose = convert::arm_pose(&message.pose);
    if message.header.frame_id != frame_id {
        let got = &message.header.frame_id;
        return Err(Flaw::new("frame", format!("expected frame `{frame_id}` (controller.frame_id), got `{got}`")));
    }
    if !pose.is_finite() {
        return Err(Flaw::new("not finite", format!("expected finite numbers, got {pose:?}")));
    }
    if !pose.is_normalised() {
        return Err(Flaw::new("quaternion", format!("expected a unit quaternion, got {:?}", pose.quaternion_xyzw)));
    }
    Ok(pose)
}
