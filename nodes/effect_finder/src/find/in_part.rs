//! Effects that leave something: how large they are, and how well that is known, where what is left counts as more than noise.

use super::{LEAST_DECREASE, Search, Stage};
use crate::calibrate::{Agreement, best_fit};
use crate::discrepancy::Whitening;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::fit::{Fit, Problem, Start};
use crate::hypothesis::Hypothesis;
use crate::laplace::Laplace;
use crate::sentences;
use crate::verdict::Fitness;

/// Most steps of a fit beside a discrepancy.
const REWEIGHINGS: usize = 10;

impl Search<'_> {
    /// The hypothesis with values that count what is left, in the fitted episodes and in others, as more than noise; how it fits
    /// is put into `fitness`.
    pub(super) fn weighed_in_part(
        &mut self,
        hypothesis: Hypothesis,
        fitness: &mut Fitness,
        yardstick: &Yardstick,
    ) -> Result<Hypothesis, FinderError> {
        let mut best = self.beside_a_discrepancy(hypothesis, yardstick)?;
        let own = best.magnitudes();
        let elsewhere = self.let_conditions_differ(&mut best, yardstick)?;
        self.telling.conclude(Stage::Repair, sentences::weighed(&own, elsewhere.as_deref(), &best.magnitudes()))?;
        let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
        let (problem, camera) = (best.problem(self.problem), &self.question.model.camera.view);
        let agreement = Agreement::with_posterior(&problem, &best.fit, &posterior, camera, self.settings)?;
        (fitness.estimates, fitness.rmse_mm) = (agreement.estimates, agreement.rmse_mm);
        Ok(best)
    }

    /// The hypothesis fitted anew beside the likeliest smooth error: what it then is, and how well it is known, counts what is
    /// left of the data as more than noise.
    fn beside_a_discrepancy(
        &mut self,
        hypothesis: Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Hypothesis, FinderError> {
        let Some(place) = hypothesis.evidence.likeliest() else { return Ok(hypothesis) };
        let own = hypothesis.problem(self.problem);
        let fit = self.weighed(&own, hypothesis.fit.clone(), yardstick.whitening(place))?;
        Ok(Hypothesis { fit, ..hypothesis })
    }

    /// The best fit as `whitening` sees it, from `fit` on.
    fn weighed(&mut self, own: &Problem<'_>, fit: Fit, whitening: &Whitening) -> Result<Fit, FinderError> {
        let mut best = whitening.of(&fit);
        let mut share = 1.0;
        for _ in 0..REWEIGHINGS {
            let promised = best.clone().descended();
            if best.cost - promised.cost < LEAST_DECREASE {
                break;
            }
            let point = best.point.iter().zip(&promised.point).map(|(from, to)| from + share * (to - from)).collect();
            let start = Start { point, tracks: own.measured() };
            let seen = self.telling.in_rounds(Stage::Repair, |on_round| own.look(vec![start], on_round));
            match seen.map(|seen| seen.into_iter().flatten().next().map(|seen| whitening.of(&seen.fit))) {
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                Ok(Some(lower)) if lower.cost < best.cost => (best, share) = (lower, 1.0),
                _ => share *= 0.5,
            }
        }
        Ok(best)
    }

    /// Fits the hypothesis to the held-out episodes alone, and takes by how much more its effects differ there than the data
    /// leave open for how much they differ between conditions: a model that leaves something is a little another one in each.
    /// One difference is all there is to say so. Returns the values of the effects there.
    fn let_conditions_differ(
        &mut self,
        best: &mut Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Option<Vec<f64>>, FinderError> {
        let Some(place) = best.evidence.likeliest().filter(|_| !self.held_out.is_empty()) else { return Ok(None) };
        let (verifier, settings) = (self.verifier(), self.settings);
        let mut cases = Vec::new();
        for case in self.held_out {
            cases.push(self.telling.in_rounds(Stage::Repair, |on_round| verifier.fitted(case, best, on_round))?.0);
        }
        let unknowns = best.unknowns.for_episodes(cases.len());
        let known = vec![unknowns.shared_from(&best.unknowns, &best.fit.point)];
        let own = Problem { cases: &cases, unknowns, ..*self.problem };
        let fit = match self.telling.in_rounds(Stage::Repair, |on_round| best_fit(&own, known, settings, on_round)) {
            Err(FinderError::NoFit(_)) => return Ok(None),
            other => other?,
        };
        let whitening = Whitening::new(&cases, yardstick.discrepancies[place]).ok_or_else(FinderError::curvature)?;
        let fit = self.weighed(&own, fit, &whitening)?;
        let there = Hypothesis { unknowns: own.unknowns, fit, ..best.clone() };
        let (here, other) = (Laplace::of(&best.fit), Laplace::of(&there.fit));
        let (here, other) = here.zip(other).ok_or_else(FinderError::curvature)?;
        let spread = |i: usize| {
            let (own, far) = (best.column(i), there.column(i));
            let apart = best.fit.point[own] - there.fit.point[far];
            // Of two draws of one Gaussian, the difference has twice its variance.
            (0.5 * (apart.powi(2) - here.sd(own).powi(2) - other.sd(far).powi(2)).max(0.0)).sqrt()
        };
        best.spread = (0..best.candidates.len()).map(spread).collect();
        Ok(Some((0..there.candidates.len()).map(|i| there.magnitude(i).0).collect()))
    }
}
