//! `catenary bench support`: supports of the prior that exclude the truth, with fixed and moving edges.

mod cases;
mod line;
mod report;

use super::args::SupportArgs;
use super::episodes::hidden_episode;
use super::runs::{Inferred, Runs, infer_on_one_core};
use crate::options::Part;
use crate::terminal::output;
use anyhow::{Result, ensure};
use bayes_sim::{PriorSupport, Settings, SupportRule};
use cases::Case;
use catenary_core::seed;
use catenary_shell::Shutdown;
use line::Line;
use report::{Report, words};
use std::time::Instant;

/// Rules that are compared, with their names.
fn rules() -> Vec<(PriorSupport, &'static str)> {
    let moving = SupportRule::ALL.map(|rule| (PriorSupport::Adaptive(rule), rule.name()));
    [(PriorSupport::Fixed, PriorSupport::NAMES[0])].into_iter().chain(moving).collect()
}

/// Infers every case with every rule, unless runs.jsonl holds the run, and prints the figures of each group.
pub fn run(arguments: &SupportArgs) -> Result<()> {
    let cases = cases::all(arguments)?;
    let rules = rules();
    let settings = arguments.sizes.settings();
    // A case meets all rules before the next one: an interrupted benchmark has the figures of all rules.
    let of = |number: usize| (number / rules.len(), rules[number % rules.len()]);
    let path = arguments.out.join("runs.jsonl");
    let runs = Runs { path: &path, part: Part::WHOLE, count: (cases.len() * rules.len()) as u64, name: "runs" };
    let of_these_cases = |line: &Line| {
        let case = cases.get(line.case).filter(|case| case.truth == line.truth && case.group == line.group);
        ensure!(case.is_some(), "expected a run of these options: is the file of another benchmark?");
        Ok(())
    };
    let lines = runs.complete(of_these_cases, |number, shutdown| {
        let (case, (support, rule)) = of(number as usize);
        infer_case(case, &cases[case], (support, rule), &settings, shutdown)
    })?;
    let report = Report::new(&lines);
    output::result(&arguments.output, &report, words)
}

fn infer_case(
    number: usize,
    case: &Case,
    (prior_support, rule): (PriorSupport, &str),
    settings: &Settings,
    shutdown: &Shutdown,
) -> Result<Line> {
    let own = seed::derive(case.seed, 3);
    let measured = hidden_episode(&case.model, &case.truth, case.seed, settings.fidelity)?;
    // The rules move the support by the networks' posterior.
    let settings = Settings { seed: own, prior_support, refine: false, ..settings.clone() };
    let started = Instant::now();
    let Inferred { result, .. } = infer_on_one_core(&case.model, measured, &settings, number as u64, shutdown)?;
    let (stated, used) = (case.model.theta.parameters(), result.posterior.parameters.parameters());
    let marginals = || result.marginals.iter().zip(&case.truth);
    let in_widths = |low: f64, high: f64, axis: usize| {
        let [low, high] = [low, high].map(|v| stated[axis].prior.to_unit(v));
        (high - low).abs()
    };
    Ok(Line {
        case: number,
        group: case.group.to_owned(),
        rule: rule.to_owned(),
        truth: case.truth.clone(),
        beyond: case.beyond.clone(),
        inside_90: marginals().map(|(m, t)| (m.q05..=m.q95).contains(t)).collect(),
        error: marginals().enumerate().map(|(i, (m, t))| in_widths(m.mean, *t, i)).collect(),
        width: marginals().enumerate().map(|(i, (m, _))| in_widths(m.q05, m.q95, i)).collect(),
        absolute: marginals().map(|(m, t)| (m.mean - t).abs()).collect(),
        decades: marginals().map(|(m, t)| (m.mean / t).abs().log10().abs()).collect(),
        held: used.iter().zip(&case.truth).map(|(p, t)| p.prior.holds(*t)).collect(),
        moves: result.iterations.iter().map(|i| i.moves.len()).sum(),
        wall_s: started.elapsed().as_secs_f64(),
    })
}
