//! HTML report of the demo.

use super::story::{REPEATS, training_words};
use super::summary::{Episode, Summary};
use crate::evaluate::score::Evaluated;
use crate::exit::Misfit;
use crate::report::Estimate;
use crate::report::plots::Series;
use crate::report::quantity::Quantity;
use crate::report::{Mark, Page, Picture, plots, posterior};
use anyhow::{Context, Result};
use base64::Engine;
use catenary_core::posterior::Marginal;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use std::path::{Path, PathBuf};

/// Frames of an episode in the timelapse.
const FRAMES: usize = 8;

/// Width of a still in the page, pixels: twice its displayed width, for high-density displays.
const STILL_WIDTH_PX: u32 = 400;
const STILL_QUALITY: u8 = 75;
/// Style of the answer at the top: two columns, which stay side by side on a telephone.
const STYLE: &str = "<style>.film{width:100%;height:auto;border-radius:4px}.answer{display:grid;grid-template-columns:1fr 1fr;\
gap:8px;margin:.3em 0 1em}.answer b{font-size:1.5em;display:block}.answer small{color:#555}</style>";

/// Writes `report/index.html` into the demo's folder and returns its path.
pub fn write(folder: &Path, summary: &Summary) -> Result<PathBuf> {
    let mut page = Page::new(&summary.headline());
    answer(&mut page, folder, summary)?;
    method(&mut page, summary);
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

/// Looping GIF, and below each half the result of its policy.
fn answer(page: &mut Page, folder: &Path, summary: &Summary) -> Result<()> {
    let path = folder.join(&summary.film);
    let gif = std::fs::read(&path).with_context(|| path.display().to_string())?;
    let data = base64::engine::general_purpose::STANDARD.encode(gif);
    let alt =
        "Both episodes side by side: the arm swings a blue bar towards a red target, pi0 on the left, pi1 on the right";
    let column = |(episode, scored): (&Episode, &Evaluated)| {
        let hits = scored.successes.iter().filter(|s| **s).count();
        format!(
            "<div><b>{hits} of {} succeed</b>{}, {}<br><small>interval of 95 %: {}; in the picture: {}</small></div>",
            scored.successes.len(),
            episode.policy,
            training_words(&episode.policy),
            percent_range(&scored.success_rate),
            summary.outcome(episode)
        )
    };
    let columns: String = summary.episodes.iter().zip(&summary.evaluation.policies).map(column).collect();
    page.svg(&format!(
        "<div>{STYLE}<img class=\"film\" alt=\"{alt}\" src=\"data:image/gif;base64,{data}\"><div class=\"answer\">{columns}</div></div>"
    ));
    page.paragraph(&summary.aim());
    let row = |(m, truth): (&Marginal, &f64)| {
        let quantity = Quantity::of(&m.name);
        let [hidden, median, low, high] = [*truth, m.median, m.q05, m.q95].map(|v| quantity.brief(v));
        vec![quantity.title, hidden, median, format!("{low} to {high}")]
    };
    let rows: Vec<Vec<String>> = summary.inference.marginals.iter().zip(&summary.truth).map(row).collect();
    page.table(&["", "hidden", "found", "with 90 %"], &rows);
    summary.of_the_arm().iter().for_each(|text| page.paragraph(text));
    summary.inference.misfit.iter().for_each(|reason| page.warning(&Misfit::headline(reason)));
    for warning in &summary.inference.warnings {
        page.warning(warning);
    }
    Ok(())
}

/// Interval in percent, as "low to high %".
fn percent_range(share: &Estimate) -> String {
    format!("{:.0} to {:.0} %", 100.0 * share.low, 100.0 * share.high)
}

/// Section on the method and on the reliability of the answer.
fn method(page: &mut Page, summary: &Summary) {
    page.heading("Method");
    page.paragraph(
        "pi0 was trained in simulation over every bar that the prior allows and run once on the cell. The recording of that \
         episode gave the posterior. pi1 was trained over the posterior with as many steps and run on the same cell. The hidden \
         values were known to the cell's process alone; inference and training never saw them.",
    );
    let evaluation = &summary.evaluation;
    let difference = evaluation.policies.last().and_then(|e| Some((e.success_gained?, e.mean_return_gained?)));
    if let Some((success, mean_return)) = difference {
        page.paragraph(&format!(
            "One episode may be luck. Both policies were therefore scored on the same {} simulated episodes of the hidden bar \
             ({} fidelity), with camera noise, damping and friction drawn anew in each. pi1 minus pi0: success {} points, return {}. \
             Brackets are intervals of 95 % (Wilson for shares, paired for differences).",
            evaluation.episodes,
            evaluation.fidelity.name(),
            success.words(100.0, 0),
            mean_return.words(1.0, 2)
        ));
    }
    let row = |e: &Evaluated| {
        vec![
            e.policy.with_extension("").display().to_string(),
            format!("{} %", e.success_rate.words(100.0, 0)),
            e.mean_return.words(1.0, 2),
            format!("{:.0} mm", 1e3 * e.median_distance_m()),
        ]
    };
    let rows: Vec<Vec<String>> = evaluation.policies.iter().map(row).collect();
    page.table(&["policy", "success", "return", "median distance"], &rows);
    page.paragraph(&format!("Preset {}, seed {}. {REPEATS}", summary.preset.name(), summary.seed));
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
    if summary.task.ends_at_success {
        page.paragraph(
            "A success ends an episode, and its rewards with it: where successes come sooner, returns are smaller.",
        );
    }
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
    page.svg(&plots::paths(&paths, summary.task.target_m)?);
    for e in &summary.episodes {
        page.heading(&format!("Camera frames: {}", e.policy));
        page.strip(&timelapse(folder, e)?);
    }
    Ok(())
}

/// Frames spread evenly over the episode, including the first and the last.
fn timelapse(folder: &Path, episode: &Episode) -> Result<Vec<Picture>> {
    let n = episode.frames.len();
    let shown = n.min(FRAMES);
    let index = |i: usize| if shown > 1 { i * (n - 1) / (shown - 1) } else { 0 };
    (0..shown)
        .map(|i| {
            let frame = &episode.frames[index(i)];
            let path = folder.join(&frame.file);
            let picture = image::open(&path).with_context(|| path.display().to_string())?.to_rgb8();
            // The first four marks are the object's keypoints, the fifth is the target.
            let colour = |k: usize| if k < 4 { "yellow" } else { "black" };
            let marks = frame.marks_px.iter().enumerate().map(|(k, p)| Mark { at_px: *p, colour: colour(k) }).collect();
            Ok(Picture {
                jpeg: still(&picture)?,
                width_px: picture.width(),
                height_px: picture.height(),
                marks,
                caption: format!("observation {}", frame.step),
            })
        })
        .collect()
}

/// Encodes the picture as a small JPEG.
fn still(picture: &image::RgbImage) -> Result<Vec<u8>> {
    let width = STILL_WIDTH_PX.min(picture.width());
    let height = (picture.height() * width / picture.width()).max(1);
    let small = image::imageops::resize(picture, width, height, FilterType::Triangle);
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, STILL_QUALITY).encode_image(&small)?;
    Ok(jpeg)
}

fn stages(page: &mut Page, summary: &Summary) {
    page.heading("Time by stage");
    let row = |s: &super::summary::Stage| vec![s.name.clone(), format!("{:.1}", s.wall_s), format!("{:.1}", s.cpu_s)];
    let mut rows: Vec<Vec<String>> = summary.stages.iter().map(row).collect();
    let total = |f: fn(&super::summary::Stage) -> f64| summary.stages.iter().map(f).sum::<f64>();
    rows.push(vec!["in all".into(), format!("{:.1}", total(|s| s.wall_s)), format!("{:.1}", total(|s| s.cpu_s))]);
    page.table(&["stage", "wall, s", "processor, s"], &rows);
    for t in &summary.training {
        page.paragraph(&format!("{}: {:.0} environment steps per second.", t.policy, t.steps_per_second));
    }
}
