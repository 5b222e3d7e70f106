//! Search in this process, with a progress bar and a resumable journal.

use super::args::FindEffectsArgs;
use super::motion;
use super::optional;
use super::page::page;
use super::report::{Report, UsedEpisode};
use crate::exit::{Given, Interrupted, Misfit};
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_shell::{Shutdown, files};
use catenary_simulator::{BeamSimulator, Registry, workers};
use effect_finder::node::journal::{self, Journal};
use effect_finder::node::names::named_apart;
use effect_finder::node::{check_each_once, convert, episodes_of, hold_out};
use effect_finder::{FinderError, Outcome, Question, Settings, find};
use indicatif::ProgressBar;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Files of a search: the verdict, the repaired model, the report.
const FILES: [&str; 3] = ["verdict.json", "model.yaml", "report/index.html"];
/// File for the simulator's answers, kept until a search has ended.
const JOURNAL: &str = "search.journal";

/// Searches, and writes verdict.json, model.yaml and report/index.html. Ctrl-C ends the search, which the same command
/// resumes.
pub fn run(arguments: &FindEffectsArgs, model: &Model, text: &str) -> Result<()> {
    let settings = Settings { null_sets: arguments.null_sets, seed: arguments.seed, ..Settings::default() };
    settings.check().context("--null-sets").given()?;
    let further = arguments.validate.iter().chain(&arguments.verify);
    let all: Vec<PathBuf> = arguments.bags.all().iter().chain(further).cloned().collect();
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let mut fitted = episodes(arguments.bags.all(), &all, model).given()?;
    let given = |bags: &[PathBuf]| if bags.is_empty() { Ok(Vec::new()) } else { episodes(bags, &all, model).given() };
    let (mut validation, mut held_out) = match (given(&arguments.validate)?, given(&arguments.verify)?) {
        (validate, verify) if validate.is_empty() && verify.is_empty() => (hold_out(&mut fitted), verify),
        // Without others, the episodes that verify must choose, too.
        (validate, verify) if validate.is_empty() => (verify, validate),
        (validate, verify) => (validate, verify),
    };
    let every = fitted.iter().chain(&validation).chain(&held_out).map(|(_, track)| track).collect::<Vec<_>>();
    check_each_once(&every).given()?;
    // Checked before the search, which takes minutes.
    for name in FILES {
        output::prepare(&arguments.out.join(name))?;
    }
    let started = Instant::now();
    let tracks = |list: &[(UsedEpisode, MeasuredTrack)]| list.iter().map(|(_, m)| m.clone()).collect::<Vec<_>>();
    let (measured, selecting, unseen) = (tracks(&fitted), tracks(&validation), tracks(&held_out));
    let candidates = convert::candidates(Registry::shipped(), model)?;
    let registry = Registry::with_templates();
    let question = Question {
        model,
        measured: &measured,
        validation: &selecting,
        held_out: &unseen,
        candidates: &candidates,
        templates: &convert::templates(&registry, model),
    };
    let simulator = BeamSimulator::with_effects(model, &registry, workers::available())?;
    let number = journal::fingerprint(&question, &settings);
    let journal = Journal::open(arguments.out.join(JOURNAL), number, &simulator);
    let outcome = match search(question, &journal, &settings, &shutdown) {
        Err(FinderError::Cancelled(stage)) => {
            let done = format!("a part of the stage `{stage}`");
            return Err(match journal.is_kept() {
                true => {
                    let path = arguments.out.join(JOURNAL);
                    let answers = format!("{} ({} answers of the simulator)", path.display(), journal.len());
                    Interrupted::kept(done, answers, "")
                }
                false => Interrupted::lost(done),
            }
            .into());
        }
        Err(error) => {
            // A failed search is deterministic: its journal would only repeat the failure.
            journal.remove();
            return Err(error.into());
        }
        Ok(outcome) => outcome,
    };
    let Outcome { finding, model: repaired, nearest, shown } = outcome;
    // Recordings that contradict the model were searched as if they had been given as fitted.
    effect_finder::report::join(&finding.joined, &mut fitted, &mut validation, &mut held_out);
    // Rewritten in place, so that the user's comments in the model file survive.
    let rewritten = |model: Option<Model>| model.map(|model| model.rewrite(text)).transpose();
    let nearest = rewritten(nearest)?;
    let text = rewritten(repaired)?.unwrap_or_else(|| text.to_owned());
    let mut warnings = warnings(&measured.iter().chain(&selecting).chain(&unseen).collect::<Vec<_>>());
    warnings.extend(finding.noise_doubt.clone());
    let used = |list: Vec<(UsedEpisode, MeasuredTrack)>| list.into_iter().map(|(episode, _)| episode).collect();
    let report = Report {
        model: model.name.clone(),
        episodes: used(fitted),
        validation: used(validation),
        held_out: used(held_out),
        settings,
        wall_s: started.elapsed().as_secs_f64(),
        fits: finding.misfit.is_none(),
        warnings,
        finding,
    };
    motion::write(&arguments.out, report.finding.separation.as_ref().map_or(&[], |s| &s.actions))?;
    write(&arguments.out, [serde_json::to_string_pretty(&report)?, text, page(&report, model, &shown)?])?;
    optional::write(&arguments.out.join(optional::NEAREST), nearest)?;
    journal.remove();
    output::result(&arguments.output, &report, |r| r.words(&arguments.out.join(FILES[2])))?;
    Misfit::check(report.finding.misfit.as_ref(), &arguments.out)
}

/// All complete episodes of `bags`, named apart from those of `all` bags of the search.
fn episodes(bags: &[PathBuf], all: &[PathBuf], model: &Model) -> Result<Vec<(UsedEpisode, MeasuredTrack)>> {
    let mut episodes = Vec::new();
    for bag in bags {
        let used = |(number, track): (u32, MeasuredTrack)| {
            (UsedEpisode { bag: bag.clone(), number, name: track.name.clone() }, track)
        };
        episodes.extend(named_apart(episodes_of(bag, model)?, bag, all).into_iter().map(used));
    }
    Ok(episodes)
}

/// Warnings of the episodes, each once. If there are several episodes, its own are named behind it.
fn warnings(episodes: &[&MeasuredTrack]) -> Vec<String> {
    let mut named: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for episode in episodes {
        episode.warnings.iter().for_each(|w| named.entry(w).or_default().push(&episode.name));
    }
    let words = |(warning, names): (&str, Vec<&str>)| match episodes {
        [_] => warning.to_owned(),
        _ => format!("{warning} ({})", names.join("; ")),
    };
    named.into_iter().map(words).collect()
}

/// Searches in this process with a progress bar. Conclusions are printed as they come.
fn search(
    question: Question<'_>,
    journal: &Journal<'_>,
    settings: &Settings,
    shutdown: &Shutdown,
) -> Result<Outcome, FinderError> {
    if !journal.is_empty() {
        output::tell(&format!("resumes with {} answers of the simulator from an earlier search", journal.len()));
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

fn write(folder: &Path, texts: [String; 3]) -> Result<()> {
    for (name, text) in FILES.into_iter().zip(texts) {
        files::write(&folder.join(name), text)?;
    }
    Ok(())
}
