//! Conversion between ROS messages and the trainer's types.

use crate::curve::CurvePoint;
use crate::domains::Domains;
use crate::settings::Settings;
use crate::trainer::{Progress, Trained};
use catenary_core::{EnvError, Model, Observation, Policy, Task, Transition};
use catenary_msgs::action::{TrainFeedback, TrainGoal, TrainResult};
use catenary_msgs::srv::StepEnvsResponse;
use catenary_shell::convert::{ConvertError, posterior_from_msg};

/// Settings of a goal: its preset with what the goal says of observations and plan, and its numbers that are not zero.
///
/// # Errors
/// [`ConvertError`] with the name of an unknown preset.
pub fn settings(goal: &TrainGoal, task: &Task) -> Result<Settings, ConvertError> {
    let mut settings = Settings::preset(&goal.preset).map_err(|e| ConvertError {
        field: "preset",
        expected: e.expected.to_owned(),
        got: e.got,
    })?;
    if goal.total_steps > 0 {
        settings.total_steps = goal.total_steps;
    }
    if goal.environments > 0 {
        settings.environments = goal.environments as usize;
    }
    if goal.newest_only {
        settings = settings.newest_only();
    }
    if goal.history > 0 {
        settings.observes.history = goal.history as usize;
    }
    // The node has no simulator of its own: the plan comes with the goal.
    settings.searches_plan = false;
    if !goal.plan.is_empty() {
        let wrong = |got: String| ConvertError { field: "plan", expected: "the policy of a plan".to_owned(), got };
        let policy = Policy::from_bytes(&goal.plan).map_err(|e| wrong(e.to_string()))?;
        let is_of_task = policy.steps == task.steps
            && policy.delta_anchor == task.delta_anchor
            && (policy.step_period_s - task.step_period_s).abs() < 1e-9
            && policy.goal.is_none_or(|goal| goal.name() == task.goal.name());
        if !is_of_task {
            let Policy { steps, step_period_s, .. } = policy;
            let goal = policy.goal.map_or("any goal", |goal| goal.name());
            return Err(ConvertError {
                field: "plan",
                expected: format!(
                    "a plan for {} in {} steps of {} s",
                    task.goal.name(),
                    task.steps,
                    task.step_period_s
                ),
                got: format!("one for {goal} in {steps} steps of {step_period_s} s, or of another anchor"),
            });
        }
        settings.begin_with(&policy).map_err(|e| wrong(e.got))?;
    }
    Ok(settings)
}

/// Distribution over the model's parameters from which a goal draws the environments' domains.
///
/// # Errors
/// [`ConvertError`] for an unknown kind, a mixture over other parameters, or a point of the wrong length.
pub fn domains(goal: &TrainGoal, model: &Model) -> Result<Domains, ConvertError> {
    let d = model.theta.dimension();
    match goal.domains {
        TrainGoal::DOMAINS_PRIOR => Ok(Domains::Prior(model.theta.clone())),
        TrainGoal::DOMAINS_MIXTURE => {
            let posterior = posterior_from_msg(&goal.mixture)?;
            let names = |space: &catenary_core::ParameterSpace| -> Vec<String> {
                space.parameters().iter().map(|p| p.name.clone()).collect()
            };
            if names(&posterior.parameters) != names(&model.theta) {
                return Err(ConvertError {
                    field: "mixture.parameters",
                    expected: names(&model.theta).join(", "),
                    got: names(&posterior.parameters).join(", "),
                });
            }
            Ok(Domains::Mixture(posterior))
        }
        TrainGoal::DOMAINS_POINT if goal.point.len() == d => Ok(Domains::Point(goal.point.clone())),
        TrainGoal::DOMAINS_POINT => {
            Err(ConvertError { field: "point", expected: format!("{d} values"), got: goal.point.len().to_string() })
        }
        other => {
            Err(ConvertError { field: "domains", expected: "one of DOMAINS_*".to_owned(), got: other.to_string() })
        }
    }
}

/// Observations from `count` rows of 12 numbers.
///
/// # Errors
/// [`EnvError::Backend`] if the number of rows is not `count`.
pub fn observations(flat: &[f64], count: usize) -> Result<Vec<Observation>, EnvError> {
    if flat.len() != count * Observation::LEN {
        let (rows, width) = (count, Observation::LEN);
        return Err(EnvError::Backend(format!("expected {rows} observations of {width}, got {} numbers", flat.len())));
    }
    Ok(flat.chunks_exact(Observation::LEN).map(|row| Observation(std::array::from_fn(|i| row[i]))).collect())
}

/// Transitions of `count` environments from the answer to a step.
///
/// # Errors
/// [`EnvError::Backend`] if the service failed or answered for another number of environments.
pub fn transitions(r: &StepEnvsResponse, count: usize) -> Result<Vec<Transition>, EnvError> {
    if !r.success {
        return Err(EnvError::Backend(r.message.clone()));
    }
    // The lists of an answer may differ in length: each one is checked before it is indexed.
    let lengths @ [rewards, terminated, truncated] = [r.rewards.len(), r.terminated.len(), r.truncated.len()];
    if lengths != [count; 3] {
        let got = format!("{rewards} rewards, {terminated} terminated and {truncated} truncated");
        return Err(EnvError::Backend(format!("expected {count} rewards and ends, got {got}")));
    }
    let next = observations(&r.observations, count)?;
    let last = observations(&r.final_observations, count)?;
    let transition = |i: usize| Transition {
        observation: next[i],
        reward: r.rewards[i],
        terminated: r.terminated[i],
        truncated: r.truncated[i],
        final_observation: last[i],
    };
    Ok((0..count).map(transition).collect())
}

/// Feedback message with the progress of a training.
#[must_use]
pub fn feedback(p: &Progress) -> TrainFeedback {
    TrainFeedback {
        steps: p.now.steps,
        total_steps: p.total_steps,
        // Before the first episode ends the mean is NaN, which a client cannot plot.
        mean_return: if p.now.mean_return.is_finite() { p.now.mean_return } else { 0.0 },
        success_rate: p.now.success_rate,
    }
}

/// Learning curve of a result.
///
/// # Errors
/// [`ConvertError`] if its lists differ in length.
pub fn curve(r: &TrainResult) -> Result<Vec<CurvePoint>, ConvertError> {
    let n = r.curve_steps.len();
    let lists = [
        ("curve_returns", &r.curve_returns),
        ("curve_successes", &r.curve_successes),
        ("curve_entropies", &r.curve_entropies),
        ("curve_value_losses", &r.curve_value_losses),
    ];
    match lists.iter().find(|(_, list)| list.len() != n) {
        Some((field, list)) => Err(unequal(field, n, list.len())),
        None => Ok((0..n)
            .map(|i| {
                let [mean_return, success_rate, entropy, value_loss] = lists.map(|(_, list)| list[i]);
                CurvePoint { steps: r.curve_steps[i], mean_return, success_rate, entropy, value_loss }
            })
            .collect()),
    }
}

/// Returns of the last episodes of a result, and true for each that succeeded.
///
/// # Errors
/// [`ConvertError`] if its lists differ in length.
pub fn last_episodes(r: &TrainResult) -> Result<Vec<(f64, bool)>, ConvertError> {
    if r.last_returns.len() != r.last_successes.len() {
        return Err(unequal("last_successes", r.last_returns.len(), r.last_successes.len()));
    }
    Ok(r.last_returns.iter().copied().zip(r.last_successes.iter().copied()).collect())
}

fn unequal(field: &'static str, expected: usize, got: usize) -> ConvertError {
    ConvertError { field, expected: format!("{expected} values"), got: got.to_string() }
}

/// Result message of a training that took `seconds`; `domains` are the parameters of the environments.
#[must_use]
pub fn result(trained: &Trained, domains: &[Vec<f64>], seconds: f64) -> TrainResult {
    let curve = |value: fn(&CurvePoint) -> f64| trained.curve.iter().map(value).collect();
    TrainResult {
        success: true,
        message: String::new(),
        policy: trained.policy.to_bytes(),
        curve_steps: trained.curve.iter().map(|p| p.steps).collect(),
        curve_returns: curve(|p| p.mean_return),
        curve_successes: curve(|p| p.success_rate),
        curve_entropies: curve(|p| p.entropy),
        curve_value_losses: curve(|p| p.value_loss),
        last_returns: trained.recent.iter().map(|(r, _)| *r).collect(),
        last_successes: trained.recent.iter().map(|(_, success)| *success).collect(),
        domains: domains.concat(),
        steps_per_second: trained.steps as f64 / seconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Judge;
    use catenary_core::policy::Plan;

    #[test]
    fn a_plan_of_another_task_is_refused_before_a_training() {
        let text = include_str!("../../../../launch_configs/models/soft_bar_place.yaml");
        let model = Model::from_yaml(text).unwrap();
        let task = model.task.unwrap();
        let plan = Plan { steps: vec![[[0.1, 0.0, 0.0]; 2]; task.steps] };
        let planned = crate::plan_search::Planned { plan, distance_m: 0.01, simulated: 1 };
        let policy = planned.policy(&Judge::of(&model).unwrap());
        let goal = TrainGoal { plan: policy.to_bytes(), ..TrainGoal::default() };
        assert!(settings(&goal, &task).unwrap().plan.is_some());
        for other in [
            Task { steps: 16, ..task },
            Task { step_period_s: 0.5, ..task },
            Task { goal: catenary_core::Goal::Whip { reward_range_m: 0.4 }, ..task },
        ] {
            let words = settings(&goal, &other).unwrap_err().to_string();
            assert!(words.contains("one for place_tip in 6 steps of 0.25 s"), "{words}");
        }
    }

    #[test]
    fn lists_of_a_result_that_differ_in_length_are_refused_by_name() {
        let lists = || vec![0.5, 1.0];
        let good = TrainResult {
            curve_steps: vec![16, 32],
            curve_returns: lists(),
            curve_successes: lists(),
            curve_entropies: lists(),
            curve_value_losses: lists(),
            last_returns: lists(),
            last_successes: vec![false, true],
            ..TrainResult::default()
        };
        assert_eq!(curve(&good).unwrap()[1].entropy, 1.0);
        assert_eq!(last_episodes(&good).unwrap(), [(0.5, false), (1.0, true)]);
        let short = TrainResult { curve_entropies: vec![1.0], last_successes: Vec::new(), ..good };
        let words = curve(&short).unwrap_err().to_string();
        assert!(words.contains("curve_entropies") && words.contains("2 values") && words.contains('1'), "{words}");
        assert!(last_episodes(&short).unwrap_err().to_string().contains("last_successes"));
    }
}
