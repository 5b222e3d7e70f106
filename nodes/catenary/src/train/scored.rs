//! Scores of a trained policy and of the best plan.

use super::report::Scored;
use crate::evaluate::score::score;
use crate::exit::Interrupted;
use crate::inputs::policy_file;
use crate::plan;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use catenary_core::{Judge, Model, Policy};
use catenary_shell::Shutdown;
use ppo_trainer::Domains;
use std::path::{Path, PathBuf};

/// Scores the policy of the file `out` and a plan with its name on the same episodes, with a progress bar. None after Ctrl-C: the policy is written already.
pub fn scored(
    model: &Model,
    domains: &Domains,
    out: &Path,
    plan: (PathBuf, Policy),
    seed: u64,
    shutdown: &Shutdown,
) -> Result<Option<Scored>> {
    let judge = Judge::of(model).context("a training has a task")?;
    let requested = plan::unseen(domains, seed)?;
    let policies = vec![(out.to_owned(), policy_file::read(out)?.0), plan];
    let all = policies.len() * requested.thetas.len();
    let bar = progress::bar("unseen episodes", 0.0)?;
    let both = score(model, &judge, policies, &requested, &mut |_, done| {
        progress::advance(&bar, progress::share(done as f64, all as f64));
        if shutdown.is_triggered() { Err(Interrupted(String::new()).into()) } else { Ok(()) }
    });
    bar.finish_and_clear();
    match both {
        Err(error) if Interrupted::is(&error) => {
            output::tell("the training has ended; Ctrl-C left its scores out");
            Ok(None)
        }
        both => {
            let [policy, best_plan]: [_; 2] = both?.try_into().ok().context("two policies have two scores")?;
            Ok(Some(Scored { fidelity: requested.fidelity.name(), policy, best_plan }))
        }
    }
}
