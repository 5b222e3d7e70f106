//! Training loop of proximal policy optimisation.

use crate::adam::Adam;
use crate::curve::CurvePoint;
use crate::loss::{Term, derivatives, entropy, log_probability};
use crate::network::Network;
use crate::normaliser::Normaliser;
use crate::rollout::{Rollout, Sample};
use crate::schedule::Schedule;
use crate::settings::{Settings, SettingsError};
use crate::state::{Random, State, StateError, Weights};
use catenary_core::policy::Memory;
use catenary_core::task::MAX_DELTA_M;
use catenary_core::{Env, EnvError, Observation, Policy, Task, Transition, seed};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::VecDeque;
use std::ops::ControlFlow;
use thiserror::Error;

/// Number of recent episodes over which progress is averaged.
const RECENT: usize = 100;
/// Gain of the actor's output layer, small so that the first actions are near zero (Andrychowicz et al. 2021).
const ACTOR_GAIN: f32 = 0.01;
/// Gain of the critic's output layer.
const CRITIC_GAIN: f32 = 1.0;
/// Bounds of the log standard deviation: from 0.7 % to 2.7 times the action limit.
const LOG_STD_RANGE: (f32, f32) = (-5.0, 1.0);

/// Reason for which a training failed.
#[derive(Debug, Error)]
pub enum TrainError {
    /// A hyperparameter is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The environment failed.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// The number of environments differs from the settings.
    #[error("training: expected {expected} environments, got {got}")]
    Environments {
        /// Number in the settings.
        expected: usize,
        /// Number of environments.
        got: usize,
    },
    /// The state is not that of a training with these settings.
    #[error(transparent)]
    State(#[from] StateError),
    /// A weight, an observation or a reward is not finite.
    #[error("training failed after {steps} steps: {what} is not finite")]
    Diverged {
        /// Environment steps taken.
        steps: u64,
        /// Name of the value that is not finite.
        what: &'static str,
    },
}

/// Progress of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Environment steps in total: the most of the settings, or fewer once the mean return is flat.
    pub total_steps: u64,
    /// State after the last update.
    pub now: CurvePoint,
}

/// Trained policy with its learning curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// Policy with the normalisation of its observations.
    pub policy: Policy,
    /// Point after each update, from the first one that an episode's end precedes.
    pub curve: Vec<CurvePoint>,
    /// Returns of the last 100 episodes, and true for each that succeeded.
    pub recent: Vec<(f64, bool)>,
    /// Environment steps taken.
    pub steps: u64,
    /// False if the training was stopped before its end.
    pub is_finished: bool,
    /// Steps after which the mean return was flat; none if it was not, or was not looked at.
    pub flat_at: Option<u64>,
}

/// Trains a policy for `task` in `env`. `on_progress` is called after each update. If it breaks, the policy learnt so far is
/// returned.
///
/// # Errors
/// [`TrainError`] if a setting is out of range, the number of environments differs from the settings, the environment fails,
/// or a value is no longer finite.
pub fn train(
    env: &mut dyn Env,
    task: &Task,
    settings: &Settings,
    training_seed: u64,
    on_progress: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Trained, TrainError> {
    train_from(None, env, task, settings, training_seed, on_progress).map(|(trained, _)| trained)
}

/// Trains as [`train`], from the beginning or from the state of a training with the same task, settings and seed, and returns the state at its end,
/// too. With a state, the environments must be where they were: they are not reset. The whole then gives the bits of an uninterrupted training. A
/// training that ended with a flat curve goes on towards the most steps.
///
/// # Errors
/// As [`train`]; [`TrainError::State`] if the state is that of another training.
pub fn train_from(
    state: Option<State>,
    env: &mut dyn Env,
    task: &Task,
    settings: &Settings,
    training_seed: u64,
    on_progress: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<(Trained, State), TrainError> {
    settings.check()?;
    if env.count() != settings.environments {
        return Err(TrainError::Environments { expected: settings.environments, got: env.count() });
    }
    let mut trainer = Trainer::new(task, settings, training_seed);
    let (mut observations, mut curve) = match state {
        Some(state) => trainer.resume(state)?,
        None => (env.reset()?, Vec::new()),
    };
    while trainer.steps < trainer.schedule.end() {
        let rollout = trainer.collect(env, &mut observations)?;
        let value_loss = trainer.update(&rollout)?;
        let now = trainer.point(value_loss);
        if now.mean_return.is_finite() {
            curve.push(now);
        }
        if settings.ends_when_flat {
            trainer.schedule.look(trainer.steps, &curve);
        }
        if on_progress(&Progress { total_steps: trainer.schedule.end(), now }).is_break() {
            break;
        }
    }
    let state = trainer.state(&observations, &curve);
    let trained = Trained {
        policy: trainer.policy(),
        curve,
        recent: trainer.recent.iter().copied().collect(),
        steps: trainer.steps,
        is_finished: trainer.steps >= trainer.schedule.end(),
        flat_at: trainer.schedule.flat_at(),
    };
    Ok((trained, state))
}

/// State of a training.
struct Trainer<'a> {
    task: &'a Task,
    settings: &'a Settings,
    actor: Network,
    critic: Network,
    log_std: [f32; 2],
    adam: Adam,
    normaliser: Normaliser,
    /// Memory of each environment's episode.
    memories: Vec<Memory>,
    rng: ChaCha8Rng,
    steps: u64,
    /// Discount for the goal.
    gamma: f32,
    schedule: Schedule,
    /// Return of each environment's current episode, and true if it succeeded.
    running: Vec<(f64, bool)>,
    /// Return and success of the last episodes.
    recent: VecDeque<(f64, bool)>,
}

impl<'a> Trainer<'a> {
    fn new(task: &'a Task, settings: &'a Settings, training_seed: u64) -> Self {
        let mut rng = seed::rng(training_seed, 0);
        let (h, inputs) = (settings.hidden, settings.observes.count());
        Self {
            task,
            actor: Network::new(&[inputs, h, h, 2], ACTOR_GAIN, &mut rng),
            critic: Network::new(&[inputs, h, h, 1], CRITIC_GAIN, &mut rng),
            log_std: [settings.initial_log_std; 2],
            adam: Adam::default(),
            normaliser: Normaliser::new(settings.normalise_observations),
            memories: vec![Memory::default(); settings.environments],
            rng,
            steps: 0,
            gamma: settings.gamma_of(task.goal),
            schedule: Schedule::of(settings),
            running: vec![(0.0, false); settings.environments],
            recent: VecDeque::new(),
            settings,
        }
    }

    /// State between two updates. The next rollout begins with `observations`.
    fn state(&self, observations: &[Observation], curve: &[CurvePoint]) -> State {
        State {
            actor: Weights::of(&self.actor),
            critic: Weights::of(&self.critic),
            log_std: self.log_std,
            adam: self.adam.clone(),
            normaliser: self.normaliser.clone(),
            memories: self.memories.clone(),
            next: observations.to_vec(),
            random: Random::of(&self.rng),
            steps: self.steps,
            schedule: self.schedule,
            running: self.running.clone(),
            recent: self.recent.iter().copied().collect(),
            curve: curve.to_vec(),
        }
    }

    /// Continues from a state. Returns the observations with which the next rollout begins, and the learning curve so far.
    fn resume(&mut self, state: State) -> Result<(Vec<Observation>, Vec<CurvePoint>), StateError> {
        let broken = |part, expected: String, got: String| Err(StateError { part, expected, got });
        let (n, width) = (self.settings.environments, 1 + self.settings.observes.history);
        let counts = [state.memories.len(), state.next.len(), state.running.len()];
        let kept = |m: &Memory| [0, width].contains(&m.newest_first().len());
        if counts != [n; 3] || !state.memories.iter().all(kept) {
            let expected = format!("0 or {width} observations of each of {n} environments");
            return broken("memories", expected, format!("{counts:?}"));
        }
        let seen = state.memories.iter().flat_map(|m| m.newest_first().iter().chain([m.first()])).chain(&state.next);
        let finite = seen.into_iter().all(|o| o.0.iter().all(|v| v.is_finite()));
        if !(finite && state.log_std.iter().all(|l| (LOG_STD_RANGE.0..=LOG_STD_RANGE.1).contains(l))) {
            return broken("memories, next, log_std", "finite numbers".to_owned(), "others".to_owned());
        }
        if state.steps > self.settings.total_steps.next_multiple_of((n * self.settings.n_steps) as u64) {
            return broken("steps", format!("at most {}", self.settings.total_steps), state.steps.to_string());
        }
        let (actor, critic) = (
            Weights::network("actor", &state.actor, &self.actor)?,
            Weights::network("critic", &state.critic, &self.critic)?,
        );
        let layers = actor.mlp.layers().iter().chain(critic.mlp.layers());
        let blocks: Vec<usize> = [2].into_iter().chain(layers.flat_map(|l| [l.weight.len(), l.bias.len()])).collect();
        let sizes = state.adam.sizes();
        if !state.adam.is_whole() || !(sizes == blocks || (sizes.is_empty() && state.steps == 0)) {
            return broken("adam", format!("whole moments of {blocks:?}"), format!("{sizes:?}"));
        }
        (self.actor, self.critic, self.log_std) = (actor, critic, state.log_std);
        (self.adam, self.normaliser, self.rng) = (state.adam, state.normaliser, state.random.rng());
        self.schedule = state.schedule.resumed(state.steps, self.settings);
        (self.steps, self.running, self.recent) = (state.steps, state.running, state.recent.into());
        self.memories = state.memories;
        Ok((state.next, state.curve))
    }

    /// Current policy. It normalises observations as the training does.
    fn policy(&self) -> Policy {
        let task = self.task;
        Policy {
            name: "ppo".to_owned(),
            actor: self.actor.mlp.clone(),
            observes: self.settings.observes,
            plan: self.settings.plan.clone(),
            observation_mean: self.normaliser.mean(),
            observation_scale: self.normaliser.scale(),
            action_scale: self.log_std.map(f32::exp),
            step_period_s: task.step_period_s,
            delta_anchor: task.delta_anchor,
            steps: task.steps,
            goal: Some(task.goal),
            // The environments know their arm and their starts, the trainer does not: its caller says it.
            arm: None,
            start_speed_m_s: None,
        }
    }

    /// State averaged over the recent episodes.
    fn point(&self, value_loss: f64) -> CurvePoint {
        let n = self.recent.len() as f64;
        let successes = self.recent.iter().filter(|(_, success)| *success).count() as f64;
        CurvePoint {
            steps: self.steps,
            mean_return: self.recent.iter().map(|(r, _)| r).sum::<f64>() / n,
            success_rate: if n > 0.0 { successes / n } else { 0.0 },
            entropy: f64::from(entropy(&self.log_std)),
            value_loss,
        }
    }

    /// Inputs of the networks, row by row, at the newest observation of each memory.
    fn inputs(&self, memories: &[Memory]) -> Vec<f32> {
        let (mean, scale, observes) = (self.normaliser.mean(), self.normaliser.scale(), self.settings.observes);
        let mut inputs = Vec::with_capacity(memories.len() * observes.count());
        memories.iter().for_each(|m| observes.append_inputs(m, self.task.steps, &mean, &scale, &mut inputs));
        inputs
    }

    /// Inputs for observations that no memory keeps: the next rollout begins with them, or their episodes are over.
    fn passing_inputs(&self, newest: &[Observation]) -> Vec<f32> {
        let mut memories = self.memories.clone();
        memories.iter_mut().zip(newest).for_each(|(m, newest)| m.see(newest, self.settings.observes.history));
        self.inputs(&memories)
    }

    /// Steps every environment `n_steps` times and estimates the advantages.
    fn collect(&mut self, env: &mut dyn Env, observations: &mut Vec<Observation>) -> Result<Rollout, TrainError> {
        let n = self.settings.environments;
        let mut rollout = Rollout::default();
        for _ in 0..self.settings.n_steps {
            // Samples keep the normalisation of their step: later updates of the moments do not change their log densities.
            observations.iter().for_each(|o| self.normaliser.update(o));
            let history = self.settings.observes.history;
            self.memories.iter_mut().zip(&*observations).for_each(|(m, newest)| m.see(newest, history));
            let x = self.inputs(&self.memories);
            let means = self.actor.forward(&x, n).to_vec();
            let values = self.critic.forward(&x, n).to_vec();
            let actions: Vec<[f32; 2]> = means
                .chunks_exact(2)
                .map(|m| {
                    std::array::from_fn(|i| m[i] + self.log_std[i].exp() * self.rng.sample::<f32, _>(StandardNormal))
                })
                .collect();
            // The arm gets the clipped sum of the plan's action and the network's. The loss uses the sampled action of the network, whose
            // density is known.
            let planned = |m: &Memory| self.settings.plan.as_ref().map_or([0.0; 2], |plan| plan.action(m));
            let delta = |(a, m): (&[f32; 2], &Memory)| -> [f64; 2] {
                let planned = planned(m);
                std::array::from_fn(|i| f64::from((planned[i] + a[i]).clamp(-1.0, 1.0)) * MAX_DELTA_M)
            };
            let deltas: Vec<[f64; 2]> = actions.iter().zip(&self.memories).map(delta).collect();
            let transitions = env.step(&deltas)?;
            self.steps += n as u64;
            let bonuses = self.bonuses(&transitions);
            for (e, t) in transitions.iter().enumerate() {
                self.count(e, t);
                rollout.samples.push(Sample {
                    action: actions[e],
                    log_probability: log_probability(&actions[e], &means[2 * e..2 * e + 2], &self.log_std),
                    value: values[e],
                    reward: t.reward as f32 + bonuses[e],
                    done: t.terminated || t.truncated,
                });
                if t.terminated || t.truncated {
                    self.memories[e] = Memory::default();
                }
            }
            rollout.inputs.extend(x);
            *observations = transitions.into_iter().map(|t| t.observation).collect();
        }
        let are_finite = rollout.samples.iter().map(|s| &s.reward).chain(&rollout.inputs).all(|v| v.is_finite());
        if !are_finite {
            return Err(TrainError::Diverged { steps: self.steps, what: "an observation or a reward" });
        }
        let x = self.passing_inputs(observations);
        let last_values = self.critic.forward(&x, n).to_vec();
        rollout.estimate(&last_values, self.gamma, self.settings.gae_lambda);
        Ok(rollout)
    }

    /// Discounted value of the last observation for each environment whose episode was cut off, and 0 for the others.
    fn bonuses(&mut self, transitions: &[Transition]) -> Vec<f32> {
        // A success may cut an episode of `reach` short. An episode whose goal is its last step has no later rewards.
        let is_cut_short = self.settings.bootstrap_success && self.task.ends_at_success;
        let cut_off = |t: &Transition| {
            (t.truncated && !t.terminated) || (is_cut_short && t.terminated && is_success(self.task, t))
        };
        // A time limit is no property of the state: without the bonus the value would depend on the step number (Pardo et al. 2018), which a policy
        // without the time does not observe. With the time the bonus is kept: the same reward is then learnt by all.
        let wanted: Vec<bool> = transitions.iter().map(cut_off).collect();
        if !wanted.contains(&true) {
            return vec![0.0; transitions.len()];
        }
        let last: Vec<Observation> = transitions.iter().map(|t| t.final_observation).collect();
        let (x, gamma) = (self.passing_inputs(&last), self.gamma);
        let values = self.critic.forward(&x, transitions.len());
        values.iter().zip(wanted).map(|(v, w)| if w { gamma * v } else { 0.0 }).collect()
    }

    /// Updates the returns and successes of an environment.
    fn count(&mut self, environment: usize, t: &Transition) {
        let running = &mut self.running[environment];
        running.0 += t.reward;
        running.1 |= is_success(self.task, t);
        if t.terminated || t.truncated {
            self.recent.push_back(std::mem::take(running));
            if self.recent.len() > RECENT {
                self.recent.pop_front();
            }
        }
    }

    /// Makes several passes over a rollout in shuffled minibatches. Returns the mean squared error of the values in the last pass.
    fn update(&mut self, rollout: &Rollout) -> Result<f64, TrainError> {
        let mut order: Vec<usize> = (0..rollout.samples.len()).collect();
        let annealed = if self.settings.anneal_learning_rate { 1.0 - self.schedule.annealed(self.steps) } else { 1.0 };
        // The last update follows the last step, at which the annealed rate would be zero.
        let learning_rate = self.settings.learning_rate * annealed.max(1e-3);
        let mut value_loss = 0.0;
        for _ in 0..self.settings.epochs {
            order.shuffle(&mut self.rng);
            let mut kl = 0.0;
            value_loss = 0.0;
            for batch in order.chunks(self.settings.batch_size) {
                let [divergence, error] = self.minibatch(rollout, batch, learning_rate)?;
                kl += divergence * batch.len() as f32;
                value_loss += f64::from(error) * batch.len() as f64 / order.len() as f64;
            }
            if self.settings.target_kl.is_some_and(|target| kl / order.len() as f32 > target) {
                break;
            }
        }
        Ok(value_loss)
    }

    /// Takes one step of the optimiser. Returns the mean approximate Kullback-Leibler divergence of the minibatch and the mean squared error
    /// of its values.
    fn minibatch(&mut self, rollout: &Rollout, batch: &[usize], learning_rate: f32) -> Result<[f32; 2], TrainError> {
        let n = batch.len();
        let x: Vec<f32> = batch.iter().flat_map(|&i| rollout.inputs_of(i)).copied().collect();
        let advantages = standardised(batch.iter().map(|&i| rollout.advantages[i]).collect());
        let means = self.actor.forward(&x, n).to_vec();
        let values = self.critic.forward(&x, n).to_vec();
        let (mut d_mean, mut d_value, mut d_log_std) = (vec![0.0; 2 * n], vec![0.0; n], [0.0; 2]);
        let (mut kl, mut squares) = (0.0, 0.0);
        // Means over the minibatch, so that the gradient's norm does not depend on its size.
        let share = 1.0 / n as f32;
        for (k, &i) in batch.iter().enumerate() {
            let s = &rollout.samples[i];
            let term = Term {
                action: s.action,
                old_log_probability: s.log_probability,
                advantage: advantages[k],
                target: rollout.returns[i],
            };
            let d = derivatives(&term, &means[2 * k..2 * k + 2], &self.log_std, values[k], self.settings);
            for c in 0..2 {
                d_mean[2 * k + c] = d.mean[c] * share;
                d_log_std[c] += d.log_std[c] * share;
            }
            d_value[k] = d.value * share;
            kl += d.kl * share;
            squares += d.error.powi(2) * share;
        }
        self.actor.backward(&d_mean, n);
        self.critic.backward(&d_value, n);
        let norm = self.descend(&d_log_std, learning_rate);
        // Adam has already stepped: the parameters are spoilt, and the training cannot go on.
        if !norm.is_finite() {
            return Err(TrainError::Diverged { steps: self.steps, what: "the gradient" });
        }
        Ok([kl, squares])
    }

    /// Takes a step of Adam over all parameters. Returns the norm of the gradient.
    fn descend(&mut self, d_log_std: &[f32; 2], learning_rate: f32) -> f32 {
        let mut blocks: Vec<(&mut [f32], &[f32])> = vec![(&mut self.log_std[..], &d_log_std[..])];
        for network in [&mut self.actor, &mut self.critic] {
            for (layer, gradient) in network.mlp.layers_mut().iter_mut().zip(&network.gradients) {
                blocks.push((&mut layer.weight, &gradient.weight));
                blocks.push((&mut layer.bias, &gradient.bias));
            }
        }
        let norm = self.adam.step(&mut blocks, learning_rate, self.settings.max_gradient_norm);
        self.log_std.iter_mut().for_each(|l| *l = l.clamp(LOG_STD_RANGE.0, LOG_STD_RANGE.1));
        norm
    }
}

/// Returns true if a step was a success.
fn is_success(task: &Task, t: &Transition) -> bool {
    t.reward >= task.success_reward
}

/// Values scaled to mean 0 and standard deviation 1. A single value becomes 0.
fn standardised(mut values: Vec<f32>) -> Vec<f32> {
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n;
    values.iter_mut().for_each(|v| *v = (*v - mean) / (variance.sqrt() + 1e-8));
    values
}

#[cfg(test)]
mod tests;
