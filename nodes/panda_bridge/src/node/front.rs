//! An arm's side of the contract: targets, episode events, services and the move to the start pose, in front of whatever
//! carries the orders out. The simulated cell and the relay to a controller have the same one.

use crate::arm::{Arm, ArmError, Plant, Progress};
use crate::compliance::Compliance;
use crate::convert;
use crate::gate::Verdict;
use anyhow::Result;
use catenary_msgs::action::{MoveToStart, MoveToStartFeedback, MoveToStartGoal, MoveToStartResult};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{AcceptedTarget, ArmState, EpisodeEvent};
use catenary_msgs::srv::{SetCompliance, SetComplianceResponse};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolResponse, Trigger, TriggerResponse};
use catenary_shell::{
    ActionServer, Concurrency, Decision, Flaw, GoalHandle, Health, Intake, Names, Node, NodeBuilder, Outcome, Param,
    ParamSpec, Publisher, Report, Service, ShellError, Subscription, Time, contract, stamp,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often a waiting action looks.
const LOOK: Duration = Duration::from_millis(20);
/// Silence of targets, while they are due, that counts as a fault; the gate ends the motion after 2 s.
const SILENCE: Duration = Duration::from_millis(1500);
/// Time between two looks at who else may move an arm, s.
pub const RECHECK_S: f64 = 0.5;
/// Longest settling that a goal may ask for, s.
const MAX_SETTLE_S: f64 = 60.0;

/// How the arm moves to its start pose.
pub struct MoveParameters {
    speed_m_s: Param<f64>,
    settle_time_s: Param<f64>,
}

impl MoveParameters {
    /// Declares `start_speed_m_s` and `settle_time_s`.
    ///
    /// # Errors
    /// A value given for them that makes no sense.
    pub fn declare(builder: &NodeBuilder) -> Result<Self> {
        let speed = ParamSpec::new("Greatest speed on the way to the start pose.").unit("m/s").range(0.01..=1.0);
        let settle = ParamSpec::new("Wait after arriving at the start pose, for the object to come to rest.");
        Ok(Self {
            speed_m_s: builder.declare_f64("start_speed_m_s", 0.15, speed)?,
            settle_time_s: builder.declare_f64("settle_time_s", 1.5, settle.unit("s").range(0.0..=MAX_SETTLE_S))?,
        })
    }
}

/// The front of an arm.
pub struct Front<P> {
    node: Node,
    /// Stamp of the arm's time 0.
    origin: Time,
    parameters: MoveParameters,
    targets: Intake,
    arm: Mutex<Arm<P>>,
}

/// What serves the arm; it ends when this is dropped.
#[must_use = "the arm is served until this is dropped"]
pub struct Served {
    _subscriptions: [Subscription; 2],
    _services: [Service; 4],
    _move: ActionServer,
}

impl<P: Plant> Front<P> {
    /// A front whose arm's time 0 has the stamp `origin`.
    ///
    /// # Errors
    /// The name of the targets' topic after remapping.
    pub fn new(node: &Node, origin: Time, parameters: MoveParameters, arm: Arm<P>) -> Result<Arc<Self>, ShellError> {
        let names = Names { one: "target", many: "targets" };
        let topic = contract::TARGET_POSE;
        let targets = node.intake::<PoseStamped>(topic.name, topic.qos, names, SILENCE)?;
        Ok(Arc::new(Self { node: node.clone(), origin, parameters, targets, arm: Mutex::new(arm) }))
    }

    /// The node.
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// The arm, locked.
    pub fn arm(&self) -> MutexGuard<'_, Arm<P>> {
        self.arm.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Looks again at what enabling looked at: whether others may move the arm. To be called every [`RECHECK_S`].
    pub fn recheck(&self) {
        match self.node.publisher_count(contract::TARGET_POSE.name) {
            Ok(publishers) => {
                if let Some(why) = self.arm().recheck(publishers) {
                    tracing::error!("motion ended: {why}");
                }
            }
            Err(error) => tracing::error!("{error}"),
        }
    }

    /// Adds the arm's fault to a report; it stays until the arm is enabled again. To be called at every report.
    pub fn report(&self, report: &mut Report) {
        let arm = self.arm();
        self.targets.need(arm.awaits_targets());
        let (accepted, rejected) = arm.counts();
        report.value("mode", format!("{:?}", arm.mode()));
        report.value("targets_accepted", accepted).value("targets_rejected", rejected);
        if !arm.fault().is_empty() {
            report.problem(Health::Warn, &format!("the arm: {}", arm.fault()));
        }
    }

    /// The stamp of a time of the arm.
    pub fn stamp(&self, time_s: f64) -> Time {
        self.origin + Duration::from_secs_f64(time_s.max(0.0))
    }

    /// Serves targets, services and the move to the start pose. `set_compliance` carries checked settings out; it may
    /// block, and gives a remark for the caller, or why it failed.
    ///
    /// # Errors
    /// The middleware's.
    pub fn serve(
        self: &Arc<Self>,
        mut set_compliance: impl FnMut(&Compliance) -> Result<String, String> + Send + 'static,
    ) -> Result<Served> {
        let node = &self.node;
        let accepted =
            node.publisher::<AcceptedTarget>(contract::ACCEPTED_TARGET.name, contract::ACCEPTED_TARGET.qos)?;
        let front = Arc::clone(self);
        let targets =
            node.take::<PoseStamped>(&self.targets, move |received| front.on_target(&accepted, &received.message))?;
        let front = Arc::clone(self);
        let events = node.subscription::<EpisodeEvent>(
            contract::EPISODE_EVENT.name,
            contract::EPISODE_EVENT.qos,
            move |received| match received.message.event {
                EpisodeEvent::STARTED => {
                    if let Err(why) = front.arm().episode_started(received.message.step_period) {
                        tracing::error!("episode {}: {why}", received.message.episode);
                    }
                }
                _ => front.arm().episode_ended(),
            },
        )?;
        let front = Arc::clone(self);
        let enable = node.serve::<SetBool>(contract::ENABLE.name, move |request| {
            let (success, message) = outcome(front.enable(request.data));
            SetBoolResponse { success, message }
        })?;
        let compliance = node.serve::<SetCompliance>(contract::SET_COMPLIANCE.name, move |request| {
            let wanted = convert::compliance(&request);
            match wanted.check().map_err(|e| e.to_string()).and_then(|()| set_compliance(&wanted)) {
                Ok(message) => SetComplianceResponse { success: true, message },
                Err(message) => SetComplianceResponse { success: false, message },
            }
        })?;
        let hold = self.serve_trigger(contract::HOLD.name, Arm::hold)?;
        let recover = self.serve_trigger(contract::ERROR_RECOVERY.name, Arm::recover)?;
        let front = Arc::clone(self);
        let moving = node.serve_action::<MoveToStart>(
            contract::MOVE_TO_START.name,
            Concurrency::One,
            |goal| match goal.settle_time {
                t if (0.0..=MAX_SETTLE_S).contains(&t) => Decision::Accept,
                t => Decision::Reject(format!("settle_time: expected 0 to {MAX_SETTLE_S} s, got {t}")),
            },
            move |handle| front.move_to_start(&handle),
        )?;
        Ok(Served { _subscriptions: [targets, events], _services: [enable, hold, recover, compliance], _move: moving })
    }

    /// The state, stamped by the measurement.
    pub fn state(&self, arm: &Arm<P>, success_rate: f64, measured: Time) -> ArmState {
        convert::arm_state(arm, success_rate, stamp::header(measured, crate::gate::BASE_FRAME))
    }

    fn serve_trigger(
        self: &Arc<Self>,
        name: &str,
        act: impl Fn(&mut Arm<P>) -> Result<(), ArmError> + Send + 'static,
    ) -> Result<Service> {
        let front = Arc::clone(self);
        Ok(self.node.serve::<Trigger>(name, move |_| {
            let (success, message) = outcome(act(&mut front.arm()).map_err(|e| e.to_string()));
            TriggerResponse { success, message }
        })?)
    }

    fn on_target(&self, accepted: &Publisher<AcceptedTarget>, message: &PoseStamped) -> Result<(), Flaw> {
        let (answer, verdict) = {
            let mut arm = self.arm();
            let stamp_s = stamp::from_msg(&message.header.stamp).secs_since(self.origin);
            let age_s = arm.plant().stamp_time_s() - stamp_s;
            let verdict = arm.command(&convert::command(message, age_s, self.node.clock().is_simulated()));
            (convert::accepted_target(&arm, &verdict, message.header.clone()), verdict)
        };
        accepted.send(answer);
        match verdict {
            Verdict::Accepted { .. } => Ok(()),
            Verdict::Rejected(why) => Err(Flaw::new(why.kind(), format!("rejected: {why}"))),
        }
    }

    fn enable(&self, on: bool) -> Result<(), String> {
        if !on {
            self.arm().disable();
            return Ok(());
        }
        let publishers = self.node.publisher_count(contract::TARGET_POSE.name).map_err(|e| e.to_string())?;
        self.arm().enable(publishers, self.node.clock().is_simulated()).map_err(|e| e.to_string())
    }

    fn move_to_start(&self, handle: &GoalHandle<MoveToStart>) -> Outcome<MoveToStartResult> {
        let result = |success, message: String| {
            let pose = self.arm().plant().measured().map(|p| convert::pose_message(&p)).unwrap_or_default();
            MoveToStartResult { success, message, pose }
        };
        if let Err(why) = self.begin_move(handle.goal()) {
            return Outcome::Aborted(result(false, why.to_string()));
        }
        loop {
            if handle.wait_cancelled(LOOK) {
                self.arm().stop_move();
                return Outcome::Canceled(result(false, "cancelled".to_owned()));
            }
            let progress = self.arm().move_progress();
            match progress {
                Progress::Moving(distance) => handle.feedback(MoveToStartFeedback { distance }),
                Progress::Arrived => return Outcome::Succeeded(result(true, String::new())),
                Progress::Stopped(why) => return Outcome::Aborted(result(false, format!("stopped: {why}"))),
            }
        }
    }

    fn begin_move(&self, goal: &MoveToStartGoal) -> Result<(), ArmError> {
        let pose = goal.use_pose.then(|| convert::arm_pose(&goal.pose));
        let settle_s = if goal.settle_time > 0.0 { goal.settle_time } else { self.parameters.settle_time_s.get() };
        self.arm().begin_move(pose, self.parameters.speed_m_s.get(), settle_s, self.node.clock().is_simulated())
    }
}

fn outcome(done: Result<(), String>) -> (bool, String) {
    match done {
        Ok(()) => (true, String::new()),
        Err(message) => (false, message),
    }
}
