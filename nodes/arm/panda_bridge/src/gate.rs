//! Safety gate: checks every command before it reaches an arm, and ends a motion when its conditions fail.
//!
//! State machine without a clock of its own. Every call carries the time, s, of one clock that never steps.

use crate::pose::ArmPose;
use catenary_core::task::Workspace;

mod verdict;
mod writer;

pub use verdict::{BASE_FRAME, Clip, Command, Mode, Order, Refusal, Rejection, Rivals, StepPeriod, Verdict};
pub use writer::{Heard, Stranger, Writer};

/// Silence timeout in policy steps, used if it is longer than `hold_after_s`. Chosen: a step may be half a period late, and a
/// policy that acts twice a second is not silent between two steps.
const SILENT_STEPS: f64 = 1.5;
/// Deviation from the target, in multiples of the jump limits, at which the arm counts as pushed or blocked. Chosen above 1: a
/// target at the limit may arrive while the arm is still moving.
const MAX_DEVIATION: f64 = 1.5;

/// Settings of the gate. The defaults are for a Panda.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateSettings {
    /// Box of allowed positions of the end effector.
    pub workspace: Workspace,
    /// Maximum distance of a target from the measured position, m. A larger value allows faster motions.
    pub max_jump_m: f64,
    /// Maximum angle between a target and the measured orientation, rad.
    pub max_turn_rad: f64,
    /// Maximum age of a command's stamp, s. The stamp may also be this far ahead.
    pub max_age_s: f64,
    /// Silence of the target stream, within an episode, after which the arm holds, s.
    pub hold_after_s: f64,
    /// Silence of the target stream after which the motion ends, s.
    pub end_after_s: f64,
    /// Time without a target outside an episode after which an enabled arm is disabled, s.
    pub idle_after_s: f64,
    /// Allow commands of a replayed recording to reach a real arm.
    pub allow_replay: bool,
}

impl Default for GateSettings {
    fn default() -> Self {
        Self {
            workspace: Workspace::default(),
            max_jump_m: 0.10,
            max_turn_rad: 0.3,
            max_age_s: 0.2,
            hold_after_s: 0.25,
            end_after_s: 2.0,
            idle_after_s: 60.0,
            allow_replay: false,
        }
    }
}

/// Safety gate of one arm.
#[derive(Debug, Clone)]
pub struct SafetyGate {
    settings: GateSettings,
    /// Mode of an arm that is connected and has nothing latched.
    activity: Mode,
    /// True if the arm was enabled when the move to the start pose began.
    enabled_before_move: bool,
    connected: bool,
    /// Latched reflex.
    reflex: Option<String>,
    user_stop_latched: bool,
    user_stop_pressed: bool,
    real_arm: bool,
    measured: Option<ArmPose>,
    target: Option<ArmPose>,
    /// Writer whose targets the arm follows. `None`: that of the first accepted target.
    writer: Option<Writer>,
    /// Writer of the events of the running episode; `None` outside an episode.
    episode_writer: Option<Writer>,
    /// True for an episode that was announced before the arm was enabled: its runner may have died since, and another may begin anew.
    episode_is_old: bool,
    /// Step period of the running episode, s; 0 for an invalid one, `None` outside an episode.
    episode_step_s: Option<f64>,
    episode_over: Option<String>,
    /// Time of the last accepted target or of the start of the episode, s.
    heard_s: Option<f64>,
    /// Time since which an enabled arm has heard nothing outside an episode, s; `None` while it is not enabled.
    idle_since_s: Option<f64>,
    accepted: u64,
    rejected: u64,
    fault: String,
}

impl SafetyGate {
    /// Creates the gate of a real or a simulated arm that is connected and idle.
    pub fn new(settings: GateSettings, real_arm: bool) -> Self {
        Self {
            settings,
            activity: Mode::Idle,
            enabled_before_move: false,
            connected: true,
            reflex: None,
            user_stop_latched: false,
            user_stop_pressed: false,
            real_arm,
            measured: None,
            target: None,
            writer: None,
            episode_writer: None,
            episode_is_old: false,
            episode_step_s: None,
            episode_over: None,
            heard_s: None,
            idle_since_s: None,
            accepted: 0,
            rejected: 0,
            fault: String::new(),
        }
    }

    /// Returns true while targets are due: an episode runs, and the arm is tracking or holding.
    pub fn awaits_targets(&self) -> bool {
        self.episode_step_s.is_some() && self.is_enabled()
    }

    /// Returns the mode of the arm. A lost connection outranks a user stop, and a user stop outranks a reflex.
    pub fn mode(&self) -> Mode {
        match (self.connected, self.user_stop_latched, &self.reflex) {
            (false, _, _) => Mode::Disconnected,
            (true, true, _) => Mode::UserStop,
            (true, false, Some(_)) => Mode::Reflex,
            (true, false, None) => self.activity,
        }
    }

    /// Returns the target in force.
    pub fn target(&self) -> Option<ArmPose> {
        self.target
    }

    /// Returns the writer whose targets the arm follows; `None` for an arm that still waits for its first target.
    pub fn writer(&self) -> Option<Writer> {
        self.writer
    }

    /// Returns true for an enabled arm without a writer: the next acceptable target binds it to its own.
    pub fn awaits_writer(&self) -> bool {
        self.is_enabled() && self.writer.is_none()
    }

    /// Returns the numbers of commands accepted and rejected since the arm was enabled.
    pub fn counts(&self) -> (u64, u64) {
        (self.accepted, self.rejected)
    }

    /// Returns the reason of a stop or of refusals, empty if there is none.
    pub fn fault(&self) -> &str {
        match (self.connected, self.user_stop_latched, &self.reflex) {
            (false, _, _) => "no connection to the arm",
            (true, true, _) => "user stop",
            (true, false, Some(what)) => what,
            (true, false, None) => &self.fault,
        }
    }

    /// Records the measured pose. A pose that is not finite is ignored.
    pub fn on_measured(&mut self, pose: ArmPose) {
        if pose.is_finite() {
            self.measured = Some(pose);
        }
    }

    /// Enables the arm with the measured pose as its target, and binds it to the only publisher of targets, or else to the writer of
    /// the first acceptable target. `simulated_time`: time comes from `/clock`.
    ///
    /// # Errors
    /// [`Refusal`]: a latched stop, a move to the start pose, rivals, a replay before a real arm, no measured pose.
    pub fn on_enable(&mut self, rivals: &Rivals, simulated_time: bool) -> Result<Order, Refusal> {
        self.check_latches()?;
        if self.activity == Mode::Moving {
            return Err(Refusal::Moving);
        }
        rivals.check()?;
        self.check_replay(simulated_time)?;
        let pose = self.measured.ok_or(Refusal::NoPose)?;
        let already = self.is_enabled();
        self.episode_over = None;
        self.fault.clear();
        // A request to an enabled arm binds anew, too: publisher and runner may have been started again.
        self.writer = rivals.writer;
        self.episode_is_old = true;
        // A second request must not stop an arm that follows an episode.
        if already && let Some(target) = self.target {
            return Ok(Order::Target(target));
        }
        (self.accepted, self.rejected) = (0, 0);
        self.seed(pose, Mode::Hold);
        Ok(Order::Hold(pose))
    }

    /// Checks the other nodes of the graph during a motion, and ends a motion that could not begin beside them.
    pub fn on_rivals(&mut self, rivals: &Rivals) -> Option<Order> {
        match rivals.check() {
            Err(refusal) => self.on_unready(&refusal.to_string()),
            Ok(()) => None,
        }
    }

    /// Ends a motion because the plant is not ready any more.
    pub fn on_unready(&mut self, why: &str) -> Option<Order> {
        if !self.may_move() {
            return None;
        }
        self.end(why.to_owned())
    }

    /// Disables the arm. Latched stops stay latched.
    pub fn on_disable(&mut self) -> Order {
        if matches!(self.activity, Mode::Tracking | Mode::Hold | Mode::Moving) {
            self.activity = Mode::Idle;
        }
        self.heard_s = None;
        Order::End
    }

    /// Holds the measured pose and ends a move to the start pose. A running episode is over: its next targets are rejected. An idle arm
    /// gets no order.
    ///
    /// # Errors
    /// [`Refusal`]: a latched stop, no measured pose.
    pub fn on_hold(&mut self) -> Result<Option<Order>, Refusal> {
        self.check_latches()?;
        let pose = self.measured.ok_or(Refusal::NoPose)?;
        match self.activity {
            Mode::Tracking | Mode::Hold => {
                (self.activity, self.target) = (Mode::Hold, Some(pose));
                // Whoever asks for a stop does not expect the policy to go on a step later.
                if self.episode_step_s.is_some() {
                    self.episode_over = Some("held by a request".to_owned());
                }
            }
            Mode::Moving => self.on_move_ended(None),
            _ => return Ok(None),
        }
        Ok(Some(Order::Hold(pose)))
    }

    /// Begins a move to the start pose, under the conditions of [`SafetyGate::on_enable`].
    ///
    /// # Errors
    /// [`Refusal`], as [`SafetyGate::on_enable`].
    pub fn on_move_begins(&mut self, rivals: &Rivals, simulated_time: bool) -> Result<(), Refusal> {
        self.check_latches()?;
        rivals.check()?;
        self.check_replay(simulated_time)?;
        self.measured.ok_or(Refusal::NoPose)?;
        // A second goal during a move must not forget that the arm was enabled before the first.
        if self.activity != Mode::Moving {
            self.enabled_before_move = self.is_enabled();
            if !self.enabled_before_move {
                self.writer = rivals.writer;
            }
        }
        self.activity = Mode::Moving;
        self.fault.clear();
        Ok(())
    }

    /// Ends a move. The arm stays at `target`, or at the measured pose if there is none. It is enabled if it was before the move.
    pub fn on_move_ended(&mut self, target: Option<ArmPose>) {
        if self.activity == Mode::Moving {
            self.activity = if self.enabled_before_move { Mode::Hold } else { Mode::Idle };
            self.target = target.or(self.measured);
            self.heard_s = None;
        }
    }

    /// Latches a reflex or a contact.
    pub fn on_reflex(&mut self, what: &str) -> Order {
        self.reflex = Some(what.to_owned());
        self.activity = Mode::Idle;
        Order::End
    }

    /// Records that the user stop was pressed, which latches it, or released.
    pub fn on_user_stop(&mut self, pressed: bool) -> Order {
        self.user_stop_pressed = pressed;
        if pressed {
            self.user_stop_latched = true;
            self.activity = Mode::Idle;
        }
        Order::End
    }

    /// Records that the connection to the arm was lost or restored. A restored arm is idle; latched stops stay latched.
    pub fn on_connection(&mut self, connected: bool) {
        if connected != self.connected {
            // The arm may have been moved meanwhile: the old measured pose must not seed a target.
            self.connected = connected;
            self.activity = Mode::Idle;
            self.measured = None;
            self.fault.clear();
        }
    }

    /// Recovers from a latched stop, only on request. The measured pose becomes the target, and the arm must be enabled again.
    /// If nothing is latched, the arm gets no order.
    ///
    /// # Errors
    /// [`Refusal`]: no connection, a user stop that is still pressed, no measured pose.
    pub fn on_recovery(&mut self) -> Result<Option<Order>, Refusal> {
        if !self.connected {
            return Err(Refusal::Disconnected);
        }
        if self.user_stop_pressed {
            return Err(Refusal::StillStopped);
        }
        let pose = self.measured.ok_or(Refusal::NoPose)?;
        if self.reflex.is_none() && !self.user_stop_latched {
            return Ok(None);
        }
        (self.reflex, self.user_stop_latched) = (None, false);
        self.seed(pose, Mode::Idle);
        self.fault.clear();
        Ok(Some(Order::Hold(pose)))
    }

    /// Admits an event of an episode by its writer. While the arm may move, an event of another writer than the running episode's is that
    /// of a stranger. An idle arm takes the begin of any episode, and nobody's end of another.
    ///
    /// # Errors
    /// [`Stranger`]: the event must not be acted on; see [`SafetyGate::on_stranger`].
    pub fn admit_event(&mut self, writer: Writer, starts: bool) -> Result<(), Stranger> {
        let may_move = self.may_move();
        let begins_anew = starts && (self.episode_is_old || !may_move);
        if let Some(bound) = self.episode_writer.filter(|bound| *bound != writer && !begins_anew) {
            return Err(Stranger { heard: Heard::EpisodeEvent, writer, bound });
        }
        self.episode_writer = starts.then_some(writer);
        self.episode_is_old = false;
        Ok(())
    }

    /// Ends a motion because of a message of a stranger.
    pub fn on_stranger(&mut self, stranger: &Stranger) -> Option<Order> {
        self.on_unready(&stranger.to_string())
    }

    /// Replaces the identifiers in the fault of a motion that a stranger ended by names.
    pub fn name_stranger(&mut self, stranger: &Stranger, text: &str) {
        if self.fault == stranger.to_string() {
            text.clone_into(&mut self.fault);
        }
    }

    /// Begins an episode with this time between two actions, s. Silence of the targets counts from now on.
    ///
    /// # Errors
    /// [`StepPeriod`] for a period out of range. The silence timeout is then `hold_after_s`.
    pub fn on_episode_started(&mut self, step_period_s: f64, now_s: f64) -> Result<(), StepPeriod> {
        self.heard_s = Some(now_s);
        let longest_s = self.settings.end_after_s;
        // Also false for NaN. An unchecked period could switch the silence timeout off.
        let is_in_range = step_period_s > 0.0 && step_period_s <= longest_s;
        self.episode_step_s = Some(if is_in_range { step_period_s } else { 0.0 });
        if is_in_range { Ok(()) } else { Err(StepPeriod { step_period_s, longest_s }) }
    }

    /// Ends the episode.
    pub fn on_episode_ended(&mut self) {
        self.episode_step_s = None;
        self.heard_s = None;
    }

    /// Judges a command. A rejected command changes nothing but its count, unless it comes from a stranger: it then ends the motion.
    pub fn on_command(&mut self, command: &Command, now_s: f64) -> Verdict {
        match self.judge(command) {
            Ok((pose, clip)) => {
                self.accepted += 1;
                self.writer = Some(command.writer);
                self.episode_is_old = false;
                self.target = Some(pose);
                self.activity = Mode::Tracking;
                self.heard_s = Some(now_s);
                // In training, a target outside the workspace ends the episode.
                if clip.any() {
                    self.episode_over = Some("the target left the workspace".to_owned());
                }
                Verdict::Accepted { pose, clip }
            }
            Err(rejection) => {
                self.rejected += 1;
                if let Rejection::Stranger(stranger) = &rejection {
                    self.on_stranger(stranger);
                }
                Verdict::Rejected(rejection)
            }
        }
    }

    fn judge(&self, command: &Command) -> Result<(ArmPose, Clip), Rejection> {
        // First of all: of a stranger not even a wrong message is normal.
        if let Some(bound) = self.writer.filter(|bound| self.may_move() && *bound != command.writer) {
            return Err(Rejection::Stranger(Stranger { heard: Heard::Target, writer: command.writer, bound }));
        }
        if !self.is_enabled() {
            let why = if self.fault().is_empty() { format!("{:?}", self.mode()) } else { self.fault().to_owned() };
            return Err(Rejection::NotEnabled(why));
        }
        if let Some(why) = &self.episode_over {
            return Err(Rejection::EpisodeOver(why.clone()));
        }
        if command.frame_id != BASE_FRAME {
            return Err(Rejection::Frame(command.frame_id.clone()));
        }
        // Finite and normalised first: distances to any other pose would be NaN and pass every limit.
        let pose = command.pose;
        if !pose.is_finite() {
            return Err(Rejection::NotFinite);
        }
        if !pose.is_normalised() {
            return Err(Rejection::NotNormalised);
        }
        self.check_replay(command.simulated_time).map_err(|_| Rejection::Replay)?;
        // Clocks of two machines differ both ways, so the limit holds for the future as well.
        let (age_s, limit_s) = (command.age_s, self.settings.max_age_s);
        // NaN compares false with every limit.
        if age_s.is_nan() || age_s.abs() > limit_s {
            return Err(Rejection::Stale { age_s, limit_s });
        }
        let measured = self.measured.ok_or(Rejection::NoPose)?;
        let (distance_m, turn_rad) = (pose.distance_m(&measured), pose.angle_rad(&measured));
        let (max_m, max_rad) = (self.settings.max_jump_m, self.settings.max_turn_rad);
        if distance_m > max_m || turn_rad > max_rad {
            return Err(Rejection::Jump { distance_m, turn_rad, max_m, max_rad });
        }
        // The limits hold for the pose that is sent, not only for the one that was asked for.
        let (inside, clip) = self.clamped(pose);
        let distance_m = inside.distance_m(&measured);
        if distance_m > max_m {
            return Err(Rejection::FarOutside { distance_m, max_m });
        }
        Ok((inside, clip))
    }

    /// Clamps a pose to the workspace.
    fn clamped(&self, mut pose: ArmPose) -> (ArmPose, Clip) {
        let w = &self.settings.workspace;
        let mut flags = [false; 3];
        for (i, [low, high]) in [w.x_m, w.y_m, w.z_m].into_iter().enumerate() {
            let inside = pose.position_m[i].clamp(low, high);
            flags[i] = inside != pose.position_m[i];
            pose.position_m[i] = inside;
        }
        (pose, Clip { x: flags[0], y: flags[1], z: flags[2] })
    }

    /// Checks the deviation of the arm from its target and the silence of the stream. Call it at least every 50 ms.
    pub fn tick(&mut self, now_s: f64) -> Option<Order> {
        // Before the silence checks, which are off outside an episode: a push must always be noticed.
        if let Some(what) = self.deviation() {
            return Some(self.on_reflex(&what));
        }
        if let Some(idle_s) = self.idle_s(now_s).filter(|idle_s| *idle_s > self.settings.idle_after_s) {
            return self.end(format!("no target for {idle_s:.0} s outside an episode: disabled"));
        }
        let silence_s = now_s - self.heard_s?;
        let step_s = self.episode_step_s?;
        if self.activity == Mode::Tracking && silence_s > self.settings.hold_after_s.max(SILENT_STEPS * step_s) {
            let pose = self.measured?;
            self.target = Some(pose);
            self.activity = Mode::Hold;
            self.fault = format!("no target for {silence_s:.2} s: holding");
            return Some(Order::Hold(pose));
        }
        if self.activity == Mode::Hold && silence_s > self.settings.end_after_s {
            return self.end(format!("no target for {silence_s:.2} s: motion ended"));
        }
        None
    }

    /// Returns the time that an enabled arm has heard nothing outside an episode, s. A forgotten arm must not stay under force. An
    /// episode whose silence is not watched does not count: its runner may have died before the arm was enabled again.
    fn idle_s(&mut self, now_s: f64) -> Option<f64> {
        let is_watched = self.episode_step_s.is_some() && self.heard_s.is_some();
        if !self.is_enabled() || is_watched {
            self.idle_since_s = None;
            return None;
        }
        let since_s = self.idle_since_s.get_or_insert(now_s);
        *since_s = self.heard_s.map_or(*since_s, |heard_s| since_s.max(heard_s));
        Some(now_s - *since_s)
    }

    /// Returns a description of an enabled arm that is too far from its target. Its controller would pull it back with full
    /// force when the obstacle is gone.
    fn deviation(&self) -> Option<String> {
        let (true, Some(target), Some(measured)) = (self.is_enabled(), self.target, self.measured) else { return None };
        let (distance_m, turn_rad) = (target.distance_m(&measured), target.angle_rad(&measured));
        let far = distance_m > MAX_DEVIATION * self.settings.max_jump_m
            || turn_rad > MAX_DEVIATION * self.settings.max_turn_rad;
        far.then(|| format!("pushed or blocked: {distance_m:.3} m and {turn_rad:.2} rad from the target"))
    }

    /// Ends the motion and makes the arm idle.
    fn end(&mut self, fault: String) -> Option<Order> {
        self.activity = Mode::Idle;
        self.heard_s = None;
        self.fault = fault;
        Some(Order::End)
    }

    fn check_latches(&self) -> Result<(), Refusal> {
        match self.mode() {
            Mode::Reflex => Err(Refusal::Latched("reflex")),
            Mode::UserStop => Err(Refusal::Latched("user stop")),
            Mode::Disconnected => Err(Refusal::Disconnected),
            _ => Ok(()),
        }
    }

    fn check_replay(&self, simulated_time: bool) -> Result<(), Refusal> {
        if self.real_arm && simulated_time && !self.settings.allow_replay { Err(Refusal::Replay) } else { Ok(()) }
    }

    /// Returns true if targets may move the arm. Latched stops and lost connections make it idle, so they need no check here.
    fn is_enabled(&self) -> bool {
        matches!(self.activity, Mode::Tracking | Mode::Hold)
    }

    /// Returns true if targets or a move to the start pose may move the arm.
    fn may_move(&self) -> bool {
        self.is_enabled() || self.activity == Mode::Moving
    }

    /// Makes the measured pose the target, so that enabling never moves the arm.
    fn seed(&mut self, pose: ArmPose, mode: Mode) {
        self.target = Some(pose);
        self.activity = mode;
        (self.heard_s, self.idle_since_s) = (None, None);
    }
}

#[cfg(test)]
mod tests;
