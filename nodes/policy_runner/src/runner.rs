//! The state machine of one episode.

use catenary_core::task::{DeltaAnchor, Judge, Moment, Verdict};
use catenary_core::track::End;
use catenary_core::{GripPose, Keypoints, Observation, Policy, seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use thiserror::Error;

/// What an episode needs besides the policy and the task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Oldest keypoints and pose that an observation may use, s, and how far their stamps may lie ahead. Larger tolerates
    /// slower perception and clocks that differ more; smaller acts on fresher data.
    pub max_age_s: f64,
    /// Time after a step was due until the episode is given up for want of fresh data, s.
    pub patience_s: f64,
    /// Go on to the step limit after the goal was reached.
    pub run_all_steps: bool,
    /// Sample actions from the policy's Gaussian, with this seed; none: take its mean.
    pub stochastic_seed: Option<u64>,
    /// Step limit; none: the policy's own.
    pub max_steps: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { max_age_s: 0.15, patience_s: 1.0, run_all_steps: false, stochastic_seed: None, max_steps: None }
    }
}

/// Why no episode can begin.
#[derive(Debug, Error, PartialEq)]
pub enum RunnerError {
    /// The policy was trained for another meaning of a delta, or another pace.
    #[error(
        "policy `{policy}`: `{field}` is {got}, the task has {expected}: a delta would not mean what it meant in training"
    )]
    Contract {
        /// Name of the policy.
        policy: String,
        /// The field.
        field: &'static str,
        /// The task's value.
        expected: String,
        /// The policy's value.
        got: String,
    },
    /// The policy would go on beyond the task's end.
    #[error("policy `{policy}`: `steps` is {got}, the task ends after {most}")]
    TooLong {
        /// Name of the policy.
        policy: String,
        /// The task's step limit.
        most: usize,
        /// The policy's.
        got: usize,
    },
    /// A limit of no steps.
    #[error("an episode needs at least one step")]
    NoSteps,
}

/// Why an episode was given up.
#[derive(Debug, Clone, Error, PartialEq)]
pub enum Fault {
    /// The arm cannot be commanded.
    #[error("the arm refuses commands: {0}")]
    Arm(String),
    /// The arm did not take the target.
    #[error("the arm rejected the target of step {step}: {why}")]
    Rejected {
        /// The step.
        step: usize,
        /// Why.
        why: String,
    },
    /// No fresh data in time.
    #[error("no fresh {what} within {patience_s} s of step {step}: {detail}")]
    Stale {
        /// What was missing.
        what: &'static str,
        /// The step that was due.
        step: usize,
        /// How long was waited, s.
        patience_s: f64,
        /// What there was.
        detail: String,
    },
    /// The end effector is outside the workspace before the first action.
    #[error("the end effector is at x {0} m, z {1} m, outside the workspace: move it to the start first")]
    Outside(f64, f64),
    /// The policy gave no finite action.
    #[error("the policy gave the action {0:?} at step {1}")]
    Action([f64; 2], usize),
}

/// What the arm's gate objects to in a target.
#[derive(Debug, Clone, PartialEq)]
pub enum Objection {
    /// It lay outside the gate's workspace and was clamped.
    Clipped,
    /// It was rejected for this reason: the arm keeps the target before.
    Rejected(String),
}

/// What is known at one moment. Times are s of one clock.
#[derive(Debug, Clone, Default)]
pub struct Inputs {
    /// The present time.
    pub now_s: f64,
    /// The newest keypoints and their stamp.
    pub keypoints: Option<(f64, Keypoints)>,
    /// The newest pose of the end effector and its stamp.
    pub pose: Option<(f64, GripPose)>,
    /// Why the arm cannot be commanded; none: it can.
    pub arm_fault: Option<String>,
    /// What is objected to in the last target, once it is known.
    pub objection: Option<Objection>,
}

/// One step: an observation, and the action that follows it unless the episode ended with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Number of the observation, from 0; the last one follows the last action.
    pub index: usize,
    /// What the policy saw.
    pub observation: Observation,
    /// Stamps of the keypoints and of the pose that it was made of, s.
    pub stamps_s: [f64; 2],
    /// What the action before was worth; none at the first observation.
    pub reward: Option<f64>,
    /// The action (dx, dz) in m and the target (x, z) in m of the end effector; none after the last observation.
    pub action: Option<([f64; 2], [f64; 2])>,
    /// Why the episode ended, where it did.
    pub end: Option<End>,
}

/// What is to be done now.
#[derive(Debug, Clone, PartialEq)]
pub enum Turn {
    /// Nothing before this time, s: either the next step is not due or fresh data have not come.
    Wait(f64),
    /// A step.
    Step(Box<Step>),
    /// The episode is given up.
    Fault(Fault),
}

/// Share of a period by which a step may be late without delaying those after it, so that small delays do not add up. An
/// action needs its period to take effect, so none is made up for.
const LATE: f64 = 0.1;
/// How often fresh data are looked for once a step is due, s.
const RETRY_S: f64 = 0.005;

/// The state of an episode.
pub struct Runner {
    policy: Policy,
    judge: Judge,
    settings: Settings,
    steps: usize,
    rng: Option<ChaCha8Rng>,
    next_step: usize,
    due_s: Option<f64>,
    last_target_m: Option<[f64; 2]>,
    last_seen_target: Option<[f64; 2]>,
    target_left_workspace: bool,
    rewards: Vec<f64>,
    end: Option<End>,
}

impl Runner {
    /// An episode of `policy` on the task of `judge`, to begin with the first turn.
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
        if policy.steps > task.steps {
            return Err(RunnerError::TooLong { policy: policy.name.clone(), most: task.steps, got: policy.steps });
        }
        let steps = settings.max_steps.unwrap_or(policy.steps);
        if steps == 0 {
            return Err(RunnerError::NoSteps);
        }
        Ok(Self {
            rng: settings.stochastic_seed.map(|s| seed::rng(s, 0)),
            policy,
            judge,
            settings,
            steps,
            next_step: 0,
            due_s: None,
            last_target_m: None,
            last_seen_target: None,
            target_left_workspace: false,
            rewards: Vec::new(),
            end: None,
        })
    }

    /// Rewards of the steps so far.
    pub fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    /// Why the episode ended, where it did.
    pub fn end(&self) -> Option<End> {
        self.end
    }

    /// The policy that runs.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Decides what to do at `inputs.now_s`.
    pub fn turn(&mut self, inputs: &Inputs) -> Turn {
        let due_s = *self.due_s.get_or_insert(inputs.now_s);
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
            Err(_) => Turn::Wait(inputs.now_s + RETRY_S),
        }
    }

    /// Puts the observation together, or says what is missing. Data from before the step was due count as fresh within
    /// the age limit.
    fn observe(&mut self, inputs: &Inputs, due_s: f64) -> Result<(Observation, [f64; 2]), (&'static str, String)> {
        let oldest_s = inputs.now_s.max(due_s) - self.settings.max_age_s;
        let newest_s = inputs.now_s + self.settings.max_age_s;
        let fresh = |what: &'static str, stamp_s: f64| match stamp_s {
            s if s < oldest_s => Err((what, format!("the newest is {:.3} s old", inputs.now_s - s))),
            s if s > newest_s => Err((what, format!("its stamp lies {:.3} s ahead", s - inputs.now_s))),
            _ => Ok(()),
        };
        let (keypoints_s, keypoints) = inputs.keypoints.ok_or(("keypoints", "none came".to_owned()))?;
        let (pose_s, pose) = inputs.pose.ok_or(("pose", "none came".to_owned()))?;
        fresh("keypoints", keypoints_s)?;
        fresh("pose", pose_s)?;
        if !keypoints.dlo_seen() {
            return Err(("keypoints", "the object is not seen".to_owned()));
        }
        if let Some(target) = keypoints.target_scaled() {
            self.last_seen_target = Some(target);
        }
        let target = self.last_seen_target.ok_or(("target", "it was never seen".to_owned()))?;
        Ok((Observation::new([pose.x_m, pose.z_m], &keypoints.dlo_scaled(), target), [keypoints_s, pose_s]))
    }

    fn step(&mut self, observation: Observation, stamps_s: [f64; 2]) -> Turn {
        let index = self.next_step;
        let [x, z] = observation.eef_m();
        let outside = !self.judge.task().workspace.contains(x, 0.0, z);
        if outside && index == 0 {
            return Turn::Fault(Fault::Outside(x, z));
        }
        let left = self.target_left_workspace || outside;
        let is_last = index == self.steps;
        let verdict = (index > 0).then(|| self.judge.verdict(&Moment::of(&observation, left, is_last)));
        let reward = verdict.map(|v| v.reward);
        self.rewards.extend(reward);
        self.end = match verdict {
            // Asked to run all steps, the episode goes on after a success.
            Some(Verdict { end: Some(End::Success), .. }) if self.settings.run_all_steps && !is_last => None,
            Some(Verdict { end: Some(end), .. }) => Some(end),
            _ if is_last => Some(self.end_at_limit()),
            _ => None,
        };
        let action = if self.end.is_some() { None } else { Some(self.act(&observation)) };
        if let Some((delta, _)) = action
            && !delta.iter().all(|v| v.is_finite())
        {
            return Turn::Fault(Fault::Action(delta, index));
        }
        self.next_step += 1;
        Turn::Step(Box::new(Step { index, observation, stamps_s, reward, action, end: self.end }))
    }

    /// An episode that ran all its steps ends as a success where it reached the goal on its way.
    fn end_at_limit(&self) -> End {
        let reached = self.rewards.iter().any(|r| *r >= self.judge.task().success_reward);
        if reached { End::Success } else { End::StepLimit }
    }

    fn act(&mut self, observation: &Observation) -> ([f64; 2], [f64; 2]) {
        let delta = match &mut self.rng {
            None => self.policy.act(observation),
            Some(rng) => {
                let noise = [rng.sample::<f32, _>(StandardNormal), rng.sample::<f32, _>(StandardNormal)];
                self.policy.act_with_noise(observation, noise)
            }
        };
        let measured = observation.eef_m();
        let anchor = match self.judge.task().delta_anchor {
            DeltaAnchor::Measured => measured,
            DeltaAnchor::LastTarget => self.last_target_m.unwrap_or(measured),
        };
        let target = [anchor[0] + delta[0], anchor[1] + delta[1]];
        self.target_left_workspace = !self.judge.task().workspace.contains(target[0], 0.0, target[1]);
        self.last_target_m = Some(target);
        (delta, target)
    }
}

#[cfg(test)]
mod tests;
