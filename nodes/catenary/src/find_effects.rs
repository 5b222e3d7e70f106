//! `catenary find-effects`: where model and recordings disagree, and which effect explains it.

mod answer;
mod page;

use crate::cli::FindEffectsArgs;
use crate::interrupted::Interrupted;
use crate::misfit::Misfit;
use crate::simulate::actions;
use crate::wrong_input::Given;
use crate::{model_file, output, progress, served};
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_shell::Shutdown;
use effect_finder::node::journal::{self, Journal};
use effect_finder::node::{episodes_of, hold_out};
use effect_finder::{FinderError, Finding, Outcome, Question, Settings, convert, find};
use indicatif::ProgressBar;
use page::page;
use serde::Serialize;
use simulator_pool::{BeamSimulator, Registry, workers};
use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a search writes where it is to tell alike effects apart.
const MOTION: &str = "separating_motion.csv";
/// What a search writes: the verdict, the model to go on with, pictures.
const FILES: [&str; 3] = ["verdict.json", "model.yaml", "report/index.html"];
/// What the simulator has answered, until a search has ended.
const JOURNAL: &str = "search.journal";

/// What verdict.json holds, and `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    model: String,
    /// What was looked at; conclusions and places count these from 0.
    episodes: Vec<Looked>,
    /// What the repair was judged by.
    held_out: Vec<Looked>,
    settings: Settings,
    wall_s: f64,
    /// Whether the best model fits the recordings; false: `misfit` says why not.
    fits: bool,
    /// What is doubtful about the recordings.
    warnings: Vec<String>,
    #[serde(flatten)]
    finding: Finding,
}

/// An episode that was looked at.
#[derive(Debug, Serialize)]
struct Looked {
    bag: PathBuf,
    /// Its number in the bag.
    number: u32,
}

/// Searches and writes verdict.json, model.yaml and report/index.html; Ctrl-C ends it.
pub fn run(arguments: &FindEffectsArgs) -> Result<()> {
    let (model, text) = model_file::read_with_text(&arguments.model)?;
    if let Some(namespace) = &arguments.served.node {
        return served::find_effects(arguments, namespace);
    }
    let settings = Settings { null_sets: arguments.null_sets, seed: arguments.seed, ..Settings::default() };
    settings.check().context("--null-sets").given()?;
    let mut fitted = episodes(arguments.bags.all(), &model).given()?;
    let held_out = match arguments.verify.as_slice() {
        [] => hold_out(&mut fitted),
        bags => episodes(bags, &model).given()?,
    };
    for name in FILES {
        output::prepare(&arguments.out.join(name))?;
    }
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let started = Instant::now();
    let tracks = |list: &[(Looked, MeasuredTrack)]| list.iter().map(|(_, m)| m.clone()).collect::<Vec<_>>();
    let (measured, unseen) = (tracks(&fitted), tracks(&held_out));
    let candidates = convert::candidates(Registry::shipped(), &model)?;
    let question = Question { model: &model, measured: &measured, held_out: &unseen, candidates: &candidates };
    let simulator = BeamSimulator::new(&model, workers::available())?;
    let number = journal::number_of(&question, &settings);
    let journal = Journal::open(arguments.out.join(JOURNAL), number, &simulator);
    let outcome = match search(question, &journal, &settings, &shutdown) {
        Err(FinderError::Cancelled(stage)) => {
            let rest = if journal.is_kept() { "; the same command goes on from there" } else { "" };
            return Err(Interrupted(format!(" while it was to {stage}{rest}")).into());
        }
        Err(error) => {
            journal.remove();
            return Err(error.into());
        }
        Ok(outcome) => outcome,
    };
    let Outcome { finding, model: repaired, shown } = outcome;
    let text = match repaired {
        Some(model) => model.rewrite(&text)?,
        None => text,
    };
    let all = measured.iter().chain(&unseen).flat_map(|m| m.warnings.iter().cloned());
    let warnings = all.collect::<BTreeSet<String>>().into_iter().collect();
    let looked = |list: Vec<(Looked, MeasuredTrack)>| list.into_iter().map(|(looked, _)| looked).collect();
    let report = Report {
        model: model.name.clone(),
        episodes: looked(fitted),
        held_out: looked(held_out),
        settings,
        wall_s: started.elapsed().as_secs_f64(),
        fits: finding.misfit.is_none(),
        warnings,
        finding,
    };
    write_motion(&arguments.out, report.finding.separation.as_ref().map_or(&[], |s| &s.actions))?;
    write(&arguments.out, [serde_json::to_string_pretty(&report)?, text, page(&report, &model, &shown)?])?;
    journal.remove();
    output::result(&arguments.output, &report, |r| words(r, &arguments.out))?;
    Misfit::check(report.finding.misfit.as_ref(), &arguments.out)
}

/// Every complete episode of the bags.
fn episodes(bags: &[PathBuf], model: &Model) -> Result<Vec<(Looked, MeasuredTrack)>> {
    let mut all = Vec::new();
    for bag in bags {
        let looked = |(number, track)| (Looked { bag: bag.clone(), number }, track);
        all.extend(episodes_of(bag, model)?.into_iter().map(looked));
    }
    Ok(all)
}

/// Searches in this process with a bar; conclusions are told as they come.
fn search(
    question: Question<'_>,
    journal: &Journal<'_>,
    settings: &Settings,
    shutdown: &Shutdown,
) -> Result<Outcome, FinderError> {
    if !journal.is_empty() {
        output::tell(&format!("goes on with {} answers of the simulator, which an earlier search left", journal.len()));
    }
    let bar = progress::bar("search", 0.0).unwrap_or_else(|_| ProgressBar::hidden());
    let found = find(question, journal, settings, &mut |told| {
        bar.set_message(told.stage.name());
        progress::advance(&bar, told.progress);
        if let Some(conclusion) = &told.conclusion {
            bar.suspend(|| output::tell(&format!("{}: {conclusion}", told.stage.name())));
        }
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    found
}

/// Writes the actions that would tell alike effects apart, in the place of those of an earlier search; none: there is no such file.
pub fn write_motion(folder: &Path, of_steps: &[[f64; 2]]) -> Result<()> {
    let path = folder.join(MOTION);
    let done = match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ if of_steps.is_empty() => Ok(()),
        _ => std::fs::write(&path, actions::written(of_steps)),
    };
    done.with_context(|| path.display().to_string())
}

fn write(folder: &Path, texts: [String; 3]) -> Result<()> {
    for (name, text) in FILES.into_iter().zip(texts) {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

fn headline(finding: &Finding) -> String {
    match finding.found.as_slice() {
        [] => finding.verdict.name().to_owned(),
        found => {
            let effects: Vec<String> = found.iter().map(|alike| alike.join(" or ")).collect();
            format!("{} ({})", finding.verdict.name(), effects.join(", "))
        }
    }
}

fn words(report: &Report, folder: &Path) -> String {
    let misfit = report.finding.misfit.iter().map(|reason| Misfit::headline(reason));
    let mut lines: Vec<String> = misfit.collect();
    lines.push(headline(&report.finding));
    lines.push(format!("{} episodes, {:.1} s", report.episodes.len(), report.wall_s));
    lines.push(format!("report: {}", folder.join(FILES[2]).display()));
    lines.join("\n")
}
