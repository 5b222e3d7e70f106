//! Probes: changes of the simulated values by parameters that are no unknowns of a fit.

use super::problem::{Fit, OnRound, Problem};
use crate::error::FitError;
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
    /// [`FitError::Cancelled`] if `on_round` breaks.
    pub fn probed(&self, fit: &Fit, probes: &[Probe<'_>], on_round: OnRound<'_>) -> Result<DMatrix<f64>, FitError> {
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
                return Err(FitError::Cancelled);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Candidate;
    use crate::fitting::Start;
    use crate::toy::{self, Toy};
    use catenary_core::Prior;
    use std::ops::ControlFlow;

    #[test]
    fn probes_are_derivatives_and_zero_where_nothing_can_be_simulated() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[]), toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let prior = Prior::Uniform { low: 0.0, high: 0.5 };
        let name = "tip_mass_kg";
        let candidate = Candidate { prior, range: [0.0, 0.5], ..toy::candidate(name) };
        let mut go_on = || ControlFlow::Continue(());
        let mut linearised = |problem: &Problem<'_>, point: Vec<f64>| {
            let start = Start { point, tracks: problem.measured() };
            problem.linearise(vec![start], &mut go_on).unwrap().remove(0).unwrap().fit
        };
        let fit = linearised(&problem, vec![0.5, 0.5]);
        let with =
            Problem { unknowns: problem.unknowns.with(&candidate), ..Problem::of(&toy::model(), &episodes, &toy, 40) };
        let known = linearised(&with, vec![0.5, 0.5, 0.0]).jacobian.column(2).into_owned();
        let probe = |names: Vec<&'static str>| Probe { names, settings: Some(("other", vec![0.1, 0.7])) };
        let columns = problem.probed(&fit, &[probe(vec![name]), probe(Vec::new())], &mut || ControlFlow::Continue(()));
        let columns = columns.unwrap();
        assert_eq!(columns.shape(), (fit.residuals.len(), 2));
        // The coordinate is half a kilogram wide.
        for column in columns.column_iter() {
            assert!((0.5 * column - &known).norm() < 1e-9 * known.norm());
        }
        // The toy refuses lengths under 0.2 m; the prior begins at 0.195 m.
        let short = Fit { point: vec![0.0, 0.5], ..fit };
        let columns = problem.probed(&short, &[probe(vec![name])], &mut || ControlFlow::Continue(())).unwrap();
        assert!(columns.ncols() == 2 && columns.iter().all(|v| *v == 0.0));
    }
}
