//! Search for the best open-loop plan of a task: what can be reached without feedback, and where a training may begin.
//!
//! The episodes of a plan are simulated, and once more for each action that is changed a little. The differences give a linear model of
//! every frame, on which the judge of the task scores thousands of other plans without a simulation. The best of them near the present plan
//! is simulated, and becomes the next one if it is better (a trust region method, Conn, Gould and Toint 2000). Constant plans are searched from
//! several starts, on few episodes; the best becomes affine in the target.

mod coordinates;
mod evolution;
mod linear;
mod loss;

use self::coordinates::Coordinates;
use self::evolution::Evolution;
use self::linear::Linear;
use self::loss::loss;
use catenary_core::mlp::Layer;
use catenary_core::policy::{Observes, Plan};
use catenary_core::simulator::{Drive, SimulationRequest, SimulatorError};
use catenary_core::task::MAX_DELTA_M;
use catenary_core::{Judge, Mlp, Model, Observation, Policy, Simulator, Track, seed};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::ops::ControlFlow;

/// Number of episodes in which a plan of `steps` steps is searched: enough for the plan to hold in others, and fewer for long plans, each of whose
/// actions costs episodes.
pub fn episodes_of(steps: usize) -> usize {
    (128 / steps.max(1)).clamp(8, 16)
}

/// Random stream of the episodes of a search: others than those of trainings and evaluations.
pub const EPISODES_STREAM: u64 = 2401;

/// Most steps of a task whose plan is searched. The time of a search rises with the square of the steps and more, and half a minute is long.
pub const MOST_STEPS: usize = 32;

/// Constant plans from which a search starts.
const STARTS: usize = 3;
/// Number of episodes for the search from a start, by the number of steps of a plan. A good plan is one whose outcome depends little on what an
/// episode draws, such as the damping; two episodes do not tell it from others.
fn start_episodes_of(steps: usize) -> usize {
    (48 / steps.max(1)).clamp(2, 6)
}
/// Most rounds from a start, and of the affine plan. A round simulates one plan, or with a new linear model one for each action, too.
const START_ROUNDS: usize = 8;
const ROUNDS: usize = 10;
/// Standard deviation of the actions of a start, in units of the action limit.
const START_SPREAD: f64 = 0.4;
/// Greatest change of an action in the first round, in the most trusting and in the last one, in units of the action limit.
const TRUST: [f64; 3] = [0.3, 1.0, 0.01];
/// Change of an action that gives the derivatives, in units of the action limit.
const DIFFERENCE: f64 = 0.1;
/// Generations on a linear model.
const GENERATIONS: usize = 100;
/// Relative gain of a round below which the search ends.
const FLAT: f64 = 1e-4;

/// Best plan that a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// Plan.
    pub plan: Plan,
    /// Mean over the episodes of the search of the distance that the task minimises, m.
    pub distance_m: f64,
    /// Number of simulated episodes.
    pub simulated: usize,
}

impl Planned {
    /// Policy that executes the plan. Its standard deviation is that of steps which together move the hand by what the plan misses: how far a
    /// training should explore about it.
    pub fn policy(&self, judge: &Judge) -> Policy {
        let spread = self.distance_m / (MAX_DELTA_M * (self.plan.steps.len().max(1) as f64).sqrt());
        Policy { action_scale: [spread.min(1.0) as f32; 2], ..policy(self.plan.clone(), judge) }
    }
}

/// Policy that executes a plan: it sees the target once, and nothing else.
fn policy(plan: Plan, judge: &Judge) -> Policy {
    let task = judge.task();
    let (inputs, outputs) = (Observation::LEN, 2);
    let still = Layer { inputs, outputs, weight: vec![0.0; inputs * outputs], bias: vec![0.0; outputs] };
    Policy {
        name: "plan".to_owned(),
        actor: Mlp::new(vec![still]).expect("one layer is a network"),
        observes: Observes::default(),
        plan: Some(plan),
        observation_mean: [0.0; Observation::LEN],
        observation_scale: [1.0; Observation::LEN],
        action_scale: [0.0; 2],
        step_period_s: task.step_period_s,
        delta_anchor: task.delta_anchor,
        steps: task.steps,
        goal: Some(task.goal),
        arm: None,
        start_speed_m_s: None,
    }
}

/// Searches the best plan for the episodes of `requested`, whose drive is replaced. Their mean return is the greatest that was found. No success
/// should end an episode of `simulator` early. Each of the episodes has its own object and target, so that a plan for objects that differ is the
/// best one for all of them together. `on_progress` gets the share of the search that is done, and may end it.
///
/// # Errors
/// [`SimulatorError`]: no task, one of more than [`MOST_STEPS`] steps, no episode, or a simulation that fails.
pub fn search(
    simulator: &dyn Simulator,
    model: &Model,
    requested: &SimulationRequest,
    search_seed: u64,
    on_progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Option<Planned>, SimulatorError> {
    let no_task = || SimulatorError::Input(format!("model `{}` has no task", model.name));
    let judge = Judge::of(model).ok_or_else(no_task)?;
    let steps = judge.task().steps;
    if steps > MOST_STEPS {
        return Err(SimulatorError::Input(format!(
            "`task.steps`: expected at most {MOST_STEPS} for a search of the best plan, got {steps}"
        )));
    }
    let start_m = [model.arm.start.x_m, model.arm.start.z_m];
    let all = (STARTS * START_ROUNDS + ROUNDS) as f64;
    let mut done = 0;
    let mut search =
        Search { simulator, judge, start_m, simulated: 0, on_progress: &mut |round| on_progress(round as f64 / all) };
    let still = search.tracks(&Plan::default(), requested)?;
    let Some(constant) = Coordinates::of(&still, judge.task().steps) else {
        return Err(SimulatorError::Input("a plan needs at least one episode".to_owned()));
    };
    let few = requested.part(0..start_episodes_of(judge.task().steps));
    let mut best: Option<Point> = None;
    for start in 0..STARTS {
        let z = search.start(&constant, seed::derive(search_seed, 2 * start as u64));
        let rounds = Rounds { first: done, count: START_ROUNDS, seed: seed::derive(search_seed, 2 * start as u64 + 1) };
        let Some(found) = search.descend(z, &constant, &few, rounds)? else { return Ok(None) };
        done += START_ROUNDS;
        // By all episodes: a plan that suits these few may miss the others.
        let found = search.point(found.z, &constant, requested)?;
        if best.as_ref().is_none_or(|best| found.loss < best.loss) {
            best = Some(found);
        }
    }
    let affine = constant.affine();
    let z = best.map_or_else(Vec::new, |best| affine.of_constants(&best.z));
    let rounds = Rounds { first: done, count: ROUNDS, seed: seed::derive(search_seed, 2 * STARTS as u64) };
    let Some(found) = search.descend(z, &affine, requested, rounds)? else { return Ok(None) };
    let distances = found.tracks.iter().map(|track| judge.score(track).distance_m);
    let distance_m = distances.sum::<f64>() / found.tracks.len() as f64;
    Ok(Some(Planned { plan: affine.plan(&found.z), distance_m, simulated: search.simulated }))
}

/// Plan with its episodes.
struct Point {
    /// Plan in its coordinates.
    z: Vec<f64>,
    tracks: Vec<Track>,
    /// Mean loss of the episodes.
    loss: f64,
}

/// Rounds of a descent.
struct Rounds {
    /// Number of rounds before.
    first: usize,
    count: usize,
    seed: u64,
}

struct Search<'a> {
    simulator: &'a dyn Simulator,
    judge: Judge,
    /// Pose (x, z) in m of the hand at the start.
    start_m: [f64; 2],
    simulated: usize,
    /// Gets the number of finished rounds.
    on_progress: &'a mut dyn FnMut(usize) -> ControlFlow<()>,
}

impl Search<'_> {
    fn tracks(&mut self, plan: &Plan, requested: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.simulated += requested.thetas.len();
        let drive = Drive::Policy(Box::new(policy(plan.clone(), &self.judge)));
        self.simulator.simulate(&SimulationRequest { drive, ..requested.clone() })
    }

    fn point(&mut self, z: Vec<f64>, at: &Coordinates, requested: &SimulationRequest) -> Result<Point, SimulatorError> {
        let tracks = self.tracks(&at.plan(&z), requested)?;
        let loss = tracks.iter().map(|track| loss(&self.judge, track)).sum::<f64>() / tracks.len() as f64;
        Ok(Point { z, tracks, loss })
    }

    /// Random constant plan inside the workspace.
    fn start(&self, constant: &Coordinates, start_seed: u64) -> Vec<f64> {
        let mut rng = seed::rng(start_seed, 0);
        let mut draw = || (0..constant.len()).map(|_| START_SPREAD * rng.sample::<f64, _>(StandardNormal)).collect();
        // Long episodes walk out of the workspace more often: after some draws, the hand stays where it is.
        let inside = |z: &Vec<f64>| linear::outside_m(&self.judge, self.start_m, &linear::executed(z), None) == 0.0;
        (0..100).map(|_| draw()).find(inside).unwrap_or_else(|| vec![0.0; constant.len()])
    }

    /// Descends from `z`. Returns `None` if the progress ended the search.
    fn descend(
        &mut self,
        z: Vec<f64>,
        at: &Coordinates,
        requested: &SimulationRequest,
        rounds: Rounds,
    ) -> Result<Option<Point>, SimulatorError> {
        let [mut trust, most, least] = TRUST;
        let mut now = self.point(z, at, requested)?;
        let mut linear: Option<Linear> = None;
        for round in 0..rounds.count {
            if (self.on_progress)(rounds.first + round).is_break() {
                return Ok(None);
            }
            let model = match linear.take() {
                Some(model) => model,
                None => match self.linear(&now, at, requested, rounds.first + round)? {
                    Some(model) => model,
                    None => return Ok(None),
                },
            };
            let (z, predicted) = self.best_near(&now, at, &model, trust, seed::derive(rounds.seed, round as u64));
            let next = if predicted < now.loss { Some(self.point(z, at, requested)?) } else { None };
            match next.filter(|next| next.loss < now.loss) {
                Some(next) => {
                    let gain = now.loss - next.loss;
                    // How far the linear model holds, by what it promised.
                    let kept = gain / (now.loss - predicted);
                    trust = if kept > 0.5 { (2.0 * trust).min(most) } else { 0.5 * trust };
                    let is_flat = gain < FLAT * now.loss.abs();
                    now = next;
                    if is_flat {
                        break;
                    }
                }
                None => {
                    trust *= 0.3;
                    linear = Some(model);
                }
            }
            if trust < least {
                break;
            }
        }
        Ok(Some(now))
    }

    /// Linear model of the episodes of a plan after a number of rounds. Returns `None` if the progress ended the search.
    fn linear(
        &mut self,
        now: &Point,
        at: &Coordinates,
        requested: &SimulationRequest,
        rounds: usize,
    ) -> Result<Option<Linear>, SimulatorError> {
        let mut model = Linear::new(&now.tracks, |target| at.actions(&now.z, target));
        for action in 0..at.actions_count() {
            let place = at.constant_of(action);
            // Towards zero, since the limit of the action clips what is beyond it.
            let change = if now.z[place] > 0.0 { -DIFFERENCE } else { DIFFERENCE };
            let mut z = now.z.clone();
            z[place] += change;
            let changed = self.tracks(&at.plan(&z), requested)?;
            model.add(action, change, &changed);
            // Most of the time of a round passes here.
            if (self.on_progress)(rounds).is_break() {
                return Ok(None);
            }
        }
        Ok(Some(model))
    }

    /// Best plan near `now` by the linear model, with its loss there.
    fn best_near(&self, now: &Point, at: &Coordinates, model: &Linear, trust: f64, draws: u64) -> (Vec<f64>, f64) {
        let loss = |z: &[f64]| model.loss(&self.judge, self.start_m, &|target| at.actions(z, target), trust);
        // A sixth: the sum over a plan's numbers then mostly stays within the trusted change.
        let mut evolution = Evolution::new(now.z.clone(), trust / 6.0);
        let mut rng = seed::rng(draws, 0);
        let mut best = (now.z.clone(), loss(&now.z));
        for _ in 0..GENERATIONS {
            let candidates = evolution.draw(&mut rng);
            let losses: Vec<f64> = candidates.iter().map(|z| loss(z)).collect();
            evolution.learn(&candidates, &losses);
            for (z, loss) in candidates.into_iter().zip(losses) {
                if loss < best.1 {
                    best = (z, loss);
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests;
