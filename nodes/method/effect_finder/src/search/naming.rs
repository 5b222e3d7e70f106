//! Choice of effects: one effect, and further ones while the best model leaves a gap.

use super::context::{Best, Checked, FOUND_SDS, LEAST_DECREASE, Named, PARENTS, Search};
use super::elsewhere::LEAST_PREDICTED_DECREASE;
use super::progress::Stage;
use super::rivals::Rival;
use crate::error::FinderError;
use crate::evidence::{
    Baseline, Effort, Extent, Hypothesis, LinearisedModel, Ranking, gain_beside_discrepancy, lowest_cost,
};
use crate::report::{Finding, SupportEvidence, sentences};
use track_fit::data::Candidate;
use track_fit::fitting::is_beyond_noise;

/// Number of tests after which the search does not go back to smaller models, so that it ends.
const MOST_TESTS: usize = 6;
/// Stream of the test of the model without a stand-in, beyond those of all other tests.
const LAST_TEST: usize = 100;

impl Search<'_> {
    /// Names effects, without a stand-in if a smaller model does without it. Returns the verification of the repair, too, if it
    /// closes the gap of the fitted episodes.
    pub(super) fn name_without_stand_in(
        &mut self,
        base: &Hypothesis,
        baseline: &Baseline,
        finding: &mut Finding,
    ) -> Result<(Named, Option<Checked>), FinderError> {
        let mut named = self.name_effects(base, baseline, finding)?;
        let mut checked = self.check_validation(&named, base)?;
        if self.drop_stand_in(&mut named, checked.as_ref(), base, baseline, finding)? {
            // A smaller model is verified anew.
            checked = self.check_validation(&named, base)?;
        }
        // A part of a part may be likelier still.
        while let Some(Rival { model, gain }) = self.rival(&named, base, baseline)? {
            if model.candidates.is_empty() {
                named.rival_gain = Some(gain);
                break;
            }
            self.reporter.conclude(Stage::Repair, sentences::rivalled(&model, gain))?;
            // The rest is what a template explains better, so that the model explains a part.
            let best = self.test_repair(model, Extent::Part, finding, LAST_TEST)?;
            let ranking = self.ranked_up_to(&named.ranking, best.hypothesis.candidates.len(), base)?;
            named = Named { ranking, best: Some(best), rival_gain: None };
            checked = None;
        }
        Ok((named, checked))
    }

    /// Names effects: fits models with one effect each, and adds effects while the best model leaves a gap.
    fn name_effects(
        &mut self,
        base: &Hypothesis,
        baseline: &Baseline,
        finding: &mut Finding,
    ) -> Result<Named, FinderError> {
        let candidates = self.question.candidates;
        let mut hypotheses = self.single_effects(base, baseline, finding)?;
        let mut tested: Option<Best> = None;
        let mut effects = 0;
        // Random stream 0 belongs to the test of the present model.
        for test in 1.. {
            effects += 1;
            let ranking = Ranking::new(self.problem, base, hypotheses, candidates.len(), self.settings)?;
            let (mut ranking, is_back) = self.settle(ranking, base, baseline)?;
            // A smaller model got better, so that larger ones are built from it anew.
            let fewer = ranking.hypotheses.first().map_or(effects, |best| best.candidates.len());
            if is_back && fewer < effects && test <= MOST_TESTS {
                effects = fewer;
                let left = ranking.hypotheses.into_iter().filter(|h| h.candidates.len() <= fewer).collect();
                ranking = Ranking::new(self.problem, base, left, candidates.len(), self.settings)?;
            }
            // A model whose fit did not change is not tested again.
            let is_known = |t: &Best, best: &Hypothesis| {
                t.hypothesis.is_same(&best.candidates) && (t.hypothesis.fit.cost - best.fit.cost).abs() < LEAST_DECREASE
            };
            let is_new = |best: &Hypothesis| tested.as_ref().is_none_or(|t| !is_known(t, best));
            self.reporter.conclude(Stage::Name, sentences::named(&ranking, self.settings))?;
            if let Some((hypothesis, extent)) = ranking.best().filter(|(best, _)| is_new(best)) {
                // A further effect needs support before its model is tested.
                if let Some(last) = tested.take_if(|t| t.hypothesis.candidates.len() < hypothesis.candidates.len())
                    && !self.is_supported(&last.hypothesis, hypothesis, &ranking)?
                {
                    let ranking = self.ranked_up_to(&ranking, last.hypothesis.candidates.len(), base)?;
                    return Ok(Named { ranking, best: Some(last), rival_gain: None });
                }
                tested = Some(self.test_repair(hypothesis.clone(), extent, finding, test)?);
            }
            let is_closed = tested.as_ref().is_some_and(|t| t.extent == Extent::Whole);
            let is_candidate = |c: &&Candidate| finding.left_out.iter().all(|(name, _)| *name != c.name);
            let usable: Vec<&Candidate> = candidates.iter().filter(is_candidate).collect();
            // A larger model that is not the most probable ends the search.
            let is_over = ranking.hypotheses.first().is_none_or(|first| first.candidates.len() < effects);
            if is_closed || is_over || effects >= self.settings.most_effects.min(usable.len()) {
                let best = tested.filter(|t| ranking.best().is_some_and(|(b, _)| b.is_same(&t.hypothesis.candidates)));
                return Ok(Named { ranking, best, rival_gain: None });
            }
            hypotheses = self.extend(ranking.hypotheses, effects, &usable, baseline)?;
        }
        unreachable!("the last round returns")
    }

    /// Ranking of the models with at most `effects` effects.
    fn ranked_up_to(&self, ranking: &Ranking, effects: usize, base: &Hypothesis) -> Result<Ranking, FinderError> {
        let left = ranking.hypotheses.iter().filter(|h| h.candidates.len() <= effects).cloned().collect();
        Ranking::new(self.problem, base, left, self.question.candidates.len(), self.settings)
    }

    /// Replaces a best model with a stand-in by the most probable smaller model without one, if there is such. Returns whether there is. `checked` is the verification of
    /// the best model.
    fn drop_stand_in(
        &mut self,
        named: &mut Named,
        checked: Option<&Checked>,
        base: &Hypothesis,
        baseline: &Baseline,
        finding: &mut Finding,
    ) -> Result<bool, FinderError> {
        let Some(best) = &named.best else { return Ok(false) };
        let Some((effect, value)) = best.hypothesis.stand_in() else { return Ok(false) };
        finding.add_stand_in(effect, value);
        let is_sound = |h: &Hypothesis| !h.has(&effect.name) && h.stand_in().is_none();
        // The other effects were found beside the stand-in. Without it, another model might take its place.
        let is_rest = |h: &&Hypothesis| {
            h.candidates.len() + 1 == best.hypothesis.candidates.len()
                && h.is_part_of(&best.hypothesis)
                && !h.has(&effect.name)
        };
        let rest: Vec<Hypothesis> = named.ranking.hypotheses.iter().filter(is_rest).cloned().collect();
        for effects in (1..best.hypothesis.candidates.len()).rev() {
            let is_first = effects + 1 == best.hypothesis.candidates.len() && !rest.is_empty();
            let ranking = if is_first {
                Ranking::new(self.problem, base, rest.clone(), self.question.candidates.len(), self.settings)?
            } else {
                self.ranked_up_to(&named.ranking, effects, base)?
            };
            let ranking = self.settle(ranking, base, baseline)?.0;
            let Some((smaller, extent)) = ranking.best().filter(|(h, _)| is_sound(h)) else { continue };
            if let Some(checked) = checked {
                self.reporter.conclude(Stage::Verify, sentences::verified(&checked.verification))?;
            }
            self.reporter.conclude(Stage::Repair, sentences::not_added(effect, value))?;
            let best = self.test_repair(smaller.clone(), extent, finding, LAST_TEST)?;
            *named = Named { ranking, best: Some(best), rival_gain: None };
            return Ok(true);
        }
        Ok(false)
    }

    /// Models with one effect each. The most promising ones are fitted.
    fn single_effects(
        &mut self,
        base: &Hypothesis,
        baseline: &Baseline,
        finding: &mut Finding,
    ) -> Result<Vec<Hypothesis>, FinderError> {
        let (candidates, problem) = (self.question.candidates, self.problem);
        let mut left_out = |candidate: &Candidate, error: FinderError| match error {
            cancelled @ FinderError::Cancelled(_) => Err(cancelled),
            error => {
                finding.left_out.push((candidate.name.clone(), error.to_string()));
                Ok(())
            }
        };
        let mut trials = Vec::new();
        for (i, candidate) in candidates.iter().enumerate() {
            self.reporter.report(Stage::Name, 0.5 * i as f64 / candidates.len() as f64, None)?;
            match self.linearised_single(base, candidate) {
                Ok(trial) => trials.push((candidate, trial)),
                Err(error) => left_out(candidate, error)?,
            }
        }
        trials.sort_by(|(_, a), (_, b)| a.predicted_cost.total_cmp(&b.predicted_cost));
        let mut hypotheses: Vec<Hypothesis> = Vec::new();
        for (i, (candidate, trial)) in trials.into_iter().enumerate() {
            let fitted = if i < self.settings.extensions {
                let aim = lowest_cost(&hypotheses);
                self.reporter.with_progress(Stage::Name, |on_round| trial.fitted(problem, aim, baseline, on_round))
            } else {
                trial.judged(baseline)
            };
            match fitted {
                Ok(one) => hypotheses.push(one),
                Err(error) => left_out(candidate, error)?,
            }
        }
        let is_found = hypotheses.iter().any(|h| h.effort == Effort::Fitted && !is_beyond_noise(&h.fit, FOUND_SDS));
        if !is_found {
            self.search_elsewhere(&mut hypotheses, base, baseline)?;
            finding.left_out.retain(|(name, _)| hypotheses.iter().all(|h| !h.has(name)));
        }
        Ok(hypotheses)
    }

    /// Returns whether the validation episodes support a further effect: they are predicted with the sizes of the fitted
    /// episodes.
    fn is_supported(&mut self, less: &Hypothesis, more: &Hypothesis, ranking: &Ranking) -> Result<bool, FinderError> {
        let log_odds = ranking.log_odds(more, less);
        let verifier = self.verifier();
        let mut predict =
            |h: &Hypothesis| self.reporter.with_progress(Stage::Verify, |on_round| verifier.predict(h, on_round));
        let evidence = match self.validation {
            [] => SupportEvidence { episodes: 0, log_likelihood_gain: 0.0, distance_ratio: 1.0, log_odds },
            episodes => {
                let (without, with) = (predict(less)?, predict(more)?);
                SupportEvidence {
                    episodes: episodes.len(),
                    log_likelihood_gain: gain_beside_discrepancy(episodes, &without.residuals(), &with.residuals())
                        .ok_or_else(FinderError::curvature)?,
                    distance_ratio: with.score.rmse_mm / without.score.rmse_mm.max(f64::MIN_POSITIVE),
                    log_odds,
                }
            }
        };
        let is_enough = evidence.is_enough(self.settings);
        if !is_enough {
            self.reporter.conclude(Stage::Verify, sentences::not_supported(more, &evidence))?;
        }
        Ok(is_enough)
    }

    /// Models extended by the most promising ones with one more effect.
    fn extend(
        &mut self,
        mut hypotheses: Vec<Hypothesis>,
        effects: usize,
        candidates: &[&Candidate],
        baseline: &Baseline,
    ) -> Result<Vec<Hypothesis>, FinderError> {
        let parents: Vec<&Hypothesis> =
            hypotheses.iter().filter(|h| h.candidates.len() == effects).take(PARENTS).collect();
        let problem = self.problem;
        let mut trials: Vec<LinearisedModel> = Vec::new();
        for (i, parent) in parents.iter().enumerate() {
            for candidate in candidates.iter().filter(|c| !parent.has(&c.name)) {
                let is_known = |t: &LinearisedModel| parent.names().iter().all(|n| t.has(n)) && t.has(&candidate.name);
                if trials.iter().any(is_known) {
                    continue;
                }
                self.reporter.report(Stage::Name, i as f64 / parents.len() as f64, None)?;
                match self
                    .reporter
                    .with_progress(Stage::Name, |on_round| parent.linearised_with(problem, candidate, on_round))
                {
                    // An effect that lowers not even the linearised cost explains nothing more.
                    Ok(trial) if trial.predicted_cost < parent.fit.cost - LEAST_PREDICTED_DECREASE => {
                        trials.push(trial)
                    }
                    Ok(_) => (),
                    Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                    // An effect that cannot be simulated beside the others is dropped.
                    Err(_) => (),
                }
            }
        }
        trials.sort_by(|a, b| a.predicted_cost.total_cmp(&b.predicted_cost));
        trials.truncate(self.settings.extensions);
        for trial in trials {
            let aim = lowest_cost(&hypotheses);
            match self.reporter.with_progress(Stage::Name, |on_round| trial.fitted(problem, aim, baseline, on_round)) {
                Ok(one) => hypotheses.push(one),
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                Err(_) => (),
            }
        }
        Ok(hypotheses)
    }

    /// Test of a repaired model. A model that fails leaves a residual.
    fn test_repair(
        &mut self,
        hypothesis: Hypothesis,
        extent: Extent,
        finding: &Finding,
        stream: usize,
    ) -> Result<Best, FinderError> {
        let with = hypothesis.problem(self.problem);
        let detection = self.detect(&with, &hypothesis.fit, stream as u64, Stage::Repair)?;
        let fitness = self.agreement(&with, &hypothesis.fit)?.with(&detection);
        let closes = extent == Extent::Whole && fitness.test.p_value > self.settings.repaired_level;
        let extent = if closes { Extent::Whole } else { Extent::Part };
        self.reporter.conclude(Stage::Repair, sentences::repaired(&hypothesis, &finding.present, &fitness, !closes))?;
        Ok(Best { hypothesis, extent, fitness })
    }
}
