//! `catenary bench fidelity`: verification of the simulator against closed-form solutions, for each fidelity.

use super::args::FidelityArgs;
use crate::inputs::model_file;
use crate::report::number::figures;
use crate::terminal::{output, progress};
use anyhow::{Result, ensure};
use catenary_core::Fidelity;
use catenary_simulator::Registry;
use catenary_simulator::verification::{self, ConvergenceOrder, Row, Stress, StressReport, default_extremes};
use catenary_simulator::workers;
use indicatif::ProgressBar;
use serde::Serialize;

/// Seed of the random episodes.
const SEED: u64 = 1;

/// All measurements.
#[derive(Debug, Serialize)]
struct Report {
    levels: Vec<Level>,
    orders: Vec<ConvergenceOrder>,
    stress: Vec<StressReport>,
    passes: bool,
}

/// Table of one fidelity.
#[derive(Debug, Serialize)]
struct Level {
    fidelity: &'static str,
    rows: Vec<Row>,
}

/// Prints the tables, the orders of convergence and, if asked for, the outcome of random episodes. Returns an error if
/// a row, an order of convergence or the random episodes miss their bound.
pub fn run(arguments: &FidelityArgs) -> Result<()> {
    let workers = workers::available();
    let levels = Fidelity::ALL
        .into_iter()
        .map(|f| Ok(Level { fidelity: f.name(), rows: verification::table(f, workers)? }))
        .collect::<Result<Vec<_>>>()?;
    let orders = verification::orders(workers)?;
    let stress = match arguments.stress {
        0 => Vec::new(),
        episodes => stress(arguments, episodes, workers)?,
    };
    let missed = levels.iter().flat_map(|l| &l.rows).filter(|r| r.passes == Some(false)).count()
        + orders.iter().filter(|o| !o.passes).count()
        + stress.iter().filter(|s| !s.passes).count();
    let report = Report { levels, orders, stress, passes: missed == 0 };
    output::result(&arguments.output, &report, words)?;
    ensure!(report.passes, "bench fidelity: {missed} promised bounds were missed");
    Ok(())
}

/// Random episodes at the fidelities of training (fast) and inference (standard).
fn stress(arguments: &FidelityArgs, episodes: usize, workers: usize) -> Result<Vec<StressReport>> {
    let model = model_file::read_or_soft_bar(arguments.model.as_deref())?;
    let registry = Registry::shipped();
    let extremes = default_extremes(registry, &model);
    let levels = [Fidelity::Fast, Fidelity::Standard];
    let bar = ProgressBar::new((levels.len() * episodes) as u64);
    bar.set_style(progress::style("random episodes [{bar:20}] {pos}/{len}", 0.0)?);
    let mut reports = Vec::new();
    for fidelity in levels {
        bar.set_message(fidelity.name());
        let stress = Stress { model: &model, registry, extremes: &extremes, fidelity, episodes, seed: SEED, workers };
        reports.push(stress.run(|| bar.inc(1))?);
    }
    bar.finish_and_clear();
    Ok(reports)
}

fn words(report: &Report) -> String {
    let mut lines = Vec::new();
    for level in &report.levels {
        lines.push(format!(
            "{}\n{:<24} {:<34} {:>10} {:>10} {:<8} {:>9} {:>7}",
            level.fidelity, "case", "what", "computed", "reference", "unit", "ratio", "bound"
        ));
        lines.extend(level.rows.iter().map(row_words));
        lines.push(String::new());
    }
    lines.push("orders of convergence".to_owned());
    lines.extend(report.orders.iter().map(order_words));
    for s in &report.stress {
        lines.push(String::new());
        lines.extend(stress_words(s));
    }
    lines.join("\n")
}

fn row_words(r: &Row) -> String {
    let bound = r.tolerance.map_or("none".to_owned(), |t| format!("{} %", 100.0 * t));
    format!(
        "{:<24} {:<34} {:>10} {:>10} {:<8} {:>9.5} {:>7}{}",
        r.case,
        r.what,
        figures(r.computed),
        figures(r.reference),
        r.unit,
        r.ratio,
        bound,
        if r.passes == Some(false) { " MISSED" } else { "" }
    )
}

fn order_words(o: &ConvergenceOrder) -> String {
    let errors: Vec<String> = o.errors.iter().map(|e| format!("{}: {:.1e} m", e.division, e.error_m)).collect();
    format!(
        "{}, by {}: {:.2}, expected {}{}\n  {}",
        o.case,
        o.divided,
        o.measured,
        o.expected,
        if o.passes { "" } else { " MISSED" },
        errors.join(", ")
    )
}

fn stress_words(s: &StressReport) -> Vec<String> {
    let mut lines = vec![format!(
        "{} random {} episodes: {} blew up, {} did not come to rest, {} of {} steps unconverged ({:.1e}, bound 1e-3){}",
        s.episodes,
        s.fidelity,
        s.blown_up,
        s.unconverged_equilibria,
        s.unconverged_steps,
        s.steps,
        s.unconverged_share,
        if s.passes { "" } else { " MISSED" }
    )];
    let bad = s.worst.iter().filter(|e| e.blown_up || !e.started_at_rest || e.unconverged_steps > 0);
    lines.extend(bad.map(|e| {
        format!(
            "  episode {}: {}{}{} unconverged, {:?}, theta {:?}, {:?}",
            e.index,
            if e.blown_up { "blew up, " } else { "" },
            if e.started_at_rest { "" } else { "did not come to rest, " },
            e.unconverged_steps,
            e.axial_law,
            e.theta,
            e.pushed
        )
    }));
    lines
}
