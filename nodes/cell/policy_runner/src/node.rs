//! Node with an action that runs one episode at a time.
#![allow(
    clippy::disallowed_methods,
    reason = "the ROS side reads the model file that a parameter names, and waits for names on a clock that does not step"
)]

mod lock_step;

use crate::convert;
use crate::runner::{Fault, Inputs, Objection, Runner, Settings, Step, StillTurn, StillWait, Turn};
use crate::writers::{Source, Writer, Writers, lock};
use anyhow::{Context, Result, anyhow};
use catenary_core::model::ArmLaw;
use catenary_core::policy::OtherArm;
use catenary_core::track::End;
use catenary_core::{Judge, Model, Policy};
use catenary_msgs::action::{RunEpisode, RunEpisodeGoal, RunEpisodeResult};
use catenary_msgs::builtin_interfaces::msg::Time as Stamp;
use catenary_msgs::geometry_msgs::msg::{Pose, PoseStamped};
use catenary_msgs::msg::{AcceptedTarget, ArmState, EefDelta, EpisodeEvent, Keypoints, Observation};
use catenary_msgs::std_msgs::msg::String as Text;
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolRequest};
use catenary_shell::{
    Attendance, CallError, Client, Concurrency, DEAD_NODE, Decision, Flaw, GoalHandle, Intake, Latest, Misconfigured,
    Msg, Names, Node, NodeBuilder, Outcome, Param, ParamSpec, Peer, Presence, Publisher, Queue, Received, StampCheck,
    Time, contract, read_model, stamp,
};
use lock_step::{Cancelled, LockStep};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};

/// Timeout of the answer to an enable request. The wait for the enabled state afterwards has the same timeout. It is longer
/// than the discovery of a new server takes.
const ENABLE: Duration = Duration::from_secs(3);
/// Longest wait for the delivery of an episode's last messages in lock step.
const DELIVERY: Duration = Duration::from_secs(5);
/// Capacity of the queue of answers to targets: far more than one step needs.
const ANSWERS: usize = 100;
/// Silence of a topic, within an episode, that is reported as an error. Shorter than the default patience of 1 s, after which
/// the episode ends.
const SILENCE: Duration = Duration::from_millis(500);
/// Maximum uninterrupted wait within a step: a cancelled episode, or one whose arm refuses, ends within it.
const NAP: Duration = Duration::from_millis(20);
/// Longest wait for the name of a node, after the end of an episode. A node tells it within a second.
const NAME: Duration = Duration::from_secs(1);
/// Period of the feedback of an episode that waits, s.
const FEEDBACK_S: f64 = 0.5;
/// Period of its log lines, s.
const WAIT_LOG_S: f64 = 10.0;
/// Period of looks at the keypoints before an episode: shorter than that of a camera's frames.
const POLL: Duration = Duration::from_millis(10);

/// Runs the node from the arguments after the program's name.
pub fn main(args: Vec<String>) -> ExitCode {
    catenary_shell::main("policy_runner", args, run)
}

/// Parameters and endpoints of the node.
struct Shell {
    node: Node,
    model_file: Param<String>,
    max_age_s: Param<f64>,
    patience_s: Param<f64>,
    still_patience_s: Param<f64>,
    still_px: Param<f64>,
    keypoints: Latest<Keypoints>,
    pose: Latest<PoseStamped>,
    arm: Latest<ArmState>,
    /// Law that the arm announces.
    law: Latest<Text>,
    target: Publisher<PoseStamped>,
    answers: Queue<AcceptedTarget>,
    action: Publisher<EefDelta>,
    observation: Publisher<Observation>,
    event: Publisher<EpisodeEvent>,
    enable: Client<SetBool>,
    /// Set if simulated time waits for the episode.
    lock_step: Option<LockStep>,
    /// Intakes of the topics that an episode needs.
    needed: [Intake; 4],
    /// Writers that the running episode is bound to.
    writers: Arc<Mutex<Writers>>,
    episodes: AtomicU32,
}

fn run(builder: NodeBuilder) -> Result<()> {
    let builder = builder.declare_lock_step()?;
    let defaults = Settings::default();
    let model_file = builder.declare_string(
        "model_file",
        "",
        ParamSpec::new("Model file whose task (step period, anchor, workspace, goal) episodes follow."),
    )?;
    let age = ParamSpec::new("Oldest keypoints and pose that an observation may use; smaller acts on fresher data.");
    let max_age_s = builder.declare_f64("max_age_s", defaults.max_age_s, age.unit("s").range(0.001..=10.0))?;
    let patience = ParamSpec::new("Time that a due step waits for fresh data before the episode is aborted.");
    let patience_s = builder.declare_f64("patience_s", defaults.patience_s, patience.unit("s").range(0.0..=60.0))?;
    let rest = ParamSpec::new("Longest wait of an episode for the object to hang still; 0: episodes begin at once.");
    let rest = rest.unit("s").range(0.0..=600.0);
    let still_patience_s = builder.declare_f64("still_patience_s", defaults.still_patience_s, rest)?;
    let still = ParamSpec::new(
        "Motion of the keypoints' middle in a second that counts as still; larger for keypoints with more noise.",
    );
    let still_px = builder.declare_f64("still_px", defaults.still_px, still.unit("px").range(0.0..=1000.0))?;
    let node = builder.build()?;
    let needed = intakes(&node)?;
    let [keypoints, pose, arm, answers] = &needed;
    let (mut doubts, limit_s) = (doubter(keypoints), max_age_s.clone());
    let writers = Arc::new(Mutex::new(Writers::default()));
    let check_keypoints = of_one_writer(&writers, Source::Keypoints, move |message: &Keypoints| {
        convert::check_keypoints(message)?;
        doubts(&message.header.stamp, limit_s.get());
        Ok(())
    });
    let (mut doubts, limit_s) = (doubter(pose), max_age_s.clone());
    let check_pose = of_one_writer(&writers, Source::Pose, move |message: &PoseStamped| {
        convert::check_pose(message)?;
        doubts(&message.header.stamp, limit_s.get());
        Ok(())
    });
    let check_arm = of_one_writer(&writers, Source::ArmState, |_: &ArmState| Ok(()));
    let (keypoints, pose) = (node.take_latest(keypoints, check_keypoints)?, node.take_latest(pose, check_pose)?);
    let arm = node.take_latest(arm, check_arm)?;
    let lock_step = node.is_in_lock_step().then(|| LockStep::new(&node, &keypoints, &pose, &arm, &writers));
    let shell = Shell {
        lock_step: lock_step.transpose().map_err(Misconfigured::new)?,
        model_file,
        max_age_s,
        patience_s,
        still_patience_s,
        still_px,
        keypoints,
        pose,
        arm,
        law: node.latest(contract::ARM_LAW.name, contract::ARM_LAW.qos)?,
        target: node.publisher(contract::TARGET_POSE.name, contract::TARGET_POSE.qos)?,
        answers: node.take_queue(answers, ANSWERS)?,
        action: node.publisher(contract::ACTION.name, contract::ACTION.qos)?,
        observation: node.publisher(contract::OBSERVATION.name, contract::OBSERVATION.qos)?,
        event: node.publisher(contract::EPISODE_EVENT.name, contract::EPISODE_EVENT.qos)?,
        enable: node.client(contract::ENABLE.name)?,
        needed,
        writers,
        episodes: AtomicU32::new(first_episode(&node)),
        node: node.clone(),
    };
    // Read once at the start, so that a wrong model file fails at once and not with the first episode.
    shell.judge().map_err(Misconfigured::new)?;
    node.report_diagnostics(|_| {})?;
    let _server = node.serve_action::<RunEpisode>(
        "policy_runner/run_episode",
        Concurrency::One,
        |_| Decision::Accept,
        move |handle| shell.serve(&handle),
    )?;
    node.wait_for_shutdown()
}

/// Returns the number of the first episode. In lock step time begins at zero, and the same run gives the same bits.
fn first_episode(node: &Node) -> u32 {
    if node.is_in_lock_step() { 1 } else { crate::numbering::first_episode(SystemTime::now()) }
}

/// Creates the intakes of keypoints, pose, arm state and answers to targets.
fn intakes(node: &Node) -> Result<[Intake; 4]> {
    let [keypoints, pose, arm] = [contract::KEYPOINTS, contract::CURRENT_POSE, contract::ARM_STATE];
    let answers = contract::ACCEPTED_TARGET;
    let names = |one, many| Names { one, many };
    Ok([
        node.intake::<Keypoints>(keypoints.name, keypoints.qos, names("keypoints", "keypoints"), SILENCE)?,
        node.intake::<PoseStamped>(pose.name, pose.qos, names("pose", "poses"), SILENCE)?,
        node.intake::<ArmState>(arm.name, arm.qos, names("arm_state", "arm_states"), SILENCE)?,
        // No timeout: answers follow the policy's steps, and none comes while the episode ends.
        node.intake::<AcceptedTarget>(answers.name, answers.qos, names("answer", "answers"), Duration::MAX)?,
    ])
}

/// Returns a check that drops the messages of a second writer within an episode, and passes the others to `check`. It runs for every
/// message: a later one may cover that of a stranger before the episode looks.
fn of_one_writer<M: Msg, F: FnMut(&M) -> Result<(), Flaw> + Send>(
    writers: &Arc<Mutex<Writers>>,
    source: Source,
    mut check: F,
) -> impl FnMut(&Received<M>) -> Result<(), Flaw> + Send + use<M, F> {
    let writers = Arc::clone(writers);
    move |received| {
        lock(&writers).hear(source, received.publisher).map_err(|stranger| Flaw::new("stranger", stranger))?;
        check(&received.message)
    }
}

/// Returns a function that reports stamps too old for an observation. Its second argument is the age limit, s.
fn doubter(intake: &Intake) -> impl FnMut(&Stamp, f64) + Send + use<> {
    let (intake, mut check) = (intake.clone(), StampCheck::new(Duration::ZERO));
    move |newest, limit_s| {
        check.set_limit(Duration::from_secs_f64(limit_s));
        intake.check_stamp(&mut check, stamp::from_msg(newest));
    }
}

impl Shell {
    /// Reads the judge of the model file's task. Each episode reads it again: the parameter may have changed.
    fn judge(&self) -> Result<Judge> {
        let path = self.model_file.get();
        anyhow::ensure!(
            !path.is_empty(),
            "parameter model_file: expected the path of a model file, got an empty string"
        );
        let model = read_model("model_file", path.as_ref(), Model::from_yaml)?;
        Judge::of(&model).with_context(|| format!("model_file {path}: it has no task"))
    }

    /// Compares the arm of the policy's training with the one that announces its law, if one does.
    fn other_arm(&self, policy: &Policy) -> Option<OtherArm> {
        let Some(announced) = self.law.get() else {
            if policy.arm.is_some() {
                tracing::info!(
                    "{}: no arm announces its law, which is not compared with that of the policy",
                    self.law.topic()
                );
            }
            return None;
        };
        match ArmLaw::from_text(&announced.message.data) {
            Ok(law) => policy.other_arm(&law),
            Err(error) => {
                tracing::warn!("{}: expected the law of an arm as a model file has it: {error}", self.law.topic());
                None
            }
        }
    }

    fn serve(&self, handle: &GoalHandle<RunEpisode>) -> Outcome<RunEpisodeResult> {
        let episode = self.episodes.fetch_add(1, Ordering::Relaxed);
        let tell = move |peer: &Peer| tracing::info!("episode {episode}: run_episode, asked for by {peer}");
        self.node.identify(handle.requester().endpoint(), tell);
        lock(&self.writers).begin();
        // Answers to targets of others are not about this episode.
        while self.answers.try_next().is_some() {}
        let outcome = self.episode(handle, episode).map_err(|error| self.with_names(error));
        lock(&self.writers).end();
        match outcome.inspect(|(_, result)| tracing::info!("episode {episode}: {}", result.end)) {
            // `End::Complete` marks a cancelled episode; see `episode`.
            Ok((End::Complete, result)) => Outcome::Canceled(result),
            Ok((_, result)) => Outcome::Succeeded(result),
            Err(error) => {
                tracing::error!("episode {episode}: {error:#}");
                Outcome::Aborted(RunEpisodeResult {
                    message: format!("{error:#}"),
                    episode,
                    ..RunEpisodeResult::default()
                })
            }
        }
    }

    /// Runs one episode. [`End::Complete`] stands for a cancelled episode.
    fn episode(&self, handle: &GoalHandle<RunEpisode>, episode: u32) -> Result<(End, RunEpisodeResult)> {
        let client = handle.requester().attendance();
        let goal = handle.goal();
        let policy = Policy::from_bytes(&goal.policy)?;
        if let Some(other) = self.other_arm(&policy) {
            tracing::warn!("episode {episode}: {other}. Train for this arm: catenary train --arm running");
        }
        let own = Settings {
            max_age_s: self.max_age_s.get(),
            patience_s: self.patience_s.get(),
            still_patience_s: self.still_patience_s.get(),
            still_px: self.still_px.get(),
            ..Settings::default()
        };
        let wait = StillWait::before(&policy, own);
        if let Some(why) = policy.moving_start() {
            tracing::info!("episode {episode}: begins at once, without a wait for the object to hang still: {why}");
        }
        let mut runner = Runner::new(policy, self.judge()?, convert::settings(goal, own))?;
        // Told at once, and not after the wait.
        self.enable.ensure_one_server()?;
        self.pose.get().with_context(|| format!("no pose on {}", self.pose.topic()))?;
        // One clock for the wait and the steps: the runner knows the target from both.
        if self.begin(handle)?.is_err() {
            return Ok(cancelled(episode));
        }
        let origin = self.node.now();
        if !self.still(handle, origin, &mut runner, wait, client)? {
            return Ok(cancelled(episode));
        }
        // Before the arm is enabled: without a pose nothing must move.
        let held = self.pose.get().with_context(|| format!("no pose on {}", self.pose.topic()))?.message.pose.clone();
        self.enable_arm(handle)?;
        self.announce(&runner, goal, episode, EpisodeEvent::STARTED, String::new());
        self.needed.iter().for_each(|intake| intake.need(true));
        let outcome = self.steps(handle, &mut runner, episode, origin, &held);
        self.needed.iter().for_each(|intake| intake.need(false));
        self.disable_arm();
        // Names take time, and the arm must not wait for them.
        let outcome = outcome.map_err(|error| self.with_names(error));
        let reason = match &outcome {
            Ok(Some(end)) => end.name().to_owned(),
            Ok(None) => "cancelled".to_owned(),
            Err(error) => format!("fault: {error:#}"),
        };
        self.announce(&runner, goal, episode, EpisodeEvent::ENDED, reason.clone());
        if self.lock_step.is_some() {
            // Time stands still after the result, and a recorder that is ended then must have everything.
            let _in_time = [self.event.wait_acknowledged(DELIVERY), self.observation.wait_acknowledged(DELIVERY)];
        }
        let end = outcome?;
        let result = RunEpisodeResult {
            success: end.is_some(),
            message: if end.is_some() { String::new() } else { reason.clone() },
            episode,
            end: reason,
            rewards: runner.rewards().to_vec(),
            episode_return: runner.rewards().iter().sum(),
        };
        Ok((end.unwrap_or(End::Complete), result))
    }

    /// Waits until the object hangs still. `origin` is the time of the goal. Returns false if the episode was cancelled meanwhile.
    fn still(
        &self,
        handle: &GoalHandle<RunEpisode>,
        origin: Time,
        runner: &mut Runner,
        mut wait: StillWait,
        mut client: Attendance,
    ) -> Result<bool> {
        let (mut feedback_s, mut log_s) = (0.0, 0.0);
        while !handle.is_cancelled() {
            // The wait may take minutes. Nobody expects a motion that was asked for by a program that was killed meanwhile.
            let Some(presence) = self.presence(handle, &mut client) else { return Ok(false) };
            anyhow::ensure!(presence != Presence::Gone, "the client that asked for the episode has left the graph");
            // An arm that was stopped meanwhile must not start once somebody has released it. States from before the goal tell of the motion to
            // the start.
            let arm = self.arm.get();
            let meanwhile = convert::measured_after(arm.as_ref().map(|a| &*a.message), origin);
            if let Some(why) = convert::arm_stopped(meanwhile) {
                return Err(fault_error(Fault::Arm(why)));
            }
            let inputs = self.inputs(origin);
            if let Some(stranger) = inputs.stranger {
                return Err(fault_error(Fault::Stranger(stranger)));
            }
            runner.note_target(&inputs);
            match wait.turn(&inputs) {
                StillTurn::Still if presence == Presence::Here => return Ok(true),
                StillTurn::Fault(fault) => return Err(fault_error(fault)),
                turn @ (StillTurn::Still | StillTurn::Wait) => {
                    let progress = wait.progress();
                    // An object that is still, or need not be, waits for its client alone.
                    let is_waiting = turn == StillTurn::Wait;
                    if is_waiting && progress.waited_s >= feedback_s {
                        feedback_s = progress.waited_s + FEEDBACK_S;
                        handle.feedback(convert::waiting(&progress));
                    }
                    if is_waiting && progress.motion_px.is_some() && progress.waited_s >= log_s {
                        log_s = progress.waited_s + WAIT_LOG_S;
                        tracing::info!("the episode begins when the object hangs still: stay clear; {progress}");
                    }
                    if self.go_on(handle, POLL)?.is_err() {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(false)
    }

    /// Runs the steps of an episode. Returns its end, or `None` if it was cancelled.
    fn steps(
        &self,
        handle: &GoalHandle<RunEpisode>,
        runner: &mut Runner,
        episode: u32,
        origin: Time,
        held: &Pose,
    ) -> Result<Option<End>> {
        let (mut sent, mut answered) = (None, None);
        while !handle.is_cancelled() {
            // Before the inputs: an answer may come from a stranger.
            let heard = self.objection(sent.as_ref());
            let objection = answered.take().or(heard);
            let inputs = Inputs { objection, ..self.inputs(origin) };
            match runner.turn(&inputs) {
                Turn::Wait(until_s) => {
                    let until = origin + Duration::from_secs_f64(until_s.max(0.0));
                    // The wait is limited to `NAP`, because the node's clock may be simulated and faster than the wall
                    // clock.
                    if self.go_on(handle, until.saturating_since(self.node.now()).min(NAP))?.is_err() {
                        return Ok(None);
                    }
                }
                Turn::Step(step) => {
                    sent = self.publish(&step, runner, episode, origin, held)?.or(sent);
                    if let Some(reward) = step.reward {
                        handle.feedback(convert::rewarded(step.index as u32 - 1, reward));
                    }
                    if step.end.is_some() {
                        return Ok(step.end);
                    }
                    if let (Some(lock_step), Some(sent)) = (&self.lock_step, &sent) {
                        match lock_step.answer(&self.answers, sent, &|nap| handle.wait_cancelled(nap))? {
                            Ok(answer) => answered = answer.as_ref().and_then(convert::objection),
                            Err(Cancelled) => return Ok(None),
                        }
                    }
                }
                Turn::Fault(fault) => return Err(fault_error(fault)),
            }
        }
        Ok(None)
    }

    /// Begins an episode in lock step at a frame; in real time it begins at once.
    fn begin(&self, handle: &GoalHandle<RunEpisode>) -> Result<Result<(), Cancelled>> {
        match &self.lock_step {
            Some(lock_step) => lock_step.begin(&|nap| handle.wait_cancelled(nap)),
            None => Ok(Ok(())),
        }
    }

    /// Waits for new data: for `nap` in real time, for the next frame in lock step.
    fn go_on(&self, handle: &GoalHandle<RunEpisode>, nap: Duration) -> Result<Result<(), Cancelled>> {
        match &self.lock_step {
            Some(lock_step) => lock_step.next_frame(&|nap| handle.wait_cancelled(nap)),
            None if handle.wait_cancelled(nap) => Ok(Err(Cancelled)),
            None => Ok(Ok(())),
        }
    }

    /// Returns the presence of the episode's client; `None` if the episode was cancelled.
    fn presence(&self, handle: &GoalHandle<RunEpisode>, client: &mut Attendance) -> Option<Presence> {
        loop {
            match client.look() {
                // Discovery takes wall time, and simulated time must not pass meanwhile.
                Presence::Missing if self.lock_step.is_some() => {
                    if handle.wait_cancelled(POLL) {
                        return None;
                    }
                }
                presence => return Some(presence),
            }
        }
    }

    fn inputs(&self, origin: Time) -> Inputs {
        let (keypoints, pose, arm) = (self.keypoints.get(), self.pose.get(), self.arm.get());
        let inputs = convert::inputs(
            origin,
            self.node.now(),
            keypoints.as_ref().map(|k| &*k.message),
            pose.as_ref().map(|p| &*p.message),
            arm.as_ref().map(|a| &*a.message),
        );
        Inputs { stranger: lock(&self.writers).stranger(), ..inputs }
    }

    /// Puts the names of both nodes into the fault of an episode that a stranger ended.
    fn with_names(&self, error: anyhow::Error) -> anyhow::Error {
        let Some(Fault::Stranger(stranger)) = error.downcast_ref::<Fault>() else { return error };
        anyhow!(stranger.text(&self.name_of(stranger.writer), &self.name_of(stranger.bound)))
    }

    /// Returns the node of a writer in words. A node that was discovered just now tells its name within a second.
    fn name_of(&self, writer: Writer) -> String {
        let start = Instant::now();
        loop {
            let peer = self.node.peer(writer);
            if peer.name().is_some() || start.elapsed() > NAME || self.node.shutdown().wait_timeout(POLL) {
                return peer.to_string();
            }
        }
    }

    /// Returns the gate's objection to the target with this stamp; `None` if it has none or has not answered yet.
    fn objection(&self, sent: Option<&Stamp>) -> Option<Objection> {
        let answers = std::iter::from_fn(|| self.answers.try_next());
        let of_the_arm =
            answers.filter(|answer| lock(&self.writers).hear(Source::AcceptedTarget, answer.publisher).is_ok());
        // Answers to targets of earlier steps, or of other publishers, are not about this step.
        let own = of_the_arm.filter(|answer| Some(&answer.message.header.stamp) == sent);
        own.filter_map(|answer| convert::objection(&answer.message)).last()
    }

    /// Publishes a step. Returns the stamp of its target, if it has one.
    fn publish(&self, step: &Step, runner: &Runner, episode: u32, origin: Time, held: &Pose) -> Result<Option<Stamp>> {
        let now = self.node.now();
        self.observation.publish(convert::observation(step, episode, origin, now))?;
        if let Some((delta, _)) = step.action {
            self.action.publish(convert::action(step, delta, episode, runner.policy().delta_anchor, now))?;
        }
        let Some(target_m) = step.target_m else { return Ok(None) };
        let target = convert::target(target_m, held, now);
        let stamp = target.header.stamp.clone();
        self.target.publish(target)?;
        Ok(Some(stamp))
    }

    fn announce(&self, runner: &Runner, goal: &RunEpisodeGoal, episode: u32, event: u8, reason: String) {
        let name = if goal.policy_name.is_empty() { &runner.policy().name } else { &goal.policy_name };
        self.event.send(EpisodeEvent {
            event,
            reason,
            steps: runner.rewards().len() as u32,
            episode_return: runner.rewards().iter().sum(),
            ..convert::event(episode, runner.policy(), name, goal.seed, self.node.now())
        });
    }

    /// Enables the arm, and waits until its state says that it can be commanded.
    fn enable_arm(&self, handle: &GoalHandle<RunEpisode>) -> Result<()> {
        // Exactly one server is required to enable an arm. Disabling does not check this: it may reach several arms.
        self.enable.ensure_one_server()?;
        let asked = self.node.now();
        let answer = self.enable.call(SetBoolRequest { data: true }, self.patience()).inspect_err(|error| {
            // A request that timed out may still be carried out later.
            if !matches!(error, CallError::NoServer { .. } | CallError::Ambiguous { .. }) {
                self.disable_arm();
            }
        })?;
        anyhow::ensure!(answer.success, "the arm refuses to be enabled: {}", answer.message);
        self.wait_enabled(handle, asked).inspect_err(|_| self.disable_arm())
    }

    /// Stops the arm where it is. The last target of an episode may still be ahead of the arm, however the episode ended.
    /// An arm that stays enabled after the episode would follow the next publisher of targets, until its idle timeout.
    fn disable_arm(&self) {
        match self.enable.call(SetBoolRequest { data: false }, self.patience()) {
            Ok(answer) if answer.success => {}
            Ok(answer) => tracing::error!("the arm refuses to be disabled: {}", answer.message),
            Err(error) => tracing::error!("the arm may still be enabled: {error}"),
        }
    }

    /// Returns the time in which the arm must answer.
    fn patience(&self) -> Duration {
        if self.lock_step.is_some() { DEAD_NODE } else { ENABLE }
    }

    /// Waits for a state of the arm that was measured after `asked` and says that the arm can be commanded.
    fn wait_enabled(&self, handle: &GoalHandle<RunEpisode>, asked: Time) -> Result<()> {
        let mut seen = 0;
        let start = self.node.now();
        loop {
            // In lock step the next frame brings a state. A cancelled episode ends at its first step.
            if self.lock_step.is_some() && self.go_on(handle, NAP)?.is_err() {
                return Ok(());
            }
            let newest = self.arm.wait_newer(seen, self.patience());
            let newest = newest.with_context(|| format!("no message on {}", self.arm.topic()))?;
            // A state from before the request may still tell of an earlier episode, in which the arm was enabled.
            let why = match convert::measured_after(Some(&newest.message), asked) {
                Some(state) => convert::arm_fault(Some(state)),
                None => {
                    let age_s = asked.secs_since(stamp::from_msg(&newest.message.header.stamp));
                    Some(format!(
                        "the newest state's stamp lies {age_s:.3} s before the request to enable it: do the clocks agree?"
                    ))
                }
            };
            match why {
                None => return Ok(()),
                Some(why) if self.node.now().saturating_since(start) > ENABLE => return Err(anyhow!("the arm: {why}")),
                Some(_) => seen = newest.count,
            }
        }
    }
}

/// Returns the outcome of an episode that was cancelled before its first step.
fn cancelled(episode: u32) -> (End, RunEpisodeResult) {
    let message = "cancelled".to_owned();
    let end = message.clone();
    (End::Complete, RunEpisodeResult { message, episode, end, ..RunEpisodeResult::default() })
}

fn fault_error(fault: Fault) -> anyhow::Error {
    anyhow!(fault)
}
