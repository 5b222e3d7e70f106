//! Probes: changes of the simulated values by parameters that are no unknowns of a fit.

use super::problem::{Fit, OnRound, Problem};
use crate::error::FinderError;
use catenary_core::simulator::{SimulatorError, TrackSensitivities};
use nalgebra::DMatrix;

/// Parameters by which simulations are differentiated, at several settings of another parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe<'a> {
    /// Names of the parameters.
    pub names: Vec<&'a str>,
    /// Name of the other parameter, and its settings; none: one setting, without another parameter.
    pub settings: Option<(&'a str, Vec<f64>)>,
}

impl Probe<'_> {
    /// Number of settings.
    fn count(&self) -> usize {
        self.settings.as_ref().map_or(1, |(_, values)| values.len())
    }
}

impl Problem<'_> {
    /// Derivatives of the simulated values at a fit, in standard deviations of the noise, by the parameters of each probe: the
    /// rows of the fit's residuals, a column for each parameter at each setting; settings outside, parameters inside. Rows of
    /// priors are zero, and so are the columns of a probe that cannot be simulated: it changes nothing there.
    ///
    /// # Errors
    /// [`FinderError::Cancelled`] if `on_round` breaks.
    pub fn probed(&self, fit: &Fit, probes: &[Probe<'_>], on_round: OnRound<'_>) -> Result<DMatrix<f64>, FinderError> {
        let width = |probe: &Probe<'_>| probe.count() * probe.names.len();
        let mut columns = DMatrix::zeros(fit.residuals.len(), probes.iter().map(width).sum());
        let mut across = 0;
        for probe in probes {
            let episodes: Result<Vec<_>, _> =
                (0..self.episodes.len()).map(|index| self.probed_episode(fit, probe, index)).collect();
            let mut down = 0;
            for parts in episodes.unwrap_or_default() {
                for (place, part) in parts.iter().enumerate() {
                    columns.view_mut((down, across + place * part.ncols()), part.shape()).copy_from(part);
                }
                down += parts.first().map_or(0, DMatrix::nrows);
            }
            across += width(probe);
            if on_round().is_break() {
                return Err(FinderError::Cancelled("fit"));
            }
        }
        Ok(columns)
    }

    /// Derivatives in one episode, a matrix for each setting.
    fn probed_episode(&self, fit: &Fit, probe: &Probe<'_>, index: usize) -> Result<Vec<DMatrix<f64>>, SimulatorError> {
        let points = vec![fit.point.as_slice(); probe.count()];
        let mut request = self.request(&points, index);
        request.effects.extend(probe.settings.as_ref().map(|(name, values)| ((*name).to_owned(), values.clone())));
        let answer = self.simulator.sensitivities(&request, &probe.names)?;
        if answer.len() != points.len() {
            let (expected, got) = (points.len(), answer.len());
            return Err(SimulatorError::Backend(format!("expected {expected} tracks with derivatives, got {got}")));
        }
        let episode = &self.episodes[index];
        let part = |mut one: TrackSensitivities| {
            one.track = episode.corrected(one.track);
            episode.compare(&episode.measured, &one).1
        };
        Ok(answer.into_iter().map(part).collect())
    }
}
