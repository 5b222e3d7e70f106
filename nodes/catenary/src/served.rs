//! `catenary infer --node`, `train --node` and `find-effects --node`: the same work, done by the nodes of a running graph.

use crate::cli::{FindEffectsArgs, InferArgs, TrainArgs};
use crate::find_effects::write_motion;
use crate::goal::{self, follow};
use crate::infer::{iteration_words, marginal_words, page};
use crate::misfit::Misfit;
use crate::train::{Report, read_posterior};
use crate::wrong_input::Given;
use crate::{model_file, output, policy_file, progress};
use anyhow::{Context, Result, anyhow, ensure};
use catenary_core::posterior::Marginal;
use catenary_core::{Model, Policy, Posterior};
use catenary_msgs::action::{
    FindEffects, FindEffectsGoal, Infer, InferFeedback, InferGoal, Train, TrainFeedback, TrainGoal,
};
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::{Act, ActionClient, NodeBuilder, RosArgs, Shutdown, convert, files};
use effect_finder::verdict::MISFIT;
use indicatif::ProgressBar;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// What `infer --node --json` prints.
#[derive(Debug, Serialize)]
struct Inferred {
    bags: Vec<PathBuf>,
    model: String,
    wall_s: f64,
    marginals: Vec<Marginal>,
    posterior: Posterior,
    mass_outside: f64,
    effective_sample_size: f64,
    warnings: Vec<String>,
    losses: Vec<f64>,
    simulations: u32,
    /// Whether the posterior fits the recording; false: `misfit` says why not.
    fits: bool,
    misfit: Option<String>,
}

/// Has the inference node infer from a bag, which must lie where it sees it; Ctrl-C cancels that.
pub fn infer(arguments: &InferArgs, model: &Model, namespace: &str) -> Result<()> {
    let policy = match &arguments.policy {
        Some(path) => policy_file::read(path)?.1,
        None => Vec::new(),
    };
    let size = |n: Option<usize>, option: &str| {
        let size = u32::try_from(n.unwrap_or(0));
        size.with_context(|| format!("--{option}: expected a number that fits 32 bits")).given()
    };
    let goal = InferGoal {
        source: InferGoal::SOURCE_BAG,
        bags: arguments.bags.all().iter().map(absolute).collect::<Result<_>>()?,
        episodes: arguments.episode.clone(),
        model_yaml: model_text(&arguments.model)?,
        preset: arguments.preset.name().to_owned(),
        iterations: size(arguments.iterations, "iterations")?,
        simulations: size(arguments.simulations, "simulations")?,
        drive: convert::drive_to_msg(model.observation.drive),
        policy,
        seed: arguments.seed,
    };
    let (path, report) = (arguments.out.join("posterior.json"), arguments.out.join("report.html"));
    output::prepare(&path)?;
    output::prepare(&report)?;
    let bar = progress::bar("inference", 0.0)?;
    let asking = Asking { who: "infer", what: "bayes_sim/infer", namespace, wait_s: arguments.served.wait_s };
    let Answer { name, result, wall_s } = asking.ask::<Infer>(goal, &bar, |bar, feedback| {
        show_inference(bar, &feedback);
    })?;
    ensure!(result.success, "{name}: {}", result.message);
    let posterior = convert::posterior_from_msg(&result.posterior)?;
    std::fs::write(&path, serde_json::to_string_pretty(&posterior)?).with_context(|| path.display().to_string())?;
    let inferred = Inferred {
        bags: arguments.bags.all().to_vec(),
        model: model.name.clone(),
        wall_s,
        marginals: posterior.marginals()?,
        posterior,
        mass_outside: result.mass_outside,
        effective_sample_size: result.effective_sample_size,
        warnings: result.warnings,
        losses: result.losses,
        simulations: result.simulations,
        fits: result.message.is_empty(),
        // With success, the message is why the posterior fits nothing.
        misfit: (!result.message.is_empty()).then_some(result.message),
    };
    let page = page::page(&page::Inferred {
        model: &inferred.model,
        bags: &inferred.bags,
        size: String::new(),
        posterior: &inferred.posterior,
        marginals: &inferred.marginals,
        predictive: None,
        misfit: inferred.misfit.as_deref(),
        warnings: &inferred.warnings,
        losses: inferred.losses.clone(),
        simulations: inferred.simulations as usize,
    })?;
    std::fs::write(&report, page).with_context(|| report.display().to_string())?;
    output::result(&arguments.output, &inferred, |i| {
        let mut lines: Vec<String> = i.misfit.iter().map(|reason| Misfit::headline(reason)).collect();
        lines.extend(marginal_words(&i.marginals));
        lines.extend(i.warnings.iter().map(|w| format!("warning: {w}")));
        lines.push(format!("{} simulations in {:.1} s", i.simulations, i.wall_s));
        lines.push(format!("posterior: {}", path.display()));
        lines.join("\n")
    })?;
    Misfit::check(inferred.misfit.as_ref(), &arguments.out)
}

/// Has the training node train a policy; Ctrl-C cancels that.
pub fn train(arguments: &TrainArgs, model: &Model, namespace: &str) -> Result<()> {
    let mixture = arguments.posterior.as_ref().map(|path| read_posterior(path, model)).transpose()?;
    let goal = TrainGoal {
        model_yaml: model_text(&arguments.model)?,
        domains: if mixture.is_some() { TrainGoal::DOMAINS_MIXTURE } else { TrainGoal::DOMAINS_PRIOR },
        mixture: mixture.as_ref().map(convert::posterior_to_msg).unwrap_or_default(),
        preset: arguments.preset.name().to_owned(),
        total_steps: arguments.steps.unwrap_or(0),
        fidelity: SimulateRequest::FIDELITY_FAST,
        seed: arguments.seed,
        ..TrainGoal::default()
    };
    output::prepare_file("out", &arguments.out)?;
    let bar = progress::bar("training", 0.0)?;
    let success_rate = Arc::new(Mutex::new(0.0));
    let told = Arc::clone(&success_rate);
    let asking = Asking { who: "train", what: "ppo_trainer/train", namespace, wait_s: arguments.served.wait_s };
    let Answer { name, result, .. } = asking.ask::<Train>(goal, &bar, move |bar, feedback| {
        show_training(bar, &feedback);
        *told.lock().unwrap_or_else(PoisonError::into_inner) = feedback.success_rate;
    })?;
    ensure!(result.success, "{name}: {}", result.message);
    Policy::from_bytes(&result.policy).with_context(|| name.clone())?;
    std::fs::write(&arguments.out, result.policy).with_context(|| arguments.out.display().to_string())?;
    let report = Report {
        policy: arguments.out.clone(),
        steps: result.curve_steps.last().copied().unwrap_or(0),
        interrupted: false,
        mean_return: result.curve_returns.last().copied().unwrap_or(f64::NAN),
        success_rate: *success_rate.lock().unwrap_or_else(PoisonError::into_inner),
        steps_per_second: result.steps_per_second,
        curve: result.curve_steps.iter().copied().zip(result.curve_returns.iter().copied()).collect(),
    };
    output::result(&arguments.output, &report, Report::words)
}

/// What `find-effects --node --json` prints.
#[derive(Debug, Serialize)]
struct Found {
    bags: Vec<PathBuf>,
    wall_s: f64,
    verdict: String,
    conclusions: Vec<String>,
    /// The effect that is named, or those that cannot be told apart.
    found: Vec<String>,
    /// Candidates and their probabilities, the most probable first.
    effects: Vec<(String, f64)>,
    /// Whether the best model fits the recording; false: `misfit` says why not.
    fits: bool,
    misfit: Option<String>,
}

/// Where a bag lies, for a node that runs in another folder.
fn absolute(bag: &PathBuf) -> Result<String> {
    let path = std::fs::canonicalize(bag).map_err(|e| anyhow!("bag {}: {e}{}", bag.display(), files::hint(bag)));
    Ok(path.given()?.display().to_string())
}

/// Has the effect finder search in bags, which must lie where it sees them; Ctrl-C cancels that.
pub fn find_effects(arguments: &FindEffectsArgs, namespace: &str) -> Result<()> {
    let goal = FindEffectsGoal {
        bags: arguments.bags.all().iter().map(absolute).collect::<Result<_>>()?,
        verify: arguments.verify.iter().map(absolute).collect::<Result<_>>()?,
        model_yaml: model_text(&arguments.model)?,
        seed: arguments.seed,
    };
    let path = arguments.out.join("model.yaml");
    output::prepare(&path)?;
    let bar = progress::bar("search", 0.0)?;
    let asking = Asking { who: "find_effects", what: "effect_finder/find", namespace, wait_s: arguments.served.wait_s };
    let Answer { name, result, wall_s } = asking.ask::<FindEffects>(goal, &bar, |bar, feedback| {
        progress::advance(bar, feedback.progress);
        bar.set_message(feedback.stage);
    })?;
    ensure!(result.success, "{name}: {}", result.message);
    std::fs::write(&path, &result.model_yaml).with_context(|| path.display().to_string())?;
    let (actions, _) = result.separating_actions.as_chunks();
    write_motion(&arguments.out, actions)?;
    let conclusions: Vec<String> = result.message.lines().map(str::to_owned).collect();
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

/// What is asked of the nodes of a namespace.
struct Asking<'a> {
    /// Name of the node that asks.
    who: &'a str,
    /// Name of the action.
    what: &'a str,
    namespace: &'a str,
    /// s to wait for a server.
    wait_s: f64,
}

/// What came of it.
struct Answer<R> {
    /// The action's name with its namespace.
    name: String,
    result: R,
    wall_s: f64,
}

impl Asking<'_> {
    /// Sends a goal and follows it to its end, with `show` moving the bar; Ctrl-C cancels the goal.
    fn ask<A: Act>(
        &self,
        goal: A::Goal,
        bar: &ProgressBar,
        mut show: impl FnMut(&ProgressBar, A::Feedback) + Send + 'static,
    ) -> Result<Answer<A::Result>> {
        let wait = goal::wait(self.wait_s)?;
        let interrupted = Shutdown::new();
        catenary_shell::end_on_signals(&interrupted)?;
        let namespace = format!("__ns:={}", self.namespace);
        let (arguments, _) = RosArgs::parse(["--ros-args".to_owned(), "-r".to_owned(), namespace])?;
        let node = NodeBuilder::new(self.who, &arguments)?.build()?;
        let client: ActionClient<A> = node.action_client(self.what)?;
        let (started, shown) = (Instant::now(), bar.clone());
        let result = follow(&client, goal, wait, &interrupted, move |feedback| show(&shown, feedback))?;
        bar.finish_and_clear();
        Ok(Answer { name: client.name().to_owned(), result, wall_s: started.elapsed().as_secs_f64() })
    }
}

/// Shows on a bar how far a training is.
pub fn show_training(bar: &ProgressBar, feedback: &TrainFeedback) {
    bar.set_length(progress::STEPS);
    progress::advance(bar, progress::share(feedback.steps as f64, feedback.total_steps as f64));
    bar.set_message(format!("return {:.2}, success {:.0} %", feedback.mean_return, 100.0 * feedback.success_rate));
}

/// Shows on a bar how far an inference is.
pub fn show_inference(bar: &ProgressBar, feedback: &InferFeedback) {
    bar.set_length(progress::STEPS);
    progress::advance(bar, progress::share(feedback.iteration, feedback.iterations));
    bar.set_message(iteration_words(feedback.simulations, feedback.loss, feedback.effective_sample_size));
}

fn model_text(path: &Path) -> Result<String> {
    Ok(model_file::read_with_text(path)?.1)
}
