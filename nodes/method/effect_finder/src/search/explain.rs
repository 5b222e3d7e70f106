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
    /// Present model with the named effects, or with the nearest ones; none without either.
    pub best: Option<Hypothesis>,
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
            return Ok(Explained { repair: None, best: None });
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
            if let Some(objection) = evidence.refutation(self.settings) {
                finding.repaired = Some(fitness);
                outcome.shown = self.bands(base, Some(&best))?;
                let stage = if checked.is_some() { Stage::Verify } else { Stage::Repair };
                self.show_verification(checked, outcome)?;
                self.reporter.conclude(stage, sentences::objected(objection, &best, rmse_mm))?;
                return Ok(Explained { repair: Some(evidence), best: None });
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
            evidence.closed.extend(verification.closed());
            evidence.validation = Some(self.validation_evidence(verification, [base, &best], &alike)?);
        }
        if evidence.refutation(self.settings).is_none() {
            let held_out = self.verify_held_out(base, &best, &ranking)?;
            evidence.closed.extend(held_out.as_ref().and_then(|checked| checked.verification.closed()));
            evidence.held_out_p_value = held_out.as_ref().and_then(|checked| checked.verification.p_value);
            self.show_verification(held_out, outcome)?;
        }
        if let Some(objection) = evidence.refutation(self.settings) {
            if matches!(objection, Objection::LessLikely(_) | Objection::ClosesNothing(_)) {
                // The discrepancy of the present model is reported, because the repaired model is discarded.
                outcome.finding.discrepancy = likeliest_discrepancy(base, baseline);
            }
            self.reporter.conclude(Stage::Verify, sentences::objected(objection, &best, rmse_mm))?;
            return Ok(Explained { repair: Some(evidence), best: None });
        }
        outcome.finding.separation = self.separation(&alike)?;
        if best.candidates.iter().any(|c| !c.companions.is_empty()) {
            self.reporter.conclude(Stage::Repair, sentences::LOCAL_INTERVALS.to_owned())?;
        }
        let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
        let model = repaired(self.question.model, &best, &posterior)?;
        match evidence.objection(self.settings) {
            None => outcome.model = Some(model),
            Some(objection) => {
                outcome.nearest = Some(model);
                self.reporter.conclude(Stage::Verify, sentences::objected(objection, &best, rmse_mm))?;
            }
        }
        Ok(Explained { repair: Some(evidence), best: Some(best) })
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

#[cfg(test)]
mod tests {
    use super::super::find::find;
    use super::super::question::Question;
    use crate::report::{Finding, Verdict};
    use crate::settings::Settings;
    use catenary_core::episode::MeasuredTrack;
    use catenary_core::seed;
    use std::ops::ControlFlow;
    use track_fit::toy::{self, Toy};

    const MASS: &str = "tip_mass_kg";
    const DRAG: &str = "linear_drag_n_s_m2";
    const THETA: [f64; 2] = [0.25, 2e4];

    /// Search in an episode with a tip mass, with these effects in a validation episode and in a held-out one.
    fn found(validation: &[(&str, f64)], held_out: &[(&str, f64)]) -> Finding {
        let (simulator, model, candidates) = (Toy { gain: 3.0 }, toy::model(), [toy::candidate(MASS)]);
        let measured = |effects: &[(&str, f64)], stream| {
            let noisy = toy::episode(&simulator, THETA, effects).measured_anew(&mut seed::rng(61, stream));
            [MeasuredTrack { track: noisy.measured, ..toy::measured(&simulator, THETA, effects) }]
        };
        let (fitted, validation, held_out) =
            (measured(&[(MASS, 0.02)], 0), measured(validation, 1), measured(held_out, 2));
        let question = Question {
            validation: &validation,
            held_out: &held_out,
            candidates: &candidates,
            ..Question::of(&model, &fitted)
        };
        let settings = Settings { finer_fidelity: None, draws: 40, starts: 2, null_sets: 99, ..Settings::default() };
        find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap().finding
    }

    #[test]
    fn effects_that_may_close_nothing_of_a_held_out_gap_are_none_of_these() {
        let mass = [(MASS, 0.02)];
        let same = found(&mass, &mass);
        assert_eq!((same.verdict, same.found), (Verdict::Named, vec![vec![MASS.to_owned()]]));
        assert!(same.verification.is_some_and(|v| !v.selects && v.closed().is_some_and(|c| !c.may_be_nothing())));
        let other = found(&mass, &[(DRAG, 0.02)]);
        assert_eq!((other.verdict, other.found.len()), (Verdict::NoneOfThese, 0), "{:?}", other.conclusions);
        assert_eq!((other.probability_of_unknown, other.presence[0].probability), (1.0, 0.0));
        let told = |s: &&String| s.starts_with("none of these: on the recordings that no fit saw the repair closes -");
        let said = other.conclusions.iter().find(told).unwrap_or_else(|| panic!("{:?}", other.conclusions));
        assert!(said.ends_with(" %), which may be nothing"), "{said}");
        assert!(other.separation.is_none() && other.discrepancy.is_some());
    }
}
