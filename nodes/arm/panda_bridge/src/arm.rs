//! Arm behind the safety gate: applies commands, requests and the move to the start pose to a [`Plant`].

use crate::gate::{
    Command, GateSettings, Mode, Order, Refusal, Rejection, Rivals, SafetyGate, StepPeriod, Stranger, Verdict, Writer,
};
use crate::kinematics::JOINTS;
use crate::path::StartPath;
use crate::pose::ArmPose;
use crate::speed::SpeedLimit;
use thiserror::Error;

/// Maximum angular speed of a move to the start pose, rad/s. Chosen; a Panda's Cartesian limit is 2.5 rad/s.
const MAX_TURN_RAD_S: f64 = 0.5;
/// Maximum speed of a joint on the way to its posture at the start, rad/s. Chosen: a sixth of a Panda's limit.
const MAX_JOINT_RAD_S: f64 = 0.35;
/// Largest turn of the hand in a move, rad. Chosen: a quarter turn, with a margin. An orientation that nobody set is the identity, half a
/// turn from a hand that points down.
const MAX_MOVE_TURN_RAD: f64 = 1.7;
/// Shortest path step that is tried, s: shorter than every cycle that calls [`Arm::steer`].
const SHORTEST_STEP_S: f64 = 1e-3;
/// Time without progress after which a move is aborted, s. Chosen: a lagging arm moves again within a few cycles.
const STALLED_S: f64 = 3.0;

/// Executor of orders: a simulated arm, or a controller in another process.
pub trait Plant: Send + 'static {
    /// Returns the arm's time, s since its own origin. The clock never steps, and runs while the arm can move.
    fn time_s(&self) -> f64;
    /// Returns the present time of the clock that stamps commands, s since the arm's origin.
    fn stamp_time_s(&self) -> f64 {
        self.time_s()
    }
    /// Returns the newest measured pose.
    fn measured(&self) -> Option<ArmPose>;
    /// Returns the age of the newest measured pose, s.
    fn measured_age_s(&self) -> f64 {
        0.0
    }
    /// Executes an order. After [`Order::End`] nothing moves the arm until the next order.
    fn obey(&mut self, order: &Order);
    /// Returns the greatest speed at which the plant follows a target. A move to the start is no faster.
    fn speed_limit(&self) -> SpeedLimit {
        SpeedLimit::NONE
    }
    /// Returns true once the motion of the last order has really begun.
    fn has_begun(&self) -> bool {
        true
    }
    /// Returns true if a motion can begin at once.
    fn can_begin(&self) -> bool {
        true
    }
    /// Returns the measured joint angles and those with which the arm should reach `target`, rad; `None` for a plant whose posture
    /// cannot be chosen.
    fn postures(&self, _target: &ArmPose) -> Option<[[f64; JOINTS]; 2]> {
        None
    }
    /// Makes these joint angles the arm's posture. The hand keeps its target.
    fn set_posture(&mut self, _joints_rad: [f64; JOINTS]) {}
}

/// Settings of an arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSettings {
    /// Settings of the gate.
    pub gate: GateSettings,
    /// Start pose; without one every move must carry its pose.
    pub start: Option<ArmPose>,
    /// True for a physical arm.
    pub real: bool,
    /// Distance from the start pose up to which a move counts as arrived, m.
    pub start_tolerance_m: f64,
}

/// State of the graph around an arm at one moment.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Surroundings {
    /// Other nodes that could command the arm or answer in its place.
    pub rivals: Rivals,
    /// Reason why the plant cannot be commanded; `None` if it can. The gate does not know this reason.
    pub unready: Option<String>,
}

/// Reason why a request was not executed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ArmError {
    /// Refusal by the gate.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Plant that is not ready, with its reason.
    #[error("{0}")]
    Unready(String),
    /// Measured pose that is too old: the arm may have moved since.
    #[error("the measured pose is {age_s:.2} s old; at most {limit_s} s are allowed")]
    OldPose {
        /// Age, s.
        age_s: f64,
        /// Limit, s.
        limit_s: f64,
    },
    /// Missing start pose.
    #[error("no start pose is configured: set use_pose and pose in the goal, or start the node with a start pose")]
    NoStart,
    /// Target with numbers that are not finite, or a quaternion without unit norm.
    #[error("pose: expected finite numbers and a unit quaternion, got {0:?}")]
    NoPose(ArmPose),
    /// Target that would turn the hand far over.
    #[error("pose: expected an orientation at most {limit_rad:.2} rad from the measured one, got {turn_rad:.2} rad")]
    Turn {
        /// Angle between the measured and the requested orientation, rad.
        turn_rad: f64,
        /// Limit, rad.
        limit_rad: f64,
    },
    /// Target outside the workspace.
    #[error("pose: expected a position inside the workspace, got {0:?}")]
    Outside([f64; 3]),
}

/// State of a move to the start pose.
#[derive(Debug, Clone, PartialEq)]
pub enum Progress {
    /// The arm is moving; holds the distance to the start pose, m.
    Moving(f64),
    /// The arm has arrived and settled.
    Arrived,
    /// The move ended before the arrival; holds the reason.
    Stopped(String),
}

/// Running move to the start pose.
#[derive(Debug, Clone, Copy)]
struct RunningMove {
    path: StartPath,
    target: ArmPose,
    /// Joint angles at the begin and at the end of the path, rad, if the posture can be chosen.
    postures: Option<[[f64; JOINTS]; 2]>,
    /// Path time reached, s.
    reached_s: f64,
    /// Plant time of the last call of [`Arm::steer`], s.
    steered_s: f64,
    /// Plant time of the last progress, s.
    progressed_s: f64,
    /// Rest at the end of the path, s.
    settle_s: f64,
}

/// Plant behind a safety gate.
#[derive(Debug)]
pub struct Arm<P> {
    plant: P,
    gate: SafetyGate,
    settings: ArmSettings,
    running_move: Option<RunningMove>,
}

impl<P: Plant> Arm<P> {
    /// Creates an idle arm.
    pub fn new(plant: P, settings: ArmSettings) -> Self {
        let mut gate = SafetyGate::new(settings.gate, settings.real);
        if let Some(pose) = plant.measured() {
            gate.on_measured(pose);
        }
        Self { plant, gate, settings, running_move: None }
    }

    /// Returns the plant.
    pub fn plant(&self) -> &P {
        &self.plant
    }

    /// Returns the plant for updates of its measurements.
    pub fn plant_mut(&mut self) -> &mut P {
        &mut self.plant
    }

    /// Returns the mode of the arm.
    pub fn mode(&self) -> Mode {
        self.gate.mode()
    }

    /// Returns true while targets are due: an episode runs, and the arm is tracking or holding.
    pub fn awaits_targets(&self) -> bool {
        self.gate.awaits_targets()
    }

    /// Returns the reason of a stop or of refusals, empty if there is none.
    pub fn fault(&self) -> &str {
        self.gate.fault()
    }

    /// Returns true for a physical arm.
    pub fn is_real(&self) -> bool {
        self.settings.real
    }

    /// Returns the target in force.
    pub fn target(&self) -> Option<ArmPose> {
        self.gate.target()
    }

    /// Returns the numbers of commands accepted and rejected since the arm was enabled.
    pub fn counts(&self) -> (u64, u64) {
        self.gate.counts()
    }

    /// Advances the target along the path to the start pose. The path waits for the arm: the target never leads the measured
    /// pose by more than the gate's limits for a jump.
    pub fn steer(&mut self) {
        let (Some(running), Some(measured)) = (&mut self.running_move, self.plant.measured()) else { return };
        let now_s = self.plant.time_s();
        let limits = &self.settings.gate;
        let mut step_s = (now_s - running.steered_s).max(0.0);
        running.steered_s = now_s;
        if running.reached_s >= running.path.duration_s() {
            // Beyond the end of the path the time counts as settling.
            running.reached_s += step_s;
            return;
        }
        loop {
            let next = running.path.at(running.reached_s + step_s);
            if next.distance_m(&measured) <= limits.max_jump_m && next.angle_rad(&measured) <= limits.max_turn_rad {
                running.reached_s += step_s;
                running.progressed_s = now_s;
                if let Some([from, to]) = running.postures {
                    // The elbow goes on along with the hand, so that the arm ends in the same joint angles each time.
                    let share = running.path.share(running.reached_s);
                    self.plant.set_posture(std::array::from_fn(|i| from[i] + share * (to[i] - from[i])));
                }
                self.plant.obey(&Order::Target(next));
                return;
            }
            // The longest step that the limits allow, to a factor of two.
            step_s /= 2.0;
            if step_s < SHORTEST_STEP_S {
                return;
            }
        }
    }

    /// Passes the newest measurement to the gate and checks the silence of the targets. Call it at least every 50 ms.
    pub fn watch(&mut self) {
        if let Some(pose) = self.plant.measured() {
            self.gate.on_measured(pose);
        }
        let order = self.gate.tick(self.plant.time_s());
        self.obey(order);
    }

    /// Judges a command, and executes it if it is accepted.
    pub fn command(&mut self, command: &Command) -> Verdict {
        let verdict = self.gate.on_command(command, self.plant.time_s());
        match &verdict {
            Verdict::Accepted { pose, .. } => self.plant.obey(&Order::Target(*pose)),
            Verdict::Rejected(Rejection::Stranger(_)) => self.end_at_once(),
            Verdict::Rejected(_) => {}
        }
        verdict
    }

    /// Admits an event of an episode by its writer; see [`SafetyGate::admit_event`].
    ///
    /// # Errors
    /// [`Stranger`]: the event must not be acted on, and ends a motion; see [`Arm::stranger`].
    pub fn admit_event(&mut self, writer: Writer, starts: bool) -> Result<(), Stranger> {
        self.gate.admit_event(writer, starts)
    }

    /// Ends a motion because of a message of a stranger. Returns true if there was a motion.
    pub fn stranger(&mut self, stranger: &Stranger) -> bool {
        let order = self.gate.on_stranger(stranger);
        let ended = order.is_some();
        if ended {
            self.end_at_once();
        }
        ended
    }

    /// Gives the fault of a motion that a stranger ended the names of both nodes.
    pub fn name_stranger(&mut self, stranger: &Stranger, text: &str) {
        self.gate.name_stranger(stranger, text);
    }

    /// Returns true for an enabled arm that the next acceptable target binds to its writer.
    pub fn awaits_writer(&self) -> bool {
        self.gate.awaits_writer()
    }

    fn end_at_once(&mut self) {
        self.running_move = None;
        self.plant.obey(&Order::End);
    }

    /// Enables the arm; see [`SafetyGate::on_enable`].
    pub fn enable(&mut self, around: &Surroundings, simulated_time: bool) -> Result<(), ArmError> {
        self.check_ready(around)?;
        let order = self.gate.on_enable(&around.rivals, simulated_time)?;
        self.plant.obey(&order);
        Ok(())
    }

    /// Repeats the checks of [`Arm::enable`] during a motion. Ends the motion if one fails, and returns the reason.
    pub fn recheck(&mut self, around: &Surroundings) -> Option<&str> {
        let order = match &around.unready {
            Some(why) => self.gate.on_unready(why),
            None => self.gate.on_rivals(&around.rivals),
        };
        self.plant.obey(&order?);
        self.running_move = None;
        Some(self.gate.fault())
    }

    /// Disables the arm, which stays where it is.
    pub fn disable(&mut self) {
        let order = self.gate.on_disable();
        self.running_move = None;
        self.plant.obey(&order);
    }

    /// Holds the measured pose. A move to the start pose ends there.
    pub fn hold(&mut self) -> Result<(), ArmError> {
        let order = self.gate.on_hold()?;
        self.running_move = None;
        self.obey(order);
        Ok(())
    }

    /// Recovers from a latched stop.
    pub fn recover(&mut self) -> Result<(), ArmError> {
        let order = self.gate.on_recovery()?;
        self.obey(order);
        Ok(())
    }

    /// Latches a reflex or a contact.
    pub fn reflex(&mut self, what: &str) {
        let order = self.gate.on_reflex(what);
        self.running_move = None;
        self.plant.obey(&order);
    }

    /// Records that the user stop was pressed, which latches it, or released.
    pub fn user_stop(&mut self, pressed: bool) {
        let order = self.gate.on_user_stop(pressed);
        if pressed {
            self.running_move = None;
            self.plant.obey(&order);
        }
    }

    /// Records that the connection to the arm was lost or restored.
    pub fn connection(&mut self, connected: bool) {
        if !connected {
            self.running_move = None;
        }
        self.gate.on_connection(connected);
    }

    /// Records the start of an episode with this time between two actions, s; see [`SafetyGate::on_episode_started`].
    ///
    /// # Errors
    /// [`StepPeriod`] for a period out of range.
    pub fn episode_started(&mut self, step_period_s: f64) -> Result<(), StepPeriod> {
        self.gate.on_episode_started(step_period_s, self.plant.time_s())
    }

    /// Records the end of the episode.
    pub fn episode_ended(&mut self) {
        self.gate.on_episode_ended();
    }

    /// Begins a move to `pose` (`None`: the start pose), followed by a rest of `settle_s`. The conditions of [`Arm::enable`]
    /// apply.
    ///
    /// # Errors
    /// [`ArmError`]: no pose, a pose outside the workspace, or a failed condition.
    pub fn begin_move(
        &mut self,
        around: &Surroundings,
        pose: Option<ArmPose>,
        speed_m_s: f64,
        settle_s: f64,
        simulated_time: bool,
    ) -> Result<(), ArmError> {
        let target = pose.or(self.settings.start).ok_or(ArmError::NoStart)?;
        // Checked here because the path, unlike a command, does not pass the gate's judgement.
        if !target.is_finite() || !target.is_normalised() {
            return Err(ArmError::NoPose(target));
        }
        let [x, y, z] = target.position_m;
        if !self.settings.gate.workspace.contains(x, y, z) {
            return Err(ArmError::Outside(target.position_m));
        }
        self.check_ready(around)?;
        let from = self.plant.measured().ok_or(Refusal::NoPose)?;
        let turn_rad = from.angle_rad(&target);
        if turn_rad > MAX_MOVE_TURN_RAD {
            return Err(ArmError::Turn { turn_rad, limit_rad: MAX_MOVE_TURN_RAD });
        }
        self.gate.on_move_begins(&around.rivals, simulated_time)?;
        let now_s = self.plant.time_s();
        // A path that is faster than the plant's own limit would only leave the hand behind.
        let limit = self.plant.speed_limit();
        let mut path =
            StartPath::new(from, target, speed_m_s.min(limit.linear_m_s), MAX_TURN_RAD_S.min(limit.angular_rad_s));
        let postures = self.plant.postures(&target);
        if let Some([from, to]) = postures {
            let farthest_rad = from.iter().zip(to).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
            path = path.lasting_for(farthest_rad, MAX_JOINT_RAD_S);
        }
        self.running_move = Some(RunningMove {
            path,
            target,
            postures,
            reached_s: 0.0,
            steered_s: now_s,
            progressed_s: now_s,
            settle_s,
        });
        Ok(())
    }

    /// Returns true while a move to the start needs time to pass: it has neither ended nor come to the end of its path and its rest, which only
    /// [`Arm::move_progress`] turns into an end.
    pub fn is_moving_on(&self) -> bool {
        self.running_move.is_some_and(|m| m.reached_s < m.path.duration_s() + m.settle_s)
    }

    /// Returns the state of the move, and ends it when it is over. The arm then stays where it is.
    pub fn move_progress(&mut self) -> Progress {
        let (Some(running), Some(measured)) = (self.running_move, self.plant.measured()) else {
            let fault = self.gate.fault();
            return Progress::Stopped(if fault.is_empty() { "by a request" } else { fault }.to_owned());
        };
        let distance_m = measured.distance_m(&running.target);
        if running.reached_s >= running.path.duration_s() + running.settle_s {
            self.running_move = None;
            self.gate.on_move_ended(Some(running.target));
            return match distance_m <= self.settings.start_tolerance_m {
                true => Progress::Arrived,
                false => Progress::Stopped(format!("the arm came to rest {distance_m:.3} m from the start pose")),
            };
        }
        if running.reached_s < running.path.duration_s() && running.steered_s - running.progressed_s > STALLED_S {
            self.stop_move();
            return Progress::Stopped(format!("the arm does not follow: {distance_m:.3} m to go"));
        }
        Progress::Moving(distance_m)
    }

    /// Ends a move at the measured pose.
    pub fn stop_move(&mut self) {
        self.running_move = None;
        if self.gate.mode() != Mode::Moving {
            return;
        }
        // The order is given here and not by the gate: `on_move_ended` also follows an arrival, where the arm keeps its target.
        self.gate.on_move_ended(None);
        if let Some(pose) = self.plant.measured() {
            self.plant.obey(&Order::Hold(pose));
        }
    }

    fn obey(&mut self, order: Option<Order>) {
        if let Some(order) = order {
            self.plant.obey(&order);
        }
    }

    fn check_ready(&self, around: &Surroundings) -> Result<(), ArmError> {
        if let Some(why) = &around.unready {
            return Err(ArmError::Unready(why.clone()));
        }
        // A missing pose is the gate's own refusal; only an old one is found here.
        let (age_s, limit_s) = (self.plant.measured_age_s(), self.settings.gate.max_age_s);
        if self.plant.measured().is_some() && age_s > limit_s {
            return Err(ArmError::OldPose { age_s, limit_s });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
