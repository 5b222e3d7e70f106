//! Hyperparameters of a training.

use catenary_core::policy::{MOST_HISTORY, Observes, Plan};
use catenary_core::{Goal, Policy};
use thiserror::Error;

/// Least and greatest standard deviation of an action about a plan, in units of the action limit.
const SPREAD: [f32; 2] = [0.05, 0.22];

/// Hyperparameters of a training, named as in Stable-Baselines3 and cleanrl.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Most environment steps, summed over all environments.
    pub total_steps: u64,
    /// True to end earlier, when the mean return has stopped rising ([`crate::schedule`]).
    pub ends_when_flat: bool,
    /// Number of environments.
    pub environments: usize,
    /// Steps of each environment between two updates. Larger gives better estimates and fewer updates.
    pub n_steps: usize,
    /// Samples in a minibatch.
    pub batch_size: usize,
    /// Passes over the samples of a rollout.
    pub epochs: usize,
    /// Adam's learning rate.
    pub learning_rate: f32,
    /// True to let the learning rate fall linearly to zero: over the whole training, or with `ends_when_flat` over its second half.
    pub anneal_learning_rate: bool,
    /// Discount of rewards per step, 0 to 1; none for that of the goal: 0.95 for `reach`, which pays each step and is cut off at its step limit, and 1
    /// for goals that pay at their end.
    pub gamma: Option<f32>,
    /// Decay of generalised advantage estimation: 0 is the one-step estimate, 1 the whole return.
    pub gae_lambda: f32,
    /// Half width of the range about 1 to which the probability ratio is clipped. Larger allows larger updates.
    pub clip_range: f32,
    /// Weight of the value loss.
    pub value_weight: f32,
    /// Weight of the entropy bonus.
    pub entropy_weight: f32,
    /// Largest norm of the gradient over all parameters.
    pub max_gradient_norm: f32,
    /// Mean approximate Kullback-Leibler divergence from the sampling policy above which a rollout's remaining epochs are
    /// skipped; none for no such limit.
    pub target_kl: Option<f32>,
    /// Initial log standard deviation of the actions, in units of the action limit.
    pub initial_log_std: f32,
    /// Width of each of the two hidden layers.
    pub hidden: usize,
    /// Inputs of the networks.
    pub observes: Observes,
    /// True if the caller should search a plan before the training, and begin with it ([`Self::begin_with`]).
    pub searches_plan: bool,
    /// Open-loop plan that the policy corrects; none: the network alone acts.
    pub plan: Option<Plan>,
    /// True to normalise observations by their running mean and standard deviation.
    pub normalise_observations: bool,
    /// True to add the value of the last observation after a success that ends the episode (`ends_at_success` of the task): without
    /// this value a policy that stays just short of the goal earns more than one that reaches it.
    pub bootstrap_success: bool,
}

/// Hyperparameter out of range.
#[derive(Debug, Error, PartialEq)]
#[error("training: `{field}`: expected {expected}, got {got}")]
pub struct SettingsError {
    /// Name of the field.
    pub field: &'static str,
    /// Expected values.
    pub expected: &'static str,
    /// Value received.
    pub got: String,
}

impl Settings {
    /// Preset with the name `default` or `sb3`. An empty name means `default`.
    ///
    /// # Errors
    /// [`SettingsError`] for any other name.
    pub fn preset(name: &str) -> Result<Self, SettingsError> {
        match name {
            "default" | "" => Ok(Self::tuned()),
            "sb3" => Ok(Self::sb3()),
            other => Err(SettingsError { field: "preset", expected: "default or sb3", got: other.to_owned() }),
        }
    }

    /// Defaults of Stable-Baselines3 (2.x) with 12 environments: five updates of 24,576 samples in 120,000 steps.
    pub fn sb3() -> Self {
        Self {
            total_steps: 120_000,
            ends_when_flat: false,
            environments: 12,
            n_steps: 2048,
            batch_size: 64,
            epochs: 10,
            learning_rate: 3e-4,
            anneal_learning_rate: false,
            gamma: Some(0.99),
            gae_lambda: 0.95,
            clip_range: 0.2,
            value_weight: 0.5,
            entropy_weight: 0.0,
            max_gradient_norm: 0.5,
            target_kl: None,
            initial_log_std: 0.0,
            hidden: 64,
            observes: Observes::default(),
            searches_plan: false,
            plan: None,
            normalise_observations: false,
            bootstrap_success: false,
        }
    }

    /// Default preset: many small updates from the best plan, for episodes of up to 16 steps and a budget of seconds.
    pub fn tuned() -> Self {
        Self {
            // 160 updates of 12 x 64 samples.
            total_steps: 122_880,
            ends_when_flat: true,
            n_steps: 64,
            batch_size: 128,
            learning_rate: 1e-3,
            anneal_learning_rate: true,
            gamma: None,
            target_kl: Some(0.03),
            // Half of the action limit: fewer actions are clipped than with the whole of it.
            initial_log_std: -0.7,
            // Velocities, and what a motion tells of the object.
            observes: Observes { history: 5, time: true },
            searches_plan: true,
            normalise_observations: true,
            bootstrap_success: true,
            ..Self::sb3()
        }
    }

    /// The same settings without what the paper's policy does not see: earlier observations and the time.
    pub fn newest_only(self) -> Self {
        Self { observes: Observes::default(), ..self }
    }

    /// Begins with the plan of a policy, and explores about it with the policy's standard deviation.
    ///
    /// # Errors
    /// [`SettingsError`] for a policy without a plan, or one that does not act by its plan alone.
    pub fn begin_with(&mut self, policy: &Policy) -> Result<(), SettingsError> {
        let wrong = |got: &str| SettingsError { field: "plan", expected: "the policy of a plan", got: got.to_owned() };
        let still = policy.actor.layers().iter().all(|l| l.weight.iter().chain(&l.bias).all(|v| *v == 0.0));
        if !still {
            return Err(wrong("one whose network acts, too"));
        }
        self.plan = Some(policy.plan.clone().ok_or_else(|| wrong("one without a plan"))?);
        let spread = policy.action_scale[0].max(policy.action_scale[1]);
        self.initial_log_std = spread.clamp(SPREAD[0], SPREAD[1]).ln();
        Ok(())
    }

    /// Discount for a goal.
    pub fn gamma_of(&self, goal: Goal) -> f32 {
        // 0.95 is a horizon of 1 / (1 - 0.95) = 20 steps: about an episode.
        self.gamma.unwrap_or(if goal == Goal::Reach { 0.95 } else { 1.0 })
    }

    /// Checks the counts, the positive numbers and the shares.
    ///
    /// # Errors
    /// [`SettingsError`] with the field that is out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let whole = [
            ("total_steps", self.total_steps as usize),
            ("environments", self.environments),
            ("n_steps", self.n_steps),
            ("batch_size", self.batch_size),
            ("epochs", self.epochs),
            ("hidden", self.hidden),
        ];
        if let Some((field, got)) = whole.into_iter().find(|(_, v)| *v == 0) {
            return Err(SettingsError { field, expected: "at least 1", got: got.to_string() });
        }
        if self.observes.history > MOST_HISTORY {
            return Err(SettingsError {
                field: "history",
                expected: "at most 64",
                got: self.observes.history.to_string(),
            });
        }
        let positive = [
            ("learning_rate", self.learning_rate),
            ("clip_range", self.clip_range),
            ("max_gradient_norm", self.max_gradient_norm),
        ];
        if let Some((field, got)) = positive.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0)) {
            return Err(SettingsError { field, expected: "a positive number", got: got.to_string() });
        }
        let shares = [("gamma", self.gamma.unwrap_or(1.0)), ("gae_lambda", self.gae_lambda)];
        match shares.into_iter().find(|(_, v)| !(0.0..=1.0).contains(v)) {
            Some((field, got)) => Err(SettingsError { field, expected: "0 to 1", got: got.to_string() }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_bad_values_are_named() {
        for name in ["default", "sb3"] {
            assert_eq!(Settings::preset(name).unwrap().check(), Ok(()));
        }
        assert!(Settings::preset("sb4").unwrap_err().to_string().contains("sb4"));
        let bad = Settings { gamma: Some(1.5), ..Settings::tuned() };
        assert_eq!(bad.check().unwrap_err().field, "gamma");
        let long = Settings { observes: Observes { history: MOST_HISTORY + 1, time: false }, ..Settings::tuned() }
            .check()
            .unwrap_err();
        assert!(long.field == "history" && long.expected.ends_with(&MOST_HISTORY.to_string()), "{long}");
        assert_eq!(Settings { n_steps: 0, ..Settings::tuned() }.check().unwrap_err().field, "n_steps");
    }
}
