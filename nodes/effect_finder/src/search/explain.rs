//! Explanation of the present model's residual: name effects, repair the model, verify it on episodes that no fit has seen.

use super::context::{Best, Checked, Named, Search};
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Baseline, Discrepancy, Hypothesis, groups, joined};
use crate::report::{Objection, Outcome, RepairEvidence, Separation, repaired, sentences, separate, trade_offs};

/// Explanation of a residual.
pub(super) struct Explained {
    /// Evidence on the best repair; none if no candidate model is more probable than the present one.
    pub repair: Option<RepairEvidence>,
    /// Present model with the named effects; none if no effect is named.
    pub named: Option<Hypothesis>,
}

impl Search<'_> {
    /// Search after the rejection of the present model: it names effects, repairs the model, and verifies it on episodes
    /// that no fit has seen.
    pub(super) fn explain(
        &mut self,
        base: &Hypothesis,
        baseline: &Baseline,
        outcome: &mut Outcome,
    ) -> Result<Explained, FinderError> {
        let finding = &mut outcome.finding;
        let (named, mut checked) = self.name_without_stand_in(base, baseline, finding)?;
        let Named { ranking, best, rival_gain } = named;
        finding.set_ranking(&ranking);
        let Some(best) = best else {
            finding.discrepancy = likeliest_discrepancy(base, baseline);
            outcome.shown = self.bands(base, None)?;
            return Ok(Explained { repair: None, named: None });
        };
        let mut alike = ranking.alike(self.settings);
        for (effect, value) in alike.iter().skip(1).filter_map(|h| h.stand_in()) {
            finding.add_stand_in(effect, value);
            self.reporter.conclude(Stage::Repair, sentences::not_added(effect, value))?;
        }
        // An alternative that stands in for something else is none, unless it is the best explanation itself.
        alike.retain(|h| h.is_same(&best.hypothesis.candidates) || h.stand_in().is_none());
        let greatest = self.settings.greatest_cosine;
        let trading = best.hypothesis.trading_pairs(greatest).len();
        let alternatives = alike.len().saturating_sub(1) + trading;
        let mut evidence = self.repair_evidence(base, &best, alternatives, rival_gain, checked.as_ref());
        let Best { hypothesis: mut best, mut fitness, .. } = best;
        let rmse_mm = fitness.rmse_mm;
        if evidence.leaves_residual(self.settings) {
            finding.discrepancy = likeliest_discrepancy(&best, baseline);
            if let Some(objection) = evidence.objection(self.settings) {
                finding.repaired = Some(fitness);
                outcome.shown = self.bands(base, Some(&best))?;
                let stage = if checked.is_some() { Stage::Verify } else { Stage::Repair };
                self.show_verification(checked, outcome)?;
                self.reporter.conclude(stage, sentences::objected(objection, &best, rmse_mm))?;
                return Ok(Explained { repair: Some(evidence), named: None });
            }
            best = self.fit_with_discrepancy(best, &mut fitness, baseline)?;
            finding.set_magnitudes(best.magnitudes());
            // The p-value of the first look stays: the repaired model was weighed by the validation episodes since then.
            let first = checked.take();
            checked = self.verify(base, &best, &ranking, first.as_ref().map(|c| &c.verification))?;
        }
        finding.repaired = Some(fitness);
        finding.trade_offs = trade_offs(&best);
        finding.found = joined(groups(&alike), &best, greatest);
        outcome.shown = self.bands(base, Some(&best))?;
        for trade_off in &outcome.finding.trade_offs {
            self.reporter.conclude(Stage::Repair, sentences::traded(trade_off))?;
        }
        self.show_verification(checked, outcome)?;
        if let Some(verification) = &outcome.finding.verification {
            evidence.validation = Some(self.validation_evidence(verification, [base, &best], &alike)?);
        }
        if let Some(objection) = evidence.objection(self.settings) {
            if matches!(objection, Objection::LessLikely(_)) {
                // The discrepancy of the present model is reported, because the repaired model is discarded.
                outcome.finding.discrepancy = likeliest_discrepancy(base, baseline);
            }
            self.reporter.conclude(Stage::Verify, sentences::objected(objection, &best, rmse_mm))?;
            return Ok(Explained { repair: Some(evidence), named: None });
        }
        let held_out = self.verify_held_out(base, &best, &ranking)?;
        self.show_verification(held_out, outcome)?;
        outcome.finding.separation = self.separation(&alike)?;
        let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
        outcome.model = Some(repaired(self.question.model, &best, &posterior)?);
        Ok(Explained { repair: Some(evidence), named: Some(best) })
    }

    /// Puts a verification and its bands into the outcome.
    fn show_verification(&mut self, checked: Option<Checked>, outcome: &mut Outcome) -> Result<(), FinderError> {
        if let Some(Checked { verification, bands }) = checked {
            outcome.shown.extend(bands);
            self.reporter.conclude(Stage::Verify, sentences::verified(&verification))?;
            outcome.finding.verification = Some(verification);
        }
        Ok(())
    }

    /// Motion that would separate the two most probable of several explanations.
    fn separation(&mut self, alike: &[&Hypothesis]) -> Result<Option<Separation>, FinderError> {
        let [first, second, ..] = alike else { return Ok(None) };
        let (model, problem, settings) = (self.question.model, self.problem, self.settings);
        let separation = self
            .reporter
            .with_progress(Stage::Verify, |on_round| separate(model, problem, [first, second], settings, on_round))?;
        self.reporter.conclude(Stage::Verify, sentences::separated(separation.as_ref()))?;
        Ok(separation.filter(Separation::separates))
    }
}

/// Likeliest discrepancy of a model.
fn likeliest_discrepancy(model: &Hypothesis, baseline: &Baseline) -> Option<Discrepancy> {
    model.evidence.likeliest().map(|place| baseline.discrepancies[place])
}
