//! Evaluation of the demo's policies on the hidden object, after inference and training.

use super::setup::{Demo, stream};
use super::stage::Stages;
use super::summary::Evaluation;
use crate::evaluate::episodes::episodes;
use crate::evaluate::score::score;
use crate::exit::Interrupted;
use anyhow::Result;
use catenary_core::{Fidelity, Policy, seed};
use std::path::PathBuf;

/// Episodes of each policy: a 95 % interval of the success rate of at most 20 points.
const EPISODES: usize = 100;
/// Fidelity of the episodes, equal to that of the cell.
const FIDELITY: Fidelity = Fidelity::Reference;

impl Demo {
    /// Evaluates both policies on one set of simulated episodes of the hidden object. No training or inference sees the
    /// result.
    pub(super) fn score(&self, stages: &mut Stages<'_>, policies: [(&str, &Policy); 2]) -> Result<Evaluation> {
        let score_seed = seed::derive(self.seed, stream::SCORE);
        let requested = episodes(vec![self.truth.clone(); EPISODES], FIDELITY, score_seed);
        let inputs = (score_seed, &self.truth, policies.map(|(_, policy)| policy.to_bytes()));
        let named = policies.map(|(name, p)| (PathBuf::from(format!("{name}.safetensors")), p.clone()));
        stages.run_or_keep("evaluate both on the hidden object", &inputs, (2 * EPISODES) as u64, |stages, bar| {
            let policies = score(&self.model, &self.judge, named.to_vec(), &requested, &mut |_, done| {
                bar.set_position(done as u64);
                match stages.graph.node.is_shutdown() {
                    true => Err(Interrupted(String::new()).into()),
                    false => stages.graph.check(),
                }
            })?;
            Ok(Evaluation { episodes: EPISODES, fidelity: FIDELITY, seed: score_seed, policies })
        })
    }
}
