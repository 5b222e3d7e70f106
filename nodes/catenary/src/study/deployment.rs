//! Deployments of a study: the first training of each policy on each object, and in its own simulation.

use super::files;
use super::plan::{Chain, Place, Plan};
use super::work::{Work, stream};
use crate::evaluate::episodes::episodes;
use anyhow::{Result, bail, ensure};
use catenary_core::{Fidelity, Track};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// One deployment.
#[derive(Debug, Serialize, Deserialize)]
pub struct Deployment {
    /// Frames, one step apart.
    pub track: Track,
    /// Reward of each step.
    pub rewards: Vec<f64>,
}

/// Greatest number of a frame and of a reward in a file: coordinates are metres and shares of the image.
const GREATEST: f64 = 1e6;

impl Deployment {
    /// Returns an error unless there is a reward for each step, and the numbers are those of a cell.
    pub fn check(&self) -> Result<()> {
        let (steps, frames) = (self.rewards.len(), self.track.frames.len());
        ensure!(steps > 0 && frames == steps + 1, "expected a frame more than rewards, got {frames} and {steps}");
        let numbers = self.track.frames.iter().flat_map(|f| {
            let keypoints = f.dlo.iter().flatten();
            keypoints.chain(&f.target).chain(&f.eef).chain(&f.action).chain(std::iter::once(&f.time_s))
        });
        match numbers.chain(&self.rewards).find(|v| v.abs() > GREATEST) {
            Some(got) => bail!("`track`, `rewards`: expected numbers within {GREATEST}, got {got:e}"),
            None => Ok(()),
        }
    }
}

/// Deployments of a policy at one place.
#[derive(Debug, Default)]
pub struct Deployments {
    /// Frames of each episode, one step apart.
    pub tracks: Vec<Track>,
    /// Rewards of each episode.
    pub rewards: Vec<Vec<f64>>,
}

impl FromIterator<Deployment> for Deployments {
    fn from_iter<T: IntoIterator<Item = Deployment>>(deployments: T) -> Self {
        let (tracks, rewards) = deployments.into_iter().map(|d| (d.track, d.rewards)).unzip();
        Self { tracks, rewards }
    }
}

/// One deployment of the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Planned {
    /// First training of the policy.
    pub chain: Chain,
    /// Place.
    pub place: Place,
    /// Number of the deployment, from 0.
    pub number: u64,
}

/// Deployments of a plan, by task, policy, place and number.
pub fn planned(plan: &Plan) -> Vec<Planned> {
    let mut all = Vec::new();
    for task in 0..plan.tasks.len() {
        for knowledge in plan.deployed() {
            let chain = Chain { task, knowledge, training: 0 };
            for place in plan.places() {
                all.extend((0..plan.repeats).map(|number| Planned { chain, place, number }));
            }
        }
    }
    all
}

/// Deployments in the order of [`planned`], by task, policy and place.
pub fn in_groups(plan: &Plan, made: Vec<Deployment>) -> Vec<Vec<Vec<Deployments>>> {
    let mut made = made.into_iter();
    let mut at_place = || made.by_ref().take(plan.repeats as usize).collect::<Deployments>();
    let (policies, places) = (plan.deployed().len(), plan.places().len());
    let mut of_policy = || (0..places).map(|_| at_place()).collect();
    let mut of_task = || (0..policies).map(|_| of_policy()).collect();
    (0..plan.tasks.len()).map(|_| of_task()).collect()
}

impl Work<'_> {
    /// File of a deployment. Those in a robot cell have a folder of their own.
    pub fn deployment_file(&self, planned: &Planned) -> PathBuf {
        let Planned { chain, place, number } = planned;
        let folder = match (place, self.cell) {
            (Place::Object(_), Some(cell)) => format!("deployments_{}", cell.name()),
            _ => "deployments".to_owned(),
        };
        self.folder.join(self.plan.deployment_file(&folder, chain, *place, *number))
    }

    /// A deployment in this process. Made if it is missing.
    pub fn simulated(&self, planned: &Planned) -> Result<Deployment> {
        files::kept(&self.deployment_file(planned), Deployment::check, || {
            let Planned { chain, place, number } = planned;
            let (policy, _) = self.training(chain)?;
            // Every policy meets the same conditions: deployments on an object are compared in pairs.
            let (theta, fidelity, of) = match *place {
                Place::Object(object) => (self.plan.objects[object].truth.clone(), Fidelity::Reference, object),
                Place::OwnSimulation => {
                    let rows = self.domains(chain.knowledge)?.rows(self.plan.repeats as usize, self.plan.seed)?;
                    (rows[*number as usize].clone(), Fidelity::Fast, self.plan.objects.len())
                }
            };
            let seed = self.seed(stream::DEPLOYMENTS, of as u64);
            let asked = episodes(vec![theta], fidelity, seed);
            let asked = catenary_core::SimulationRequest { first_episode: *number, ..asked };
            let (track, score) = self.episodes(&self.models.tasks[chain.task], &policy, asked)?.remove(0);
            Ok(Deployment { track, rewards: score.rewards })
        })
    }
}
