//! `catenary find-effects`: where model and recordings disagree, and which effect explains it.

use crate::cli::FindEffectsArgs;
use crate::interrupted::Interrupted;
use crate::report::{Page, plots};
use crate::{figures::figures, model_file, output, served};
use anyhow::{Context, Result};
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_shell::Shutdown;
use effect_finder::localise::{Part, Place};
use effect_finder::verdict::{Estimate, Fitness};
use effect_finder::{FinderError, Finding, Question, Settings, convert, find, node::episodes_of};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use simulator_pool::{BeamSimulator, Registry, workers};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a search writes: the verdict, the model to go on with, pictures.
const FILES: [&str; 3] = ["verdict.json", "model.yaml", "report/index.html"];
/// Of how many episodes one is held out, where nobody says which.
const HELD_OUT: usize = 3;
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
        [] => {
            let kept = fitted.len() - fitted.len() / HELD_OUT;
            fitted.split_off(kept)
        }
        bags => episodes(bags, &model)?,
    };
    for name in FILES {
        output::prepare(&arguments.out.join(name))?;
    }
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let started = Instant::now();
    let tracks = |list: &[(Looked, MeasuredTrack)]| list.iter().map(|(_, m)| m.clone()).collect::<Vec<_>>();
    let (finding, repaired) = search(&model, [&tracks(&fitted), &tracks(&held_out)], &settings, &shutdown)?;
    let text = match repaired {
        Some(model) => model.rewrite(&text)?,
        None => text,
    };
    let looked = |list: Vec<(Looked, MeasuredTrack)>| list.into_iter().map(|(looked, _)| looked).collect();
    let report = Report {
        model: model.name.clone(),
        episodes: looked(fitted),
        held_out: looked(held_out),
        settings,
        wall_s: started.elapsed().as_secs_f64(),
        finding,
    };
    write(&arguments.out, [serde_json::to_string_pretty(&report)?, text, page(&report)?])?;
    output::result(&arguments.output, &report, words)
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
    model: &Model,
    [measured, held_out]: [&[MeasuredTrack]; 2],
    settings: &Settings,
    shutdown: &Shutdown,
) -> Result<(Finding, Option<Model>)> {
    let simulator = BeamSimulator::new(model, workers::available())?;
    let candidates = convert::candidates(Registry::shipped(), model);
    let bar = ProgressBar::new(STEPS as u64);
    bar.set_style(ProgressStyle::with_template("{msg:<10} [{bar:30}] {percent} %")?.progress_chars("=> "));
    let question = Question { model, measured, held_out, candidates: &candidates };
    let found = find(question, &simulator, settings, &mut |progress| {
        bar.set_message(progress.stage.name());
        bar.set_position((STEPS * progress.progress) as u64);
        if let Some(conclusion) = &progress.conclusion {
            bar.suspend(|| output::tell(&format!("{}: {conclusion}", progress.stage.name())));
        }
        if shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    match found {
        Err(FinderError::Cancelled(stage)) => Err(Interrupted(format!(" while it was to {stage}")).into()),
        other => Ok(other?),
    }
}

fn write(folder: &Path, texts: [String; 3]) -> Result<()> {
    for (name, text) in FILES.into_iter().zip(texts) {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

fn page(report: &Report) -> Result<String> {
    let finding = &report.finding;
    let mut page = Page::new(&format!("catenary find-effects: {}", report.model));
    page.paragraph(&format!("verdict: {}", headline(finding)));
    finding.conclusions.iter().for_each(|c| page.paragraph(c));
    let row = |(i, e): (usize, &Looked)| vec![i.to_string(), e.number.to_string(), e.bag.display().to_string()];
    let rows: Vec<Vec<String>> = report.episodes.iter().enumerate().map(row).collect();
    page.table(&["episode", "number in its bag", "bag"], &rows);
    page.heading("The present model");
    fitness(&mut page, &finding.present)?;
    if let Some(repaired) = &finding.repaired {
        page.heading("The model with the most probable effects");
        fitness(&mut page, repaired)?;
    }
    page.heading("Where they disagree");
    let rows: Vec<Vec<String>> = finding.places.iter().map(place).collect();
    page.table(&["part", "times the noise", "excess, sd", "p (corrected)"], &rows);
    if !finding.explanations.is_empty() {
        page.heading("What explains it");
        let other = |name: &str, probability: f64| {
            let empty = String::new;
            vec![name.to_owned(), empty(), "0.00".into(), format!("{probability:.3}"), empty(), empty()]
        };
        let mut rows = vec![
            other("none of them, and nothing else", finding.probability_of_none),
            other("none of them, but something", finding.probability_of_unknown),
        ];
        rows.extend(finding.explanations.iter().map(|e| {
            let sizes: Vec<String> =
                e.effects.iter().map(|m| format!("{} ± {}", figures(m.value), figures(m.sd))).collect();
            vec![
                e.names(),
                sizes.join(", "),
                format!("{:.2}", e.log_bayes_factor),
                format!("{:.3}", e.probability),
                format!("{:.3}", e.probability_in_part),
                format!("{:.2}", e.cosine_with_best),
            ]
        }));
        page.table(
            &["effects", "values", "log Bayes factor", "probability", "with something else", "cosine with the best"],
            &rows,
        );
    }
    for (name, reason) in &finding.left_out {
        page.paragraph(&format!("{name} was left out: {reason}"));
    }
    Ok(page.finish())
}

/// Values and test of a model: the null sets' statistics as a distribution function, with the measured one.
fn fitness(page: &mut Page, fitness: &Fitness) -> Result<()> {
    let row = |e: &Estimate| vec![e.name.clone(), figures(e.value), figures(e.q05), figures(e.q95)];
    page.table(&["parameter", "best fit", "5 %", "95 %"], &fitness.estimates.iter().map(row).collect::<Vec<_>>());
    let test = &fitness.test;
    page.paragraph(&format!(
        "RMSE {:.1} mm; {} coordinates leave {:.0} squared deviations; p = {:.3}",
        fitness.rmse_mm, test.coordinates, test.statistic, test.p_value
    ));
    let count = test.null.len() as f64;
    let null = test.null.iter().enumerate().map(|(i, t)| (*t, (i as f64 + 1.0) / count)).collect();
    let series = [
        plots::Series { name: "fits of simulated data without a gap".into(), points: null },
        plots::Series { name: "this fit".into(), points: vec![(test.statistic, 0.0), (test.statistic, 1.0)] },
    ];
    page.svg(&plots::lines("what is left after a fit", "squared deviations", "share below", &series)?);
    Ok(())
}

fn place(place: &Place) -> Vec<String> {
    use effect_finder::case::Quantity;
    let part = match place.part {
        Part::Quantity(Quantity::Keypoint { point, axis }) => format!("keypoint {point}, {}", ["x", "y"][axis]),
        Part::Quantity(Quantity::Pose { axis }) => format!("arm, {}", ["x", "z", "pitch"][axis]),
        Part::Window { episode, from_s, to_s } => format!("episode {episode}, {from_s:.2} to {to_s:.2} s"),
    };
    vec![
        part,
        format!("{:.2}", place.mean_square.sqrt()),
        format!("{:.1}", place.excess),
        format!("{:.3}", place.p_value),
    ]
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
    format!("{}\n{} episodes, {:.1} s", headline(&report.finding), report.episodes.len(), report.wall_s)
}
