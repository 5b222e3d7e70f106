//! Result of a training, in the form in which `evaluate` reports, too.

use crate::evaluate::beside_the_plan;
use crate::evaluate::score::Evaluated;
use crate::options::SimulatedArm;
use crate::plan::NAME;
use crate::report::Estimate;
use ppo_trainer::{CurvePoint, Rise, Trained};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Result of a training.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Path of the policy file.
    pub policy: PathBuf,
    /// Law of the simulated arm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arm: Option<SimulatedArm>,
    /// Environment steps taken.
    pub steps: u64,
    /// True if Ctrl-C ended the training early.
    pub interrupted: bool,
    /// Environment steps after which the mean return had stopped rising; none if it rose to the end, or was not looked at.
    pub flat_at: Option<u64>,
    /// Path of the state from which `--resume` goes on; none if nothing is left of the steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state: Option<PathBuf>,
    /// Mean return of the last episodes of the training, of up to 100; none before two have ended.
    pub mean_return: Option<Estimate>,
    /// Share of successes among these episodes.
    pub success_rate: Option<Estimate>,
    /// Rise of the mean return.
    pub rise: Rise,
    /// Environment steps per second.
    pub steps_per_second: f64,
    /// Policy and best plan in episodes that neither has seen; none without a plan, and after Ctrl-C.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scored: Option<Scored>,
    /// Learning curve.
    pub curve: Vec<CurvePoint>,
}

/// Policy and best plan in the same episodes.
#[derive(Debug, Serialize)]
pub struct Scored {
    /// Fidelity of the episodes.
    pub fidelity: &'static str,
    /// Trained policy.
    pub policy: Evaluated,
    /// Best plan that a search found, or that of `--plan`: what can be reached without feedback.
    pub best_plan: Evaluated,
}

impl Scored {
    /// Scores in words.
    fn words(&self) -> String {
        let Self { fidelity, policy, best_plan } = self;
        let verdict = beside_the_plan(std::slice::from_ref(policy), best_plan);
        let success = |e: &Evaluated| e.success_rate.words(100.0, 0);
        format!(
            "success {} % in {} unseen episodes at {fidelity} fidelity; {}: {} %\n{verdict}",
            success(policy),
            policy.returns.len(),
            if best_plan.policy == Path::new(NAME) {
                format!("the {NAME}")
            } else {
                best_plan.policy.display().to_string()
            },
            success(best_plan)
        )
    }
}

/// How a training ended.
#[derive(Debug, Clone, Copy)]
pub struct Ended {
    /// Environment steps taken.
    pub steps: u64,
    /// True if Ctrl-C ended it.
    pub interrupted: bool,
    /// Steps after which the mean return was flat, if it was.
    pub flat_at: Option<u64>,
}

impl Ended {
    /// End of a training in this process.
    pub fn of(trained: &Trained) -> Self {
        Self { steps: trained.steps, interrupted: !trained.is_finished, flat_at: trained.flat_at }
    }
}

impl Report {
    /// Report of a training with its curve and its last episodes: return, and true for a success.
    pub fn new(
        policy: PathBuf,
        ended: &Ended,
        curve: Vec<CurvePoint>,
        last: &[(f64, bool)],
        steps_per_second: f64,
    ) -> Self {
        let returns: Vec<f64> = last.iter().map(|(r, _)| *r).collect();
        let successes = last.iter().filter(|(_, success)| *success).count();
        let is_enough = last.len() >= 2;
        Self {
            policy,
            arm: None,
            steps: ended.steps,
            interrupted: ended.interrupted,
            flat_at: ended.flat_at,
            mean_return: is_enough.then(|| Estimate::mean(&returns)),
            success_rate: is_enough.then(|| Estimate::share(successes, last.len())),
            rise: Rise::of(&curve),
            steps_per_second,
            scored: None,
            state: None,
            curve,
        }
    }

    /// Report in words.
    pub fn words(&self) -> String {
        let arm = self.arm.and_then(|arm| arm.words()).map_or_else(String::new, |line| format!("\n{line}"));
        format!("{}{arm}", self.outcome())
    }

    fn outcome(&self) -> String {
        let policy = self.policy.display();
        let (Some(mean_return), Some(success)) = (&self.mean_return, &self.success_rate) else {
            return format!("{policy}: {} steps, too few for two episodes", self.steps);
        };
        let rise = match self.rise {
            _ if self.flat_at.is_some() => {
                let on = self.state.as_ref().map_or("", |_| "; the same command with --resume trains on");
                format!("the return had stopped rising by step {}{on}", self.flat_at.unwrap_or_default())
            }
            Rise::By(at) => format!("95 % of the return's rise were made by step {at}"),
            Rise::ToTheEnd => "the return rose to the end: more steps may help".to_owned(),
            Rise::None => "the return never rose".to_owned(),
        };
        let ends = self.curve.first().zip(self.curve.last());
        let falls = ends.map_or_else(String::new, |(first, last)| {
            format!(
                ", entropy {:.2} to {:.2} nat, value loss {:.2e} to {:.2e}",
                first.entropy, last.entropy, first.value_loss, last.value_loss
            )
        });
        let training = format!(
            "{policy}: return {}, success {} % in the last episodes of the training\n{} steps, {:.0} steps/s{falls}; {rise}",
            mean_return.words(1.0, 2),
            success.words(100.0, 0),
            self.steps,
            self.steps_per_second
        );
        // First: what a reader wants to know.
        self.scored.as_ref().map_or(training.clone(), |scored| format!("{}\n{training}", scored.words()))
    }
}
