//! Training on a small task: bring the end effector to a point.

use super::*;
use catenary_core::Goal;
use catenary_core::policy::Observes;
use catenary_core::task::{DeltaAnchor, Workspace};

/// Environments of the task. The reward falls with the distance from the goal; an episode has [`STEPS`] steps.
#[derive(Clone)]
struct Reaching {
    at: Vec<[f64; 2]>,
    steps: Vec<usize>,
    /// Side of each environment's goal, -1 or 1, drawn for each episode. It shows in the first observation alone. Empty: the goal is [`GOAL`].
    sides: Vec<f64>,
    rng: ChaCha8Rng,
}

const GOAL: [f64; 2] = [0.5, 0.3];
const STEPS: usize = 8;

impl Reaching {
    fn new(count: usize) -> Self {
        Self { at: vec![[0.4, 0.4]; count], steps: vec![0; count], sides: Vec::new(), rng: seed::rng(9, 9) }
    }

    fn with_sides(count: usize) -> Self {
        Self { sides: vec![1.0; count], ..Self::new(count) }
    }

    fn goal(&self, e: usize) -> [f64; 2] {
        self.sides.get(e).map_or(GOAL, |side| [0.45 + 0.1 * side, GOAL[1]])
    }

    fn observe(&self, e: usize) -> Observation {
        let side = self.sides.get(e).filter(|_| self.steps[e] == 0);
        Observation::new(self.at[e], &[[side.copied().unwrap_or(0.0); 2]; 4], [0.0; 2])
    }

    fn restart(&mut self, e: usize) {
        self.at[e] = [self.rng.random_range(0.3..0.6), self.rng.random_range(0.15..0.45)];
        self.steps[e] = 0;
        if let Some(side) = self.sides.get_mut(e) {
            *side = if self.rng.random_bool(0.5) { 1.0 } else { -1.0 };
        }
    }
}

impl Env for Reaching {
    fn count(&self) -> usize {
        self.at.len()
    }

    fn reset(&mut self) -> Result<Vec<Observation>, EnvError> {
        (0..self.count()).for_each(|e| self.restart(e));
        Ok((0..self.count()).map(|e| self.observe(e)).collect())
    }

    fn step(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Transition>, EnvError> {
        let mut transitions = Vec::new();
        for (e, a) in actions.iter().enumerate() {
            for i in 0..2 {
                self.at[e][i] += a[i];
            }
            self.steps[e] += 1;
            let goal = self.goal(e);
            let distance = (self.at[e][0] - goal[0]).hypot(self.at[e][1] - goal[1]);
            let final_observation = self.observe(e);
            let truncated = self.steps[e] == STEPS;
            if truncated {
                self.restart(e);
            }
            let reward = 1.0 - 5.0 * distance;
            transitions.push(Transition {
                observation: self.observe(e),
                reward,
                terminated: false,
                truncated,
                final_observation,
            });
        }
        Ok(transitions)
    }
}

fn task() -> Task {
    Task {
        goal: Goal::Reach,
        steps: STEPS,
        rest_steps: 0,
        step_period_s: 0.5,
        delta_anchor: DeltaAnchor::LastTarget,
        workspace: Workspace::default(),
        target_m: GOAL,
        target_jitter_m: 0.0,
        success_reward: 0.75,
        ends_at_success: false,
    }
}

fn run(settings: &Settings) -> Trained {
    train(&mut Reaching::new(12), &task(), settings, 3, &mut |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn learns_to_reach_a_point() {
    let settings = Settings { total_steps: 18_432, ..Settings::tuned() };
    let trained = run(&settings);
    let (first, last) = (trained.curve[0].mean_return, trained.curve[trained.curve.len() - 1].mean_return);
    // The best policy earns about 7.4 from a random start, as it spends two steps on the way.
    assert!(first < 5.0 && last > 6.8, "return rose from {first:.2} to {last:.2}");
    let point = |i: usize| trained.curve[i];
    let end = point(trained.curve.len() - 1);
    assert!(end.entropy < point(0).entropy, "the policy made up its mind: {end:?}");
    // The discounted returns span some units; a critic that learnt nothing would miss their variance.
    assert!(end.value_loss < 0.5 * point(0).value_loss, "{:?}, then {end:?}", point(0));
    let recent = trained.recent.iter().map(|(r, _)| r).sum::<f64>() / trained.recent.len() as f64;
    assert!(trained.recent.len() == 100 && (recent - end.mean_return).abs() < 1e-9, "{recent}");
    let policy = trained.policy;
    let toward = policy.act(&Observation::new([0.35, 0.3], &[[0.0; 2]; 4], [0.0; 2]), &mut Memory::default());
    assert!(toward[0] > 0.04, "from the left it goes right: {toward:?}");
}

#[test]
fn equal_seeds_give_equal_bits() {
    let settings = Settings { total_steps: 2_304, ..Settings::tuned() };
    assert_eq!(run(&settings), run(&settings));
}

#[test]
fn a_stopped_training_returns_the_policy_learnt_so_far() {
    let mut calls = 0;
    let trained = train(&mut Reaching::new(12), &task(), &Settings::tuned(), 1, &mut |p| {
        calls += 1;
        if p.now.steps >= 1_536 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })
    .unwrap();
    assert_eq!((calls, trained.steps), (2, 1_536));
}

#[test]
fn a_training_that_goes_on_from_its_state_ends_with_the_same_bits() {
    // 13 steps between two updates and 8 of an episode: the rollouts end within episodes.
    let (n_steps, total_steps) = (13, 12 * 13 * 6);
    for (history, normalise_observations) in [(0, true), (5, true), (2, false)] {
        let settings = Settings {
            n_steps,
            total_steps,
            observes: Observes { history, time: history > 2 },
            normalise_observations,
            ..Settings::tuned()
        };
        let mut goes_on = |_: &Progress| ControlFlow::Continue(());
        let mut env = Reaching::with_sides(12);
        let whole = train_from(None, &mut env, &task(), &settings, 3, &mut goes_on).unwrap();
        for updates in [1, 2, 5] {
            let mut env = Reaching::with_sides(12);
            let mut left = updates;
            let (_, state) = train_from(None, &mut env, &task(), &settings, 3, &mut |_| {
                left -= 1;
                if left == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })
            .unwrap();
            assert_eq!(state.steps(), 12 * 13 * updates);
            let resumed = train_from(Some(state), &mut env, &task(), &settings, 3, &mut goes_on).unwrap();
            assert_eq!(resumed, whole, "history {history}, from update {updates}");
        }
    }
}

#[test]
fn the_state_of_another_training_is_refused() {
    let settings = Settings { total_steps: 1_536, ..Settings::tuned() };
    let from = |state: Option<State>, settings: &Settings| {
        train_from(state, &mut Reaching::new(12), &task(), settings, 3, &mut |_| ControlFlow::Continue(()))
    };
    let (_, state) = from(None, &settings).unwrap();
    let cases: [(Settings, &str); 3] = [
        (
            Settings { hidden: 32, ..settings.clone() },
            "`actor`: expected layers of [(73, 32), (32, 32), (32, 2)], got [(73, 64)",
        ),
        (
            Settings { observes: Observes { history: 1, time: false }, ..settings.clone() },
            "`actor`: expected layers of [(24, 64), (64, 64), (64, 2)]",
        ),
        (Settings { total_steps: 768, ..settings.clone() }, "`steps`: expected at most 768, got 1536"),
    ];
    for (other, words) in cases {
        let error = from(Some(state.clone()), &other).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// Environments of which one gives a reward of NaN.
struct RewardOfNan(Reaching);

impl Env for RewardOfNan {
    fn count(&self) -> usize {
        self.0.count()
    }

    fn reset(&mut self) -> Result<Vec<Observation>, EnvError> {
        self.0.reset()
    }

    fn step(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Transition>, EnvError> {
        let mut transitions = self.0.step(actions)?;
        transitions[0].reward = f64::NAN;
        Ok(transitions)
    }
}

#[test]
fn a_reward_of_nan_and_a_wrong_number_of_environments_are_errors() {
    let e =
        train(&mut RewardOfNan(Reaching::new(12)), &task(), &Settings::tuned(), 1, &mut |_| ControlFlow::Continue(()));
    assert!(matches!(e, Err(TrainError::Diverged { .. })));
    let e = train(&mut Reaching::new(3), &task(), &Settings::tuned(), 1, &mut |_| ControlFlow::Continue(()));
    assert!(matches!(e, Err(TrainError::Environments { expected: 12, got: 3 })));
}

#[test]
fn a_history_remembers_what_the_first_observation_showed() {
    let trained = |history| {
        let settings =
            Settings { total_steps: 24_576, observes: Observes { history, time: false }, ..Settings::tuned() };
        train(&mut Reaching::with_sides(12), &task(), &settings, 3, &mut |_| ControlFlow::Continue(())).unwrap()
    };
    let last = |t: &Trained| t.curve[t.curve.len() - 1].mean_return;
    let (without, with) = (trained(0), trained(STEPS - 1));
    // Between the two places, each 0.1 m away, every step loses 0.5.
    assert!(last(&with) > last(&without) + 1.0, "with {:.2}, without {:.2}", last(&with), last(&without));
    // The policy does in an episode what it did in training: it remembers the side.
    let ends = [-1.0, 1.0].map(|side| {
        let (mut memory, mut x) = (Memory::default(), 0.45);
        for step in 0..STEPS {
            let shown = if step == 0 { side } else { 0.0 };
            x += with.policy.act(&Observation::new([x, 0.3], &[[shown; 2]; 4], [0.0; 2]), &mut memory)[0];
        }
        x
    });
    assert!(ends[1] - ends[0] > 0.1, "it went to {ends:.2?}");
}
