//! HTML report of the demo.

use super::config::MODEL;
use super::story::{repeats, training_words};
use super::summary::{Episode, Inference, Progress, Stage, Summary, Training};
use crate::evaluate::score::Evaluated;
use crate::exit::Misfit;
use crate::options::Preset;
use crate::report::Estimate;
use crate::report::plots::Series;
use crate::report::quantity::{Quantity, titled};
use crate::report::{Mark, Page, Picture, RecordedFit, plots, posterior};
use anyhow::{Context, Result};
use base64::Engine;
use catenary_bag::read_measured;
use catenary_core::Model;
use catenary_core::posterior::Marginal;
use catenary_shell::files;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use std::path::{Path, PathBuf};

/// Frames of an episode in the timelapse.
const FRAMES: usize = 8;

/// Width of a still in the page, pixels: twice its displayed width, for high-density displays.
const STILL_WIDTH_PX: u32 = 400;
const STILL_QUALITY: u8 = 75;
/// Writes `report/index.html` into the demo's folder and returns its path.
pub fn write(folder: &Path, summary: &Summary) -> Result<PathBuf> {
    let mut page = Page::new(&summary.headline());
    answer(&mut page, folder, summary)?;
    method(&mut page, summary);
    let is_known = summary.truth.len() == summary.inference.marginals.len();
    over_one_another(&mut page, folder, &summary.inference, summary.episodes.first());
    inferred(&mut page, &summary.inference, is_known.then_some(summary.truth.as_slice()))?;
    training(&mut page, &summary.training)?;
    if summary.task.ends_at_success {
        page.paragraph(
            "A success ends an episode, and its rewards with it: where successes come sooner, returns are smaller.",
        );
    }
    episodes(&mut page, folder, summary)?;
    stages(&mut page, &summary.stages, &summary.training);
    save(folder, page)
}

/// Writes the report of a demo that stopped before its end: the error, and the stages so far. Returns its path.
pub fn write_stopped(folder: &Path, progress: &Progress, done: &[Stage], error: &str) -> Result<PathBuf> {
    let mut page = Page::new("Demo, not finished");
    let how = "Finished stages are kept: the same command goes on from here.".to_owned();
    page.answer(&[format!("Stopped: {error}"), how], true);
    if let Some(inference) = &progress.inference {
        // The hidden values are told with the whole answer alone.
        over_one_another(&mut page, folder, inference, progress.episodes.first());
        inferred(&mut page, inference, None)?;
    }
    if !progress.training.is_empty() {
        training(&mut page, &progress.training)?;
    }
    for episode in &progress.episodes {
        page.heading(&format!("Camera frames: {}", episode.policy));
        page.strip(&timelapse(folder, episode)?);
    }
    stages(&mut page, done, &progress.training);
    save(folder, page)
}

fn save(folder: &Path, page: Page) -> Result<PathBuf> {
    let report = folder.join("report");
    std::fs::create_dir_all(&report).with_context(|| report.display().to_string())?;
    let path = report.join("index.html");
    files::write(&path, page.finish())?;
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
    page.wide(&format!(
        "<div><img class=\"film\" alt=\"{alt}\" src=\"data:image/gif;base64,{data}\"><div class=\"pair\">{columns}</div></div>"
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
    let misfit = summary.inference.misfit.iter().map(|reason| Misfit::headline(reason));
    page.warnings(&misfit.chain(summary.inference.warnings.iter().map(|text| titled(text))).collect::<Vec<String>>());
    Ok(())
}

/// Interval in percent, as "low to high %".
fn percent_range(share: &Estimate) -> String {
    format!("{:.0} to {:.0} %", 100.0 * share.low, 100.0 * share.high)
}

/// Section on the method and on the reliability of the answer.
fn method(page: &mut Page, summary: &Summary) {
    page.heading("Method");
    // The sizes of the paper have the trainer of the paper.
    let of_training = match summary.preset {
        Preset::Default => {
            " Each training began with the best plan that a search found over its bars, and ended when its return had stopped rising."
        }
        Preset::Paper => "",
    };
    page.paragraph(&format!(
        "pi0 was trained in simulation over every bar that the prior allows and run once on the cell. The recording of that \
         episode gave the posterior. pi1 was trained over the posterior and run on the same cell. The hidden \
         values were known to the cell's process alone; inference and training never saw them.{of_training} The best plan for the hidden bar \
         itself, which the search was told, shows what can be reached without feedback.",
    ));
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
    let rows: Vec<Vec<String>> = evaluation.policies.iter().chain(&evaluation.best_plan).map(row).collect();
    page.table(&["policy", "success", "return", "median distance"], &rows);
    page.paragraph(&format!("Preset {}, seed {}. {}", summary.preset.name(), summary.seed, repeats(summary.cell)));
}

/// Recording of the first episode, and the model at what was found from it. Without the bag the section is left out.
fn over_one_another(page: &mut Page, folder: &Path, inference: &Inference, episode: Option<&Episode>) {
    let (Ok(model), Some(episode)) = (Model::from_yaml(MODEL), episode) else { return };
    let Ok(measured) = read_measured(&[folder.join(&episode.bag)], &[], &model) else { return };
    let fits = RecordedFit::at_medians(&model, &measured, None, &inference.marginals);
    if fits.is_empty() {
        return;
    }
    page.heading("Recording and fit");
    page.note(
        "Keypoints of the bar in the picture of the camera: recorded, and simulated with what was found. The slider begins where they differ most.",
    );
    fits.iter().for_each(|fit| page.svg(&fit.figure()));
}

fn inferred(page: &mut Page, inference: &Inference, truth: Option<&[f64]>) -> Result<()> {
    page.heading("Posterior");
    if inference.posterior.parameters.dimension() >= 2 {
        page.wide(&plots::corner(&inference.posterior, &inference.domains, truth)?);
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
    page.svg(&plots::lines("Held-out loss of inference", "iteration", "nat", &series)?);
    Ok(())
}

fn training(page: &mut Page, trainings: &[Training]) -> Result<()> {
    page.heading("Training");
    let series: Vec<Series> = trainings
        .iter()
        .map(|t| Series { name: t.policy.clone(), points: t.curve.iter().map(|(s, r)| (*s as f64, *r)).collect() })
        .collect();
    page.svg(&plots::lines("Learning curves", "environment steps", "mean return", &series)?);
    Ok(())
}

fn episodes(page: &mut Page, folder: &Path, summary: &Summary) -> Result<()> {
    page.heading("Episodes on the cell");
    let row = |e: &Episode| {
        let best = e.rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let [p50, p99] = e.keypoint_latency_ms;
        vec![
            e.policy.clone(),
            e.end.replace('_', " "),
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

fn stages(page: &mut Page, done: &[Stage], trainings: &[Training]) {
    page.heading("Time by stage");
    let row = |s: &Stage| vec![s.name.clone(), format!("{:.1}", s.wall_s), format!("{:.1}", s.cpu_s)];
    let mut rows: Vec<Vec<String>> = done.iter().map(row).collect();
    let total = |f: fn(&Stage) -> f64| done.iter().map(f).sum::<f64>();
    rows.push(vec!["in all".into(), format!("{:.1}", total(|s| s.wall_s)), format!("{:.1}", total(|s| s.cpu_s))]);
    page.table(&["stage", "wall, s", "processor, s"], &rows);
    for t in trainings {
        page.paragraph(&format!("{}: {:.0} environment steps per second.", t.policy, t.steps_per_second));
    }
}
