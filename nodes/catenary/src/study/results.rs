//! Figures of a study: what knowing the object is worth, by task and object.

use super::deployment::Deployments;
use super::evidence::Evidence;
use super::plan::{Chain, Knowledge, Plan};
use super::work::{Inferred, ObjectScores, Scored};
use crate::graph::own::Cell;
use anyhow::Result;
use catenary_core::comparison::{Bootstrap, Decision, Interval, SequentialSigns, sign_change_test};
use catenary_core::posterior::Marginal;
use catenary_core::statistics::mean;
use serde::Serialize;

/// Error probability of the sequential test of deployments.
const ERROR: f64 = 0.05;
/// Number of thresholds of a performance profile, evenly from 0 to the largest score.
const THRESHOLDS: usize = 41;

/// Results of a study.
#[derive(Debug, Serialize)]
pub struct Study {
    /// Plan of the study.
    pub plan: Plan,
    /// Robot cell of the deployments; none: a simulation.
    pub cell: Option<Cell>,
    /// Posteriors of the objects.
    pub objects: Vec<ObjectPosterior>,
    /// Results of each task.
    pub tasks: Vec<TaskResult>,
}

/// Posteriors of an object in numbers.
#[derive(Debug, Serialize)]
pub struct ObjectPosterior {
    /// Name of the object.
    pub object: String,
    /// Hidden values.
    pub truth: Vec<f64>,
    /// Posterior from each evidence of the plan.
    pub posteriors: Vec<EvidencePosterior>,
}

/// Posterior from one evidence.
#[derive(Debug, Serialize)]
pub struct EvidencePosterior {
    /// Marginals of the posterior.
    pub marginals: Vec<Marginal>,
    /// Kullback-Leibler divergence of the posterior from the prior, nat.
    pub information_nat: f64,
    /// Reason for which the posterior does not fit, if it does not.
    pub misfit: Option<String>,
}

/// Results of a task.
#[derive(Debug, Serialize)]
pub struct TaskResult {
    /// Name of the task.
    pub task: String,
    /// Aim of the task in words.
    pub aim: String,
    /// Mean return of each policy: by object, by training.
    pub policies: Vec<PolicyScores>,
    /// Gains of the policy of an object's posterior, on that object.
    pub objects: Vec<ObjectGains>,
    /// Gains over all objects.
    pub all: Vec<Gain>,
    /// Worth of each evidence of the plan.
    pub evidence: Vec<EvidenceGains>,
    /// Gain of the oracle policies over U, over all objects.
    pub told: Option<Gain>,
    /// Best plan that a search finds for each object; empty without a search.
    pub best_plans: Vec<BestPlan>,
    /// Share of the mean returns above each threshold, by group.
    pub profiles: Vec<Profile>,
    /// Deployments of matched policies against U.
    pub deployments: Vec<Pairs>,
}

/// Scores of the best plan that a search finds for an object: what can be reached without feedback.
#[derive(Debug, Serialize)]
pub struct BestPlan {
    /// Mean return over the episodes.
    pub mean_return: f64,
    /// Share of successes.
    pub success: f64,
}

impl BestPlan {
    fn of(scores: &ObjectScores) -> Self {
        Self { mean_return: mean(&scores.returns), success: share(&scores.successes) }
    }
}

/// Scores of the trainings of a policy.
#[derive(Debug, Serialize)]
pub struct PolicyScores {
    /// Name of the policy.
    pub policy: String,
    /// Knowledge that it was trained with.
    pub knowledge: Knowledge,
    /// Mean return over the episodes: by object, by training.
    pub mean_returns: Vec<Vec<f64>>,
    /// Share of successes: by object, by training.
    pub successes: Vec<Vec<f64>>,
    /// Interquartile mean of the mean returns over all objects.
    pub interquartile_mean: Interval,
}

/// Gains on one object.
#[derive(Debug, Serialize)]
pub struct ObjectGains {
    /// Name of the object.
    pub object: String,
    /// Interquartile mean of the matched policy's mean returns.
    pub own: Interval,
    /// Matched policy against others.
    pub gains: Vec<Gain>,
}

/// Policies that were trained over the posteriors from one evidence, each on its object.
#[derive(Debug, Serialize)]
pub struct EvidenceGains {
    /// The evidence.
    pub evidence: Evidence,
    /// Gain over U on each object.
    pub objects: Vec<Gain>,
    /// Gains over all objects: against U, own (that is, the first evidence) and true.
    pub all: Vec<Gain>,
}

/// Policy of an object's posterior against another one.
#[derive(Debug, Clone, Serialize)]
pub struct Gain {
    /// The other: U, mu, mismatched (mean of the policies of the other objects' posteriors), own, or true.
    pub against: &'static str,
    /// Interquartile mean of the mean returns minus that of the other, with its interval of 95 % over trainings.
    pub gain: Interval,
    /// Probability that a training of the policy has the larger mean return.
    pub probability: Interval,
    /// Two-sided p-value of the differences, paired by training, from all changes of their signs. Over several objects, a training's difference is
    /// its mean over them.
    pub p: f64,
}

/// Performance profile of a group of policies.
#[derive(Debug, Serialize)]
pub struct Profile {
    /// Group: own, U, mu, mismatched, true.
    pub group: &'static str,
    /// Thresholds.
    pub thresholds: Vec<f64>,
    /// Share of the mean returns above each.
    pub shares: Vec<Interval>,
}

/// Deployments in pairs.
#[derive(Debug, Serialize)]
pub struct Pairs {
    /// Name of the object; "all" for all of them.
    pub object: String,
    /// Pairs that either policy won, also after the decision; a tie counts for neither.
    pub signs: SequentialSigns,
    /// First decision of a sequential sign test with an error of 5 %; later pairs do not change it.
    pub decision: Decision,
    /// Number of pairs at the decision; none if it is open after the last one.
    pub after: Option<usize>,
}

/// Share of successes.
fn share(successes: &[bool]) -> f64 {
    successes.iter().filter(|s| **s).count() as f64 / successes.len() as f64
}

/// Groups that the matched policy is compared with.
const OTHERS: [&str; 4] = ["U", "mu", "mismatched", "true"];

/// Results of the work of a plan. `inferred` is by object and evidence, `scores` are in the order of the plan's chains, `plans` by task and
/// object, `deployments` by task, policy and place.
pub fn study(
    plan: Plan,
    cell: Option<Cell>,
    inferred: &[Vec<Inferred>],
    aims: Vec<String>,
    scores: &[Scored],
    plans: &[ObjectScores],
    deployments: &[Vec<Vec<Deployments>>],
) -> Result<Study> {
    let chains = plan.chains();
    let posterior = |inferred: &Inferred| -> Result<EvidencePosterior> {
        Ok(EvidencePosterior {
            marginals: inferred.marginals.clone(),
            information_nat: inferred.posterior().information_nat()?,
            misfit: inferred.misfit.clone(),
        })
    };
    let objects = plan.objects.iter().zip(inferred).map(|(object, inferred)| {
        Ok(ObjectPosterior {
            object: object.name.clone(),
            truth: object.truth.clone(),
            posteriors: inferred.iter().map(posterior).collect::<Result<_>>()?,
        })
    });
    let objects = objects.collect::<Result<_>>()?;
    let tasks = aims.into_iter().enumerate().map(|(task, aim)| {
        let of_task: Vec<(&Chain, &Scored)> = chains.iter().zip(scores).filter(|(c, _)| c.task == task).collect();
        let n = plan.objects.len();
        task_result(
            &plan,
            task,
            aim,
            &of_task,
            plans.get(task * n..(task + 1) * n).unwrap_or_default(),
            &deployments[task],
        )
    });
    let tasks = tasks.collect();
    Ok(Study { plan, cell, objects, tasks })
}

fn task_result(
    plan: &Plan,
    task: usize,
    aim: String,
    scores: &[(&Chain, &Scored)],
    plans: &[ObjectScores],
    deployments: &[Vec<Deployments>],
) -> TaskResult {
    let knowledge = plan.knowledge();
    // The scores of one training on several objects depend on one another, and are drawn together.
    let bootstrap = Bootstrap { seed: plan.seed, together: true, ..Bootstrap::default() };
    let of = |knowledge: Knowledge, value: &dyn Fn(&Scored, usize) -> f64| -> Vec<Vec<f64>> {
        let trainings = || scores.iter().filter(move |(c, _)| c.knowledge == knowledge);
        (0..plan.objects.len()).map(|object| trainings().map(|(_, s)| value(s, object)).collect()).collect()
    };
    let mean_return = |s: &Scored, object: usize| mean(&s.objects[object].returns);
    let success = |s: &Scored, object: usize| share(&s.objects[object].successes);
    let policies: Vec<PolicyScores> = knowledge
        .iter()
        .map(|&knowledge| {
            let mean_returns = of(knowledge, &mean_return);
            PolicyScores {
                policy: plan.policy_name(knowledge),
                knowledge,
                successes: of(knowledge, &success),
                interquartile_mean: bootstrap.interquartile_mean(&mean_returns),
                mean_returns,
            }
        })
        .collect();
    // Scores of a policy on an object, by training; empty for one that the study does without.
    let find = |wanted: Knowledge, object: usize| -> Vec<f64> {
        let found = policies.iter().find(|p| p.knowledge == wanted);
        found.map_or_else(Vec::new, |p| p.mean_returns[object].clone())
    };
    // Scores of a group on an object, by training.
    let group = |name: &str, object: usize| -> Vec<f64> {
        match name {
            "own" => find(Knowledge::own(object), object),
            "U" => find(Knowledge::Prior, object),
            "mu" => find(Knowledge::Median, object),
            "true" => find(Knowledge::Truth(object), object),
            "mismatched" => {
                let others: Vec<Vec<f64>> =
                    (0..plan.objects.len()).filter(|o| *o != object).map(|o| find(Knowledge::own(o), object)).collect();
                let at = |training: usize| mean(&others.iter().map(|of| of[training]).collect::<Vec<f64>>());
                (0..others.first().map_or(0, Vec::len)).map(at).collect()
            }
            other => unreachable!("group {other}"),
        }
    };
    let gain = |known: &dyn Fn(usize) -> Knowledge, against: &'static str, objects: &[usize]| -> Option<Gain> {
        let own: Vec<Vec<f64>> = objects.iter().map(|&o| find(known(o), o)).collect();
        let other: Vec<Vec<f64>> = objects.iter().map(|&o| group(against, o)).collect();
        // A single object has no mismatched policies, and the study may do without mu and those that are told.
        if own.iter().chain(&other).any(Vec::is_empty) {
            return None;
        }
        // Scores on several objects belong to one training: they are one difference.
        let difference = |training: usize| {
            mean(&own.iter().zip(&other).map(|(a, b)| a[training] - b[training]).collect::<Vec<f64>>())
        };
        let differences: Vec<f64> = (0..own[0].len()).map(difference).collect();
        Some(Gain {
            against,
            gain: bootstrap.gain(&own, &other),
            probability: bootstrap.probability_of_improvement(&own, &other),
            p: sign_change_test(&differences, plan.seed),
        })
    };
    let every: Vec<usize> = (0..plan.objects.len()).collect();
    let objects = every.iter().map(|&object| ObjectGains {
        object: plan.objects[object].name.clone(),
        own: bootstrap.interquartile_mean(&[group("own", object)]),
        gains: OTHERS.iter().filter_map(|against| gain(&Knowledge::own, against, &[object])).collect(),
    });
    let evidence = (0..plan.evidence.len()).map(|evidence| {
        let known = move |object: usize| Knowledge::Posterior { object, evidence };
        // The first evidence is that of the own policies.
        let against: &[&'static str] = if evidence == 0 { &["U", "true"] } else { &["U", "own", "true"] };
        EvidenceGains {
            evidence: plan.evidence[evidence],
            objects: every.iter().filter_map(|&object| gain(&known, "U", &[object])).collect(),
            all: against.iter().filter_map(|against| gain(&known, against, &every)).collect(),
        }
    });
    let told = gain(&Knowledge::Truth, "U", &every);
    let thresholds: Vec<f64> = (0..THRESHOLDS).map(|i| i as f64 / (THRESHOLDS - 1) as f64 * top(&policies)).collect();
    let profile = |name: &'static str| {
        let scores: Vec<Vec<f64>> = every.iter().map(|&o| group(name, o)).collect();
        if scores.iter().any(Vec::is_empty) {
            return None;
        }
        let shares = bootstrap.performance_profile(&scores, &thresholds);
        Some(Profile { group: name, thresholds: thresholds.clone(), shares })
    };
    TaskResult {
        task: plan.tasks[task].clone(),
        aim,
        objects: objects.collect(),
        all: OTHERS.iter().filter_map(|against| gain(&Knowledge::own, against, &every)).collect(),
        profiles: ["own", "U", "mu", "mismatched", "true"].into_iter().filter_map(profile).collect(),
        evidence: evidence.collect(),
        told,
        best_plans: plans.iter().map(BestPlan::of).collect(),
        deployments: pairs(plan, deployments),
        policies,
    }
}

/// Largest mean return, at least 1: the end of a profile.
fn top(policies: &[PolicyScores]) -> f64 {
    policies.iter().flat_map(|p| p.mean_returns.iter().flatten()).fold(1.0, |a: f64, b| a.max(*b))
}

/// Deployments of each object's matched policy against U, in pairs of the same conditions; then all of them.
fn pairs(plan: &Plan, deployments: &[Vec<Deployments>]) -> Vec<Pairs> {
    let knowledge = plan.deployed();
    let place = |wanted: Knowledge| knowledge.iter().position(|k| *k == wanted);
    let returns = |of: Knowledge, object: usize| -> Vec<f64> {
        let deployed = place(of).and_then(|policy| deployments.get(policy)?.get(object));
        deployed.map_or_else(Vec::new, |d| d.rewards.iter().map(|r| r.iter().sum()).collect())
    };
    let differences = |object: usize| -> Vec<f64> {
        let (own, uniform) = (returns(Knowledge::own(object), object), returns(Knowledge::Prior, object));
        own.iter().zip(&uniform).map(|(a, b)| a - b).collect()
    };
    let decided = |object: String, differences: &[f64]| {
        let mut signs = SequentialSigns::default();
        let (mut decision, mut after) = (Decision::Open, None);
        for (i, d) in differences.iter().enumerate() {
            signs.add(*d);
            if decision == Decision::Open {
                decision = signs.decision(ERROR, (differences.len() - i - 1) as u32);
                after = (decision != Decision::Open).then_some(i + 1);
            }
        }
        Pairs { object, signs, decision, after }
    };
    let mut rows: Vec<Pairs> =
        plan.objects.iter().enumerate().map(|(i, o)| decided(o.name.clone(), &differences(i))).collect();
    // By repeat, so that every object has its turn.
    let all: Vec<Vec<f64>> = (0..plan.objects.len()).map(differences).collect();
    let mixed: Vec<f64> =
        (0..plan.repeats as usize).flat_map(|k| all.iter().filter_map(move |d| d.get(k).copied())).collect();
    rows.push(decided("all".to_owned(), &mixed));
    rows
}
