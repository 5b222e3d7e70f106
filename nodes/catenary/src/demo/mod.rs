//! `catenary demo`: the whole Real2Sim2Real loop (Algorithm 1 of the paper) on a simulated cell with hidden parameters.

mod algorithm;
pub mod args;
mod config;
mod film;
mod observe;
mod page;
mod score;
mod setup;
mod stage;
mod story;
mod summary;

use crate::exit::{Given, Interrupted, Misfit};
use crate::graph::own::OwnDomain;
use crate::terminal::output;
use anyhow::{Context, Result};
use args::{DemoArgs, ReportArgs};
use catenary_core::{Judge, Model};
use catenary_shell::{Discovery, NodeBuilder, RosArgs};
use setup::{Demo, hidden_truth};
use stage::Stages;
use summary::Summary;

/// Runs the demo and prints the path of the report.
pub fn run(arguments: &DemoArgs) -> Result<()> {
    // A wrong environment is refused before anything is written.
    catenary_shell::domain_id()?;
    let folder = config::fresh_folder(&arguments.out)?;
    let taken = match folder == arguments.out {
        true => String::new(),
        false => format!(", because {} exists already", arguments.out.display()),
    };
    let folder = folder.canonicalize().with_context(|| folder.display().to_string())?;
    let model = Model::from_yaml(config::MODEL)?;
    let judge = Judge::of(&model).context("the demo's model needs a task")?;
    let truth = hidden_truth(&model, arguments.seed);
    let sizes = if arguments.paper { setup::PAPER } else { setup::DEFAULT };
    let builder = NodeBuilder::new("demo", &RosArgs::default())?;
    catenary_shell::end_on_signals(builder.shutdown())?;
    // Claimed after the signal handler is set: Ctrl-C during the search for a domain must end the demo.
    let domain = OwnDomain::claim()?;
    if builder.shutdown().is_triggered() {
        return Err(Interrupted(String::new()).into());
    }
    let cell = arguments.cell;
    let demo = Demo { model, judge, folder, cell, seed: arguments.seed, sizes, truth, domain };
    let node = builder.domain(demo.domain.id(), Discovery::Localhost).build()?;
    output::tell(&format!("catenary demo: results go to {}{taken}", demo.folder.display()));
    output::tell(&format!("catenary demo: {}", demo.domain.words()));
    let mut stages = Stages::new(demo.launch(&node)?);
    let outcome = demo.algorithm(&node, &mut stages);
    // Shut down before the error is reported, so that no log line follows it.
    stages.graph.supervisor.shut_down();
    let summary = outcome?;
    summary.write(&demo.folder)?;
    let page = page::write(&demo.folder, &summary)?;
    output::tell(&format!("report: {}", page.display()));
    output::result(&arguments.output, &summary, Summary::words)?;
    Misfit::check(summary.inference.misfit.as_ref(), &demo.folder)
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
