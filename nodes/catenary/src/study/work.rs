//! Work of a study: recordings and posteriors of the hidden objects, trainings and scores.
//!
//! Each piece runs on one core and depends on the plan alone, so that the results do not depend on where it runs.

use super::files;
use super::plan::{Chain, Knowledge, Models, Object, Plan};
use crate::evaluate::episodes::{as_measured, episodes, without_early_success};
use crate::exit::{Given, Interrupted};
use crate::graph::own::Cell;
use crate::inputs::policy_file;
use crate::inputs::posterior_file::PosteriorFile;
use crate::plan;
use anyhow::{Context, Result, bail, ensure};
use bayes_sim::InferenceError;
use catenary_core::episode::MeasuredTrack;
use catenary_core::posterior::Marginal;
use catenary_core::simulator::Drive;
use catenary_core::task::Score;
use catenary_core::{
    Fidelity, Frame, Judge, Model, Policy, Posterior, SimulationRequest, Simulator, Task, Track, seed,
};
use catenary_shell::Shutdown;
use catenary_simulator::verification::path_of_actions;
use catenary_simulator::{BeamSimulator, VectorEnv};
use ppo_trainer::{Domains, Settings, Trained};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::Path;

/// Random streams of a study.
pub mod stream {
    pub const RECORDER: u64 = 1;
    pub const RECORDINGS: u64 = 2;
    pub const INFERENCE: u64 = 3;
    pub const TRAININGS: u64 = 4;
    pub const SCORES: u64 = 5;
    pub const DEPLOYMENTS: u64 = 6;
    pub const PLANS: u64 = 7;
}

/// Most environment steps of the training of the recorder.
const RECORDER_STEPS: u64 = 49_152;

/// Posterior of an object.
#[derive(Debug, Serialize, Deserialize)]
pub struct Inferred {
    /// Posterior, as `catenary infer` writes it.
    pub posterior: PosteriorFile,
    /// Marginals in the parameters' units.
    pub marginals: Vec<Marginal>,
    /// Simulations of the inference.
    pub simulations: usize,
    /// Reason for which the posterior does not fit the recordings, if it does not.
    pub misfit: Option<String>,
}

impl Inferred {
    /// Returns an error unless posterior and marginals are of the parameters of the study's model.
    fn check(&self, model: &Model) -> Result<()> {
        ensure!(
            self.posterior.parameters.equals_up_to_bounds(&model.theta),
            "`posterior`: its parameters are not those of model `{}`",
            model.name
        );
        let names = self.marginals.iter().map(|m| m.name.as_str());
        ensure!(
            names.eq(model.theta.parameters().iter().map(|p| p.name.as_str())),
            "`marginals`: expected one of each parameter, in their order"
        );
        for m in &self.marginals {
            let is_range = m.sd >= 0.0 && m.q05 <= m.median && m.median <= m.q95;
            ensure!(is_range, "`marginals`: {}: expected a sd from 0, and q05 <= median <= q95", m.name);
        }
        Ok(())
    }

    /// The posterior.
    pub fn posterior(&self) -> Posterior {
        Posterior { parameters: self.posterior.parameters.clone(), mixture: self.posterior.mixture.clone() }
    }
}

/// Learning curve: environment steps, mean return and share of successes.
pub type Curve = Vec<(u64, f64, f64)>;

/// Greatest return and success distance (m) of a file: far beyond any, since a step earns at most 1 and loses at most 1.
const GREATEST_RETURN: f64 = 1e6;

/// Returns an error unless the numbers of a curve are those of returns and shares.
fn check_curve(curve: &Curve) -> Result<()> {
    let is_point = |(_, mean, share): &(u64, f64, f64)| mean.abs() <= GREATEST_RETURN && (0.0..=1.0).contains(share);
    match curve.iter().find(|point| !is_point(point)) {
        Some((steps, mean, share)) => bail!(
            "`curve`: expected returns within {GREATEST_RETURN} and shares of 0 to 1, got {mean} and {share} after {steps} steps"
        ),
        None => Ok(()),
    }
}

impl Scored {
    /// Returns an error unless the scores are those of each object and episode of the plan.
    fn check(&self, plan: &Plan) -> Result<()> {
        let (objects, episodes) = (plan.objects.len(), plan.episodes as usize);
        ensure!(self.objects.len() == objects, "`objects`: expected {objects}, got {}", self.objects.len());
        check_curve(&self.curve)?;
        self.objects.iter().try_for_each(|scores| scores.check(episodes))
    }
}

impl ObjectScores {
    /// Checks the numbers of a file.
    fn check(&self, episodes: usize) -> Result<()> {
        let Self { returns, successes, distances_m } = self;
        let counts = [returns.len(), successes.len(), distances_m.len()];
        ensure!(
            counts == [episodes; 3],
            "`objects`: expected returns, successes and distances_m of {episodes} episodes, got {counts:?}"
        );
        let wrong_return = returns.iter().find(|v| v.abs() > GREATEST_RETURN);
        if let Some(got) = wrong_return.or_else(|| distances_m.iter().find(|v| !(0.0..=GREATEST_RETURN).contains(*v))) {
            bail!("`objects`: expected returns within {GREATEST_RETURN} and distances from 0, got {got:e}");
        }
        Ok(())
    }
}

/// Scores of a training on each object, and how it was trained.
#[derive(Debug, Serialize, Deserialize)]
pub struct Scored {
    /// Learning curve.
    pub curve: Curve,
    /// Scores on each object.
    pub objects: Vec<ObjectScores>,
}

/// Scores of episodes on one object, in their order. The same number stands for the same conditions for all policies.
#[derive(Debug, Serialize, Deserialize)]
pub struct ObjectScores {
    /// Sum of the rewards.
    pub returns: Vec<f64>,
    /// True for a success.
    pub successes: Vec<bool>,
    /// Distance that the task minimises, m.
    pub distances_m: Vec<f64>,
}

/// Worker on a study.
pub struct Work<'a> {
    /// Plan of the study.
    pub plan: &'a Plan,
    /// Models of the plan.
    pub models: &'a Models,
    /// Folder of the study.
    pub folder: &'a Path,
    /// Robot cell of the deployments; none: a simulation in this process.
    pub cell: Option<Cell>,
    /// Ends the work early.
    pub shutdown: &'a Shutdown,
}

impl Work<'_> {
    /// Policy that records the objects, trained over the prior of the model's own task. It sees the newest observation alone: the recordings are
    /// those of every study with this seed. Made if it is missing.
    pub fn recorder(&self) -> Result<Policy> {
        let path = self.folder.join(self.plan.recorder_file());
        if !path.exists() {
            let domains = Domains::Prior(self.models.model.theta.clone());
            let seed = seed::derive(self.plan.seed, stream::RECORDER);
            let settings =
                Settings { total_steps: RECORDER_STEPS, searches_plan: false, ..Settings::tuned().newest_only() };
            let trained = self.train_with(&self.models.model, &domains, &settings, seed)?;
            files::write(&path, &trained.policy.to_bytes())?;
        }
        read_policy(&path)
    }

    /// Posterior of an object from recordings of it; `evidence` is the index of their number and of the simulations. Made if it is missing.
    pub fn posterior(&self, object: usize, evidence: usize) -> Result<Inferred> {
        let check = |inferred: &Inferred| inferred.check(&self.models.model);
        files::kept(&self.folder.join(self.plan.posterior_file(object, evidence)), check, || {
            let measured = self.recordings(object, self.plan.evidence[evidence].recordings)?;
            self.infer(&measured, object, evidence).with_context(|| self.plan.objects[object].name.clone())
        })
    }

    /// Scores of a chain. Made if they are missing, with the training.
    pub fn scores(&self, chain: &Chain) -> Result<Scored> {
        let check = |scored: &Scored| scored.check(self.plan);
        files::kept(&self.folder.join(self.plan.scores_file(chain)), check, || {
            let (policy, curve) = self.training(chain)?;
            let score = |(i, object): (usize, &Object)| {
                let number = chain.training * self.plan.objects.len() as u64 + i as u64;
                let seed = self.seed(stream::SCORES, number);
                self.object_scores(&self.models.tasks[chain.task], &policy, object, seed)
            };
            let objects = self.plan.objects.iter().enumerate().map(score).collect::<Result<Vec<_>>>()?;
            Ok(Scored { curve, objects })
        })
    }

    /// Seed of item `number` of a stream of the study.
    pub fn seed(&self, stream: u64, number: u64) -> u64 {
        seed::derive(seed::derive(self.plan.seed, stream), number)
    }

    /// Policy of a chain with its learning curve. Made if it is missing.
    pub fn training(&self, chain: &Chain) -> Result<(Policy, Curve)> {
        let path = self.folder.join(self.plan.training_file(chain));
        let curve = path.with_extension("curve.json");
        if !path.exists() || !curve.exists() {
            let model = &self.models.tasks[chain.task];
            let seed = self.seed(stream::TRAININGS, chain.training);
            let trained = self.train(model, &self.domains(chain.knowledge)?, seed)?;
            let points: Curve = trained.curve.iter().map(|p| (p.steps, p.mean_return, p.success_rate)).collect();
            files::write_json(&curve, &points)?;
            // Last, because it tells that the training is done.
            files::write(&path, &trained.policy.to_bytes())?;
        }
        Ok((read_policy(&path)?, files::read_json(&curve, check_curve)?))
    }

    /// Parameters of the environments of a training.
    pub fn domains(&self, knowledge: Knowledge) -> Result<Domains> {
        let theta = &self.models.model.theta;
        Ok(match knowledge {
            Knowledge::Prior => Domains::Prior(theta.clone()),
            Knowledge::Median => Domains::Point(theta.from_unit(&vec![0.5; theta.dimension()])),
            Knowledge::Posterior { object, evidence } => {
                Domains::Mixture(self.posterior(object, evidence)?.posterior())
            }
            Knowledge::Truth(object) => Domains::Point(self.plan.objects[object].truth.clone()),
        })
    }

    /// Trains a policy as the plan of the study says.
    fn train(&self, model: &Model, domains: &Domains, of: u64) -> Result<Trained> {
        let mut settings = Settings {
            total_steps: self.plan.steps,
            observes: self.plan.observes,
            ..Settings::preset(&self.plan.preset)?
        };
        if settings.searches_plan && self.plan.searches_plans {
            settings.begin_with(&self.best_plan(model, domains, of)?)?;
        }
        self.train_with(model, domains, &settings, of)
    }

    fn train_with(&self, model: &Model, domains: &Domains, settings: &Settings, of: u64) -> Result<Trained> {
        let task = model.task.context("the model has a task")?;
        let rows = domains.rows(settings.environments, of)?;
        let mut env = VectorEnv::open(model, settings.environments, rows, Fidelity::Fast, seed::derive(of, 1), 1)?;
        let mut trained = ppo_trainer::train(&mut env, &task, settings, of, &mut |_| self.goes_on())?;
        self.check()?;
        trained.policy.arm = Some(model.arm.law);
        Ok(trained)
    }

    /// Best plan that a search finds for the objects of `domains`.
    fn best_plan(&self, model: &Model, domains: &Domains, of: u64) -> Result<Policy> {
        let rows = |n, draws| Ok(domains.rows(n, draws)?);
        let found = plan::best(model, &rows, of, 1, &mut |_| self.goes_on())?;
        self.check()?;
        found.context("a search that nothing ended")
    }

    fn goes_on(&self) -> ControlFlow<()> {
        if self.shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Scores on an object of the best plan that a search finds for it, in the episodes of the first training. Made if they are missing.
    pub fn plan_scores(&self, task: usize, object: usize) -> Result<ObjectScores> {
        let (model, of_object) = (&self.models.tasks[task], &self.plan.objects[object]);
        let check = |scores: &ObjectScores| scores.check(self.plan.episodes as usize);
        files::kept(&self.folder.join(self.plan.plan_scores_file(task, object)), check, || {
            let number = object as u64;
            let domains = Domains::Point(of_object.truth.clone());
            let plan = self.best_plan(model, &domains, self.seed(stream::PLANS, number))?;
            self.object_scores(model, &plan, of_object, self.seed(stream::SCORES, number))
        })
    }

    /// Scores of a policy on an object.
    fn object_scores(&self, model: &Model, policy: &Policy, object: &Object, of: u64) -> Result<ObjectScores> {
        let thetas = vec![object.truth.clone(); self.plan.episodes as usize];
        let scores = self.episodes(model, policy, episodes(thetas, Fidelity::Reference, of))?;
        Ok(ObjectScores {
            returns: scores.iter().map(|(_, s)| s.rewards.iter().sum()).collect(),
            successes: scores.iter().map(|(_, s)| s.succeeded).collect(),
            distances_m: scores.iter().map(|(_, s)| s.distance_m).collect(),
        })
    }

    /// The first `count` recordings of an object in the simulated laboratory: the recorder's motions at the highest fidelity, with the
    /// camera's noise. The path of the hand is exact.
    fn recordings(&self, index: usize, count: u64) -> Result<Vec<MeasuredTrack>> {
        let (recorder, object) = (self.recorder()?, &self.plan.objects[index]);
        let model = &self.models.model;
        let (simulator, task) = (BeamSimulator::new(model, 1)?, model.task.context("the model has a task")?);
        let record = |number: u64| {
            let seed = self.seed(stream::RECORDINGS, 1000 * index as u64 + number);
            let asked = episodes(vec![object.truth.clone()], Fidelity::Reference, seed);
            let asked_of_policy =
                SimulationRequest { drive: Drive::Policy(Box::new(recorder.clone())), ..asked.clone() };
            let track = simulator.simulate(&asked_of_policy)?.remove(0);
            let actions: Vec<[f64; 2]> = acted(&task, &track).iter().map(|f| f.action).collect();
            let path = path_of_actions(model, &actions).context("the recorder made no action")?;
            // Repetition of the same episode, with the frames of a recording along the path of the hand.
            let o = model.observation;
            let steps = actions.len() + task.rest_after(actions.len());
            let last_s = steps as f64 * task.step_period_s + 1e-9;
            let times = (0..o.frames).map(|i| i as f64 * o.frame_period_s).filter(|t| *t <= last_s).collect();
            let seen = SimulationRequest { drive: Drive::Grip(path.clone()), frame_times_s: times, ..asked };
            let track = simulator.simulate(&seen)?.remove(0);
            Ok(as_measured(format!("recording {} of {}", number + 1, object.name), track, path, model))
        };
        (0..count).map(record).collect()
    }

    fn infer(&self, measured: &[MeasuredTrack], object: usize, evidence: usize) -> Result<Inferred> {
        let seed = self.seed(stream::INFERENCE, (self.plan.objects.len() * evidence + object) as u64);
        let settings = bayes_sim::Settings { seed, ..self.plan.evidence[evidence].settings() };
        let simulator = BeamSimulator::new(&self.models.model, 1)?;
        let mut listen = |_: &bayes_sim::sequential::Progress<'_>| {
            if self.shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let result =
            match bayes_sim::infer(&self.models.model, measured, None, &settings, None, &simulator, &mut listen) {
                Err(InferenceError::Cancelled { .. }) => return Err(interrupted()),
                other => other?,
            };
        Ok(Inferred {
            posterior: PosteriorFile::new(&result.posterior, result.support_moves()),
            simulations: result.simulations(),
            marginals: result.marginals,
            misfit: result.misfit,
        })
    }

    /// Episodes of a policy as asked, with their scores. Success ends none of them.
    pub fn episodes(&self, model: &Model, policy: &Policy, asked: SimulationRequest) -> Result<Vec<(Track, Score)>> {
        self.check()?;
        let judge = Judge::of(model).context("a task file has a task")?;
        let simulator = BeamSimulator::new(&without_early_success(model), 1)?;
        let asked = SimulationRequest { drive: Drive::Policy(Box::new(policy.clone())), ..asked };
        let scored = |track: Track| {
            let score = judge.score(&track);
            (track, score)
        };
        Ok(simulator.simulate(&asked)?.into_iter().map(scored).collect())
    }

    /// Returns an error once the user asked for the end.
    pub fn check(&self) -> Result<()> {
        if self.shutdown.is_triggered() { Err(interrupted()) } else { Ok(()) }
    }
}

/// Frames of a track that an action follows.
pub fn acted<'a>(task: &Task, track: &'a Track) -> &'a [Frame] {
    &track.frames[..track.frames.len().saturating_sub(1).min(task.steps)]
}

fn interrupted() -> anyhow::Error {
    Interrupted::kept("a part of the study", "each finished training, posterior and deployment in --out", "").into()
}

fn read_policy(path: &Path) -> Result<Policy> {
    let again = || format!("{}: remove it, and it is made again", path.display());
    policy_file::read(path).map(|(policy, _)| policy).with_context(again).given()
}
