//! `catenary find-effects`: where model and recordings disagree, and which effect explains it.

mod page;

use crate::cli::FindEffectsArgs;
use crate::interrupted::Interrupted;
use crate::misfit::Misfit;
use crate::simulate::actions;
use crate::{model_file, output, served};
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_shell::Shutdown;
use effect_finder::node::journal::{self, Journal};
use effect_finder::node::{episodes_of, hold_out};
use effect_finder::{FinderError, Finding, Outcome, Question, Settings, convert, find};
use indicatif::{ProgressBar, ProgressStyle};
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
/// Steps of the progress bar.
const STEPS: f64 = 1000.0;

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
    let model = model_file::read(&arguments.model)?;
    if let Some(namespace) = &arguments.served.node {
        return served::find_effects(arguments, namespace);
    }
    let text = std::fs::read_to_string(&arguments.model).with_context(|| arguments.model.display().to_string())?;
    let settings = Settings { null_sets: arguments.null_sets, seed: arguments.seed, ..Settings::default() };
    settings.check().context("--null-sets")?;
    let mut fitted = episodes(&arguments.bag, &model)?;
    let held_out = match arguments.verify.as_slice() {
        [] => hold_out(&mut fitted),
        bags => episodes(bags, &model)?,
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
    write(&arguments.out, [serde_json::to_string_pretty(&report)?, text, page(&report, &shown)?])?;
    journal.remove();
    output::result(&arguments.output, &report, words)?;
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
    let bar = ProgressBar::new(STEPS as u64);
    let style = ProgressStyle::with_template("{msg:<10} [{bar:30}] {percent} %");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
    let found = find(question, journal, settings, &mut |progress| {
        bar.set_message(progress.stage.name());
        bar.set_position((STEPS * progress.progress) as u64);
        if let Some(conclusion) = &progress.conclusion {
            bar.suspend(|| output::tell(&format!("{}: {conclusion}", progress.stage.name())));
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

fn words(report: &Report) -> String {
    let misfit =
        report.finding.misfit.iter().map(|reason| format!("{}\n", Misfit::headline(reason))).collect::<String>();
    let (verdict, episodes) = (headline(&report.finding), report.episodes.len());
    format!("{misfit}{verdict}\n{episodes} episodes, {:.1} s", report.wall_s)
}
