//! `catenary study`: what knowing the object is worth. Posteriors of hidden objects, policies trained with and without them, and
//! a comparison with statistics that hold.

pub mod args;
mod deployment;
mod dtw;
mod evidence;
mod files;
mod further;
mod on_cell;
mod page;
mod plan;
mod results;
mod work;

use crate::all_cores;
use crate::exit::Given;
use crate::options::Part;
use crate::report::aim;
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use args::StudyArgs;
use catenary_core::Judge;
use catenary_shell::{NodeBuilder, RosArgs, Shutdown};
use deployment::{Deployment, Deployments, Planned};
use indicatif::ProgressBar;
use plan::{Chain, Knowledge, Place, Plan};
use results::{Study, study};
use serde::Serialize;
use std::path::PathBuf;
use work::{Inferred, Scored, Work};

/// Answer of the command.
#[derive(Debug, Serialize)]
struct Answer {
    /// Folder of the study.
    out: PathBuf,
    /// Part that was made; none: all of it.
    part: Option<String>,
    /// Results; none after a part.
    #[serde(skip_serializing_if = "Option::is_none")]
    study: Option<Study>,
}

/// Makes what is missing of the study, or of a part of it, and then the report. Ctrl-C ends it, and the same command goes on.
pub fn run(arguments: &StudyArgs) -> Result<()> {
    let (plan, models) = Plan::of(arguments)?;
    // A file of its own, since other parts may look at the same time.
    output::prepare(&arguments.out.join(format!("probe-{:016x}", rand::random::<u64>())))?;
    plan.keep(&arguments.out)?;
    // A wrong environment is refused before the work, which may take hours.
    let builder = match arguments.cell {
        Some(_) => Some(NodeBuilder::new("study", &RosArgs::default())?),
        None => None,
    };
    let shutdown = builder.as_ref().map_or_else(Shutdown::new, |b| b.shutdown().clone());
    catenary_shell::end_on_signals(&shutdown)?;
    let work = Work { plan: &plan, models: &models, folder: &arguments.out, cell: arguments.cell, shutdown: &shutdown };
    let part = arguments.part.unwrap_or(Part::WHOLE);
    let chains: Vec<Chain> =
        plan.chains().into_iter().enumerate().filter(|(i, _)| part.has(*i)).map(|(_, c)| c).collect();
    // Before the posteriors on all cores, each of which would make it.
    work.recorder()?;
    let by_object = (0..plan.objects.len())
        .flat_map(|object| (0..plan.evidence.len()).map(move |evidence| (object, evidence)))
        .filter(|&(object, evidence)| chains.iter().any(|c| c.knowledge == Knowledge::Posterior { object, evidence }));
    let wanted: Vec<(usize, usize)> = by_object.collect();
    let inferred: Vec<Inferred> = each("posteriors", &wanted, |&(object, evidence)| work.posterior(object, evidence))?;
    let scores: Vec<Scored> = each("trainings", &chains, |chain| work.scores(chain))?;
    let out = arguments.out.clone();
    if arguments.part.is_some() {
        let part = Some(format!("{}/{}", part.number, part.of));
        return output::result(&arguments.output, &Answer { out, part, study: None }, |answer| {
            format!("part {} is done in {}", answer.part.as_deref().unwrap_or_default(), answer.out.display())
        });
    }
    let tasks = if plan.searches_plans { plan.tasks.len() } else { 0 };
    let by_task: Vec<(usize, usize)> =
        (0..tasks).flat_map(|task| (0..plan.objects.len()).map(move |object| (task, object))).collect();
    let plans = each("best plans", &by_task, |&(task, object)| work.plan_scores(task, object))?;
    let mut inferred = inferred.into_iter();
    let mut of_object = || inferred.by_ref().take(plan.evidence.len()).collect::<Vec<Inferred>>();
    let inferred: Vec<Vec<Inferred>> = plan.objects.iter().map(|_| of_object()).collect();
    let deployments = deployments(&work, builder)?;
    let aims = models.tasks.iter().map(words_of).collect::<Result<Vec<String>>>()?;
    let page = page::Data { inferred: &inferred, scores: &scores, deployments: &deployments, models: &models };
    let study = study(plan.clone(), arguments.cell, &inferred, aims, &scores, &plans, &deployments)?;
    let report = page::page(&study, &page)?;
    for (name, bytes) in [("study.json", serde_json::to_vec_pretty(&study)?), ("report.html", report.into_bytes())] {
        files::write(&arguments.out.join(name), &bytes)?;
    }
    output::result(&arguments.output, &Answer { out, part: None, study: Some(study) }, |answer| {
        let study = answer.study.as_ref().map(page::words).unwrap_or_default();
        format!("{study}\nreport: {}", answer.out.join("report.html").display())
    })
}

/// Deployments by task, policy and place. `builder` makes the node that commands the arm of the cell, if there is one.
fn deployments(work: &Work<'_>, builder: Option<NodeBuilder>) -> Result<Vec<Vec<Vec<Deployments>>>> {
    let planned = deployment::planned(work.plan);
    let (on_cell, in_process): (Vec<Planned>, Vec<Planned>) =
        planned.iter().partition(|p| work.cell.is_some() && p.place != Place::OwnSimulation);
    each("deployments", &in_process, |planned| work.simulated(planned))?;
    if let (Some(cell), Some(builder)) = (work.cell, builder) {
        let bar = bar(&format!("{} cell", cell.name()), on_cell.len())?;
        on_cell::deploy(work, cell, builder, &on_cell, &bar)?;
        bar.finish_and_clear();
    }
    // Only read: the end of the cell's node looks to other work like Ctrl-C.
    let made =
        planned.iter().map(|p| files::read_json(&work.deployment_file(p), Deployment::check)).collect::<Result<_>>()?;
    Ok(deployment::in_groups(work.plan, made))
}

/// Progress bar of `length` pieces of work.
fn bar(name: &str, length: usize) -> Result<ProgressBar> {
    let bar = ProgressBar::new(length as u64);
    bar.set_style(progress::style(&format!("{name} [{{bar:24}}] {{pos}}/{{len}}"), 0.0)?);
    Ok(bar)
}

/// Does a piece of work for each item on all cores, with a progress bar. Returns the results in order.
fn each<T: Sync, R: Send>(name: &str, items: &[T], work: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
    let bar = bar(name, items.len())?;
    let mut results = Vec::with_capacity(items.len());
    all_cores::in_order(
        0..items.len() as u64,
        |number| work(&items[number as usize]),
        |result| {
            results.push(result);
            bar.inc(1);
            Ok(())
        },
    )?;
    bar.finish_and_clear();
    Ok(results)
}

fn words_of(model: &catenary_core::Model) -> Result<String> {
    let judge = Judge::of(model).context("a task file has a task").given()?;
    Ok(aim::of(judge.task(), judge.success_distance_m()))
}
