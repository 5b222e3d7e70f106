//! `catenary bench sensitivities`: what the derivatives of a track cost, and how far they are from the truth.

use super::cpu_time;
use crate::cli::Output;
use crate::{model_file, output};
use anyhow::Result;
use catenary_core::Fidelity;
use indicatif::{ProgressBar, ProgressStyle};
use simulator_pool::verification::{DerivativeReport, DerivativeTrial};
use std::path::Path;

/// Differentiates random episodes at the fidelity of inference.
pub fn run(model: Option<&Path>, episodes: u64, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(model)?;
    let bar = ProgressBar::new(episodes);
    bar.set_style(ProgressStyle::with_template("episodes [{bar:30}] {pos}/{len}, {eta} left")?.progress_chars("=> "));
    let trial = DerivativeTrial { model: &model, fidelity: Fidelity::Standard, episodes, cpu_time };
    let report = trial.run(|| bar.inc(1))?;
    bar.finish_and_clear();
    output::result(out, &report, words)
}

fn words(report: &DerivativeReport) -> String {
    let mut lines = vec![
        format!(
            "{} at {}: a track takes {:.1} ms; with its derivatives {:.1} ms, as long as {:.1} tracks",
            match report.episodes {
                1 => "1 episode".to_owned(),
                n => format!("{n} episodes"),
            },
            report.fidelity,
            1e3 * report.track_s,
            1e3 * report.sensitivities_s,
            report.tracks
        ),
        format!(
            "derivatives by {} parameters; central differences take {} tracks",
            report.rows.len(),
            2 * report.rows.len()
        ),
        format!("{:<28} {:>12} {:>20} {:>12}", "median relative error of", "derivative", "central difference", "over"),
    ];
    let row = |r: &simulator_pool::verification::DerivativeRow| {
        format!("{:<28} {:>12.1e} {:>20.1e} {:>12.1e}", r.name, r.error, r.difference_error, r.difference_step)
    };
    lines.extend(report.rows.iter().map(row));
    lines.join("\n")
}
