//! `catenary effects`: list of the effects that a model may have beyond the base simulator.

pub mod args;

use crate::exit::{Given, WrongInput};
use crate::inputs::{actions_file, model_file};
use crate::report::number::figures;
use crate::terminal::output;
use anyhow::{Context, Result};
use args::EffectsArgs;
use catenary_core::model::DriveKind;
use catenary_core::spelling::did_you_mean;
use catenary_core::{Model, Prior};
use catenary_simulator::effects::{About, Effect, Hook, Sign, replaced};
use catenary_simulator::{BeamSimulator, Registry, workers};
use effect_finder::node::convert;
use effect_finder::report::detectable_size;
use effect_finder::{Candidate, Settings};
use serde::Serialize;
use std::path::Path;
use track_fit::data::{MeasuredEpisode, Unknowns};
use track_fit::fitting::Problem;

#[derive(Debug, Serialize)]
struct Row {
    name: &'static str,
    title: &'static str,
    description: &'static str,
    unit: &'static str,
    hook: &'static str,
    sign: Sign,
    prior: Prior,
    range: [f64; 2],
    /// Names of the effects that set where, how fast or from which size on it acts.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    companions: Vec<&'static str>,
    /// Smallest size that shows at the 5 % level in four of five such episodes. `None` if no episode was given, if the
    /// model has the effect already, or if no size shows.
    #[serde(skip_serializing_if = "Option::is_none")]
    detectable: Option<f64>,
}

impl From<&dyn Effect> for Row {
    fn from(effect: &dyn Effect) -> Self {
        let about = effect.about();
        let (sign, companions) = (about.sign(), effect.companions().to_vec());
        let About { name, title, description, unit, hook, prior, range } = about;
        Self { name, title, description, unit, hook: hook.name(), sign, prior, range, companions, detectable: None }
    }
}

/// Lists the effects. With a model and actions, the list includes unlisted effects and the smallest detectable size of
/// each.
pub fn run(arguments: &EffectsArgs) -> Result<()> {
    // Effects that no search offers still have a detectable size.
    let model = arguments.model.as_deref().map(model_file::read).transpose()?;
    let registry = &match &model {
        Some(model) => Registry::with_unlisted().with_expressions(model)?,
        None => Registry::shipped().clone(),
    };
    let known: Vec<&str> = registry.effects().map(|e| e.about().name).collect();
    if let Some(name) = arguments.name.iter().find(|name| registry.find(name).is_none()) {
        if let Some((_, by)) = replaced(name) {
            return Err(WrongInput::error(format!("--name {name}: it is no more: expected {by}")));
        }
        let hint = did_you_mean(name, known.iter().copied());
        return Err(WrongInput::error(format!("--name {name}: expected one of {}{hint}", known.join(", "))));
    }
    // A companion does nothing alone, so that it is listed only by its name.
    let is_asked = |name: &str| match arguments.name.as_slice() {
        [] => !registry.is_companion(name),
        names => names.iter().any(|n| n == name),
    };
    let asked: Vec<&dyn Effect> = registry.effects().filter(|e| is_asked(e.about().name)).collect();
    let rows: Vec<Row> = match (&model, &arguments.actions) {
        (Some(model), Some(actions)) => sized(asked, registry, model, actions, &arguments.value)?,
        _ => asked.into_iter().map(Row::from).collect(),
    };
    let is_sized = arguments.model.is_some();
    output::result(&arguments.output, &rows, |rows| words(rows, is_sized))
}

/// Text for the terminal: a header, and for each effect a line with its description below.
fn words(rows: &[Row], is_sized: bool) -> String {
    const WIDTH: usize = 80;
    const INDENT: &str = "    ";
    let width = |text: fn(&Row) -> usize| rows.iter().map(text).max().unwrap_or(0).max("name".len());
    let (names, units) = (width(|r| r.name.len()), width(|r| r.unit.len()));
    let entry = |r: &Row| {
        let head = format!("{:<names$}  {:<units$}  {:<11}  {}", r.name, r.unit, r.hook, r.prior);
        let size = format!("shows from {}; ", r.detectable.map_or("no size".into(), figures));
        let size = if is_sized { size } else { String::new() };
        let below = output::wrapped(&format!("{size}{}", r.description), WIDTH - INDENT.len());
        std::iter::once(head).chain(below.iter().map(|line| format!("{INDENT}{line}"))).collect::<Vec<_>>().join("\n")
    };
    let head = format!("{:<names$}  {:<units$}  {:<11}  prior\n{INDENT}what more of it does", "name", "unit", "hook");
    std::iter::once(head).chain(rows.iter().map(entry)).collect::<Vec<_>>().join("\n")
}

/// Smallest detectable size of each effect in an episode of these actions.
fn sized(
    asked: Vec<&dyn Effect>,
    registry: &Registry,
    model: &Model,
    actions: &Path,
    values: &[(String, f64)],
) -> Result<Vec<Row>> {
    let name = actions.display().to_string();
    let text = catenary_shell::files::read_text("actions", actions).given()?;
    // Companions are no unknowns of the model: it fixes them.
    let (companions, values): (Vec<_>, Vec<_>) = values.iter().partition(|(name, _)| registry.is_companion(name));
    let mut model = model.clone();
    model.parameters.extend(companions.into_iter().cloned());
    // Each effect has a size here, those too that searches offer only to a model that expects them.
    for effect in registry.effects().filter(|e| !e.is_offered_unasked()) {
        model.lacking.prior_odds.entry(effect.about().name.to_owned()).or_insert(1.0);
    }
    let model = &model;
    let settings = Settings::default();
    let episodes = [MeasuredEpisode::planned(model, &actions_file::read(&name, &text).given()?, &settings.of_fits())];
    let unknowns = Unknowns::of(model, 1);
    // Medians of all priors, before nominal and given values replace them.
    let mut point = vec![0.5; unknowns.columns()];
    for (place, (parameter, value)) in model.theta.parameters().iter().zip(model.nominal_theta()).enumerate() {
        point[place] = parameter.prior.to_unit(value);
    }
    for (name, value) in values {
        let names = unknowns.names();
        let place = unknowns.list().iter().position(|u| u.name == *name).with_context(|| {
            let hint = did_you_mean(name, names.iter().copied());
            format!("--value {name}: expected one of {}{hint}", names.join(", "))
        });
        let place = place.given()?;
        let prior = &unknowns.list()[place].prior;
        let u = prior.to_unit(*value);
        if !(0.0..=1.0).contains(&u) {
            return Err(WrongInput::error(format!("--value {name}: expected {prior}, got {value}")));
        }
        point[unknowns.column(place, 0)] = u;
    }
    let simulator = BeamSimulator::with_effects(model, registry, workers::available())?;
    let problem = Problem::of(model, &episodes, &simulator, settings.rounds);
    let candidates = convert::candidates(registry, model)?;
    let row = |effect: &dyn Effect| {
        let about = effect.about();
        // A measured path already contains the arm's deviation from its commands, so that actuation effects cannot
        // show.
        let is_seen = about.hook != Hook::Actuation || model.observation.drive != DriveKind::Grip;
        let own: Option<&Candidate> = candidates.iter().find(|c| c.name == about.name && is_seen);
        let detectable = own.map(|c| detectable_size(&problem, &point, c)).transpose()?.flatten();
        Ok(Row { detectable, ..Row::from(effect) })
    };
    asked.into_iter().map(row).collect()
}
