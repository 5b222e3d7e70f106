//! `catenary demo`: the whole Real2Sim2Real loop (Algorithm 1 of the paper) on a simulated cell with hidden parameters.

mod algorithm;
pub mod args;
mod config;
mod film;
mod kept;
mod observe;
mod page;
mod recording;
mod score;
mod setup;
mod stage;
mod story;
mod summary;

use crate::exit::{Given, Interrupted, Misfit};
use crate::graph::own::OwnDomain;
use crate::terminal::output;
use anyhow::{Context, Error, Result};
use args::{DemoArgs, ReportArgs};
use catenary_core::Judge;
use catenary_shell::{Discovery, NodeBuilder, RosArgs};
use kept::{Kept, Owner};
use setup::{Demo, hidden_truth};
use stage::Stages;
use std::path::Path;
use summary::{Progress, Summary};

/// Runs the demo and prints the path of the report.
pub fn run(arguments: &DemoArgs) -> Result<()> {
    // A wrong environment is refused before anything is written.
    catenary_shell::domain_id()?;
    let (model, model_yaml) = setup::model(arguments.cell)?;
    let judge = Judge::of(&model).context("the demo's model needs a task")?;
    let truth = hidden_truth(&model, arguments.seed);
    let sizes = if arguments.paper { setup::PAPER } else { setup::DEFAULT };
    let cell = arguments.cell;
    let owner = Owner::new(arguments.seed, sizes.preset.name(), cell.name(), &model);
    let (folder, kept) = Kept::open(&arguments.out, owner)?;
    let why = match (kept.is_resumed, folder == arguments.out) {
        (true, _) => ", where an interrupted demo is taken up again".to_owned(),
        (false, true) => String::new(),
        (false, false) => format!(", because {} exists already", arguments.out.display()),
    };
    let folder = folder.canonicalize().with_context(|| folder.display().to_string())?;
    // Time of the cell is that of the observer, too.
    let in_step = cell.is_in_lock_step();
    let simulated = ["--ros-args", "-p", "use_sim_time:=true"].map(str::to_owned);
    let (ros, _) = RosArgs::parse(simulated.into_iter().filter(|_| in_step))?;
    let builder = NodeBuilder::new("demo", &ros)?.in_lock_step(in_step);
    catenary_shell::end_on_signals(builder.shutdown())?;
    // Claimed after the signal handler is set: Ctrl-C during the search for a domain must end the demo.
    let domain = OwnDomain::claim()?;
    if builder.shutdown().is_triggered() {
        return Err(Interrupted(String::new()).into());
    }
    let demo = Demo { model, model_yaml, judge, folder, cell, seed: arguments.seed, sizes, truth, domain };
    let node = builder.domain(demo.domain.id(), Discovery::Localhost).build()?;
    output::tell(&format!("catenary demo: results go to {}{why}", demo.folder.display()));
    output::tell(&format!("catenary demo: {}", demo.domain.words()));
    let mut stages = Stages::new(demo.launch(&node)?, &kept);
    let mut progress = Progress::default();
    let outcome = demo.algorithm(&node, &mut stages, &mut progress);
    // Shut down before the error is reported, so that no log line follows it.
    stages.graph.supervisor.shut_down();
    let summary = outcome.map_err(|error| stopped(&demo.folder, &progress, &stages, error))?;
    let page = page::write(&demo.folder, &summary)?;
    // Last: it marks the demo as finished.
    summary.write(&demo.folder)?;
    output::tell(&format!("report: {}", page.display()));
    output::result(&arguments.output, &summary, Summary::words)?;
    Misfit::check(summary.inference.misfit.as_ref(), &demo.folder)
}

/// Leaves a report of what there is behind, and returns the error with the way to go on.
fn stopped(folder: &Path, progress: &Progress, stages: &Stages<'_>, error: Error) -> Error {
    let words = format!("{error:#}");
    match page::write_stopped(folder, progress, &stages.done, &words) {
        Ok(page) => output::tell(&format!("report so far: {}", page.display())),
        // The first error counts.
        Err(also) => output::tell(&format!("no report: {also:#}")),
    }
    if error.is::<Interrupted>() {
        let stage = stages.done.last().map_or("demo", |stage| stage.name.as_str()).to_owned();
        return Error::from(Interrupted("; the same command goes on from here".to_owned())).context(stage);
    }
    output::tell("catenary demo: finished stages are kept: the same command goes on from here");
    error
}

/// Builds the report of a demo's folder again.
pub fn run_report(arguments: &ReportArgs) -> Result<()> {
    let folder = &arguments.dir;
    let summary = Summary::read(folder).given()?;
    for bag in summary.episodes.iter().map(|e| folder.join(&e.bag)).filter(|bag| !bag.exists()) {
        tracing::warn!("{} is gone: the report names it all the same", bag.display());
    }
    let page = page::write(folder, &summary)?;
    output::result(&arguments.output, &serde_json::json!({ "page": page }), |_| page.display().to_string())
}
