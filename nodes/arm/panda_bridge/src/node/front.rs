//! ROS 2 front end of an arm: targets, episode events, services and the move to the start pose. The simulated cell and the
//! relay to a controller share it.
#![allow(clippy::disallowed_methods, reason = "the begin of a motion is waited for on a clock that does not step")]

use crate::arm::{Arm, Plant, Progress, Surroundings};
use crate::compliance::Compliance;
use crate::convert;
use crate::gate::{Mode, Rejection, Rivals, Stranger, Verdict, Writer};
use anyhow::Result;
use catenary_msgs::action::{MoveToStart, MoveToStartFeedback, MoveToStartGoal, MoveToStartResult};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{AcceptedTarget, ArmState, EpisodeEvent};
use catenary_msgs::srv::{SetCompliance, SetComplianceResponse};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolResponse, Trigger, TriggerResponse};
use catenary_shell::{
    ActionServer, Concurrency, Decision, Flaw, GoalHandle, GraphSnapshot, Health, Intake, Names, Node, NodeBuilder,
    Outcome, Param, ParamSpec, Peer, Publisher, Received, Report, Requester, Service, ShellError, Subscription, Time,
    contract, stamp,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Polling period of a running move, 50 Hz as the rate of targets.
const MOVE_POLL: Duration = Duration::from_millis(20);
/// Silence of targets, while they are due, that is reported as an error. Shorter than the 2 s after which the gate ends the
/// motion.
const SILENCE: Duration = Duration::from_millis(1500);
/// Time between two checks of the other nodes of the graph, s.
pub const RECHECK_S: f64 = 0.5;
/// Maximum settling time of a goal, s.
const MAX_SETTLE_S: f64 = 60.0;

/// Longest wait for the begin of a motion, and for an arm that can move again after a recovery. Chosen: a robot begins within 0.1 s.
const BEGINNING: Duration = Duration::from_secs(2);
/// Polling period of that wait.
const BEGIN_POLL: Duration = Duration::from_millis(2);
/// Time for the discovery of all other nodes, which takes less than half a second.
const DISCOVERY_TIME: Duration = Duration::from_millis(700);

/// Waits until the other nodes of the domain are discovered. Call it before serving the arm: an arm that answers earlier could
/// be enabled beside rivals that are not yet discovered.
pub fn meet_others(node: &Node) {
    let _everybody = node.look_around(DISCOVERY_TIME);
}

/// Parameters of the move to the start pose.
pub struct MoveParameters {
    speed_m_s: Param<f64>,
    settle_time_s: Param<f64>,
}

impl MoveParameters {
    /// Declares `start_speed_m_s` and `settle_time_s`.
    ///
    /// # Errors
    /// An invalid value for one of them.
    pub fn declare(builder: &NodeBuilder) -> Result<Self> {
        let speed = ParamSpec::new("Greatest speed on the way to the start pose.").unit("m/s").range(0.01..=1.0);
        let settle = ParamSpec::new("Wait after arriving at the start pose, for the object to come to rest.");
        Ok(Self {
            speed_m_s: builder.declare_f64("start_speed_m_s", 0.15, speed)?,
            settle_time_s: builder.declare_f64("settle_time_s", 1.5, settle.unit("s").range(0.0..=MAX_SETTLE_S))?,
        })
    }
}

/// Check whether a plant can be commanded, from a snapshot of the graph. Returns the reason if it cannot.
type Readiness = Box<dyn Fn(&GraphSnapshot<'_>) -> Option<String> + Send + Sync>;

/// Front end of an arm.
pub struct Front<P> {
    node: Node,
    /// Stamp of time 0 of the arm.
    origin: Time,
    parameters: MoveParameters,
    targets: Intake,
    readiness: Readiness,
    arm: Mutex<Arm<P>>,
    /// Writer that the arm follows, with the name that its node had then: a node that has died has none any more.
    followed: Mutex<Option<(Writer, String)>>,
}

/// Endpoints of an arm. They end when this is dropped.
#[must_use = "the arm is served until this is dropped"]
pub struct Served {
    _subscriptions: [Subscription; 2],
    _services: [Service; 4],
    _move: ActionServer,
}

impl<P: Plant> Front<P> {
    /// Creates the front end of an arm whose plant is always ready. `origin` is the stamp of the arm's time 0.
    ///
    /// # Errors
    /// [`ShellError::Name`]: the topic of targets after remapping.
    pub fn new(node: &Node, origin: Time, parameters: MoveParameters, arm: Arm<P>) -> Result<Arc<Self>, ShellError> {
        Self::with_readiness(node, origin, parameters, arm, |_| None)
    }

    /// Creates the front end of an arm. `readiness` returns the reason why the plant cannot be commanded; `None` if it can.
    ///
    /// # Errors
    /// As [`Front::new`].
    pub fn with_readiness(
        node: &Node,
        origin: Time,
        parameters: MoveParameters,
        arm: Arm<P>,
        readiness: impl Fn(&GraphSnapshot<'_>) -> Option<String> + Send + Sync + 'static,
    ) -> Result<Arc<Self>, ShellError> {
        let names = Names { one: "target", many: "targets" };
        let topic = contract::TARGET_POSE;
        let targets = node.intake::<PoseStamped>(topic.name, topic.qos, names, SILENCE)?;
        let readiness: Readiness = Box::new(readiness);
        let (arm, followed) = (Mutex::new(arm), Mutex::new(None));
        Ok(Arc::new(Self { node: node.clone(), origin, parameters, targets, readiness, arm, followed }))
    }

    /// Returns the node.
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// Locks the arm.
    pub fn arm(&self) -> MutexGuard<'_, Arm<P>> {
        self.arm.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Repeats the checks of enabling: other nodes that could move the arm end its motion. Call it every [`RECHECK_S`].
    pub fn recheck(&self) {
        if !matches!(self.arm().mode(), Mode::Tracking | Mode::Hold | Mode::Moving) {
            return;
        }
        // Collected before the arm is locked: copying the graph takes time, and targets wait for that lock.
        match self.surroundings() {
            Ok(around) => {
                if let Some(why) = self.arm().recheck(&around) {
                    tracing::error!("motion ended: {why}");
                }
            }
            Err(error) => tracing::error!("{error}"),
        }
    }

    /// Returns the state of the graph around the arm, from one copy of the discovered writers.
    fn surroundings(&self) -> Result<Surroundings, String> {
        let words = |peers: Vec<Peer>| peers.iter().map(Peer::to_string).collect();
        let graph = self.node.graph_snapshot();
        let publishers = graph.publishers(contract::TARGET_POSE.name).map_err(|e| e.to_string())?;
        let servers = graph.servers(&contract::ARM).map_err(|e| e.to_string())?;
        // With several, the arm does not move.
        let writer = publishers.first().filter(|_| publishers.len() == 1).map(Peer::endpoint);
        // One publisher is allowed, so its name is not needed. Looking it up reads /proc, and this runs twice a second.
        let publishers = match publishers.len() {
            0 | 1 => vec![String::new(); publishers.len()],
            _ => words(publishers),
        };
        let arms = graph.publishing(&contract::ARM_TOPICS).map_err(|e| e.to_string())?;
        let rivals = Rivals { publishers, writer, servers: words(servers), arms: words(arms) };
        Ok(Surroundings { rivals, unready: (self.readiness)(&graph) })
    }

    /// Adds the arm's mode, counts and fault to a report. A fault stays until the arm is enabled again. Call it at every report.
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

    /// Returns the stamp of a time of the arm, s.
    pub fn stamp(&self, time_s: f64) -> Time {
        self.origin + Duration::from_secs_f64(time_s.max(0.0))
    }

    /// Serves targets, services and the move to the start pose. Call [`meet_others`] before. `set_compliance` applies checked
    /// settings; it may block, and returns a remark for the caller or the reason of a failure. `recover` makes the robot recover
    /// before the gate does; it may block.
    ///
    /// # Errors
    /// [`ShellError`]: the names after remapping, the middleware.
    pub fn serve(
        self: &Arc<Self>,
        mut set_compliance: impl FnMut(&Compliance) -> Result<String, String> + Send + 'static,
        recover: impl Fn() -> Result<(), String> + Send + 'static,
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
            move |received| front.on_event(&received),
        )?;
        let front = Arc::clone(self);
        let enable = node.serve_to::<SetBool>(contract::ENABLE.name, move |request, requester| {
            let done = if request.data { front.enable() } else { front.disable() };
            front.log_request(if request.data { "enable" } else { "disable" }, requester, &done);
            let (success, message) = outcome(done);
            SetBoolResponse { success, message }
        })?;
        let front = Arc::clone(self);
        let compliance = node.serve_to::<SetCompliance>(contract::SET_COMPLIANCE.name, move |request, requester| {
            let wanted = convert::compliance(&request);
            let done = wanted.check().map_err(|e| e.to_string()).and_then(|()| set_compliance(&wanted));
            front.log_request("set_compliance", requester, &done);
            match done {
                Ok(message) => SetComplianceResponse { success: true, message },
                Err(message) => SetComplianceResponse { success: false, message },
            }
        })?;
        let hold = self.serve_trigger(contract::HOLD.name, |front| front.arm().hold().map_err(|e| e.to_string()))?;
        let recover = self.serve_trigger(contract::ERROR_RECOVERY.name, move |front| {
            // The arm is not locked while the robot recovers.
            recover()?;
            front.arm().recover().map_err(|e| e.to_string())?;
            front.wait_until_it_can_move()
        })?;
        let front = Arc::clone(self);
        let moving = node.serve_action::<MoveToStart>(
            contract::MOVE_TO_START.name,
            Concurrency::One,
            // Also rejects NaN, which no comparison would.
            |goal| match goal.settle_time {
                t if (0.0..=MAX_SETTLE_S).contains(&t) => Decision::Accept,
                t => Decision::Reject(format!("settle_time: expected 0 to {MAX_SETTLE_S} s, got {t}")),
            },
            move |handle| front.move_to_start(&handle),
        )?;
        Ok(Served { _subscriptions: [targets, events], _services: [enable, hold, recover, compliance], _move: moving })
    }

    /// Makes the state message, stamped with the time of the measurement.
    pub fn state(&self, arm: &Arm<P>, success_rate: f64, measured: Time) -> ArmState {
        convert::arm_state(arm, success_rate, stamp::header(measured, crate::gate::BASE_FRAME))
    }

    /// Serves a request by `act`, which may block.
    fn serve_trigger(
        self: &Arc<Self>,
        name: &str,
        act: impl Fn(&Self) -> Result<(), String> + Send + 'static,
    ) -> Result<Service> {
        let front = Arc::clone(self);
        let what = name.rsplit('/').next().unwrap_or(name).to_owned();
        Ok(self.node.serve_to::<Trigger>(name, move |_, requester| {
            let done = act(&front);
            front.log_request(&what, requester, &done);
            let (success, message) = outcome(done);
            TriggerResponse { success, message }
        })?)
    }

    fn on_event(self: &Arc<Self>, received: &Received<EpisodeEvent>) {
        let (event, mut arm) = (&received.message, self.arm());
        let starts = event.event == EpisodeEvent::STARTED;
        if let Err(stranger) = arm.admit_event(received.publisher, starts) {
            drop(arm);
            self.on_stranger(stranger);
        } else if starts {
            if let Err(why) = arm.episode_started(event.step_period) {
                tracing::error!("episode {}: {why}", event.episode);
            }
        } else {
            // Any other event ends the supervision of silence; an unknown one must not start it.
            arm.episode_ended();
        }
    }

    /// Ends a motion because of a message of a stranger, and names both nodes.
    pub fn on_stranger(self: &Arc<Self>, stranger: Stranger) {
        if self.arm().stranger(&stranger) {
            self.name(stranger);
        }
    }

    /// Logs a stranger that ended a motion, and writes both names into the fault. The motion has ended before: names take time.
    fn name(self: &Arc<Self>, stranger: Stranger) {
        let followed = self.followed().clone();
        let bound = followed.filter(|(writer, _)| *writer == stranger.bound).map(|(_, name)| name);
        let bound = bound.unwrap_or_else(|| self.node.peer(stranger.bound).to_string());
        let front = Arc::clone(self);
        self.node.identify(stranger.writer, move |peer| {
            let text = stranger.text(&peer.to_string(), &bound);
            tracing::error!("{text}");
            front.arm().name_stranger(&stranger, &text);
        });
    }

    fn followed(&self) -> MutexGuard<'_, Option<(Writer, String)>> {
        self.followed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps the name of the writer that the arm follows.
    fn keep_name(self: &Arc<Self>, writer: Writer, told: &'static str) {
        let front = Arc::clone(self);
        self.node.identify(writer, move |peer| {
            tracing::info!("{told} {peer}");
            *front.followed() = Some((writer, peer.to_string()));
        });
    }

    fn on_target(
        self: &Arc<Self>,
        accepted: &Publisher<AcceptedTarget>,
        received: &Received<PoseStamped>,
    ) -> Result<(), Flaw> {
        let message = &received.message;
        // The first target binds the arm to its writer, which must be the only one. Looking at the graph takes too long for each target.
        if self.arm().awaits_writer() {
            self.recheck();
        }
        let (answer, verdict, is_first) = {
            let mut arm = self.arm();
            let was_tracking = arm.mode() == Mode::Tracking;
            let stamp_s = stamp::from_msg(&message.header.stamp).secs_since(self.origin);
            let age_s = arm.plant().stamp_time_s() - stamp_s;
            let is_simulated = self.node.clock().is_simulated();
            let verdict = arm.command(&convert::command(message, received.publisher, age_s, is_simulated));
            let is_first = !was_tracking && arm.mode() == Mode::Tracking;
            (convert::accepted_target(&arm, &verdict, message.header.clone()), verdict, is_first)
        };
        accepted.send(answer);
        if is_first {
            self.keep_name(received.publisher, "following the targets of");
        }
        if let Verdict::Rejected(Rejection::Stranger(stranger)) = &verdict {
            self.name(*stranger);
        }
        match verdict {
            Verdict::Accepted { .. } => Ok(()),
            // A rejected target counts as a dropped message in the node's diagnostics.
            Verdict::Rejected(why) => Err(Flaw::new(why.kind(), format!("rejected: {why}"))),
        }
    }

    fn disable(&self) -> Result<(), String> {
        self.arm().disable();
        Ok(())
    }

    /// Enables the arm, and waits until its motion has begun.
    fn enable(self: &Arc<Self>) -> Result<(), String> {
        let around = self.surroundings()?;
        self.arm().enable(&around, self.node.clock().is_simulated()).map_err(|e| e.to_string())?;
        if let Some(writer) = around.rivals.writer {
            self.keep_name(writer, "enabled for the targets of");
        }
        let start = Instant::now();
        loop {
            {
                let mut arm = self.arm();
                if !matches!(arm.mode(), Mode::Tracking | Mode::Hold) {
                    let why = if arm.fault().is_empty() { format!("{:?}", arm.mode()) } else { arm.fault().to_owned() };
                    return Err(format!("the motion ended before it had begun: {why}"));
                }
                if arm.plant().has_begun() {
                    return Ok(());
                }
                if start.elapsed() > BEGINNING {
                    arm.disable();
                    drop(arm);
                    return Err(self.late("the motion has not begun"));
                }
            }
            if self.node.shutdown().wait_timeout(BEGIN_POLL) {
                return Err("the node is ending".to_owned());
            }
        }
    }

    /// Waits until an arm that has recovered takes a motion. An arm in a motion, which had nothing to recover from, need not wait.
    fn wait_until_it_can_move(&self) -> Result<(), String> {
        let start = Instant::now();
        loop {
            {
                let arm = self.arm();
                match arm.mode() {
                    Mode::Tracking | Mode::Hold | Mode::Moving => return Ok(()),
                    Mode::Idle if arm.plant().can_begin() => return Ok(()),
                    Mode::Idle => {}
                    _ => return Err(format!("stopped again: {}", arm.fault())),
                }
            }
            if start.elapsed() > BEGINNING {
                return Err(self.late("the arm has recovered, and cannot move yet"));
            }
            if self.node.shutdown().wait_timeout(BEGIN_POLL) {
                return Err("the node is ending".to_owned());
            }
        }
    }

    fn late(&self, what: &str) -> String {
        let why = (self.readiness)(&self.node.graph_snapshot());
        let why = why.unwrap_or_else(|| "the robot gives no reason".to_owned());
        format!("{what} within {} s: {why}", BEGINNING.as_secs())
    }

    fn move_to_start(&self, handle: &GoalHandle<MoveToStart>) -> Outcome<MoveToStartResult> {
        let result = |success, message: String| {
            let pose = self.arm().plant().measured().map(|p| convert::pose_message(&p)).unwrap_or_default();
            MoveToStartResult { success, message, pose }
        };
        let begun = self.begin_move(handle.goal());
        self.log_request("move_to_start", handle.requester(), &begun);
        if let Err(why) = begun {
            return Outcome::Aborted(result(false, why));
        }
        loop {
            if handle.wait_cancelled(MOVE_POLL) {
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

    /// Logs a request that may move or stop the arm, with its sender and its outcome.
    fn log_request<T>(&self, what: &str, requester: &Requester, done: &Result<T, String>) {
        let outcome = done.as_ref().map_or_else(|why| format!("refused: {why}"), |_| "done".to_owned());
        let what = what.to_owned();
        let tell = move |peer: &Peer| tracing::info!("{what}, asked for by {peer}: {outcome}");
        self.node.identify(requester.endpoint(), tell);
    }

    fn begin_move(&self, goal: &MoveToStartGoal) -> Result<(), String> {
        let around = self.surroundings()?;
        let pose = goal.use_pose.then(|| convert::arm_pose(&goal.pose));
        let settle_s = if goal.settle_time > 0.0 { goal.settle_time } else { self.parameters.settle_time_s.get() };
        let (speed_m_s, is_simulated) = (self.parameters.speed_m_s.get(), self.node.clock().is_simulated());
        self.arm().begin_move(&around, pose, speed_m_s, settle_s, is_simulated).map_err(|e| e.to_string())
    }
}

fn outcome(done: Result<(), String>) -> (bool, String) {
    match done {
        Ok(()) => (true, String::new()),
        Err(message) => (false, message),
    }
}
