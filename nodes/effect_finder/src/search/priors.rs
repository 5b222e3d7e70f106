//! Parameters at bounds of their priors, which may cause the gap.

use super::context::Search;
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Detection, p_value};
use crate::report::{Finding, sentences};
use track_fit::fitting::{Fit, Laplace, Problem, best_fit, is_bound_active};

/// Distance from a bound of the prior within which a value is near it: the smaller of this many standard deviations and
/// this share of the prior.
const NEAR_SDS: f64 = 3.0;
const NEAR: f64 = 0.1;

impl Search<'_> {
    /// Returns whether the gap closes once theta's priors are opened: the bounds of the priors caused it.
    pub(super) fn closes_with_open_priors(
        &mut self,
        fit: &Fit,
        finding: &Finding,
        detection: &Detection,
    ) -> Result<bool, FinderError> {
        if finding.pressing.is_empty() {
            return Ok(false);
        }
        let unknowns = self.problem.unknowns.opened();
        let point = unknowns.point_from(&self.problem.unknowns, &fit.point);
        let open = Problem { unknowns, ..*self.problem };
        let settings = self.settings;
        let best = match self
            .reporter
            .with_progress(Stage::Localise, |on_round| best_fit(&open, vec![point], &settings.of_fits(), on_round))
        {
            // Values beyond the prior may be impossible to simulate.
            Err(FinderError::NoFit(_)) => return Ok(false),
            other => other?,
        };
        // The null sets of the present model serve the opened one, too: they differ only in the bounds.
        let p_value = p_value(best.cost, detection.null.iter().map(|f| f.cost));
        let closes = p_value > self.settings.level;
        if closes {
            self.reporter.conclude(Stage::Localise, sentences::narrow(&finding.pressing, p_value))?;
        }
        Ok(closes)
    }

    /// Parameters of theta at an active bound of their prior, or so near to a bound that their values may lie beyond
    /// it.
    pub(super) fn pressing(&self, fit: &Fit) -> Vec<String> {
        let unknowns = &self.problem.unknowns;
        let (gradient, posterior) = (fit.gradient(), Laplace::of(fit));
        let at_edge = |column: usize| {
            let u = fit.point[column];
            let reach = posterior.as_ref().map_or(0.0, |p| NEAR_SDS * p.sd(column)).min(NEAR);
            is_bound_active(u, gradient[column]) || u.min(1.0 - u) < reach
        };
        let theta = unknowns.list()[..unknowns.theta()].iter().enumerate();
        theta.filter(|(i, _)| at_edge(unknowns.column(*i, 0))).map(|(_, u)| u.name.clone()).collect()
    }
}
