//! `catenary effects`: what a model may have beyond the base simulator.

use crate::cli::EffectsArgs;
use crate::output;
use anyhow::Result;
use catenary_core::Prior;
use serde::Serialize;
use simulator_pool::Registry;
use simulator_pool::effects::{About, Sign};

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
}

impl From<About> for Row {
    fn from(about: About) -> Self {
        let sign = about.sign();
        let About { name, title, description, unit, hook, prior, range } = about;
        Self { name, title, description, unit, hook: hook.name(), sign, prior, range }
    }
}

/// Lists the effects.
pub fn run(arguments: &EffectsArgs) -> Result<()> {
    let rows: Vec<Row> = Registry::shipped().effects().map(|e| e.about().into()).collect();
    output::result(&arguments.output, &rows, |rows| {
        let width = |text: fn(&Row) -> usize| rows.iter().map(text).max().unwrap_or(0);
        let (names, units) = (width(|r| r.name.len()), width(|r| r.unit.len()));
        let line = |r: &Row| {
            let prior = r.prior.to_string();
            format!("{:<names$}  {:<units$}  {:<11}  {prior:<27}  {}", r.name, r.unit, r.hook, r.description)
        };
        let head =
            format!("{:<names$}  {:<units$}  {:<11}  {:<27}  what more of it does", "name", "unit", "hook", "prior");
        std::iter::once(head).chain(rows.iter().map(line)).collect::<Vec<_>>().join("\n")
    })
}
