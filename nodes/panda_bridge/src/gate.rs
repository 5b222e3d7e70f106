//! The safety gate: what a command must be before it reaches an arm, and what ends a motion.
//!
//! A state machine without a clock: times are s of one clock that does not step, given with every call.

use crate::pose::ArmPose;
use catenary_core::task::Workspace;

mod verdict;

pub use verdict::{Clip, Command, Mode, Order, Refusal, Rejection, Rivals, StepPeriod, Verdict};

/// The frame that commands must be in.
pub const BASE_FRAME: &str = "panda_link0";
/// Steps of a policy after which a silent stream counts as silent, where steps are longer than the silence allowed else:
/// a policy that acts twice a second is not silent in between.
const SILENT_STEPS: f64 = 1.5;
/// Share of the limits for targets beyond which an arm counts as pushed or blocked: a target at the limit may come while
/// the arm is still on its way from it.
const STRAYED: f64 = 1.5;

/// Limits of the gate. Defaults are those for a Panda.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateSettings {
    /// The box of the end effector.
    pub workspace: Workspace,
    /// Greatest distance of a target from the measured position, m. Larger lets the arm be commanded faster.
    pub max_jump_m: f64,
    /// Greatest turn of a target from the measured orientation, rad.
    pub max_turn_rad: f64,
    /// Greatest age of a command's stamp, s, and how far it may lie ahead.
    pub max_age_s: f64,
    /// Silence of the target stream within an episode after which the arm holds, s.
    pub hold_after_s: f64,
    /// Silence after which the motion ends, s.
    pub end_after_s: f64,
    /// Let commands of a replayed recording reach a real arm.
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
            allow_replay: false,
        }
    }
}

/// The gate.
#[derive(Debug, Clone)]
pub struct SafetyGate {
    settings: GateSettings,
    /// What the arm does where it is connected and nothing is latched.
    activity: Mode,
    /// The arm was enabled when the move to the start pose began.
    enabled_before_move: bool,
    connected: bool,
    /// The reflex that is latched.
    reflex: Option<String>,
    user_stop_latched: bool,
    user_stop_pressed: bool,
    real_arm: bool,
    measured: Option<ArmPose>,
    target: Option<ArmPose>,
    /// Step period of the episode that runs.
    episode_step_s: Option<f64>,
    episode_over: Option<String>,
    /// When the stream was last heard, or the episode began.
    heard_s: Option<f64>,
    accepted: u64,
    rejected: u64,
    fault: String,
}

impl SafetyGate {
    /// A gate before a real or a simulated arm, which is connected and idle.
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
            episode_step_s: None,
            episode_over: None,
            heard_s: None,
            accepted: 0,
            rejected: 0,
            fault: String::new(),
        }
    }

    /// Whether targets are due: an episode runs, and the arm follows or holds.
    pub fn awaits_targets(&self) -> bool {
        self.episode_step_s.is_some() && self.is_enabled()
    }

    /// What the arm is doing.
    pub fn mode(&self) -> Mode {
        match (self.connected, self.user_stop_latched, &self.reflex) {
            (false, _, _) => Mode::Disconnected,
            (true, true, _) => Mode::UserStop,
            (true, false, Some(_)) => Mode::Reflex,
            (true, false, None) => self.activity,
        }
    }

    /// The target in force.
    pub fn target(&self) -> Option<ArmPose> {
        self.target
    }

    /// Commands accepted and rejected since the arm was enabled.
    pub fn counts(&self) -> (u64, u64) {
        (self.accepted, self.rejected)
    }

    /// Why the arm stopped or refuses, empty where it does not.
    pub fn fault(&self) -> &str {
        match (self.connected, self.user_stop_latched, &self.reflex) {
            (false, _, _) => "no connection to the arm",
            (true, true, _) => "user stop",
            (true, false, Some(what)) => what,
            (true, false, None) => &self.fault,
        }
    }

    /// The arm was measured at `pose`.
    pub fn on_measured(&mut self, pose: ArmPose) {
        if pose.is_finite() {
            self.measured = Some(pose);
        }
    }

    /// Enables the arm, its target the measured pose. `simulated_time`: whether time comes from `/clock`.
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
        if already && let Some(target) = self.target {
            return Ok(Order::Target(target));
        }
        (self.accepted, self.rejected) = (0, 0);
        self.seed(pose, Mode::Hold);
        Ok(Order::Hold(pose))
    }

    /// These nodes were seen: a motion ends that would not begin beside them.
    pub fn on_rivals(&mut self, rivals: &Rivals) -> Option<Order> {
        match rivals.check() {
            Err(refusal) => self.on_unready(&refusal.to_string()),
            Ok(()) => None,
        }
    }

    /// What carries the orders out is not ready any more.
    pub fn on_unready(&mut self, why: &str) -> Option<Order> {
        if !self.is_enabled() && self.activity != Mode::Moving {
            return None;
        }
        self.end(why.to_owned())
    }

    /// Disables the arm.
    pub fn on_disable(&mut self) -> Order {
        if matches!(self.activity, Mode::Tracking | Mode::Hold | Mode::Moving) {
            self.activity = Mode::Idle;
        }
        self.heard_s = None;
        Order::End
    }

    /// Holds the measured pose; a move to the start pose ends there. An idle arm is told nothing.
    pub fn on_hold(&mut self) -> Result<Option<Order>, Refusal> {
        self.check_latches()?;
        let pose = self.measured.ok_or(Refusal::NoPose)?;
        match self.activity {
            Mode::Tracking | Mode::Hold => (self.activity, self.target) = (Mode::Hold, Some(pose)),
            Mode::Moving => self.on_move_ended(None),
            _ => return Ok(None),
        }
        Ok(Some(Order::Hold(pose)))
    }

    /// A move to the start pose begins, under the conditions of [`SafetyGate::on_enable`].
    pub fn on_move_begins(&mut self, rivals: &Rivals, simulated_time: bool) -> Result<(), Refusal> {
        self.check_latches()?;
        rivals.check()?;
        self.check_replay(simulated_time)?;
        self.measured.ok_or(Refusal::NoPose)?;
        if self.activity != Mode::Moving {
            self.enabled_before_move = self.is_enabled();
        }
        self.activity = Mode::Moving;
        self.fault.clear();
        Ok(())
    }

    /// It has ended, well or not; the arm stays at `target`, or where it was measured. It is enabled if it was before.
    pub fn on_move_ended(&mut self, target: Option<ArmPose>) {
        if self.activity == Mode::Moving {
            self.activity = if self.enabled_before_move { Mode::Hold } else { Mode::Idle };
            self.target = target.or(self.measured);
            self.heard_s = None;
        }
    }

    /// A reflex or a contact: latched.
    pub fn on_reflex(&mut self, what: &str) -> Order {
        self.reflex = Some(what.to_owned());
        self.activity = Mode::Idle;
        Order::End
    }

    /// The user stop was pressed (latched) or released.
    pub fn on_user_stop(&mut self, pressed: bool) -> Order {
        self.user_stop_pressed = pressed;
        if pressed {
            self.user_stop_latched = true;
            self.activity = Mode::Idle;
        }
        Order::End
    }

    /// The arm was lost or came back; back, it is idle, and what was latched still is.
    pub fn on_connection(&mut self, connected: bool) {
        if connected != self.connected {
            self.connected = connected;
            self.activity = Mode::Idle;
            self.measured = None;
            self.fault.clear();
        }
    }

    /// Recovers from a latched stop: by request alone. The target is the measured pose, and the arm must be enabled again.
    /// Where nothing is latched, the arm is told nothing.
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

    /// An episode began, with this time between two actions, s. From now on silence counts.
    ///
    /// # Errors
    /// A time that no policy has; the episode is watched as one of quick steps then.
    pub fn on_episode_started(&mut self, step_period_s: f64, now_s: f64) -> Result<(), StepPeriod> {
        self.heard_s = Some(now_s);
        let longest_s = self.settings.end_after_s;
        let makes_sense = step_period_s > 0.0 && step_period_s <= longest_s;
        self.episode_step_s = Some(if makes_sense { step_period_s } else { 0.0 });
        if makes_sense { Ok(()) } else { Err(StepPeriod { step_period_s, longest_s }) }
    }

    /// The episode ended.
    pub fn on_episode_ended(&mut self) {
        self.episode_step_s = None;
        self.heard_s = None;
    }

    /// Judges a command.
    pub fn on_command(&mut self, command: &Command, now_s: f64) -> Verdict {
        match self.judge(command) {
            Ok((pose, clip)) => {
                self.accepted += 1;
                self.target = Some(pose);
                self.activity = Mode::Tracking;
                self.heard_s = Some(now_s);
                if clip.any() {
                    self.episode_over = Some("the target left the workspace".to_owned());
                }
                Verdict::Accepted { pose, clip }
            }
            Err(rejection) => {
                self.rejected += 1;
                Verdict::Rejected(rejection)
            }
        }
    }

    fn judge(&self, command: &Command) -> Result<(ArmPose, Clip), Rejection> {
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
        let pose = command.pose;
        if !pose.is_finite() {
            return Err(Rejection::NotFinite);
        }
        if !pose.is_normalised() {
            return Err(Rejection::NotNormalised);
        }
        self.check_replay(command.simulated_time).map_err(|_| Rejection::Replay)?;
        let (age_s, limit_s) = (command.age_s, self.settings.max_age_s);
        if age_s.is_nan() || age_s.abs() > limit_s {
            return Err(Rejection::Stale { age_s, limit_s });
        }
        let measured = self.measured.ok_or(Rejection::NoPose)?;
        let (distance_m, turn_rad) = (pose.distance_m(&measured), pose.angle_rad(&measured));
        let (max_m, max_rad) = (self.settings.max_jump_m, self.settings.max_turn_rad);
        if distance_m > max_m || turn_rad > max_rad {
            return Err(Rejection::Jump { distance_m, turn_rad, max_m, max_rad });
        }
        let (inside, clip) = self.clamped(pose);
        let distance_m = inside.distance_m(&measured);
        if distance_m > max_m {
            return Err(Rejection::FarOutside { distance_m, max_m });
        }
        Ok((inside, clip))
    }

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

    /// Looks at the silence of the stream, and whether the arm is where it should be; to be called at least every 50 ms.
    pub fn tick(&mut self, now_s: f64) -> Option<Order> {
        if let Some(what) = self.strayed() {
            return Some(self.on_reflex(&what));
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

    /// How an enabled arm is elsewhere than any target it took. What keeps it there would have it run back when it lets go.
    fn strayed(&self) -> Option<String> {
        let (true, Some(target), Some(measured)) = (self.is_enabled(), self.target, self.measured) else { return None };
        let (distance_m, turn_rad) = (target.distance_m(&measured), target.angle_rad(&measured));
        let far = distance_m > STRAYED * self.settings.max_jump_m || turn_rad > STRAYED * self.settings.max_turn_rad;
        far.then(|| format!("pushed or blocked: {distance_m:.3} m and {turn_rad:.2} rad from the target"))
    }

    /// Ends the motion: the arm is idle.
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

    /// Whether targets may move the arm. Whatever latches or cuts it off makes it idle.
    fn is_enabled(&self) -> bool {
        matches!(self.activity, Mode::Tracking | Mode::Hold)
    }

    /// Makes the measured pose the target.
    fn seed(&mut self, pose: ArmPose, mode: Mode) {
        self.target = Some(pose);
        self.activity = mode;
        self.heard_s = None;
    }
}

#[cfg(test)]
mod tests;
