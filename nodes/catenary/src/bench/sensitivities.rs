//! `catenary bench sensitivities`: cost and accuracy of the derivatives of a track.

use super::cpu_time::cpu_time;
use crate::inputs::model_file;
use crate::options::Output;
use crate::terminal::{output, progress};
use anyhow::{Result, ensure};
use catenary_core::Fidelity;
use catenary_simulator::verification::{DerivativeReport, DerivativeTrial};
use indicatif::ProgressBar;
use std::path::Path;

/// Differentiates random episodes at the fidelity of inference. Returns an error if the derivatives miss their bound.
pub fn run(model: Option<&Path>, episodes: u64, out: &Output) -> Result<()> {
    let model = model_file::read_or_soft_bar(model)?;
    let bar = ProgressBar::new(episodes);
    bar.set_style(progress::style("episodes [{bar:24}] {pos}/{len}", 0.0)?);
    let trial = DerivativeTrial { model: &model, fidelity: Fidelity::Standard, episodes, cpu_time };
    let report = trial.run(|| bar.inc(1))?;
    bar.finish_and_clear();
    output::result(out, &report, words)?;
    ensure!(report.passes, "bench sensitivities: the derivatives err by more than 2 %, and more than differences do");
    Ok(())
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
            "derivatives with respect to {} parameters and effects; central differences take {} tracks",
            report.difference_tracks / 2,
            report.difference_tracks
        ),
        format!(
            "{:<28} {:>10} {:>10} {:>25} {:>10}",
            "relative error of", "median", "worst", "median central difference", "over"
        ),
    ];
    let row = |r: &catenary_simulator::verification::DerivativeRow| {
        let missed = if r.passes { "" } else { "  MISSED" };
        let (error, step) = (r.difference_error, r.difference_step);
        format!("{:<28} {:>10.1e} {:>10.1e} {error:>25.1e} {step:>10.1e}{missed}", r.name, r.error, r.worst)
    };
    lines.extend(report.rows.iter().map(row));
    lines.join("\n")
}
