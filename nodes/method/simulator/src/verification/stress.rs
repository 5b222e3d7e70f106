//! Stress test: random episodes at the edges of the prior and of every parameter. Nothing may blow up, and Newton's
//! method must converge.

use super::error::VerificationError;
use super::hand_path::random_motion;
use crate::effects::{Effect, Registry};
use crate::episode::{Conditions, EpisodeSimulation};
use crate::workers;
use catenary_core::model::AxialLaw;
use catenary_core::{Fidelity, Model, seed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Promised share of unconverged steps, and of episodes whose initial shape is not found.
const UNCONVERGED_SHARE: f64 = 1e-3;
/// Distance in m from the frame's origin beyond which an episode counts as blown up.
const FAR_M: f64 = 10.0;
/// Distance from the picture's middle, in half pictures, beyond which a keypoint counts as blown up.
const FAR_SCALED: f64 = 100.0;
/// Time in s between two checks of the nodes.
const CHECK_PERIOD_S: f64 = 0.1;
/// Probability that a coordinate of theta lies on an edge of the prior box.
const EDGE_CHANCE: f64 = 0.25;
/// Number of episodes in the report's list of the worst.
const WORST: usize = 5;

/// Extremes of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Extreme {
    /// Name, as model files write it.
    pub name: String,
    /// Smallest sensible value.
    pub low: f64,
    /// Largest sensible value.
    pub high: f64,
}

/// Largest tip mass in kg.
// Half the mass of a bar of 60 g; the effect's own prior reaches up to the load of a cable.
const MOST_TIP_MASS_KG: f64 = 0.03;

/// Returns the extremes of a soft bar's model: every parameter except length and stiffness, which have priors, and
/// every effect of the registry, over its prior.
pub fn default_extremes(registry: &Registry, model: &Model) -> Vec<Extreme> {
    let parameters = [
        ("poisson_ratio", 0.0, 0.5),
        ("density_kg_m3", 800.0, 2000.0),
        (STRANDS[0].0, STRANDS[0].1, 1e-3),
        (STRANDS[1].0, STRANDS[1].1, 1e-2),
        ("slip_spread_ratio", 1.0, 100.0),
        ("creep_time_s", 0.05, 20.0),
        ("table_height_m", -0.05, 0.05),
        ("table_friction", 0.0, 1.0),
    ];
    // Companions do nothing alone; an effect that is pushed has its companions pushed with it.
    let is_pushed = |effect: &&dyn Effect| effect.concerns(model) && !registry.is_companion(effect.about().name);
    let effects = registry.effects().filter(is_pushed).map(|effect| {
        let about = effect.about();
        let (low, high) = about.prior.bounds();
        let is_mass = ["tip_mass_kg", "tip_load_kg"].contains(&about.name);
        let high = if is_mass { MOST_TIP_MASS_KG } else { high };
        (about.name, low, high)
    });
    let extreme = |(name, low, high): (&str, f64, f64)| Extreme { name: name.to_owned(), low, high };
    parameters.into_iter().chain(effects).map(extreme).collect()
}

/// Parameters of strands, with a sticking stiffness in N m^2 and a slip moment in N m without noticeable effect.
// Not zero: each of the two needs the other.
const STRANDS: [(&str, f64); 2] = [("sticking_stiffness_n_m2", 1e-9), ("slip_moment_n_m", 1e-6)];
/// Effect that takes the place of these parameters.
const STRANDS_EFFECT: &str = "strand_friction_rad";

/// Stress test of many random episodes.
#[derive(Debug, Clone, Copy)]
pub struct Stress<'a> {
    /// Model with a task. Its theta and effects are drawn from their own distributions.
    pub model: &'a Model,
    /// Effects that may act.
    pub registry: &'a Registry,
    /// Parameters and effects that are pushed to their extremes.
    pub extremes: &'a [Extreme],
    /// Fidelity.
    pub fidelity: Fidelity,
    /// Number of episodes.
    pub episodes: usize,
    /// Seed of the test.
    pub seed: u64,
    /// Number of threads.
    pub workers: usize,
}

/// Result of one episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StressedEpisode {
    /// Number of the episode, which repeats it together with the seed.
    pub index: usize,
    /// Values of theta.
    pub theta: Vec<f64>,
    /// Parameters at their extremes.
    pub pushed: Vec<(String, f64)>,
    /// Axial law.
    pub axial_law: AxialLaw,
    /// Time steps.
    pub steps: u64,
    /// Steps whose Newton iteration did not converge.
    pub unconverged_steps: u64,
    /// True if the initial shape at rest was found.
    pub started_at_rest: bool,
    /// True if a node became infinite, NaN, or farther away than 10 m.
    pub blown_up: bool,
}

/// Result of the stress test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StressReport {
    /// Name of the fidelity.
    pub fidelity: &'static str,
    /// Number of episodes.
    pub episodes: usize,
    /// Time steps.
    pub steps: u64,
    /// Steps whose Newton iteration did not converge.
    pub unconverged_steps: u64,
    /// Share of unconverged steps.
    pub unconverged_share: f64,
    /// Episodes whose initial shape at rest was not found.
    pub unconverged_equilibria: usize,
    /// Episodes that blew up.
    pub blown_up: usize,
    /// Worst five episodes: blown up first, then not at rest at the start, then by unconverged steps.
    pub worst: Vec<StressedEpisode>,
    /// True if nothing blew up and fewer than one in a thousand steps, and initial shapes, did not converge.
    pub passes: bool,
}

impl Stress<'_> {
    /// Runs the episodes and calls `done` after each. The number of workers changes nothing.
    ///
    /// Theta comes from the prior box, with a quarter of its coordinates on the edges. The axial law is random. A third
    /// of the episodes has no further parameter pushed, a third has one at one extreme, and a third has half of them,
    /// each at either extreme. The hand makes the task's steps at random, low over the table half of the time.
    pub fn run(&self, done: impl Fn() + Sync) -> Result<StressReport, VerificationError> {
        let all: Vec<usize> = (0..self.episodes).collect();
        let outcomes = workers::map(all, self.workers, |_, index| {
            let outcome = self.episode(index);
            done();
            outcome
        });
        let mut outcomes = outcomes.into_iter().collect::<Result<Vec<_>, _>>()?;
        let steps = outcomes.iter().map(|e| e.steps).sum();
        let unconverged_steps = outcomes.iter().map(|e| e.unconverged_steps).sum();
        let blown_up = outcomes.iter().filter(|e| e.blown_up).count();
        let unconverged_equilibria = outcomes.iter().filter(|e| !e.started_at_rest).count();
        let lost_share = unconverged_equilibria as f64 / self.episodes as f64;
        let unconverged_share = unconverged_steps as f64 / steps as f64;
        outcomes.sort_by_key(|e| std::cmp::Reverse((e.blown_up, !e.started_at_rest, e.unconverged_steps)));
        outcomes.truncate(WORST);
        Ok(StressReport {
            fidelity: self.fidelity.name(),
            episodes: self.episodes,
            steps,
            unconverged_steps,
            unconverged_share,
            unconverged_equilibria,
            blown_up,
            worst: outcomes,
            passes: blown_up == 0 && lost_share < UNCONVERGED_SHARE && unconverged_share < UNCONVERGED_SHARE,
        })
    }

    fn episode(&self, index: usize) -> Result<StressedEpisode, VerificationError> {
        let episode_seed = seed::derive(self.seed, index as u64);
        let mut rng = seed::rng(episode_seed, 0);
        let mut model = self.model.clone();
        model.object.axial_law = if rng.random::<bool>() { AxialLaw::Linear } else { AxialLaw::NeoHookean };
        let theta = self.theta(&mut rng);
        let mut pushed = self.pushed(index, &mut rng);
        pushed.extend(self.companions(&pushed, index));
        if pushed.iter().any(|(name, _)| name == STRANDS_EFFECT) {
            // Strands have one law: that of the effect, or that of the parameters.
            pushed.retain(|(name, _)| STRANDS.iter().all(|(own, _)| own != name));
        } else {
            for (name, none) in STRANDS {
                model.parameters.entry(name.into()).or_insert(none);
            }
        }
        let duration_s = model.task.map_or(0.0, |t| t.steps as f64 * t.step_period_s);

        let mut simulation = EpisodeSimulation::new(&model, self.registry, self.fidelity)?;
        simulation.prepare(&Conditions {
            theta: &theta,
            effects: &pushed,
            seed: episode_seed,
            noise: false,
            target_m: None,
        })?;
        let (path, _) = random_motion(&model, &simulation.episode_model().arm, episode_seed)
            .ok_or_else(|| VerificationError::NoTask(model.name.clone()))?;
        simulation.hang(path.at(0.0));
        let mut blown_up = false;
        for k in 0..=(duration_s / CHECK_PERIOD_S).round() as usize {
            let time_s = k as f64 * CHECK_PERIOD_S;
            simulation.advance(time_s, |t| path.at(t));
            // Negated, so that a NaN counts as blown up.
            blown_up |= !simulation.keypoints(time_s).as_flattened().iter().all(|v| v.abs() < FAR_SCALED);
            blown_up |= !simulation.beam().nodes().iter().flatten().all(|v| v.abs() < FAR_M);
        }
        let counters = simulation.beam().counters();
        Ok(StressedEpisode {
            index,
            theta,
            pushed,
            axial_law: model.object.axial_law,
            steps: counters.steps,
            unconverged_steps: counters.unconverged_steps,
            started_at_rest: counters.unconverged_equilibria == 0,
            blown_up,
        })
    }

    /// Companions of the pushed effects, at each combination of the ends of their priors in turn.
    fn companions(&self, pushed: &[(String, f64)], index: usize) -> Vec<(String, f64)> {
        let effects = pushed.iter().filter_map(|(name, _)| self.registry.find(name));
        let of = |(place, name): (usize, &&str)| {
            let (low, high) = self.registry.find(name)?.about().prior.bounds();
            Some(((*name).to_owned(), if (index >> place).is_multiple_of(2) { low } else { high }))
        };
        effects.flat_map(|effect| effect.companions().iter().enumerate().filter_map(of)).collect()
    }

    fn theta(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let coordinate = |_| {
            let (edge, u) = (rng.random::<f64>() < EDGE_CHANCE, rng.random::<f64>());
            if edge { u.round() } else { u }
        };
        let u: Vec<f64> = (0..self.model.theta.dimension()).map(coordinate).collect();
        self.model.theta.from_unit(&u)
    }

    fn pushed(&self, index: usize, rng: &mut ChaCha8Rng) -> Vec<(String, f64)> {
        let either = |e: &Extreme, high: bool| (e.name.clone(), if high { e.high } else { e.low });
        match index % 3 {
            1 if !self.extremes.is_empty() => {
                let turn = index / 3;
                vec![either(&self.extremes[(turn / 2) % self.extremes.len()], turn.is_multiple_of(2))]
            }
            2 => {
                let draws = self.extremes.iter().map(|e| (e, rng.random::<bool>(), rng.random::<bool>()));
                draws.filter(|d| d.1).map(|(e, _, high)| either(e, high)).collect()
            }
            _ => Vec::new(),
        }
    }
}
