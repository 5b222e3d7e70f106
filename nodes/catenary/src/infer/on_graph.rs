//! Work of `infer --node`, done by the inference node of a running graph.

use super::args::InferArgs;
use super::page::{Contents, page};
use super::words::{iteration_words, marginal_words};
use crate::exit::{Given, Misfit, WrongInput};
use crate::graph::request::{Answer, Request, absolute};
use crate::inputs::policy_file;
use crate::inputs::posterior_file::PosteriorFile;
use crate::report::RecordedFit;
use crate::terminal::{output, progress};
use anyhow::{Context, Result, ensure};
use bayes_sim::sequential::SupportMove;
use catenary_bag::read_measured;
use catenary_core::posterior::Marginal;
use catenary_core::{Model, Posterior};
use catenary_msgs::action::{Infer, InferFeedback, InferGoal};
use catenary_shell::convert;
use indicatif::ProgressBar;
use serde::Serialize;
use std::path::PathBuf;

/// Sentence on the posterior predictive check. The action's result has its objections, and no field for its figures.
const UNKNOWN_CHECK: &str = "The inference node made the posterior predictive check. Its objections, if any, stand above. Its \
                             figures are not part of the answer: `catenary infer` without --node shows them.";

/// Result of `infer --node` in the form of `--json`.
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
    support_moves: Vec<SupportMove>,
    losses: Vec<f64>,
    simulations: u32,
    /// False if the posterior does not fit the recording; `misfit` has the reason.
    fits: bool,
    misfit: Option<String>,
}

/// Lets the inference node infer from bags, whose paths must be valid there. Ctrl-C cancels the inference.
pub fn run(arguments: &InferArgs, model: &Model, model_yaml: String, namespace: &str) -> Result<()> {
    if !arguments.predict.is_empty() {
        // The account of the refinement says which noise a prediction has.
        let why = "the answer of an inference node lacks the noise that the fit left, without which no prediction has its width";
        return Err(WrongInput::error(format!("--predict: expected an inference in this process, got --node: {why}")));
    }
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
        model_yaml,
        preset: arguments.sizes.preset.name().to_owned(),
        iterations: size(arguments.sizes.iterations, "iterations")?,
        simulations: size(arguments.sizes.simulations, "simulations")?,
        drive: convert::drive_to_msg(model.observation.drive),
        policy,
        seed: arguments.seed,
        prior_support: arguments.prior_support.map_or_else(String::new, |support| support.name().to_owned()),
    };
    let (path, report) = (arguments.out.join("posterior.json"), arguments.out.join("report.html"));
    output::prepare(&path)?;
    output::prepare(&report)?;
    let bar = progress::bar("inference", 0.0)?;
    let request = Request { who: "infer", action: "bayes_sim/infer", namespace, wait_s: arguments.on_graph.wait_s };
    let Answer { name, result, wall_s } = request.send::<Infer>(goal, &bar, |bar, feedback| {
        show_inference(bar, &feedback);
    })?;
    ensure!(result.success, "{name}: {}", result.message);
    let posterior = convert::posterior_from_msg(&result.posterior)?;
    let support_moves = bayes_sim::convert::support_moves(&result);
    let text = PosteriorFile::new(&posterior, support_moves.clone()).text()?;
    catenary_shell::files::write(&path, text)?;
    let inferred = Inferred {
        bags: arguments.bags.all().to_vec(),
        model: model.name.clone(),
        wall_s,
        marginals: posterior.marginals()?,
        posterior,
        mass_outside: result.mass_outside,
        effective_sample_size: result.effective_sample_size,
        warnings: result.warnings,
        support_moves,
        losses: result.losses,
        simulations: result.simulations,
        fits: result.message.is_empty(),
        // In a successful result, the message gives the reason why the posterior does not fit.
        misfit: (!result.message.is_empty()).then_some(result.message),
    };
    // The bags may lie on the node's computer alone; without them the page has no picture of the fit.
    let measured = read_measured(arguments.bags.all(), &arguments.episode, model).unwrap_or_default();
    let fits = RecordedFit::at_medians(model, &measured, None, &inferred.marginals);
    let page = page(&Contents {
        model: &inferred.model,
        bags: &inferred.bags,
        size: String::new(),
        posterior: &inferred.posterior,
        marginals: &inferred.marginals,
        predictive: Err(UNKNOWN_CHECK),
        misfit: inferred.misfit.as_deref(),
        warnings: &inferred.warnings,
        losses: inferred.losses.clone(),
        simulations: inferred.simulations as usize,
        refinement: None,
        fits: &fits,
        predicted: &[],
    })?;
    catenary_shell::files::write(&report, page)?;
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

/// Shows the feedback of an inference on a bar.
pub fn show_inference(bar: &ProgressBar, feedback: &InferFeedback) {
    bar.set_length(progress::STEPS);
    progress::advance(bar, progress::share(feedback.iteration, feedback.iterations));
    bar.set_message(iteration_words(feedback.simulations, feedback.loss, feedback.effective_sample_size));
}
