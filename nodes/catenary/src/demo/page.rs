//! The demo's report.

use super::summary::{Episode, Summary};
use crate::report::plots::{self, Series};
use crate::report::{Mark, Page, Picture, posterior};
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};

/// Frames of an episode that the timelapse shows.
const FRAMES: usize = 8;

/// Writes `report/index.html` into the demo's folder and returns its path.
pub fn write(folder: &Path, summary: &Summary) -> Result<PathBuf> {
    let mut page = Page::new("catenary: from one recording to a policy");
    overview(&mut page, summary);
    inferred(&mut page, summary)?;
    training(&mut page, summary)?;
    episodes(&mut page, folder, summary)?;
    stages(&mut page, summary);
    let report = folder.join("report");
    std::fs::create_dir_all(&report).with_context(|| report.display().to_string())?;
    let path = report.join("index.html");
    std::fs::write(&path, page.finish()).with_context(|| path.display().to_string())?;
    Ok(path)
}

fn overview(page: &mut Page, summary: &Summary) {
    page.paragraph(&format!(
        "Preset {}, seed {}. A policy pi0 was trained over the prior and run once on the cell; the recording gave the \
         posterior below; pi1 was trained over that posterior and run on the same cell. The hidden values were known to the \
         cell alone and are shown here after the fact.",
        summary.preset, summary.seed
    ));
    for warning in &summary.inference.warnings {
        page.warning(warning);
    }
}

fn inferred(page: &mut Page, summary: &Summary) -> Result<()> {
    let inference = &summary.inference;
    page.heading("Posterior");
    let truth = (summary.truth.len() == inference.marginals.len()).then_some(summary.truth.as_slice());
    if inference.posterior.parameters.dimension() >= 2 {
        for extent in [plots::Extent::Prior, plots::Extent::Posterior] {
            page.svg(&plots::heatmap(&inference.posterior, [0, 1], extent, &inference.domains, truth)?);
        }
    }
    let head = &posterior::HEAD[..if truth.is_some() { 5 } else { 4 }];
    page.table(head, &posterior::rows(&inference.posterior, &inference.marginals, truth));
    page.paragraph(&format!(
        "{} simulations; effective sample size of the last iteration {:.0}; {:.1} % of the mixture outside the prior's support.",
        inference.simulations,
        inference.effective_sample_size,
        100.0 * inference.mass_outside
    ));
    let losses = inference.losses.iter().enumerate().map(|(i, l)| (i as f64 + 1.0, *l)).collect();
    let series = [Series { name: "held-out loss".into(), points: losses }];
    page.svg(&plots::lines("held-out loss of inference", "iteration", "nat", &series)?);
    Ok(())
}

fn training(page: &mut Page, summary: &Summary) -> Result<()> {
    page.heading("Training");
    let series: Vec<Series> = summary
        .training
        .iter()
        .map(|t| Series { name: t.policy.clone(), points: t.curve.iter().map(|(s, r)| (*s as f64, *r)).collect() })
        .collect();
    page.svg(&plots::lines("learning curves", "environment steps", "mean return", &series)?);
    page.paragraph(
        "A success ends an episode, and its rewards with it: where successes come sooner, returns are smaller.",
    );
    Ok(())
}

fn episodes(page: &mut Page, folder: &Path, summary: &Summary) -> Result<()> {
    page.heading("Episodes on the cell");
    let row = |e: &Episode| {
        let best = e.rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let [p50, p99] = e.keypoint_latency_ms;
        vec![
            e.policy.clone(),
            e.end.clone(),
            e.rewards.len().to_string(),
            format!("{:.3}", e.episode_return),
            format!("{best:.3}"),
            format!("{p50:.1} / {p99:.1}"),
            e.bag.clone(),
        ]
    };
    let rows: Vec<Vec<String>> = summary.episodes.iter().map(row).collect();
    page.table(&["policy", "end", "steps", "return", "best reward", "keypoint latency p50 / p99, ms", "bag"], &rows);
    let path =
        |e: &Episode| plots::Path { name: e.policy.clone(), points_m: e.path_m.clone(), rewards: e.rewards.clone() };
    let paths: Vec<plots::Path> = summary.episodes.iter().map(path).collect();
    page.svg(&plots::paths(&paths, summary.target_m)?);
    for e in &summary.episodes {
        page.heading(&format!("What the camera saw: {}", e.policy));
        page.strip(&timelapse(folder, e)?);
    }
    Ok(())
}

/// Frames spread evenly over the episode, the first and the last among them.
fn timelapse(folder: &Path, episode: &Episode) -> Result<Vec<Picture>> {
    let n = episode.frames.len();
    let shown = n.min(FRAMES);
    let index = |i: usize| if shown > 1 { i * (n - 1) / (shown - 1) } else { 0 };
    (0..shown)
        .map(|i| {
            let frame = &episode.frames[index(i)];
            let path = folder.join(&frame.file);
            let png = std::fs::read(&path).with_context(|| path.display().to_string())?;
            let picture = image::load_from_memory(&png).with_context(|| path.display().to_string())?;
            let colour = |k: usize| if k < 4 { "yellow" } else { "black" };
            let marks = frame.marks_px.iter().enumerate().map(|(k, p)| Mark { at_px: *p, colour: colour(k) }).collect();
            Ok(Picture {
                png,
                width_px: picture.width(),
                height_px: picture.height(),
                marks,
                caption: format!("observation {}", frame.step),
            })
        })
        .collect()
}

fn stages(page: &mut Page, summary: &Summary) {
    page.heading("Where the time went");
    let row = |s: &super::summary::Stage| vec![s.name.clone(), format!("{:.1}", s.wall_s), format!("{:.1}", s.cpu_s)];
    let mut rows: Vec<Vec<String>> = summary.stages.iter().map(row).collect();
    let total = |f: fn(&super::summary::Stage) -> f64| summary.stages.iter().map(f).sum::<f64>();
    rows.push(vec!["in all".into(), format!("{:.1}", total(|s| s.wall_s)), format!("{:.1}", total(|s| s.cpu_s))]);
    page.table(&["stage", "wall, s", "processor, s"], &rows);
    for t in &summary.training {
        page.paragraph(&format!("{}: {:.0} environment steps per second.", t.policy, t.steps_per_second));
    }
}
