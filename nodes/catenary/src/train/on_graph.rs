//! Work of `train --node`, done by the training node of a running graph.

use super::args::TrainArgs;
use super::report::{Ended, Report};
use crate::graph::request::{Answer, Request};
use crate::terminal::progress;
use anyhow::{Context, Result, ensure};
use catenary_core::Policy;
use catenary_msgs::action::{Train, TrainFeedback, TrainGoal};
use catenary_msgs::msg::Mixture;
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::convert;
use indicatif::ProgressBar;
use ppo_trainer::{Domains, convert as convert_training};

/// Lets the training node train a policy. Ctrl-C cancels the training.
pub fn run(
    arguments: &TrainArgs,
    domains: &Domains,
    model_yaml: String,
    plan: Option<&Policy>,
    namespace: &str,
) -> Result<Report> {
    let (kind, mixture, point) = match domains {
        Domains::Prior(_) => (TrainGoal::DOMAINS_PRIOR, Mixture::default(), Vec::new()),
        Domains::Mixture(posterior) => (TrainGoal::DOMAINS_MIXTURE, convert::posterior_to_msg(posterior), Vec::new()),
        Domains::Point(theta) => (TrainGoal::DOMAINS_POINT, Mixture::default(), theta.clone()),
    };
    let goal = TrainGoal {
        model_yaml,
        domains: kind,
        mixture,
        point,
        preset: arguments.preset.name().to_owned(),
        total_steps: arguments.steps.unwrap_or(0),
        history: arguments.observes.history.unwrap_or(0),
        newest_only: arguments.observes.newest_only,
        plan: plan.map_or_else(Vec::new, Policy::to_bytes),
        fidelity: SimulateRequest::FIDELITY_FAST,
        seed: arguments.seed,
        ..TrainGoal::default()
    };
    let bar = progress::bar("training", 0.0)?;
    let request = Request { who: "train", action: "ppo_trainer/train", namespace, wait_s: arguments.on_graph.wait_s };
    let Answer { name, result, .. } =
        request.send::<Train>(goal, &bar, |bar, feedback| show_training(bar, &feedback))?;
    ensure!(result.success, "{name}: {}", result.message);
    let policy = Policy::from_bytes(&result.policy).with_context(|| name.clone())?;
    // The node knows the effects of the model, and not that the starts were meant to move. Else the bytes stay those of its answer.
    let bytes = match arguments.start.start_moving {
        Some(speed) => Policy { start_speed_m_s: Some(speed), ..policy }.to_bytes(),
        None => result.policy.clone(),
    };
    catenary_shell::files::write(&arguments.out, bytes)?;
    let curve = convert_training::curve(&result).with_context(|| name.clone())?;
    let last = convert_training::last_episodes(&result).with_context(|| name.clone())?;
    // The node's answer does not say why the training ended.
    let ended = Ended { steps: curve.last().map_or(0, |p| p.steps), interrupted: false, flat_at: None };
    Ok(Report::new(arguments.out.clone(), &ended, curve, &last, result.steps_per_second))
}

/// Shows the feedback of a training on a bar.
pub fn show_training(bar: &ProgressBar, feedback: &TrainFeedback) {
    bar.set_length(progress::STEPS);
    progress::advance(bar, progress::share(feedback.steps as f64, feedback.total_steps as f64));
    bar.set_message(format!("return {:.2}, success {:.0} %", feedback.mean_return, 100.0 * feedback.success_rate));
}
