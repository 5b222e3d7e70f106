//! The simulated arm: the bridge's gate in front of the arm model, and the arm's services and action.

use super::cell::{Shared, State};
use crate::cell::Cell;
use anyhow::Result;
use catenary_core::{Model, Task};
use catenary_msgs::action::{MoveToStart, MoveToStartFeedback, MoveToStartGoal, MoveToStartResult};
use catenary_msgs::geometry_msgs::msg::{Point, Pose, PoseStamped, Quaternion};
use catenary_msgs::msg::{AcceptedTarget, ArmState, EpisodeEvent};
use catenary_msgs::srv::{SetCompliance, SetComplianceRequest, SetComplianceResponse};
use catenary_msgs::std_srvs::srv::{SetBool, SetBoolResponse, Trigger, TriggerResponse};
use catenary_shell::{
    ActionServer, Concurrency, Decision, GoalHandle, Outcome, Param, Publisher, Service, Subscription, contract, stamp,
};
use panda_bridge::{ArmPose, Command, Compliance, GateSettings, Mode, Order, SafetyGate, StartPath, Verdict};
use std::sync::Arc;
use std::time::Duration;

/// Greatest rate of turning on the way to the start pose, rad/s.
const MAX_TURN_RAD_S: f64 = 0.5;
/// How often a waiting action looks.
const LOOK: Duration = Duration::from_millis(20);

/// Settings of the simulated arm.
pub struct ArmSettings {
    start: ArmPose,
    start_speed_m_s: Param<f64>,
    settle_time_s: Param<f64>,
    gate: GateSettings,
}

impl ArmSettings {
    /// The model's start pose and workspace.
    pub fn new(model: &Model, start_speed_m_s: Param<f64>, settle_time_s: Param<f64>) -> Self {
        let start = model.arm.start;
        let gate = GateSettings {
            workspace: model.task.map(|t: Task| t.workspace).unwrap_or_default(),
            ..GateSettings::default()
        };
        let start = ArmPose { position_m: [start.x_m, 0.0, start.z_m], quaternion_xyzw: start.quaternion_xyzw() };
        Self { start, start_speed_m_s, settle_time_s, gate }
    }
}

/// The gate, and the way to the start pose while it is under way.
pub struct Arm {
    settings: ArmSettings,
    gate: SafetyGate,
    path: Option<(f64, StartPath)>,
}

impl Arm {
    /// An arm that is idle where the cell's is.
    pub fn new(settings: ArmSettings, cell: &Cell) -> Self {
        let mut gate = SafetyGate::new(settings.gate, false);
        gate.on_measured(measured(cell));
        Self { settings, gate, path: None }
    }

    /// Brings cell and gate to `time_s`.
    pub fn drive(&mut self, cell: &mut Cell, time_s: f64) {
        if let Some((since_s, path)) = self.path {
            let [x, _, z] = path.at(time_s - since_s).position_m;
            cell.set_target([x, z]);
        }
        cell.advance(time_s);
        self.gate.on_measured(measured(cell));
        let order = self.gate.tick(time_s);
        self.obey(order, cell);
    }

    fn obey(&mut self, order: Option<Order>, cell: &mut Cell) {
        match order {
            Some(Order::Target(pose) | Order::Hold(pose)) => cell.set_target([pose.position_m[0], pose.position_m[2]]),
            Some(Order::End) => {
                let here = cell.grip();
                cell.set_target([here.x_m, here.z_m]);
            }
            None => {}
        }
    }

    /// The hand touched what it must not touch: a reflex.
    pub fn collide(&mut self, what: &str) {
        if self.gate.mode() != Mode::Reflex {
            tracing::error!("reflex: {what}");
            self.gate.on_reflex(what);
            self.path = None;
        }
    }

    /// The state as the contract has it, without a header.
    pub fn state(&self) -> ArmState {
        let mode = self.gate.mode();
        ArmState {
            mode: match mode {
                Mode::Idle => ArmState::MODE_IDLE,
                Mode::Tracking => ArmState::MODE_TRACKING,
                Mode::Hold => ArmState::MODE_HOLD,
                Mode::Moving => ArmState::MODE_MOVING,
                Mode::Reflex => ArmState::MODE_REFLEX,
                Mode::UserStop => ArmState::MODE_USER_STOP,
                Mode::Disconnected => ArmState::MODE_DISCONNECTED,
            },
            errors: if mode == Mode::Reflex { vec![self.gate.fault().to_owned()] } else { Vec::new() },
            reflex: mode == Mode::Reflex,
            success_rate: 1.0,
            fault: self.gate.fault().to_owned(),
            is_sim: true,
            ..ArmState::default()
        }
    }

    fn command(&mut self, cell: &mut Cell, command: &Command, now_s: f64) -> (Verdict, Option<ArmPose>, (u64, u64)) {
        let verdict = self.gate.on_command(command, now_s);
        if let Verdict::Accepted { pose, .. } = verdict {
            self.obey(Some(Order::Target(pose)), cell);
        }
        (verdict, self.gate.target(), self.gate.counts())
    }
}

fn measured(cell: &Cell) -> ArmPose {
    let grip = cell.grip();
    ArmPose { position_m: [grip.x_m, 0.0, grip.z_m], quaternion_xyzw: grip.quaternion_xyzw() }
}

fn arm_pose(pose: &Pose) -> ArmPose {
    let (p, q) = (&pose.position, &pose.orientation);
    ArmPose { position_m: [p.x, p.y, p.z], quaternion_xyzw: [q.x, q.y, q.z, q.w] }
}

fn pose_message(pose: &ArmPose) -> Pose {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.position_m, pose.quaternion_xyzw);
    Pose { position: Point { x, y, z }, orientation: Quaternion { x: qx, y: qy, z: qz, w: qw } }
}

/// What serves the arm; it ends when this is dropped.
pub struct Served {
    _subscriptions: [Subscription; 2],
    _services: [Service; 4],
    _move: ActionServer,
}

/// Serves targets, services and the move to the start pose.
pub fn serve(shared: &Arc<Shared>) -> Result<Served> {
    let node = &shared.node;
    let accepted = node.publisher::<AcceptedTarget>(contract::ACCEPTED_TARGET.name, contract::ACCEPTED_TARGET.qos)?;
    let s = Arc::clone(shared);
    let targets =
        node.subscription::<PoseStamped>(contract::TARGET_POSE.name, contract::TARGET_POSE.qos, move |received| {
            on_target(&s, &accepted, &received.message);
        })?;
    let s = Arc::clone(shared);
    let events = node.subscription::<EpisodeEvent>(
        contract::EPISODE_EVENT.name,
        contract::EPISODE_EVENT.qos,
        move |received| {
            let mut state = s.lock();
            match received.message.event {
                EpisodeEvent::STARTED => state.arm.gate.on_episode_started(received.message.step_period),
                _ => state.arm.gate.on_episode_ended(),
            }
        },
    )?;
    let s = Arc::clone(shared);
    let enable = node.serve::<SetBool>(contract::ENABLE.name, move |request| {
        let (success, message) = enable(&s, request.data);
        SetBoolResponse { success, message }
    })?;
    let s = Arc::clone(shared);
    let hold = node.serve::<Trigger>(contract::HOLD.name, move |_| answer(&s, |arm| arm.gate.on_hold()))?;
    let s = Arc::clone(shared);
    let recover =
        node.serve::<Trigger>(contract::ERROR_RECOVERY.name, move |_| answer(&s, |arm| arm.gate.on_recovery()))?;
    let compliance = node.serve::<SetCompliance>(contract::SET_COMPLIANCE.name, |request| set_compliance(&request))?;
    let s = Arc::clone(shared);
    let moving = node.serve_action::<MoveToStart>(
        contract::MOVE_TO_START.name,
        Concurrency::One,
        |goal| match goal.settle_time {
            t if (0.0..=60.0).contains(&t) => Decision::Accept,
            t => Decision::Reject(format!("settle_time: expected 0 to 60 s, got {t}")),
        },
        move |handle| move_to_start(&s, &handle),
    )?;
    Ok(Served { _subscriptions: [targets, events], _services: [enable, hold, recover, compliance], _move: moving })
}

fn on_target(shared: &Shared, accepted: &Publisher<AcceptedTarget>, message: &PoseStamped) {
    let mut state = shared.lock();
    let state = &mut *state;
    let now_s = state.cell.time_s();
    let stamp_s = stamp::from_msg(&message.header.stamp).secs_since(shared.origin);
    let command = Command { stamp_s, frame_id: message.header.frame_id.clone(), pose: arm_pose(&message.pose) };
    let (verdict, target, (accepted_count, rejected_count)) = state.arm.command(&mut state.cell, &command, now_s);
    let mut answer = AcceptedTarget {
        header: message.header.clone(),
        pose: target.map(|t| pose_message(&t)).unwrap_or_default(),
        accepted_count,
        rejected_count,
        ..AcceptedTarget::default()
    };
    match verdict {
        Verdict::Accepted { clip, .. } => {
            answer.accepted = true;
            (answer.clipped_x, answer.clipped_y, answer.clipped_z) = (clip.x, clip.y, clip.z);
            if clip.any() {
                "clamped to the workspace".clone_into(&mut answer.reason);
            }
        }
        Verdict::Rejected(why) => {
            tracing::warn!("target rejected: {why}");
            answer.reason = why.to_string();
        }
    }
    accepted.send(answer);
}

fn enable(shared: &Shared, on: bool) -> (bool, String) {
    let publishers = match shared.node.publisher_count(contract::TARGET_POSE.name) {
        Ok(n) => n,
        Err(e) => return (false, e.to_string()),
    };
    let mut state = shared.lock();
    let state = &mut *state;
    if !on {
        let order = state.arm.gate.on_disable();
        state.arm.obey(Some(order), &mut state.cell);
        return (true, String::new());
    }
    // The cell's own clock is no replay: it is what the arm lives in.
    match state.arm.gate.on_enable(publishers, false) {
        Ok(order) => {
            state.arm.obey(Some(order), &mut state.cell);
            (true, String::new())
        }
        Err(refusal) => (false, refusal.to_string()),
    }
}

fn answer(shared: &Shared, ask: impl FnOnce(&mut Arm) -> Result<Order, panda_bridge::Refusal>) -> TriggerResponse {
    let mut state = shared.lock();
    let state = &mut *state;
    match ask(&mut state.arm) {
        Ok(order) => {
            state.arm.obey(Some(order), &mut state.cell);
            TriggerResponse { success: true, message: String::new() }
        }
        Err(refusal) => TriggerResponse { success: false, message: refusal.to_string() },
    }
}

/// The arm model has no gains: good settings are accepted and say so, bad ones are refused as the real arm would.
fn set_compliance(request: &SetComplianceRequest) -> SetComplianceResponse {
    let wanted =
        Compliance { stiffness: request.stiffness, damping: request.damping, error_clip_m: request.error_clip };
    match wanted.check() {
        Ok(()) => {
            SetComplianceResponse { success: true, message: "the simulated arm keeps its time constant".to_owned() }
        }
        Err(e) => SetComplianceResponse { success: false, message: e.to_string() },
    }
}

fn move_to_start(shared: &Shared, handle: &GoalHandle<MoveToStart>) -> Outcome<MoveToStartResult> {
    let result = |success, message: String| {
        let pose = pose_message(&measured(&shared.lock().cell));
        MoveToStartResult { success, message, pose }
    };
    let (end_s, target) = match begin_move(shared, handle.goal()) {
        Ok(begun) => begun,
        Err(why) => return Outcome::Aborted(result(false, why)),
    };
    loop {
        let cancelled = handle.wait_cancelled(LOOK);
        let (moving, done, distance, fault) = {
            let mut state = shared.lock();
            let State { cell, arm } = &mut *state;
            let (moving, done) = (arm.gate.mode() == Mode::Moving, cell.time_s() >= end_s);
            if cancelled || done || !moving {
                arm.path = None;
                arm.gate.on_move_ended();
                if !done {
                    arm.obey(Some(Order::End), cell);
                }
            }
            (moving, done, measured(cell).distance_m(&target), arm.gate.fault().to_owned())
        };
        match (cancelled, done, moving) {
            (true, _, _) => return Outcome::Canceled(result(false, "cancelled".to_owned())),
            (_, _, false) => return Outcome::Aborted(result(false, format!("stopped: {fault}"))),
            (_, true, _) => return Outcome::Succeeded(result(true, String::new())),
            _ => handle.feedback(MoveToStartFeedback { distance }),
        }
    }
}

/// Sets out; returns when it will have arrived and settled, and where.
fn begin_move(shared: &Shared, goal: &MoveToStartGoal) -> Result<(f64, ArmPose), String> {
    let mut state = shared.lock();
    let state = &mut *state;
    let settings = &state.arm.settings;
    let target = if goal.use_pose { arm_pose(&goal.pose) } else { settings.start };
    if !target.is_finite() || !target.is_normalised() {
        return Err(format!("pose: expected finite numbers and a unit quaternion, got {target:?}"));
    }
    let [x, y, z] = target.position_m;
    if !settings.gate.workspace.contains(x, y, z) {
        return Err(format!("pose: expected a position inside the workspace, got {:?}", target.position_m));
    }
    let settle_s = if goal.settle_time > 0.0 { goal.settle_time } else { settings.settle_time_s.get() };
    let path = StartPath::new(measured(&state.cell), target, settings.start_speed_m_s.get(), MAX_TURN_RAD_S);
    state.arm.gate.on_move_begins().map_err(|refusal| refusal.to_string())?;
    let now_s = state.cell.time_s();
    state.arm.path = Some((now_s, path));
    Ok((now_s + path.duration_s() + settle_s, target))
}
