//! `catenary infer --node`, `train --node` and `find-effects --node`: the same work, done by the nodes of a running graph.

use crate::cli::{FindEffectsArgs, InferArgs, Preset, TrainArgs};
use crate::find_effects::write_motion;
use crate::goal::{self, follow};
use crate::infer::{iteration_words, marginal_words};
use crate::misfit::Misfit;
use crate::train::{Report, read_posterior};
use crate::{output, policy_file};
use anyhow::{Context, Result, ensure};
use catenary_core::posterior::Marginal;
use catenary_core::{Model, Policy, Posterior};
use catenary_msgs::action::{FindEffects, FindEffectsGoal, Infer, InferGoal, Train, TrainFeedback, TrainGoal};
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::{Act, ActionClient, NodeBuilder, RosArgs, Shutdown, convert};
use effect_finder::verdict::MISFIT;
use indicatif::{ProgressBar, ProgressStyle};
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
        u32::try_from(n.unwrap_or(0)).with_context(|| format!("--{option}: expected a number that fits 32 bits"))
    };
    let goal = InferGoal {
        source: InferGoal::SOURCE_BAG,
        bags: arguments.bag.iter().map(absolute).collect::<Result<_>>()?,
        episodes: arguments.episode.clone(),
        model_yaml: text(&arguments.model)?,
        preset: if arguments.preset == Preset::Paper { "paper" } else { "default" }.to_owned(),
        iterations: size(arguments.iterations, "iterations")?,
        simulations: size(arguments.simulations, "simulations")?,
        drive: convert::drive_to_msg(model.observation.drive),
        policy,
        seed: arguments.seed,
    };
    let path = arguments.out.join("posterior.json");
    output::prepare(&path)?;
    let bar = bar("inference", "{pos}/{len}")?;
    let asking = Asking { who: "infer", what: "bayes_sim/infer", namespace, wait_s: arguments.served.wait_s };
    let Answer { name, result, wall_s } = asking.ask::<Infer>(goal, &bar, |bar, feedback| {
        bar.set_length(u64::from(feedback.iterations));
        bar.set_position(u64::from(feedback.iteration));
        bar.set_message(iteration_words(feedback.simulations, feedback.loss, feedback.effective_sample_size));
    })?;
    ensure!(result.success, "{name}: {}", result.message);
    let posterior = convert::posterior_from_msg(&result.posterior)?;
    std::fs::write(&path, serde_json::to_string_pretty(&posterior)?).with_context(|| path.display().to_string())?;
    let inferred = Inferred {
        bags: arguments.bag.clone(),
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
    output::result(&arguments.output, &inferred, |i| {
        let mut lines: Vec<String> = i.misfit.iter().map(|reason| Misfit::headline(reason)).collect();
        lines.extend(marginal_words(&i.marginals));
        lines.extend(i.warnings.iter().map(|w| format!("warning: {w}")));
        lines.push(format!("{} simulations in {:.1} s", i.simulations, i.wall_s));
        lines.join("\n")
    })?;
    Misfit::check(inferred.misfit.as_ref(), &arguments.out)
}

/// Has the training node train a policy; Ctrl-C cancels that.
pub fn train(arguments: &TrainArgs, model: &Model, namespace: &str) -> Result<()> {
    let mixture = arguments.posterior.as_ref().map(|path| read_posterior(path, model)).transpose()?;
    let goal = TrainGoal {
        model_yaml: text(&arguments.model)?,
        domains: if mixture.is_some() { TrainGoal::DOMAINS_MIXTURE } else { TrainGoal::DOMAINS_PRIOR },
        mixture: mixture.as_ref().map(convert::posterior_to_msg).unwrap_or_default(),
        preset: arguments.preset.clone(),
        total_steps: arguments.steps.unwrap_or(0),
        fidelity: SimulateRequest::FIDELITY_FAST,
        seed: arguments.seed,
        ..TrainGoal::default()
    };
    output::prepare(&arguments.out)?;
    let bar = bar("training", "{percent:>3}%")?;
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
    Ok(std::fs::canonicalize(bag).with_context(|| format!("bag {}", bag.display()))?.display().to_string())
}

/// Has the effect finder search in bags, which must lie where it sees them; Ctrl-C cancels that.
pub fn find_effects(arguments: &FindEffectsArgs, namespace: &str) -> Result<()> {
    let goal = FindEffectsGoal {
        bags: arguments.bag.iter().map(absolute).collect::<Result<_>>()?,
        verify: arguments.verify.iter().map(absolute).collect::<Result<_>>()?,
        model_yaml: text(&arguments.model)?,
        seed: arguments.seed,
    };
    let path = arguments.out.join("model.yaml");
    output::prepare(&path)?;
    let bar = bar("search", "{percent:>3}%")?;
    bar.set_length(1000);
    let asking = Asking { who: "find_effects", what: "effect_finder/find", namespace, wait_s: arguments.served.wait_s };
    let Answer { name, result, wall_s } = asking.ask::<FindEffects>(goal, &bar, |bar, feedback| {
        bar.set_position((1000.0 * feedback.progress) as u64);
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
        bags: arguments.bag.clone(),
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
    bar.set_length(feedback.total_steps.max(1));
    bar.set_position(feedback.steps);
    bar.set_message(format!("return {:.2}, success {:.0} %", feedback.mean_return, 100.0 * feedback.success_rate));
}

fn bar(what: &str, count: &str) -> Result<ProgressBar> {
    let bar = ProgressBar::new(1);
    let style = ProgressStyle::with_template(&format!("{what} [{{bar:30}}] {count} {{msg}}"))?;
    bar.set_style(style.progress_chars("=> "));
    Ok(bar)
}

fn text(file: &Path) -> Result<String> {
    std::fs::read_to_string(file).with_context(|| file.display().to_string())
}
