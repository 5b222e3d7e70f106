//! An arm's side of the contract: targets, episode events, services and the move to the start pose, in front of whatever
//! carries the orders out. The simulated cell and the relay to a controller have the same one.

use crate::arm::{Arm, ArmError, Plant, Progress};
use crate::compliance::Compliance;
use crate::convert;
use crate::gate::{Mode, Rivals, Verdict};
use anyhow::Result;
use catenary_msgs::action::{MoveToStart, MoveToStartFeedback, MoveToStartGoal, MoveToStartResult};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{AcceptedTarget, ArmState, EpisodeEvent};
use catenary_msgs::srv::{SetCompliance, SetComplianceResponse};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolResponse, Trigger, TriggerResponse};
use catenary_shell::{
    ActionServer, Concurrency, Decision, Flaw, GoalHandle, Health, Intake, Names, Node, NodeBuilder, Outcome, Param,
    ParamSpec, Peer, Publisher, Received, Report, Requester, Service, ShellError, Subscription, Time, contract, stamp,
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

/// Time in which every other node is found: discovery takes less than half a second.
const FIRST_LOOK: Duration = Duration::from_millis(700);

/// Waits until the other nodes of the domain are known. To be called before the arm is served: an arm that answered at once
/// would be enabled beside rivals that it has not met.
pub fn meet_others(node: &Node) {
    let _everybody = node.look_around(FIRST_LOOK);
}

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
        if !matches!(self.arm().mode(), Mode::Tracking | Mode::Hold | Mode::Moving) {
            return;
        }
        match self.rivals() {
            Ok(rivals) => {
                if let Some(why) = self.arm().recheck(&rivals) {
                    tracing::error!("motion ended: {why}");
                }
            }
            Err(error) => tracing::error!("{error}"),
        }
    }

    /// Who else may command the arm or answers in its place.
    fn rivals(&self) -> Result<Rivals, String> {
        let words = |peers: Vec<Peer>| peers.iter().map(Peer::to_string).collect();
        let publishers = self.node.publishers(contract::TARGET_POSE.name).map_err(|e| e.to_string())?;
        let servers = self.node.servers(&contract::ARM).map_err(|e| e.to_string())?;
        // One publisher is not looked up in words: this is asked twice a second.
        let publishers = match publishers.len() {
            0 | 1 => vec![String::new(); publishers.len()],
            _ => words(publishers),
        };
        let arms = self.node.publishing(&contract::ARM_TOPICS).map_err(|e| e.to_string())?;
        Ok(Rivals { publishers, servers: words(servers), arms: words(arms) })
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

    /// Serves targets, services and the move to the start pose, after [`meet_others`]. `set_compliance` carries checked settings out; it may
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
        let targets = node.take::<PoseStamped>(&self.targets, move |received| front.on_target(&accepted, &received))?;
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
        let enable = node.serve_to::<SetBool>(contract::ENABLE.name, move |request, requester| {
            let done = front.enable(request.data);
            report(if request.data { "enable" } else { "disable" }, requester, &done);
            let (success, message) = outcome(done);
            SetBoolResponse { success, message }
        })?;
        let compliance = node.serve_to::<SetCompliance>(contract::SET_COMPLIANCE.name, move |request, requester| {
            let wanted = convert::compliance(&request);
            let done = wanted.check().map_err(|e| e.to_string()).and_then(|()| set_compliance(&wanted));
            report("set_compliance", requester, &done);
            match done {
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
        let what = name.rsplit('/').next().unwrap_or(name).to_owned();
        Ok(self.node.serve_to::<Trigger>(name, move |_, requester| {
            let done = act(&mut front.arm()).map_err(|e| e.to_string());
            report(&what, requester, &done);
            let (success, message) = outcome(done);
            TriggerResponse { success, message }
        })?)
    }

    fn on_target(&self, accepted: &Publisher<AcceptedTarget>, received: &Received<PoseStamped>) -> Result<(), Flaw> {
        let message = &received.message;
        let (answer, verdict, is_first) = {
            let mut arm = self.arm();
            let was_tracking = arm.mode() == Mode::Tracking;
            let stamp_s = stamp::from_msg(&message.header.stamp).secs_since(self.origin);
            let age_s = arm.plant().stamp_time_s() - stamp_s;
            let verdict = arm.command(&convert::command(message, age_s, self.node.clock().is_simulated()));
            let is_first = !was_tracking && arm.mode() == Mode::Tracking;
            (convert::accepted_target(&arm, &verdict, message.header.clone()), verdict, is_first)
        };
        accepted.send(answer);
        if is_first {
            tracing::info!("following the targets of {}", self.node.peer(received.publisher));
        }
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
        let rivals = self.rivals()?;
        self.arm().enable(&rivals, self.node.clock().is_simulated()).map_err(|e| e.to_string())
    }

    fn move_to_start(&self, handle: &GoalHandle<MoveToStart>) -> Outcome<MoveToStartResult> {
        let result = |success, message: String| {
            let pose = self.arm().plant().measured().map(|p| convert::pose_message(&p)).unwrap_or_default();
            MoveToStartResult { success, message, pose }
        };
        let begun = self.begin_move(handle.goal());
        report("move_to_start", handle.requester(), &begun);
        if let Err(why) = begun {
            return Outcome::Aborted(result(false, why));
        }
        loop {
            if handle.wait_cancelled(LOOK) {
                self.arm().stop_move();
                tracing::info!("move_to_start: cancelled");
                return Outcome::Canceled(result(false, "cancelled".to_owned()));
            }
            let progress = self.arm().move_progress();
            match progress {
                Progress::Moving(distance) => handle.feedback(MoveToStartFeedback { distance }),
                Progress::Arrived => {
                    tracing::info!("move_to_start: arrived");
                    return Outcome::Succeeded(result(true, String::new()));
                }
                Progress::Stopped(why) => {
                    tracing::info!("move_to_start: stopped: {why}");
                    return Outcome::Aborted(result(false, format!("stopped: {why}")));
                }
            }
        }
    }

    fn begin_move(&self, goal: &MoveToStartGoal) -> Result<(), String> {
        let rivals = self.rivals()?;
        let pose = goal.use_pose.then(|| convert::arm_pose(&goal.pose));
        let settle_s = if goal.settle_time > 0.0 { goal.settle_time } else { self.parameters.settle_time_s.get() };
        let (speed_m_s, is_simulated) = (self.parameters.speed_m_s.get(), self.node.clock().is_simulated());
        self.arm().begin_move(&rivals, pose, speed_m_s, settle_s, is_simulated).map_err(|e| e.to_string())
    }
}

/// Logs a request that may move or stop the arm: who sent it, and what came of it.
fn report<T>(what: &str, requester: &Requester, done: &Result<T, String>) {
    match done {
        Ok(_) => tracing::info!("{what}, asked for by {requester}: done"),
        Err(why) => tracing::info!("{what}, asked for by {requester}: refused: {why}"),
    }
}

fn outcome(done: Result<(), String>) -> (bool, String) {
    match done {
        Ok(()) => (true, String::new()),
        Err(message) => (false, message),
    }
}
