//! Validation episodes, which no fit sees and which choose between models: verification of a repair, and evidence for its
//! verdict. Held-out episodes, which choose no model, verify the result, and may refute it.

use super::context::{Best, Checked, Named, Search};
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Effort, Extent, Hypothesis, Ranking};
use crate::report::{EpisodeBands, PREDICTIONS, RepairEvidence, ValidationEvidence, Verification};
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::FidelityCorrection;

impl<'a> Search<'a> {
    /// Evidence of the fitted episodes on the best repair, with the first look at the validation episodes.
    pub(super) fn repair_evidence(
        &self,
        base: &Hypothesis,
        best: &Best,
        alternatives: usize,
        rival_gain: Option<f64>,
        checked: Option<&Checked>,
    ) -> RepairEvidence {
        let Best { hypothesis, extent, .. } = best;
        let coordinates = base.fit.residuals.len() as f64;
        let (left, excess) = ((hypothesis.fit.cost - coordinates).max(0.0), base.fit.cost - coordinates);
        RepairEvidence {
            extent: *extent,
            // The smallest positive number keeps an empty gap from a division by zero.
            share_explained: 1.0 - left / excess.max(f64::MIN_POSITIVE),
            gain_over_discrepancy: hypothesis.evidence.with_any() - base.evidence.with_any(),
            is_stand_in: hypothesis.stand_in().is_some(),
            rival_gain,
            alternatives,
            first_p_value: checked.and_then(|c| c.verification.p_value),
            closed: Vec::new(),
            held_out_p_value: None,
            validation: None,
        }
    }

    /// Verifies a repair that closes the gap of the fitted episodes: the validation episodes may still show a residual.
    pub(super) fn check_validation(
        &mut self,
        named: &Named,
        base: &Hypothesis,
    ) -> Result<Option<Checked>, FinderError> {
        match &named.best {
            Some(best) if best.extent == Extent::Whole => self.verify(base, &best.hypothesis, &named.ranking, None),
            _ => Ok(None),
        }
    }

    /// Verification on the validation episodes, with their predictive bands; none without such episodes. The p-value of
    /// a `known` verification is taken over.
    pub(super) fn verify(
        &mut self,
        base: &Hypothesis,
        best: &Hypothesis,
        ranking: &Ranking,
        known: Option<&Verification>,
    ) -> Result<Option<Checked>, FinderError> {
        self.verify_on(self.validation, base, best, ranking, known)
    }

    /// Verification on the held-out episodes, with their predictive bands; none without such episodes. They choose
    /// no model.
    pub(super) fn verify_held_out(
        &mut self,
        base: &Hypothesis,
        best: &Hypothesis,
        ranking: &Ranking,
    ) -> Result<Option<Checked>, FinderError> {
        let checked = self.verify_on(self.held_out, base, best, ranking, None)?;
        Ok(checked.map(|c| Checked { verification: Verification { selects: false, ..c.verification }, ..c }))
    }

    fn verify_on(
        &mut self,
        episodes: &'a [MeasuredEpisode],
        base: &Hypothesis,
        best: &Hypothesis,
        ranking: &Ranking,
        known: Option<&Verification>,
    ) -> Result<Option<Checked>, FinderError> {
        if episodes.is_empty() {
            return Ok(None);
        }
        self.reporter.report(Stage::Verify, 0.0, None)?;
        let alike = ranking.alike(self.settings);
        // A fitted single effect that is neither named nor like the named ones.
        let is_wrong = |h: &&Hypothesis| {
            let is_other = alike.iter().all(|a| !a.is_same(&h.candidates));
            h.effort != Effort::Linearised && h.candidates.len() == 1 && !best.has(&h.candidates[0].name) && is_other
        };
        let wrong = ranking.hypotheses.iter().find(is_wrong);
        let camera = &self.question.model.camera.view;
        let verifier = self.verifier_on(episodes);
        let (verification, [before, after]) = self
            .reporter
            .with_progress(Stage::Verify, |on_round| verifier.verify(base, best, wrong, known, on_round))?;
        let draws = before.draws.iter().zip(&after.draws);
        let bands = episodes
            .iter()
            .zip(draws)
            .map(|(episode, (b, a))| EpisodeBands::held_out(episode, [b, a], PREDICTIONS, camera))
            .collect();
        Ok(Some(Checked { verification, bands }))
    }

    /// Evidence of the validation episodes on the repair `best` of `base`. The alternatives `alike` are predicted only if the
    /// episodes speak against the repair itself, and until one of them does better.
    pub(super) fn validation_evidence(
        &mut self,
        verification: &Verification,
        [base, best]: [&Hypothesis; 2],
        alike: &[&Hypothesis],
    ) -> Result<ValidationEvidence, FinderError> {
        let is_corrected = |h: &Hypothesis| h.correction == FidelityCorrection::Applied;
        let mut evidence = ValidationEvidence {
            p_value: verification.p_value,
            share_explained: verification.share_explained,
            log_likelihood_gain: verification.log_likelihood_gain,
            // A correction of one model alone would decide the comparison.
            is_equally_corrected: is_corrected(base) == is_corrected(best),
            alternative_losses: Vec::new(),
        };
        if !evidence.is_doubtful(self.settings) {
            return Ok(evidence);
        }
        let (least, verifier) = (self.settings.least_log_bayes_factor, self.verifier());
        let mut cost = |h: &Hypothesis| {
            self.reporter.with_progress(Stage::Verify, |on_round| {
                verifier.predict(h, on_round).map(|predicted| predicted.cost())
            })
        };
        let present = cost(base)?;
        for other in alike.iter().filter(|h| !h.is_same(&best.candidates)) {
            let loss = 0.5 * (cost(other)? - present);
            evidence.alternative_losses.push(loss);
            if loss < least {
                break;
            }
        }
        Ok(evidence)
    }
}

#[cfg(test)]
mod tests {
    use super::super::progress::{Progress, Reporter, Told};
    use super::super::question::Question;
    use super::*;
    use crate::evidence::Evidence;
    use crate::report::Objection;
    use crate::settings::Settings;
    use catenary_core::seed;
    use std::ops::ControlFlow;
    use track_fit::data::Candidate;
    use track_fit::fitting::{Problem, Start};
    use track_fit::noise::KeypointNoise;
    use track_fit::toy::{self, Toy, candidate};

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// The fitted episode has a tip mass, or a drag of the same size; the held-out one has neither, or another effect.
    #[test]
    fn validation_episodes_refute_a_repair_only_with_all_alternatives() {
        let (toy, model) = (Toy { gain: 3.0 }, toy::model());
        let theta = [0.25, 2e4];
        let measured = |effects: &[(&str, f64)], stream| {
            toy::episode(&toy, theta, effects).measured_anew(&mut seed::rng(5, stream))
        };
        let [tip, drag] = ["tip_mass_kg", "linear_drag_n_s_m2"];
        let small = 0.004;
        let refusal = |unseen: &[(&str, f64)], is_corrected: bool| {
            let validation = [measured(unseen, 1)];
            let fitted = |names: &[&str]| {
                let effects: Vec<(&str, f64)> = names.iter().map(|name| (*name, small)).collect();
                let episodes = [measured(&effects, 2)];
                let problem = Problem::of(&model, &episodes, &toy, 40);
                let candidates: Vec<Candidate> = names.iter().map(|name| candidate(name)).collect();
                let unknowns = candidates.iter().fold(problem.unknowns.clone(), |all, c| all.with(c));
                let own = Problem { unknowns: unknowns.clone(), ..problem };
                let start = Start { point: vec![0.4; unknowns.columns()], tracks: own.measured() };
                let fit = own.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
                let evidence = Evidence { alone: 0.0, with: Vec::new() };
                let correction = if is_corrected && !names.is_empty() {
                    FidelityCorrection::Applied
                } else {
                    FidelityCorrection::Untried
                };
                let (effort, spread) = (Effort::Searched, Vec::new());
                Hypothesis { candidates, unknowns, episodes: None, correction, fit, evidence, effort, spread }
            };
            let (base, best, other) = (fitted(&[]), fitted(&[tip]), fitted(&[drag]));
            let episodes = [measured(&[], 2)];
            let problem = Problem::of(&model, &episodes, &toy, 40);
            let settings = Settings { finer_fidelity: None, ..Settings::default() };
            let question = Question::of(&model, &[]);
            let mut listen = |_: &Progress| ControlFlow::Continue(());
            let reporter = Reporter::new(&mut listen, Told::default());
            let mut search = Search {
                question,
                noise: KeypointNoise::stated(&model),
                problem: &problem,
                validation: &validation,
                held_out: &[],
                settings: &settings,
                reporter,
            };
            let verification = search.verifier().verify(&base, &best, None, None, &mut go_on).unwrap().0;
            let asked = |search: &mut Search<'_>, v: &Verification, alike: &[&Hypothesis]| {
                let validation = Some(search.validation_evidence(v, [&base, &best], alike).unwrap());
                let fitted = RepairEvidence {
                    extent: Extent::Whole,
                    share_explained: 1.0,
                    gain_over_discrepancy: 10.0,
                    is_stand_in: false,
                    rival_gain: None,
                    alternatives: alike.len() - 1,
                    first_p_value: None,
                    closed: Vec::new(),
                    validation,
                    held_out_p_value: None,
                };
                match fitted.objection(&settings) {
                    Some(Objection::LessLikely(loss)) => loss,
                    Some(other) => panic!("{other:?}"),
                    None => 0.0,
                }
            };
            let alone = asked(&mut search, &verification, &[&best]);
            let both = asked(&mut search, &verification, &[&best, &other]);
            let explained = Verification { p_value: Some(0.5), ..verification };
            assert_eq!(asked(&mut search, &explained, &[&best]), 0.0, "its own test does not doubt it");
            (alone, both)
        };
        let (alone, both) = refusal(&[], false);
        assert!(alone > 3.0 && both == alone, "{alone} {both}");
        let (alone, both) = refusal(&[(drag, small)], false);
        assert!(alone > 3.0 && both == 0.0, "the other is the one: {alone} {both}");
        assert_eq!(refusal(&[(tip, small)], false), (0.0, 0.0));
        assert_eq!(refusal(&[], true), (0.0, 0.0), "one of them alone counts finer simulations");
    }
}
