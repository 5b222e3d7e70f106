//! Vectorised environment of a model's task.

use crate::arm::ArmModel;
use crate::effects::Registry;
use crate::episode::{Conditions, EpisodeSimulation, verdict};
use crate::parameters::ParameterError;
use crate::workers;
use catenary_core::env::EnvError;
use catenary_core::task::{Referee, Verdict};
use catenary_core::track::End;
use catenary_core::{Env, Fidelity, Goal, Judge, Model, Observation, Transition, seed};
use rand::RngExt;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Random stream that selects the domain of an episode.
const DOMAIN_STREAM: u64 = 17;

/// Error of environments that cannot be opened.
#[derive(Debug, Error, PartialEq)]
pub enum OpenError {
    /// Parameters that make no beam.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// Missing task, no environments, too few domains, or domains of the wrong length.
    #[error("environments: {0}")]
    Input(String),
}

/// Environment of one object.
struct Member {
    simulation: EpisodeSimulation,
    arm: ArmModel,
    referee: Referee,
    step: usize,
    seed: u64,
    episodes: u64,
    /// Domain of the present episode.
    domain: Option<usize>,
    /// Actions of the present episode.
    actions: Vec<[f64; 2]>,
}

/// Present episode of an environment. An environment that repeats it is in the same state, to the bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ongoing {
    /// Number of the episode, from 0.
    pub episode: u64,
    /// Actions so far, (dx, dz) in m.
    pub actions: Vec<[f64; 2]>,
}

/// N environments of one model, each with its own object.
pub struct VectorEnv {
    model: Model,
    judge: Judge,
    domains: Vec<Vec<f64>>,
    members: Vec<Member>,
    workers: usize,
}

impl VectorEnv {
    /// Opens `count` environments of `model`. With as many `domains` (thetas) as environments, environment i keeps row
    /// i. With more, each episode draws one.
    ///
    /// # Errors
    /// [`OpenError`] if there is no task, no environment, a missing or bad domain, or no object.
    pub fn open(
        model: &Model,
        count: usize,
        domains: Vec<Vec<f64>>,
        fidelity: Fidelity,
        env_seed: u64,
        workers: usize,
    ) -> Result<Self, OpenError> {
        let input = |what: String| OpenError::Input(what);
        let judge = Judge::of(model).ok_or_else(|| input(format!("model `{}` has no task", model.name)))?;
        if count == 0 || domains.len() < count {
            return Err(input(format!(
                "expected at least one environment and a domain for each, got {count} and {}",
                domains.len()
            )));
        }
        let d = model.theta.dimension();
        if let Some(bad) = domains.iter().find(|t| t.len() != d) {
            return Err(input(format!("expected {d} values a domain, got {}", bad.len())));
        }
        crate::parameters::check(model)?;
        let member = |i: usize| -> Result<Member, ParameterError> {
            let simulation = EpisodeSimulation::new(model, Registry::shipped(), fidelity)?;
            Ok(Member {
                arm: simulation.arm([model.arm.start.x_m, model.arm.start.z_m]),
                simulation,
                referee: judge.referee(),
                step: 0,
                seed: seed::derive(env_seed, i as u64),
                episodes: 0,
                domain: None,
                actions: Vec::new(),
            })
        };
        let members = (0..count).map(member).collect::<Result<_, _>>()?;
        Ok(Self { model: model.clone(), judge, domains, members, workers })
    }

    /// Present episode of each environment; none before the first reset.
    pub fn ongoing(&self) -> Option<Vec<Ongoing>> {
        let of = |m: &Member| Some(Ongoing { episode: m.episodes.checked_sub(1)?, actions: m.actions.clone() });
        self.members.iter().map(of).collect()
    }

    /// Repeats the present episodes of environments that were opened alike, in place of a reset. The environments then go on as those did.
    ///
    /// # Errors
    /// [`EnvError::Input`]: another number of episodes, an action that is not finite, or more actions than an episode has.
    pub fn resume(&mut self, ongoing: Vec<Ongoing>) -> Result<(), EnvError> {
        if ongoing.len() != self.members.len() {
            return Err(EnvError::Input(format!("expected {} episodes, got {}", self.members.len(), ongoing.len())));
        }
        let again = |shared: &Shared<'_>, i: usize, member: &mut Member, Ongoing { episode, actions }: Ongoing| {
            member.episodes = episode;
            member.reset(shared, i)?;
            for action in actions {
                let is_over = |t: &Transition| t.terminated || t.truncated;
                if !action.iter().all(|v| v.is_finite()) || is_over(&member.step(shared, i, action)?) {
                    return Err(EnvError::Input(format!("episode {episode} of environment {i} cannot be repeated")));
                }
            }
            Ok(())
        };
        self.each(ongoing, again).into_iter().collect()
    }

    /// Runs `work` on every environment with an item of its own, on the workers.
    fn each<T: Send, R: Send>(
        &mut self,
        items: Vec<T>,
        work: impl Fn(&Shared<'_>, usize, &mut Member, T) -> R + Sync,
    ) -> Vec<R> {
        let shared =
            Shared { model: &self.model, judge: &self.judge, domains: &self.domains, count: self.members.len() };
        let pairs: Vec<(&mut Member, T)> = self.members.iter_mut().zip(items).collect();
        workers::map(pairs, self.workers, |i, (member, item)| work(&shared, i, member, item))
    }
}

/// Data that all environments read.
struct Shared<'a> {
    model: &'a Model,
    judge: &'a Judge,
    domains: &'a [Vec<f64>],
    count: usize,
}

impl Member {
    /// Starts an episode. Returns its first observation.
    fn reset(&mut self, shared: &Shared<'_>, index: usize) -> Result<Observation, EnvError> {
        let episode_seed = seed::derive(self.seed, self.episodes);
        let domain = if shared.domains.len() == shared.count {
            index
        } else {
            seed::rng(episode_seed, DOMAIN_STREAM).random_range(0..shared.domains.len())
        };
        self.domain = Some(domain);
        self.episodes += 1;
        self.step = 0;
        self.actions.clear();
        let conditions = Conditions {
            theta: &shared.domains[domain],
            effects: &[],
            seed: episode_seed,
            noise: true,
            target_m: None,
        };
        self.simulation.prepare(&conditions).map_err(|e| EnvError::Input(e.to_string()))?;
        let start = shared.model.arm.start;
        self.arm = self.simulation.arm([start.x_m, start.z_m]);
        self.simulation.hang(start);
        self.referee = shared.judge.referee();
        Ok(self.observe(0.0, [start.x_m, start.z_m]))
    }

    fn observe(&mut self, time_s: f64, eef_m: [f64; 2]) -> Observation {
        let dlo = self.simulation.keypoints(time_s);
        Observation::new(eef_m, &dlo, self.simulation.target_scaled())
    }

    fn step(&mut self, shared: &Shared<'_>, index: usize, action: [f64; 2]) -> Result<Transition, EnvError> {
        let task = shared.judge.task();
        self.actions.push(action);
        self.arm.set_delta(self.step as f64 * task.step_period_s, action);
        let (mut observation, mut verdict) = self.go_on(shared);
        // The rest belongs to the last action: a policy does not act in it.
        while self.step >= task.steps && verdict.end.is_none() {
            (observation, verdict) = self.go_on(shared);
        }
        let Verdict { reward, end } = verdict;
        // The step limit cuts `reach` off, whose later steps would earn more; the other goals are paid at their end.
        let is_limit = match end {
            Some(End::LeftWorkspace) => false,
            Some(End::Success) => !task.ends_at_success,
            _ => end.is_some(),
        };
        let truncated = is_limit && task.goal == Goal::Reach;
        let terminated = end.is_some() && !truncated;
        // The next episode begins at once, and the last observation is given apart, as in Gymnasium's vector
        // environments.
        let next = if terminated || truncated { self.reset(shared, index)? } else { observation };
        Ok(Transition { observation: next, reward, terminated, truncated, final_observation: observation })
    }

    /// Goes on for one step without a new action, and judges where it leads.
    fn go_on(&mut self, shared: &Shared<'_>) -> (Observation, Verdict) {
        let task = shared.judge.task();
        self.step += 1;
        let time_s = self.step as f64 * task.step_period_s;
        self.arm.run_to(time_s);
        let (arm, pitch_rad) = (&self.arm, shared.model.arm.start.pitch_rad);
        self.simulation.advance(time_s, |t| arm.grip(t, pitch_rad));
        let eef_m = arm.position_m(time_s);
        let observation = self.observe(time_s, eef_m);
        let verdict = verdict(task, &mut self.referee, &self.arm, &observation, self.step);
        (observation, verdict)
    }
}

impl Env for VectorEnv {
    fn count(&self) -> usize {
        self.members.len()
    }

    fn reset(&mut self) -> Result<Vec<Observation>, EnvError> {
        let nothing = vec![(); self.members.len()];
        self.each(nothing, |shared, i, member, ()| member.reset(shared, i)).into_iter().collect()
    }

    fn step(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Transition>, EnvError> {
        if actions.len() != self.members.len() {
            return Err(EnvError::Input(format!("expected {} actions, got {}", self.members.len(), actions.len())));
        }
        if let Some(bad) = actions.iter().find(|a| !a.iter().all(|v| v.is_finite())) {
            return Err(EnvError::Input(format!("expected finite actions, got {bad:?}")));
        }
        self.each(actions.to_vec(), |shared, i, member, action| member.step(shared, i, action)).into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::{never_stop, run};
    use crate::parameters::tests::soft_bar;
    use catenary_core::simulator::{Drive, StartShape};
    use catenary_core::task::{MAX_DELTA_M, Moment, Phase};

    fn open(count: usize, domains: usize, workers: usize) -> VectorEnv {
        let rows = (0..domains).map(|i| vec![0.2 + 0.1 * i as f64 / domains as f64, 2e4]).collect();
        VectorEnv::open(&soft_bar(), count, rows, Fidelity::Fast, 7, workers).unwrap()
    }

    fn roll(mut env: VectorEnv, actions: &[[f64; 2]], steps: usize) -> Vec<Vec<Transition>> {
        env.reset().unwrap();
        (0..steps).map(|_| env.step(actions).unwrap()).collect()
    }

    #[test]
    fn the_number_of_workers_does_not_change_a_bit() {
        let actions = [[0.01, -0.02], [-0.01, 0.0], [0.0, -0.03]];
        let one = roll(open(3, 8, 1), &actions, 3);
        assert_eq!(one, roll(open(3, 8, 2), &actions, 3));
        assert_eq!(one, roll(open(3, 8, 8), &actions, 3));
    }

    #[test]
    fn environments_that_repeat_their_episodes_go_on_with_the_same_bits() {
        // Three environments and eight domains: each reset draws one. The second leaves the workspace, and begins anew.
        let actions = [[0.01, -0.02], [-0.05, 0.0], [0.0, -0.03]];
        let mut whole = open(3, 8, 2);
        assert_eq!(whole.ongoing(), None);
        whole.reset().unwrap();
        (0..21).for_each(|_| drop(whole.step(&actions).unwrap()));
        let ongoing = whole.ongoing().unwrap();
        assert!(ongoing[1].episode > ongoing[0].episode && ongoing[0].episode == 1, "{ongoing:?}");
        let mut resumed = open(3, 8, 1);
        resumed.resume(ongoing.clone()).unwrap();
        assert_eq!(resumed.ongoing(), Some(ongoing.clone()));
        for _ in 0..20 {
            assert_eq!(resumed.step(&actions).unwrap(), whole.step(&actions).unwrap());
        }
        assert!(open(2, 8, 1).resume(ongoing.clone()).is_err());
        let long = vec![Ongoing { episode: 0, actions: vec![[0.0; 2]; 100] }; 3];
        assert!(open(3, 8, 1).resume(long).unwrap_err().to_string().contains("cannot be repeated"));
        let wrong = vec![Ongoing { episode: 0, actions: vec![[f64::NAN; 2]] }; 3];
        assert!(open(3, 8, 1).resume(wrong).is_err());
    }

    #[test]
    fn an_episode_is_cut_off_at_the_step_limit_and_starts_anew() {
        let steps = roll(open(1, 1, 1), &[[0.0, 0.0]], 17);
        assert!(steps[..15].iter().all(|t| !t[0].truncated && !t[0].terminated));
        let last = &steps[15][0];
        assert!(last.truncated && !last.terminated && last.observation != last.final_observation);
        assert!(!steps[16][0].truncated);
    }

    #[test]
    fn placing_the_tip_ends_with_the_last_step_which_alone_is_rewarded() {
        let mut model = soft_bar();
        let task = model.task.as_mut().unwrap();
        (task.goal, task.steps, task.step_period_s) = (Goal::PlaceTip { reward_range_m: 0.5 }, 3, 0.25);
        let mut env = VectorEnv::open(&model, 1, vec![vec![0.25, 2e4]], Fidelity::Fast, 7, 1).unwrap();
        env.reset().unwrap();
        let steps: Vec<Transition> = (0..4).map(|_| env.step(&[[0.02, -0.02]]).unwrap().remove(0)).collect();
        assert!(steps[..2].iter().all(|t| t.reward == 0.0 && !t.terminated && !t.truncated), "{steps:?}");
        // The value ends with the episode: it is terminated and not cut off.
        assert!(steps[2].reward > 0.1 && steps[2].terminated && !steps[2].truncated, "{:?}", steps[2]);
        assert!(!steps[3].terminated, "the next episode has begun");
        let judge = Judge::of(&model).unwrap();
        let moment = Moment::of(&steps[2].final_observation, false, Phase::Last);
        assert_eq!(steps[2].reward, judge.referee().verdict(&moment).reward);
    }

    #[test]
    fn the_rest_belongs_to_the_last_action_and_is_judged_as_the_simulator_does() {
        let mut model = soft_bar();
        let task = model.task.as_mut().unwrap();
        (task.goal, task.steps, task.rest_steps) = (Goal::Settle { reward_range_m: 0.5 }, 2, 4);
        (task.step_period_s, task.target_m) = (0.25, [0.5, 0.1]);
        let task = *task;
        let mut env = VectorEnv::open(&model, 1, vec![vec![0.25, 2e4]], Fidelity::Fast, 7, 1).unwrap();
        env.reset().unwrap();
        let steps: Vec<Transition> = (0..3).map(|_| env.step(&[[0.05, 0.0]]).unwrap().remove(0)).collect();
        assert!(steps[0].reward == 0.0 && !steps[0].terminated, "{steps:?}");
        assert!(steps[1].reward > 0.5 && steps[1].terminated && !steps[1].truncated, "{steps:?}");
        assert!(!steps[2].terminated, "the next episode has begun");
        // The same actions, frame by frame.
        let mut simulation = EpisodeSimulation::new(&model, Registry::shipped(), Fidelity::Fast).unwrap();
        let episode_seed = seed::derive(seed::derive(7, 0), 0);
        let conditions =
            Conditions { theta: &[0.25, 2e4], effects: &[], seed: episode_seed, noise: true, target_m: None };
        simulation.prepare(&conditions).unwrap();
        let drive = Drive::Actions(vec![[0.05, 0.0]; 2]);
        let track = run(&mut simulation, &drive, &StartShape::HangingAtRest, &[], &never_stop).unwrap();
        assert_eq!(track.frames.len(), 1 + task.all_steps());
        let score = Judge::of(&model).unwrap().score(&track);
        assert!((score.rewards[5] - steps[1].reward).abs() < 1e-12, "{score:?}, {}", steps[1].reward);
    }

    #[test]
    fn a_success_ends_an_episode_of_reach_only_if_the_task_says_so() {
        let mut model = soft_bar();
        let open = |model: &Model| {
            let mut env = VectorEnv::open(model, 1, vec![vec![0.2, 2e4]], Fidelity::Fast, 7, 1).unwrap();
            env.reset().unwrap();
            (0..16).map(|_| env.step(&[[0.005, -0.03]]).unwrap().remove(0)).collect::<Vec<Transition>>()
        };
        model.task.as_mut().unwrap().success_reward = 0.3;
        let steps = open(&model);
        let first = steps.iter().position(|t| t.reward >= 0.3).expect("the bar comes near the target");
        assert!(!steps[first].terminated && first < 15, "{steps:?}");
        model.task.as_mut().unwrap().ends_at_success = true;
        let steps = open(&model);
        assert!(steps[first].terminated && !steps[first].truncated, "{steps:?}");
    }

    #[test]
    fn leaving_the_workspace_ends_the_episode_with_minus_one() {
        let steps = roll(open(1, 1, 1), &[[-MAX_DELTA_M, 0.0]], 3);
        let end = steps.iter().find(|t| t[0].terminated).expect("0.4 m less 0.18 m lies outside");
        assert_eq!(end[0].reward, -1.0);
        assert!(end[0].final_observation.eef_m()[0] < 0.4 && end[0].observation.eef_m() == [0.4, 0.42]);
    }

    #[test]
    fn the_reward_is_that_of_the_observed_position() {
        let steps = roll(open(2, 2, 1), &[[0.02, -0.04], [0.0, -0.01]], 2);
        for t in steps.iter().flatten().filter(|t| !t.terminated) {
            assert!((t.reward - t.final_observation.reward()).abs() < 1e-12);
        }
    }

    #[test]
    fn bad_domains_and_actions_are_refused() {
        let model = soft_bar();
        let open_with =
            |count, rows| VectorEnv::open(&model, count, rows, Fidelity::Fast, 1, 1).err().map(|e| e.to_string());
        assert!(open_with(2, vec![vec![0.2, 1e4]]).unwrap().contains("2 and 1"));
        assert!(open_with(1, vec![vec![0.2]]).unwrap().contains("2 values"));
        let mut env = open(2, 2, 1);
        env.reset().unwrap();
        assert!(env.step(&[[0.0; 2]]).is_err());
        assert!(env.step(&[[f64::NAN, 0.0], [0.0; 2]]).is_err());
    }
}
