//! An arm behind the gate: what the contract's commands, services and move to the start do to whatever carries them out.

use crate::gate::{Command, GateSettings, Mode, Order, Refusal, Rivals, SafetyGate, StepPeriod, Verdict};
use crate::path::StartPath;
use crate::pose::ArmPose;
use thiserror::Error;

/// Greatest rate of turning on the way to the start pose, rad/s.
const MAX_TURN_RAD_S: f64 = 0.5;
/// Shortest piece of the way that is tried, s.
const SHORTEST_STEP_S: f64 = 1e-3;
/// Time without progress after which a move is given up, s.
const STALLED_S: f64 = 3.0;

/// What carries orders out: a simulated arm, or a controller elsewhere.
pub trait Plant: Send + 'static {
    /// The arm's time, s since an origin of its own. It runs on as long as the arm can move, and does not step.
    fn time_s(&self) -> f64;
    /// The present time of the clock that stamps commands, s since the arm's origin.
    fn stamp_time_s(&self) -> f64 {
        self.time_s()
    }
    /// The newest measured pose.
    fn measured(&self) -> Option<ArmPose>;
    /// Age of that measurement, s.
    fn measured_age_s(&self) -> f64 {
        0.0
    }
    /// Carries an order out. After [`Order::End`] nothing moves the arm until the next order.
    fn obey(&mut self, order: &Order);
    /// Why it cannot be commanded now, beyond what the gate knows.
    fn unready(&self) -> Option<String> {
        None
    }
}

/// Settings of an arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSettings {
    /// Limits of the gate.
    pub gate: GateSettings,
    /// The start pose; without one every move to the start must name its pose.
    pub start: Option<ArmPose>,
    /// Whether a physical arm moves.
    pub real: bool,
    /// Distance from the start pose up to which a move counts as arrived, m.
    pub start_tolerance_m: f64,
}

/// Why the arm does not do what was asked of it.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ArmError {
    /// The gate's refusal.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// What carries the orders out is not ready.
    #[error("{0}")]
    Unready(String),
    /// The measured pose is old: the arm may be elsewhere by now.
    #[error("the measured pose is {age_s:.2} s old; at most {limit_s} s are allowed")]
    OldPose {
        /// Age.
        age_s: f64,
        /// Limit.
        limit_s: f64,
    },
    /// There is no start pose.
    #[error("no start pose is configured: the goal must bring one")]
    NoStart,
    /// No pose.
    #[error("pose: expected finite numbers and a unit quaternion, got {0:?}")]
    NoPose(ArmPose),
    /// Outside.
    #[error("pose: expected a position inside the workspace, got {0:?}")]
    Outside([f64; 3]),
}

/// How a move to the start pose stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Progress {
    /// Under way, with this distance to go in m.
    Moving(f64),
    /// It has arrived and settled.
    Arrived,
    /// It has ended before that.
    Stopped(String),
}

/// A move to the start pose under way.
#[derive(Debug, Clone, Copy)]
struct Way {
    path: StartPath,
    target: ArmPose,
    /// How much of the path is done, s.
    done_s: f64,
    /// When it was last looked at, and when it last went on, s.
    looked_s: f64,
    went_on_s: f64,
    settle_s: f64,
}

/// The gate and what is behind it.
#[derive(Debug)]
pub struct Arm<P> {
    plant: P,
    gate: SafetyGate,
    settings: ArmSettings,
    way: Option<Way>,
}

impl<P: Plant> Arm<P> {
    /// An arm that is idle.
    pub fn new(plant: P, settings: ArmSettings) -> Self {
        let mut gate = SafetyGate::new(settings.gate, settings.real);
        if let Some(pose) = plant.measured() {
            gate.on_measured(pose);
        }
        Self { plant, gate, settings, way: None }
    }

    /// What carries the orders out.
    pub fn plant(&self) -> &P {
        &self.plant
    }

    /// The same, to measure with.
    pub fn plant_mut(&mut self) -> &mut P {
        &mut self.plant
    }

    /// What the arm is doing.
    pub fn mode(&self) -> Mode {
        self.gate.mode()
    }

    /// Whether targets are due: an episode runs, and the arm follows or holds.
    pub fn awaits_targets(&self) -> bool {
        self.gate.awaits_targets()
    }

    /// Why it stopped or refuses, empty where it does not.
    pub fn fault(&self) -> &str {
        self.gate.fault()
    }

    /// Whether a physical arm moves.
    pub fn is_real(&self) -> bool {
        self.settings.real
    }

    /// The target in force.
    pub fn target(&self) -> Option<ArmPose> {
        self.gate.target()
    }

    /// Commands accepted and rejected since the arm was enabled.
    pub fn counts(&self) -> (u64, u64) {
        self.gate.counts()
    }

    /// Leads the arm further on its way to the start pose. The way waits for an arm that lags behind by more than the gate
    /// lets a target jump.
    pub fn steer(&mut self) {
        let (Some(way), Some(measured)) = (&mut self.way, self.plant.measured()) else { return };
        let now_s = self.plant.time_s();
        let limits = &self.settings.gate;
        let mut step_s = (now_s - way.looked_s).max(0.0);
        way.looked_s = now_s;
        if way.done_s >= way.path.duration_s() {
            way.done_s += step_s;
            return;
        }
        loop {
            let next = way.path.at(way.done_s + step_s);
            if next.distance_m(&measured) <= limits.max_jump_m && next.angle_rad(&measured) <= limits.max_turn_rad {
                way.done_s += step_s;
                way.went_on_s = now_s;
                self.plant.obey(&Order::Target(next));
                return;
            }
            step_s /= 2.0;
            if step_s < SHORTEST_STEP_S {
                return;
            }
        }
    }

    /// Takes the newest measurement and looks at the silence of the targets; to be called at least every 50 ms.
    pub fn watch(&mut self) {
        if let Some(pose) = self.plant.measured() {
            self.gate.on_measured(pose);
        }
        let order = self.gate.tick(self.plant.time_s());
        self.obey(order);
    }

    /// Judges a command and carries it out.
    pub fn command(&mut self, command: &Command) -> Verdict {
        let verdict = self.gate.on_command(command, self.plant.time_s());
        if let Verdict::Accepted { pose, .. } = verdict {
            self.plant.obey(&Order::Target(pose));
        }
        verdict
    }

    /// Enables the arm; see [`SafetyGate::on_enable`].
    pub fn enable(&mut self, rivals: &Rivals, simulated_time: bool) -> Result<(), ArmError> {
        self.check_ready()?;
        let order = self.gate.on_enable(rivals, simulated_time)?;
        self.plant.obey(&order);
        Ok(())
    }

    /// Looks again at what enabling looked at; an arm that could not be enabled any more ends its motion. Returns why.
    pub fn recheck(&mut self, rivals: &Rivals) -> Option<&str> {
        let order = match self.plant.unready() {
            Some(why) => self.gate.on_unready(&why),
            None => self.gate.on_rivals(rivals),
        };
        self.plant.obey(&order?);
        self.way = None;
        Some(self.gate.fault())
    }

    /// Disables the arm: it stays where it is.
    pub fn disable(&mut self) {
        let order = self.gate.on_disable();
        self.way = None;
        self.plant.obey(&order);
    }

    /// Holds the measured pose; a move to the start pose ends there.
    pub fn hold(&mut self) -> Result<(), ArmError> {
        let order = self.gate.on_hold()?;
        self.way = None;
        self.obey(order);
        Ok(())
    }

    /// Recovers from a latched stop.
    pub fn recover(&mut self) -> Result<(), ArmError> {
        let order = self.gate.on_recovery()?;
        self.obey(order);
        Ok(())
    }

    /// A reflex or a contact: latched.
    pub fn reflex(&mut self, what: &str) {
        let order = self.gate.on_reflex(what);
        self.way = None;
        self.plant.obey(&order);
    }

    /// The arm was lost or came back.
    pub fn connection(&mut self, connected: bool) {
        if !connected {
            self.way = None;
        }
        self.gate.on_connection(connected);
    }

    /// An episode began, with this time between two actions, s; see [`SafetyGate::on_episode_started`].
    pub fn episode_started(&mut self, step_period_s: f64) -> Result<(), StepPeriod> {
        self.gate.on_episode_started(step_period_s, self.plant.time_s())
    }

    /// The episode ended.
    pub fn episode_ended(&mut self) {
        self.gate.on_episode_ended();
    }

    /// Sets out for `pose` (none: the start pose), to settle there. What keeps an arm from being enabled keeps it from this.
    pub fn begin_move(
        &mut self,
        rivals: &Rivals,
        pose: Option<ArmPose>,
        speed_m_s: f64,
        settle_s: f64,
        simulated_time: bool,
    ) -> Result<(), ArmError> {
        let target = pose.or(self.settings.start).ok_or(ArmError::NoStart)?;
        if !target.is_finite() || !target.is_normalised() {
            return Err(ArmError::NoPose(target));
        }
        let [x, y, z] = target.position_m;
        if !self.settings.gate.workspace.contains(x, y, z) {
            return Err(ArmError::Outside(target.position_m));
        }
        self.check_ready()?;
        let from = self.plant.measured().ok_or(Refusal::NoPose)?;
        self.gate.on_move_begins(rivals, simulated_time)?;
        let now_s = self.plant.time_s();
        let path = StartPath::new(from, target, speed_m_s, MAX_TURN_RAD_S);
        self.way = Some(Way { path, target, done_s: 0.0, looked_s: now_s, went_on_s: now_s, settle_s });
        Ok(())
    }

    /// How the move stands; where it has ended, the arm stays.
    pub fn move_progress(&mut self) -> Progress {
        let (Some(way), Some(measured)) = (self.way, self.plant.measured()) else {
            let fault = self.gate.fault();
            return Progress::Stopped(if fault.is_empty() { "by a request" } else { fault }.to_owned());
        };
        let distance_m = measured.distance_m(&way.target);
        if way.done_s >= way.path.duration_s() + way.settle_s {
            self.way = None;
            self.gate.on_move_ended(Some(way.target));
            return match distance_m <= self.settings.start_tolerance_m {
                true => Progress::Arrived,
                false => Progress::Stopped(format!("the arm came to rest {distance_m:.3} m from the start pose")),
            };
        }
        if way.done_s < way.path.duration_s() && way.looked_s - way.went_on_s > STALLED_S {
            self.stop_move();
            return Progress::Stopped(format!("the arm does not follow: {distance_m:.3} m to go"));
        }
        Progress::Moving(distance_m)
    }

    /// Ends a move where the arm is.
    pub fn stop_move(&mut self) {
        self.way = None;
        if self.gate.mode() != Mode::Moving {
            return;
        }
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

    fn check_ready(&self) -> Result<(), ArmError> {
        if let Some(why) = self.plant.unready() {
            return Err(ArmError::Unready(why));
        }
        let (age_s, limit_s) = (self.plant.measured_age_s(), self.settings.gate.max_age_s);
        if self.plant.measured().is_some() && age_s > limit_s {
            return Err(ArmError::OldPose { age_s, limit_s });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
