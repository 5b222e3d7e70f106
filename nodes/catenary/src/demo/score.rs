//! Evaluation of the demo's policies on the hidden object, after inference and training.

use super::setup::{Demo, stream};
use super::stage::Stages;
use super::summary::Evaluation;
use crate::evaluate::episodes::episodes;
use crate::evaluate::score::score;
use crate::exit::Interrupted;
use crate::plan;
use anyhow::Result;
use catenary_core::{Fidelity, Policy, seed};
use catenary_simulator::workers;
use std::ops::ControlFlow;
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
        // As much for the search as for each policy.
        stages.run_or_keep("evaluate both on the hidden object", &inputs, (4 * EPISODES) as u64, |stages, bar| {
            let plan = self.plan(stages, &|n, _| Ok(vec![self.truth.clone(); n]), score_seed, &mut |share| {
                bar.set_position((share * EPISODES as f64) as u64);
            })?;
            let named = named.into_iter().chain([(PathBuf::from(plan::NAME), plan)]).collect();
            let mut policies = score(&self.model, &self.judge, named, &requested, &mut |_, done| {
                let done = EPISODES + done;
                bar.set_position(done as u64);
                match stages.graph.node.is_shutdown() {
                    true => Err(Interrupted(String::new()).into()),
                    false => stages.graph.check(),
                }
            })?;
            let best_plan = policies.pop();
            Ok(Evaluation { episodes: EPISODES, fidelity: FIDELITY, seed: score_seed, policies, best_plan })
        })
    }

    /// Best plan for the objects of `rows`. `on_progress` gets the share of the search that is done.
    pub(super) fn plan(
        &self,
        stages: &mut Stages<'_>,
        rows: plan::Rows<'_>,
        search_seed: u64,
        on_progress: &mut dyn FnMut(f64),
    ) -> Result<Policy> {
        let found = plan::best(&self.model, rows, search_seed, workers::available(), &mut |share| {
            on_progress(share);
            let goes_on = !stages.graph.node.is_shutdown() && stages.graph.check().is_ok();
            if goes_on { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })?;
        // What ended it: a process of the graph, or Ctrl-C.
        stages.graph.check()?;
        found.ok_or_else(|| Interrupted(String::new()).into())
    }
}
