//! Lines of an inference for the terminal.

use crate::report::number::figures;
use bayes_sim::{Predictive, Refinement, Widening};
use catenary_core::posterior::Marginal;
use std::fmt::Display;

/// Posterior predictive check in a line.
pub fn predictive_words(p: &Predictive) -> String {
    format!(
        "posterior predictive: RMSE {:.1} mm; {:.0} % of the measured coordinates in the 90 % band, whose half width is {:.1} mm (rms); p = {:.3}",
        p.rmse_mm,
        100.0 * p.coverage,
        p.half_width_mm,
        p.p_value
    )
}

/// Refinement in a line: what the networks alone knew, and how near the model comes to the recording.
pub fn refinement_words(refinement: &Refinement, marginals: &[Marginal]) -> String {
    let narrower = |(m, before): (&Marginal, &f64)| format!("{} to {:.0} %", m.name, 100.0 * (m.q95 - m.q05) / before);
    let networks = refinement
        .networks_rmse_mm
        .map_or_else(String::new, |rmse_mm| format!("; the networks' posterior is {rmse_mm:.1} mm off"));
    format!(
        "refined with the simulator: the best fit is {:.1} mm off (rms){networks}; widths of the 90 % intervals, in shares of the networks': {}",
        refinement.best_fit_rmse_mm,
        marginals.iter().zip(&refinement.networks_width).map(narrower).collect::<Vec<_>>().join(", ")
    )
}

/// Widening of the intervals in a line.
pub fn widening_words(widening: &Widening, marginals: &[Marginal]) -> String {
    let of = |(i, m): (usize, &Marginal)| {
        // Rounded first, so that no change of less than half a percent has a sign.
        let growth = (100.0 * ((m.q95 - m.q05) / widening.width_before[i] - 1.0)).round() as i64;
        let change = match growth {
            0 => "unchanged".to_owned(),
            more if more > 0 => format!("{more} % wider"),
            less => format!("{} % narrower", -less),
        };
        format!("{} {change} ({:.0} % lay in it before)", m.name, 100.0 * widening.coverage_before[i])
    };
    format!(
        "90 % intervals fitted to {} held-out simulations, as far as the prior lets them: {}",
        widening.held_out,
        marginals.iter().enumerate().map(of).collect::<Vec<_>>().join(", ")
    )
}

/// Message of the progress bar for an iteration: simulations so far, loss in nat, effective sample size. Short, to fit
/// 80 columns.
pub fn iteration_words(simulations: impl Display, loss: impl Display, effective: impl Display) -> String {
    format!("{simulations} simulations, loss {loss:.2}, {effective:.0} effective")
}

/// Number of simulations, including those of a resumed process, and the time that this process took.
pub fn time_words(simulations: usize, wall_s: f64, simulation_s: f64) -> String {
    let rest_s = wall_s - simulation_s;
    format!(
        "{simulations} simulations; {wall_s:.1} s: simulation {simulation_s:.1} s, training and the rest {rest_s:.1} s"
    )
}

/// One line per parameter: median and 90 % interval.
pub fn marginal_words(marginals: &[Marginal]) -> Vec<String> {
    let line = |m: &Marginal| format!("{}: {} ({} to {})", m.name, figures(m.median), figures(m.q05), figures(m.q95));
    marginals.iter().map(line).collect()
}
