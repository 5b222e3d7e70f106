//! `catenary effects`: what a model may have beyond the base simulator.

use crate::cli::EffectsArgs;
use crate::simulate::actions;
use crate::{figures::figures, model_file, output};
use anyhow::{Context, Result, ensure};
use catenary_core::model::DriveKind;
use catenary_core::{Model, Prior};
use effect_finder::case::Case;
use effect_finder::detectable::detectable_size;
use effect_finder::fit::Problem;
use effect_finder::unknowns::Unknowns;
use effect_finder::{Candidate, Settings, convert};
use serde::Serialize;
use simulator_pool::effects::{About, Hook, Sign};
use simulator_pool::{BeamSimulator, Registry, workers};
use std::path::Path;

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
    /// How large it must be to show, at 5 %, in four of five episodes like the one asked about; none where nobody asked, the model
    /// has the effect itself, or it stays hidden however large it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    detectable: Option<f64>,
}

impl From<About> for Row {
    fn from(about: About) -> Self {
        let sign = about.sign();
        let About { name, title, description, unit, hook, prior, range } = about;
        Self { name, title, description, unit, hook: hook.name(), sign, prior, range, detectable: None }
    }
}

/// Lists effects; with a model and actions, those that no search offers, too, and how large each must be to show.
pub fn run(arguments: &EffectsArgs) -> Result<()> {
    let registry = if arguments.model.is_some() { &Registry::with_unlisted() } else { Registry::shipped() };
    let known = || registry.effects().map(|e| e.about().name).collect::<Vec<_>>().join(", ");
    for name in &arguments.name {
        ensure!(registry.find(name).is_some(), "--name {name}: expected one of {}", known());
    }
    let is_asked = |a: &About| arguments.name.is_empty() || arguments.name.iter().any(|n| n == a.name);
    let asked: Vec<About> = registry.effects().map(|e| e.about()).filter(is_asked).collect();
    let rows: Vec<Row> = match (&arguments.model, &arguments.actions) {
        (Some(model), Some(actions)) => sized(asked, registry, &model_file::read(model)?, actions, &arguments.value)?,
        _ => asked.into_iter().map(Row::from).collect(),
    };
    let is_sized = arguments.model.is_some();
    output::result(&arguments.output, &rows, |rows| {
        let width = |text: fn(&Row) -> usize| rows.iter().map(text).max().unwrap_or(0);
        let (names, units) = (width(|r| r.name.len()), width(|r| r.unit.len()));
        let shows = |text: String| if is_sized { format!("{text:<11}  ") } else { String::new() };
        let line = |r: &Row| {
            let prior = r.prior.to_string();
            let size = shows(r.detectable.map_or("-".into(), figures));
            format!("{:<names$}  {:<units$}  {:<11}  {prior:<27}  {size}{}", r.name, r.unit, r.hook, r.description)
        };
        let (name, unit, size) = ("name", "unit", shows("shows from".into()));
        let head =
            format!("{name:<names$}  {unit:<units$}  {:<11}  {:<27}  {size}what more of it does", "hook", "prior");
        std::iter::once(head).chain(rows.iter().map(line)).collect::<Vec<_>>().join("\n")
    })
}

/// How large each effect must be to show in an episode of these actions.
fn sized(
    asked: Vec<About>,
    registry: &Registry,
    model: &Model,
    actions: &Path,
    values: &[(String, f64)],
) -> Result<Vec<Row>> {
    let name = actions.display().to_string();
    let text = std::fs::read_to_string(actions).with_context(|| format!("actions {name}"))?;
    let settings = Settings::default();
    let cases = [Case::planned(model, &actions::read(&name, &text)?, &settings)];
    let unknowns = Unknowns::of(model, 1);
    let mut point = vec![0.5; unknowns.columns()];
    for (place, (parameter, value)) in model.theta.parameters().iter().zip(model.nominal_theta()).enumerate() {
        point[place] = parameter.prior.to_unit(value);
    }
    for (name, value) in values {
        let known = || unknowns.names().join(", ");
        let place = unknowns.list().iter().position(|u| u.name == *name);
        let place = place.with_context(|| format!("--value {name}: expected one of {}", known()))?;
        let u = unknowns.list()[place].prior.to_unit(*value);
        ensure!((0.0..=1.0).contains(&u), "--value {name}: expected {}, got {value}", unknowns.list()[place].prior);
        point[unknowns.column(place, 0)] = u;
    }
    let simulator = BeamSimulator::with_effects(model, registry, workers::available())?;
    let problem = Problem::of(model, &cases, &simulator, settings.rounds);
    let candidates = convert::candidates(registry, model)?;
    let row = |about: About| {
        // A measured path tells what the arm has done, whatever it was asked for.
        let is_seen = about.hook != Hook::Actuation || model.observation.drive != DriveKind::Grip;
        let own: Option<&Candidate> = candidates.iter().find(|c| c.name == about.name && is_seen);
        let detectable = own.map(|c| detectable_size(&problem, &point, c)).transpose()?.flatten();
        Ok(Row { detectable, ..Row::from(about) })
    };
    asked.into_iter().map(row).collect()
}
