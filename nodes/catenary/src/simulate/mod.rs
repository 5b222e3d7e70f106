//! `catenary simulate`: one episode of a model, as figures, a bag, a video or a picture.

pub mod args;
mod eyes;
mod picture;
mod player;
mod recording;
mod show;
mod staged;
mod summary;
mod timeline;
pub mod video;

pub use video::GifFile;

use crate::exit::{Given, Interrupted, WrongInput};
use crate::inputs::{actions_file, model_file, parameter_values};
use crate::terminal::{output, progress};
use anyhow::{Context, Result};
use args::SimulateArgs;
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use catenary_core::model::Effect;
use catenary_shell::{Shutdown, files};
use catenary_simulator::Registry;
use eyes::Eyes;
use indicatif::ProgressBar;
use picture::Sheet;
use player::{Motion, Player, Setting};
use recording::{Facts, Recording};
use show::{Show, Sinks};
use simulated_cell::render::Renderer;
use staged::{Staged, with_final_names};
use std::path::{Path, PathBuf};
use summary::{Episode, Report};
use video::Video;

/// Standard deviation of the sensor noise in grey levels: that of a RealSense indoors.
const IMAGE_NOISE: f64 = 3.0;

/// Plays the episode of each model and writes the requested files. Ctrl-C ends it without leaving a file.
pub fn run(arguments: &SimulateArgs) -> Result<()> {
    let report = play(arguments).map_err(|error| {
        let outputs = [&arguments.out, &arguments.video, &arguments.picture].into_iter().flatten();
        let shown: Vec<(&Path, String)> = outputs.map(|path| (path.as_path(), path.display().to_string())).collect();
        let places: Vec<(&Path, &str)> = shown.iter().map(|(path, shown)| (*path, shown.as_str())).collect();
        with_final_names(error, &places)
    })?;
    output::result(&arguments.output, &report, Report::words)
}

fn play(arguments: &SimulateArgs) -> Result<Report> {
    let models = arguments.model.iter().map(|path| model_file::read(path)).collect::<Result<Vec<Model>>>()?;
    let fidelity = arguments.fidelity.0;
    let single = [("out", &arguments.out), ("video", &arguments.video)].into_iter().find(|(_, path)| path.is_some());
    for path in [&arguments.video, &arguments.picture].into_iter().flatten() {
        output::prepare(path)?;
    }
    if let (Some((option, _)), true) = (single, models.len() > 1) {
        let got = models.len();
        return Err(WrongInput::error(format!(
            "--{option}: expected one --model, got {got}: several go into a --picture"
        )));
    }
    let shows =
        arguments.images || arguments.eyes.is_some() || arguments.video.is_some() || arguments.picture.is_some();
    if arguments.laboratory.is_some() && !shows {
        return Err(WrongInput::error("--laboratory: expected --images, --eyes, --video or --picture, which show it"));
    }
    let shutdown = Shutdown::new();
    catenary_shell::end_on_signals(&shutdown)?;
    let motion = |(path, model): (&PathBuf, &Model)| motion(arguments, path, model);
    let motions = arguments.model.iter().zip(&models).map(motion).collect::<Result<Vec<Motion>>>().given()?;
    let settings = models.iter().map(|model| setting(arguments, model)).collect::<Result<Vec<Setting>>>().given()?;
    let bar = ProgressBar::new(motions.iter().map(|m| (1e3 * m.duration_s()) as u64).sum());
    bar.set_style(progress::style("simulation [{bar:24}]", 0.0)?);
    let mut sheet = arguments.picture.as_ref().map(|_| Sheet::default());
    let mut report = Report::default();
    let source = [&arguments.track, &arguments.actions].into_iter().flatten().next();
    let source = source.map_or_else(String::new, |path| path.display().to_string());
    for ((model, motion), setting) in models.iter().zip(&motions).zip(&settings) {
        bar.set_message(model.name.clone());
        let player = Player::new(model, motion, setting, fidelity).with_context(|| format!("model `{}`", model.name));
        let player = player.given()?;
        let mut sinks = open(arguments, model, motion, &player).given()?;
        sinks.sheet = sheet.take();
        let episode = Episode::new(model, setting, fidelity);
        let mut show = Show::new(model, motion, player, sinks, episode, arguments.laboratory);
        let mut passed_ms = 0;
        for (at_ns, tick) in timeline::ticks(motion, &show.rates(arguments)).context(source.clone()).given()? {
            if shutdown.is_triggered() {
                return Err(Interrupted::lost(format!("{passed_ms} of {} ms", bar.length().unwrap_or(0))).into());
            }
            show.tick(at_ns, tick)?;
            let now_ms = (at_ns / 1_000_000) as u64;
            bar.inc(now_ms - passed_ms);
            passed_ms = now_ms;
        }
        let (episode, sinks) = show.finish();
        report.episodes.push(episode);
        if let Some((staged, recording)) = sinks.recording {
            report.messages = recording.finish("complete")?.messages;
            report.bag = Some(staged.commit()?);
        }
        if let Some((staged, video)) = sinks.video {
            video.finish()?;
            report.video = Some(staged.commit()?);
        }
        sheet = sinks.sheet;
    }
    bar.finish_and_clear();
    if let (Some(path), Some(sheet)) = (&arguments.picture, sheet) {
        let staged = Staged::new(path)?;
        files::write(&staged.path(), sheet.png()?)?;
        report.picture = Some(staged.commit()?);
    }
    Ok(report)
}

/// Motion of the clamped end, from `--actions` or `--track`.
fn motion(arguments: &SimulateArgs, file: &Path, model: &Model) -> Result<Motion> {
    if let Some(path) = &arguments.track {
        return Ok(Motion::Measured(Box::new(measured(path, model)?)));
    }
    let path = arguments.actions.as_ref().context("no motion of the object: give --actions or --track")?;
    let task = model.task.with_context(|| {
        let what = "it has no task, which says how long an action lasts: expected --track in place of --actions";
        format!("model {}: {what}", file.display())
    })?;
    let name = path.display().to_string();
    let text = files::read_text("actions", path)?;
    Ok(Motion::Actions { task, actions: actions_file::read(&name, &text)? })
}

/// Measured track from a CSV file or a bag.
fn measured(path: &Path, model: &Model) -> Result<MeasuredTrack> {
    if path.is_dir() || path.extension().is_some_and(|e| e == "mcap" || e == "db3") {
        return last_measured(path.to_owned(), model);
    }
    let name = path.display().to_string();
    let text = files::read_text("track", path)?;
    // A CSV track becomes a bag first, so that both kinds are read by the same code.
    let place = std::env::temp_dir().join("catenary_track");
    let staged = Staged::new(&place)?;
    let imported = catenary_bag::import_track(&name, &text, model, &staged.path())?;
    imported.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    last_measured(staged.path(), model).map_err(|error| with_final_names(error, &[(&place, &name)]))
}

/// Last complete episode of a bag.
fn last_measured(bag: PathBuf, model: &Model) -> Result<MeasuredTrack> {
    let measured = catenary_bag::read_measured(&[bag], &[], model)?.remove(0);
    measured.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    Ok(measured)
}

/// Parameters of the object: the values of the command line, else the model's nominal ones, else the medians of the
/// priors. With noise, effects without a given value are drawn.
fn setting(arguments: &SimulateArgs, model: &Model) -> Result<Setting> {
    let mut values = model.nominal_theta();
    for (name, value) in &arguments.theta {
        values[parameter_values::place_of(name, *value, model)?] = *value;
    }
    let usual =
        |e: &Effect| model.nominal.get(&e.name).copied().or((!arguments.noise).then(|| e.distribution.from_unit(0.5)));
    let mut given: Vec<(String, f64)> =
        model.effects.iter().filter_map(|e| Some((e.name.clone(), usual(e)?))).collect();
    let registry = Registry::complete();
    for (name, value) in &arguments.effect {
        parameter_values::check_effect(name, *value, model, &registry)?;
        given.retain(|(known, _)| known != name);
        given.push((name.clone(), *value));
    }
    Ok(Setting { theta: values, given, seed: arguments.seed, noise: arguments.noise })
}

/// Opens the outputs of the episode, except the picture of moments.
fn open(arguments: &SimulateArgs, model: &Model, motion: &Motion, player: &Player<'_>) -> Result<Sinks> {
    let camera = player.camera();
    let size = [camera.image_width_px, camera.image_height_px];
    let video = match &arguments.video {
        None => None,
        Some(path) => {
            let staged = Staged::new(path)?;
            let video = Video::create(&staged.path(), path, size, arguments.video_rate)?;
            Some((staged, video))
        }
    };
    let recording = match &arguments.out {
        None => None,
        Some(path) => {
            // A bag is never overwritten: it may hold the only recording of an experiment.
            if path.exists() {
                let expected = "expected a folder that does not exist yet";
                return Err(WrongInput::error(format!("--out {}: {expected}", path.display())));
            }
            let acts = matches!(motion, Motion::Actions { .. });
            let facts = Facts::of(model, acts, arguments.seed, arguments.noise, arguments.eyes.is_some());
            let staged = Staged::new(path)?;
            let recording = Recording::create(&staged.path(), facts, arguments.images)?;
            Some((staged, recording))
        }
    };
    let noise = if arguments.noise { IMAGE_NOISE } else { 0.0 };
    let renderer = |noise| Renderer::new(size[0], size[1], noise, arguments.seed).in_laboratory(arguments.laboratory);
    let eyes = arguments.eyes.as_deref().map(|file| Eyes::new(file, arguments.images, model)).transpose()?;
    Ok(Sinks {
        recording,
        pictures: (arguments.images || eyes.is_some()).then(|| renderer(noise)),
        eyes,
        frames: video.is_some().then(|| renderer(0.0)),
        video,
        sheet: None,
    })
}
