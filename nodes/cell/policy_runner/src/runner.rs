//! State machine of one episode.

mod decay;
mod standing_target;
mod still;

use standing_target::StandingTarget;
pub use still::{StillProgress, StillTurn, StillWait};

use crate::writers::Stranger;
use catenary_core::policy::Memory;
use catenary_core::task::{Judge, Moment, Phase, Referee};
use catenary_core::track::End;
use catenary_core::{GripPose, Keypoints, Observation, Policy, seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use thiserror::Error;

/// Settings of an episode besides the policy and the task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Maximum age of keypoints and pose in an observation, s. Their stamps may also be this far ahead. A larger value tolerates
    /// slower perception and clocks that differ more; a smaller one acts on fresher data.
    pub max_age_s: f64,
    /// Time after a due step at which the episode is aborted for lack of fresh data, s.
    pub patience_s: f64,
    /// Time after the goal within which the object must have come to rest, s; the episode begins once it has. 0: it begins at once.
    pub still_patience_s: f64,
    /// Largest motion of an object at rest within a second, in pixels of the mask, at the middle of the four keypoints. A larger value
    /// tolerates keypoints with more noise; a smaller one begins nearer to rest.
    pub still_px: f64,
    /// Continue to the step limit after a success that would end the episode.
    pub run_all_steps: bool,
    /// Seed for actions sampled from the policy's Gaussian; `None`: the mean action.
    pub stochastic_seed: Option<u64>,
    /// Limit of the actions; `None`: the policy's own.
    pub max_steps: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        // Chosen: 0.15 s are nine camera frames at 60 Hz.
        // Soft bars lose half their swing in 4 to 22 s. 2 px at the middle are 7 mm in the demo's view, and twice that at the free end.
        Self {
            max_age_s: 0.15,
            patience_s: 1.0,
            still_patience_s: 120.0,
            still_px: 2.0,
            run_all_steps: false,
            stochastic_seed: None,
            max_steps: None,
        }
    }
}

/// Reason why an episode cannot begin.
#[derive(Debug, Error, PartialEq)]
pub enum RunnerError {
    /// Policy trained for another delta anchor or another step period than the task's.
    #[error(
        "policy `{policy}`: `{field}` is {got}, the task has {expected}: a delta would not mean what it meant in training"
    )]
    Contract {
        /// Name of the policy.
        policy: String,
        /// Name of the field.
        field: &'static str,
        /// Value of the task.
        expected: String,
        /// Value of the policy.
        got: String,
    },
    /// Policy that was trained for another goal.
    #[error("policy `{policy}`: it was trained for the goal `{got}`, the task has `{expected}`")]
    Goal {
        /// Name of the policy.
        policy: String,
        /// Goal of the task.
        expected: &'static str,
        /// Goal of the policy.
        got: &'static str,
    },
    /// Policy with more steps than the task.
    #[error("policy `{policy}`: `steps` is {got}, the task ends after {most}")]
    TooLong {
        /// Name of the policy.
        policy: String,
        /// Step limit of the task.
        most: usize,
        /// Step limit of the policy.
        got: usize,
    },
    /// Step limit of zero.
    #[error("an episode needs at least one step")]
    NoSteps,
}

/// Reason of an aborted episode.
#[derive(Debug, Clone, Error, PartialEq)]
pub enum Fault {
    /// Arm that cannot be commanded.
    #[error("the arm refuses commands: {0}")]
    Arm(String),
    /// Target that the arm rejected.
    #[error("the arm rejected the target of step {step}: {why}")]
    Rejected {
        /// Number of the step.
        step: usize,
        /// Reason of the arm.
        why: String,
    },
    /// Message of a second writer on a topic of the episode.
    #[error("{0}")]
    Stranger(Stranger),
    /// Missing fresh data.
    #[error("no fresh {what} within {patience_s} s of step {step}: {detail}")]
    Stale {
        /// Kind of the missing data.
        what: &'static str,
        /// Number of the due step.
        step: usize,
        /// Time waited, s.
        patience_s: f64,
        /// State of the newest data.
        detail: String,
    },
    /// Object that does not come to rest before the episode. The motion in a second, px, is unknown if keypoints came too rarely.
    #[error("the object does not come to rest within {still_patience_s} s: {}, expected at most {still_px} px (`still_px`)", words(*.moved_px))]
    Swinging {
        /// Time waited, s.
        still_patience_s: f64,
        /// Largest motion at rest, px.
        still_px: f64,
        /// Motion, px.
        moved_px: Option<f64>,
    },
    /// End effector outside the workspace before the first action: x and z, m.
    #[error("the end effector is at x {0} m, z {1} m, outside the workspace: move it to the start first")]
    Outside(f64, f64),
    /// Action that is not finite, and the number of its step.
    #[error("the policy gave an action that is not finite at step {1}: {0:?}")]
    Action([f64; 2], usize),
}

fn words(moved_px: Option<f64>) -> String {
    moved_px.map_or_else(
        || "it is not seen ten times in a second".to_owned(),
        |px| format!("its keypoints move by {px:.1} px in a second"),
    )
}

/// Objection of the arm's gate to a target.
#[derive(Debug, Clone, PartialEq)]
pub enum Objection {
    /// Target outside the gate's workspace, clamped to it.
    Clipped,
    /// Rejected target, with the reason. The arm keeps the previous target.
    Rejected(String),
}

/// Inputs of one turn. Times are s of one clock.
#[derive(Debug, Clone, Default)]
pub struct Inputs {
    /// Present time.
    pub now_s: f64,
    /// Stamp and value of the newest keypoints.
    pub keypoints: Option<(f64, Keypoints)>,
    /// Stamp and value of the newest pose of the end effector.
    pub pose: Option<(f64, GripPose)>,
    /// Reason why the arm cannot be commanded; `None` if it can.
    pub arm_fault: Option<String>,
    /// Objection to the last target, if one is known.
    pub objection: Option<Objection>,
    /// Second writer on one of the topics, if one was heard.
    pub stranger: Option<Stranger>,
}

/// Step: an observation and, unless the step ends the episode or belongs to its rest, the action that follows the observation.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Number of the observation, from 0; the last observation follows the last action.
    pub index: usize,
    /// Observation of the policy.
    pub observation: Observation,
    /// Stamps of the keypoints and of the pose in the observation, s.
    pub stamps_s: [f64; 2],
    /// Reward of the previous action; `None` at the first observation.
    pub reward: Option<f64>,
    /// Action (dx, dz) and target (x, z) of the end effector, m; `None` after the last action.
    pub action: Option<([f64; 2], [f64; 2])>,
    /// Target (x, z) to send, m: that of the action, and in the rest the last one again, because the arm stops when targets stop.
    pub target_m: Option<[f64; 2]>,
    /// End of the episode, if this step ends it.
    pub end: Option<End>,
}

/// Outcome of one turn.
#[derive(Debug, Clone, PartialEq)]
pub enum Turn {
    /// Nothing to do before this time, s: the next step is not due, or fresh data are missing.
    Wait(f64),
    /// Step to publish.
    Step(Box<Step>),
    /// Abort of the episode.
    Fault(Fault),
}

/// Delay of a step, as a share of the period, that does not shift the later steps: small delays do not add up. A longer delay
/// shifts them, because an action needs its whole period to take effect. Chosen.
const LATE: f64 = 0.1;
/// Polling period for fresh data once a step is due, s: a few polls per camera frame.
const RETRY_S: f64 = 0.005;

/// Reasons why data are missing.
const NONE_CAME: &str = "none came";
const NOT_SEEN: &str = "the object is not seen";

/// Checks that a stamp lies between the oldest and the newest that count as fresh, s.
///
/// # Errors
/// State of the data.
fn check_stamp(stamp_s: f64, now_s: f64, [oldest_s, newest_s]: [f64; 2]) -> Result<(), String> {
    match stamp_s {
        s if s < oldest_s => Err(format!("the newest is {:.3} s old", now_s - s)),
        s if s > newest_s => Err(format!("its stamp lies {:.3} s ahead", s - now_s)),
        _ => Ok(()),
    }
}

/// State of an episode.
pub struct Runner {
    policy: Policy,
    judge: Judge,
    referee: Referee,
    settings: Settings,
    /// Number of actions.
    steps: usize,
    rng: Option<ChaCha8Rng>,
    memory: Memory,
    next_step: usize,
    due_s: Option<f64>,
    last_target_m: Option<[f64; 2]>,
    target: StandingTarget,
    target_left_workspace: bool,
    rewards: Vec<f64>,
    end: Option<End>,
}

impl Runner {
    /// Creates an episode of `policy` on the task of `judge`. It begins with the first turn.
    ///
    /// # Errors
    /// [`RunnerError`]: a policy that does not fit the task, a step limit of zero.
    pub fn new(policy: Policy, judge: Judge, settings: Settings) -> Result<Self, RunnerError> {
        let task = judge.task();
        let contract = |field, expected: String, got: String| RunnerError::Contract {
            policy: policy.name.clone(),
            field,
            expected,
            got,
        };
        if policy.delta_anchor != task.delta_anchor {
            return Err(contract(
                "delta_anchor",
                format!("{:?}", task.delta_anchor),
                format!("{:?}", policy.delta_anchor),
            ));
        }
        if (policy.step_period_s - task.step_period_s).abs() > 1e-9 {
            return Err(contract("step_period_s", task.step_period_s.to_string(), policy.step_period_s.to_string()));
        }
        if let Some(goal) = policy.goal.filter(|goal| goal.name() != task.goal.name()) {
            let (expected, got) = (task.goal.name(), goal.name());
            return Err(RunnerError::Goal { policy: policy.name, expected, got });
        }
        if policy.steps > task.steps {
            return Err(RunnerError::TooLong { policy: policy.name.clone(), most: task.steps, got: policy.steps });
        }
        let most = settings.max_steps.unwrap_or(policy.steps);
        // Beyond its own steps such a policy has no plan, and a time that its training never had.
        let knows_its_end = policy.observes.time || policy.plan.is_some();
        let steps = if knows_its_end { most.min(policy.steps) } else { most };
        if steps == 0 {
            return Err(RunnerError::NoSteps);
        }
        Ok(Self {
            rng: settings.stochastic_seed.map(|s| seed::rng(s, 0)),
            policy,
            referee: judge.referee(),
            judge,
            settings,
            steps,
            memory: Memory::default(),
            next_step: 0,
            due_s: None,
            last_target_m: None,
            target: StandingTarget::default(),
            target_left_workspace: false,
            rewards: Vec::new(),
            end: None,
        })
    }

    /// Returns the rewards of the steps so far.
    pub fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    /// Returns the end of the episode, if it has ended.
    pub fn end(&self) -> Option<End> {
        self.end
    }

    /// Returns the policy.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Decides the next action at `inputs.now_s`.
    pub fn turn(&mut self, inputs: &Inputs) -> Turn {
        if self.due_s.is_none() {
            self.target.begin(inputs.now_s);
        }
        self.note_target(inputs);
        // The first turn begins the episode: step 0 is due at once.
        let due_s = *self.due_s.get_or_insert(inputs.now_s);
        if let Some(stranger) = inputs.stranger {
            return Turn::Fault(Fault::Stranger(stranger));
        }
        // Checked in every turn, also between two steps: an arm that stopped must not wait for the next step.
        if let Some(fault) = &inputs.arm_fault {
            return Turn::Fault(Fault::Arm(fault.clone()));
        }
        match &inputs.objection {
            Some(Objection::Rejected(why)) => {
                let step = self.next_step.saturating_sub(1);
                return Turn::Fault(Fault::Rejected { step, why: why.clone() });
            }
            Some(Objection::Clipped) => self.target_left_workspace = true,
            None => {}
        }
        if inputs.now_s < due_s {
            return Turn::Wait(due_s);
        }
        match self.observe(inputs, due_s) {
            Ok((observation, stamps_s)) => {
                let period_s = self.judge.task().step_period_s;
                let late = inputs.now_s - due_s > LATE * period_s;
                self.due_s = Some(if late { inputs.now_s } else { due_s } + period_s);
                self.step(observation, stamps_s)
            }
            Err((what, detail)) if inputs.now_s - due_s >= self.settings.patience_s => {
                let (step, patience_s) = (self.next_step, self.settings.patience_s);
                Turn::Fault(Fault::Stale { what, step, patience_s, detail })
            }
            // The due time is not changed. The step is made once fresh data arrive.
            Err(_) => Turn::Wait(inputs.now_s + RETRY_S),
        }
    }

    /// Notes where fresh keypoints see the target. Called in the wait before the first turn, too: the first step then knows its place better than
    /// from one frame. Times are of one clock.
    pub fn note_target(&mut self, inputs: &Inputs) {
        let Some((stamp_s, keypoints)) = inputs.keypoints else { return };
        let (now_s, max_age_s) = (inputs.now_s, self.settings.max_age_s);
        if check_stamp(stamp_s, now_s, [now_s - max_age_s, now_s + max_age_s]).is_ok() {
            self.target.add_sighting(stamp_s, keypoints.target_scaled());
        }
    }

    /// Assembles the observation. Data from before the due time count as fresh within the age limit.
    ///
    /// # Errors
    /// Kind of the missing data, and their state.
    fn observe(&self, inputs: &Inputs, due_s: f64) -> Result<(Observation, [f64; 2]), (&'static str, String)> {
        let oldest_s = inputs.now_s.max(due_s) - self.settings.max_age_s;
        let newest_s = inputs.now_s + self.settings.max_age_s;
        let fresh = |what: &'static str, stamp_s: f64| {
            check_stamp(stamp_s, inputs.now_s, [oldest_s, newest_s]).map_err(|detail| (what, detail))
        };
        let (keypoints_s, keypoints) = inputs.keypoints.ok_or(("keypoints", NONE_CAME.to_owned()))?;
        let (pose_s, pose) = inputs.pose.ok_or(("pose", NONE_CAME.to_owned()))?;
        fresh("keypoints", keypoints_s)?;
        fresh("pose", pose_s)?;
        if !keypoints.dlo_seen() {
            return Err(("keypoints", NOT_SEEN.to_owned()));
        }
        let target = self.target.place().ok_or(("target", "it was not seen".to_owned()))?;
        Ok((Observation::new([pose.x_m, pose.z_m], &keypoints.dlo_scaled(), target), [keypoints_s, pose_s]))
    }

    fn step(&mut self, observation: Observation, stamps_s: [f64; 2]) -> Turn {
        let index = self.next_step;
        let [x, z] = observation.eef_m();
        let outside = !self.judge.task().allows([x, z]);
        // An episode that begins outside would end with a penalty that no action has earned.
        if outside && index == 0 {
            return Turn::Fault(Fault::Outside(x, z));
        }
        let left = self.target_left_workspace || outside;
        let phase = Phase::of(index, self.steps, self.judge.task().rest_after(self.steps));
        let verdict = (index > 0).then(|| self.referee.verdict(&Moment::of(&observation, left, phase)));
        let reward = verdict.map(|v| v.reward);
        self.rewards.extend(reward);
        self.end = match verdict.and_then(|v| v.end) {
            // With `run_all_steps` the episode continues after a success.
            Some(End::Success) if self.settings.run_all_steps && phase != Phase::Last => None,
            end => end,
        };
        // In the rest the arm keeps its target, and no action follows.
        let acts = self.end.is_none() && index < self.steps;
        let action = acts.then(|| self.act(&observation));
        if let Some((delta, _)) = action
            && !delta.iter().all(|v| v.is_finite())
        {
            return Turn::Fault(Fault::Action(delta, index));
        }
        self.next_step += 1;
        let target_m = if self.end.is_none() { self.last_target_m } else { None };
        Turn::Step(Box::new(Step { index, observation, stamps_s, reward, action, target_m, end: self.end }))
    }

    fn act(&mut self, observation: &Observation) -> ([f64; 2], [f64; 2]) {
        let delta = match &mut self.rng {
            None => self.policy.act(observation, &mut self.memory),
            Some(rng) => {
                let noise = [rng.sample::<f32, _>(StandardNormal), rng.sample::<f32, _>(StandardNormal)];
                self.policy.act_with_noise(observation, &mut self.memory, noise)
            }
        };
        let measured = observation.eef_m();
        let last_target = self.last_target_m.unwrap_or(measured);
        let target = self.judge.task().delta_anchor.target_m(delta, measured, last_target, 0.0);
        self.target_left_workspace = !self.judge.task().allows(target);
        self.last_target_m = Some(target);
        (delta, target)
    }
}

#[cfg(test)]
mod tests;
