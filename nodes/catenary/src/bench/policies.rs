//! `catenary bench policies`: the processor time in which a training comes near the best plan, by what the policy observes and begins with, and
//! with other hyperparameters.

use super::args::PoliciesArgs;
use super::cpu_time::cpu_time;
use crate::evaluate::episodes::episodes;
use crate::evaluate::score::score;
use crate::inputs::model_file;
use crate::options::TaskOption;
use crate::plan;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use catenary_core::policy::Observes;
use catenary_core::{Fidelity, Judge, Model, Policy, seed};
use catenary_simulator::VectorEnv;
use catenary_simulator::workers;
use ppo_trainer::{Domains, Settings, Trained};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Episodes that score a policy.
const EPISODES: usize = 100;
/// Points of success below the best plan within which a training has come near it.
const NEAR: f64 = 3.0;
/// Random streams of a seed.
const SCORES: u64 = 1;
const SEARCH: u64 = 2;

/// Method of training: the default preset with changes.
#[derive(Debug, Clone, Copy)]
struct Method {
    name: &'static str,
    changed: fn(Settings) -> Settings,
}

/// Policy that observes the time and earlier observations, and begins without a plan.
fn observing(settings: Settings) -> Settings {
    Settings { searches_plan: false, ..settings }
}

/// From the paper's policy to the default one.
const METHODS: [Method; 4] = [
    Method { name: "newest observation", changed: |s| observing(s).newest_only() },
    Method {
        name: "and the time",
        changed: |s| Settings { observes: Observes { history: 0, time: true }, ..observing(s) },
    },
    Method { name: "and five earlier ones", changed: observing },
    Method { name: "and the best plan", changed: |s| s },
];

/// Other hyperparameters, each beside "and five earlier ones". The scale of the rewards is missing: advantages are normalised in each minibatch.
const HYPERPARAMETERS: [Method; 7] = [
    Method { name: "and 48 environments", changed: |s| Settings { environments: 48, batch_size: 512, ..observing(s) } },
    Method { name: "and learning rate x 3", changed: |s| Settings { learning_rate: 3e-3, ..observing(s) } },
    Method { name: "and learning rate / 3", changed: |s| Settings { learning_rate: 3e-4, ..observing(s) } },
    Method { name: "and a constant rate", changed: |s| Settings { anneal_learning_rate: false, ..observing(s) } },
    Method { name: "and batches of 512", changed: |s| Settings { batch_size: 512, ..observing(s) } },
    Method { name: "and exploration x 2", changed: |s| Settings { initial_log_std: 0.0, ..observing(s) } },
    Method { name: "and exploration / 2", changed: |s| Settings { initial_log_std: -1.4, ..observing(s) } },
];

/// Results on one object.
#[derive(Debug, Serialize)]
struct OfObject {
    object: String,
    /// Success of the best plan, %.
    plan: f64,
    /// Processor time of its search, s.
    plan_cpu_s: f64,
    methods: Vec<OfMethod>,
}

/// Results of a method: one entry for each budget, in their order.
#[derive(Debug, Serialize)]
struct OfMethod {
    method: &'static str,
    /// Success by budget and seed, %.
    successes: Vec<Vec<f64>>,
    /// Environment steps by budget and seed.
    steps: Vec<Vec<u64>>,
    /// Mean processor time of a training with each budget, the search of its plan included, s.
    cpu_s: Vec<f64>,
    /// Processor time with the least budget whose mean success is near the best plan; none if no budget is enough.
    near_cpu_s: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Report {
    task: String,
    /// Budgets of environment steps; none: until the return is flat.
    budgets: Vec<Option<u64>>,
    seeds: u64,
    objects: Vec<OfObject>,
}

/// Trains oracle policies with every method, budget and seed on every object.
pub fn run(arguments: &PoliciesArgs) -> Result<()> {
    let budgets: Vec<Option<u64>> = match arguments.steps.as_slice() {
        [] => vec![None],
        steps => steps.iter().copied().map(Some).collect(),
    };
    let default = METHODS.len() - 1;
    let methods = match (arguments.default_only, arguments.hyperparameters) {
        (true, _) => METHODS[default..].to_vec(),
        (false, true) => [&METHODS[default - 1..], &HYPERPARAMETERS].concat(),
        (false, false) => METHODS.to_vec(),
    };
    let all = arguments.objects.len() * (1 + methods.len() * budgets.len() * arguments.seeds as usize);
    let bar = progress::bar("trainings", 0.0)?;
    let mut done = 0;
    let mut advance = || {
        done += 1;
        progress::advance(&bar, progress::share(done as f64, all as f64));
    };
    let mut objects = Vec::new();
    for path in &arguments.objects {
        let own = model_file::read(path)?;
        let named = |name: &str| {
            own.nominal.get(name).copied().with_context(|| format!("{}: no nominal {name}", path.display()))
        };
        let theta = own.theta.parameters().iter().map(|p| named(&p.name)).collect::<Result<Vec<f64>>>()?;
        let model = TaskOption { task: Some(arguments.task.clone()) }.applied_to(own)?;
        let object = Object { model, domains: Domains::Point(theta.clone()), theta };
        let before = cpu_time();
        let best = object.plan(1)?;
        let plan_cpu_s = (cpu_time() - before).as_secs_f64();
        let plan = object.success(best)?;
        advance();
        let of_method = |method: &Method| -> Result<OfMethod> {
            let (mut successes, mut cpu_s, mut steps) = (Vec::new(), Vec::new(), Vec::new());
            for budget in &budgets {
                let before = cpu_time();
                let mut all_trained = Vec::new();
                for number in 1..=arguments.seeds {
                    all_trained.push(object.trained(method, *budget, number)?);
                    advance();
                }
                cpu_s.push((cpu_time() - before).as_secs_f64() / arguments.seeds as f64);
                steps.push(all_trained.iter().map(|t| t.steps).collect());
                successes
                    .push(all_trained.into_iter().map(|t| object.success(t.policy)).collect::<Result<Vec<f64>>>()?);
            }
            let mean = |s: &Vec<f64>| s.iter().sum::<f64>() / s.len() as f64;
            let near = successes.iter().position(|s| mean(s) >= plan - NEAR);
            Ok(OfMethod { method: method.name, near_cpu_s: near.map(|i| cpu_s[i]), successes, steps, cpu_s })
        };
        let methods = methods.iter().map(of_method).collect::<Result<_>>()?;
        objects.push(OfObject { object: object.model.name.clone(), plan, plan_cpu_s, methods });
    }
    bar.finish_and_clear();
    let task = arguments.task.display().to_string();
    let report = Report { task, budgets, seeds: arguments.seeds, objects };
    output::result(&arguments.output, &report, words)
}

struct Object {
    model: Model,
    theta: Vec<f64>,
    domains: Domains,
}

impl Object {
    fn plan(&self, number: u64) -> Result<Policy> {
        let rows = |n, draws| Ok(self.domains.rows(n, draws)?);
        let own = seed::derive(number, SEARCH);
        plan::best(&self.model, &rows, own, workers::available(), &mut |_| ControlFlow::Continue(()))?
            .context("a search that nothing ended")
    }

    fn trained(&self, method: &Method, budget: Option<u64>, number: u64) -> Result<Trained> {
        let mut settings = (method.changed)(Settings::tuned());
        if let Some(total_steps) = budget {
            settings = Settings { total_steps, ends_when_flat: false, ..settings };
        }
        if settings.searches_plan {
            settings.begin_with(&self.plan(number)?)?;
        }
        let rows = self.domains.rows(settings.environments, number)?;
        let (count, available) = (settings.environments, workers::available());
        let mut env = VectorEnv::open(&self.model, count, rows, Fidelity::Fast, seed::derive(number, 0), available)?;
        let task = self.model.task.context("a task file has a task")?;
        Ok(ppo_trainer::train(&mut env, &task, &settings, number, &mut |_| ControlFlow::Continue(()))?)
    }

    /// Share of successes in episodes at the highest fidelity, %.
    fn success(&self, policy: Policy) -> Result<f64> {
        let judge = Judge::of(&self.model).context("a task file has a task")?;
        let asked = episodes(vec![self.theta.clone(); EPISODES], Fidelity::Reference, seed::derive(1, SCORES));
        let scored = score(&self.model, &judge, vec![(PathBuf::new(), policy)], &asked, &mut |_, _| Ok(()))?;
        Ok(100.0 * scored[0].success_rate.value)
    }
}

fn words(report: &Report) -> String {
    let budget =
        |steps: &Option<u64>| steps.map_or("its end at a flat return".to_owned(), |steps| format!("{steps} steps"));
    let mut lines = vec![format!(
        "task {}: success in % at reference fidelity, mean of {} trainings that are told the object, after {}; mean processor time of a training, \
         and that until within {NEAR} points of the best plan",
        report.task,
        report.seeds,
        report.budgets.iter().map(budget).collect::<Vec<_>>().join(", ")
    )];
    for o in &report.objects {
        lines.push(format!("{}: best plan {:.0} % after {:.1} CPU s", o.object, o.plan, o.plan_cpu_s));
        for m in &o.methods {
            let mean = |s: &Vec<f64>| s.iter().sum::<f64>() / s.len() as f64;
            let shown = |i: usize| {
                let steps = m.steps[i].iter().sum::<u64>() as f64 / m.steps[i].len() as f64;
                format!("{:.0} ({steps:.0} steps, {:.1} CPU s)", mean(&m.successes[i]), m.cpu_s[i])
            };
            let by_budget = (0..m.successes.len()).map(shown).collect::<Vec<String>>().join(", ");
            let near = m.near_cpu_s.map_or("not reached".to_owned(), |s| format!("{s:.1} CPU s"));
            lines.push(format!("  {:<22} {by_budget}; {near}", m.method));
        }
    }
    lines.join("\n")
}
