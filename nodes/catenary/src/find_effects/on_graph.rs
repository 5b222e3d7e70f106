//! Work of `find-effects --node`, done by the effect finder of a running graph.

use super::args::FindEffectsArgs;
use super::motion;
use super::optional;
use crate::exit::Misfit;
use crate::graph::request::{Answer, Request, absolute};
use crate::terminal::{output, progress};
use anyhow::{Result, ensure};
use catenary_msgs::action::{FindEffects, FindEffectsGoal};
use catenary_shell::files;
use effect_finder::report::MISFIT;
use serde::Serialize;
use std::path::PathBuf;

/// Result of `find-effects --node` in the form of `--json`.
#[derive(Debug, Serialize)]
struct Found {
    bags: Vec<PathBuf>,
    wall_s: f64,
    verdict: String,
    conclusions: Vec<String>,
    /// Named effects. Effects that cannot be told apart share one entry, joined by `|`.
    found: Vec<String>,
    /// Candidates and their probabilities, the most probable first.
    effects: Vec<(String, f64)>,
    /// False if the best model does not fit the recording; `misfit` has the reason.
    fits: bool,
    misfit: Option<String>,
}

/// Lets the effect finder of a graph search the bags. The paths must be valid on its machine. Ctrl-C cancels the search.
pub fn run(arguments: &FindEffectsArgs, model_yaml: String, namespace: &str) -> Result<()> {
    let goal = FindEffectsGoal {
        bags: arguments.bags.all().iter().map(absolute).collect::<Result<_>>()?,
        verify: arguments.verify.iter().map(absolute).collect::<Result<_>>()?,
        model_yaml,
        seed: arguments.seed,
    };
    let path = arguments.out.join("model.yaml");
    output::prepare(&path)?;
    let bar = progress::bar("search", 0.0)?;
    let request =
        Request { who: "find_effects", action: "effect_finder/find", namespace, wait_s: arguments.on_graph.wait_s };
    let Answer { name, result, wall_s } = request.send::<FindEffects>(goal, &bar, |bar, feedback| {
        progress::advance(bar, feedback.progress);
        bar.set_message(feedback.stage);
    })?;
    ensure!(result.success, "{name}: {}", result.message);
    files::write(&path, &result.model_yaml)?;
    // The answer of a graph holds one model.
    optional::write(&arguments.out.join(optional::NEAREST), None)?;
    // The message holds (dx, dz) of all steps as one list.
    let (actions, _) = result.separating_actions.as_chunks();
    motion::write(&arguments.out, actions)?;
    let conclusions: Vec<String> = result.message.lines().map(str::to_owned).collect();
    // The first line of the result's message is the misfit, if there is one.
    let first = conclusions.first().and_then(|c| c.strip_prefix(MISFIT)?.strip_prefix(": "));
    let misfit = first.map(str::to_owned);
    let found = Found {
        bags: arguments.bags.all().to_vec(),
        wall_s,
        verdict: result.verdict,
        conclusions,
        found: result.found,
        effects: result.effects.into_iter().zip(result.probabilities).collect(),
        fits: misfit.is_none(),
        misfit,
    };
    output::result(&arguments.output, &found, |f| {
        let mut lines: Vec<String> = f.misfit.iter().map(|reason| Misfit::headline(reason)).collect();
        lines.extend(f.conclusions.iter().filter(|c| !c.starts_with(MISFIT)).cloned());
        lines.push(f.verdict.clone());
        lines.push(format!("{:.1} s", f.wall_s));
        lines.push(format!("model: {}", path.display()));
        lines.join("\n")
    })?;
    Misfit::check(found.misfit.as_ref(), &arguments.out)
}
