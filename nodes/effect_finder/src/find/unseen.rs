//! What episodes that no fit has seen say of a repair.

use super::naming::Named;
use super::{Search, Stage};
use crate::error::FinderError;
use crate::hypothesis::{Depth, Grain, Hypothesis};
use crate::name::{Extent, Ranking};
use crate::outcome::Shown;
use crate::sentences;
use crate::verdict::Fitness;
use crate::verify::{Verification, Verifier};

/// Why unseen episodes refute a repair.
pub(super) enum Refusal {
    /// It leaves something, and explains but this share of what there is.
    ExplainsLittle(f64),
    /// They are less likely with it than with the present model, by so many nats.
    LessLikely(f64),
}

/// What unseen episodes say of what is named.
pub(super) struct Looked {
    /// What it is worth on them; none where something is left of the fitted episodes already.
    pub verified: Option<(Verification, Vec<Shown>)>,
    /// Whether something is left, in either.
    pub is_left: bool,
}

impl<'a> Search<'a> {
    pub(super) fn verifier(&self) -> Verifier<'a> {
        let camera = &self.question.model.camera.view;
        Verifier { problem: self.problem, held_out: self.held_out, camera, settings: self.settings }
    }

    /// Whether effects that leave something explain enough to be named: more than a smooth error does by itself, and the
    /// greater part of what there is.
    fn is_worth_naming(&self, base: &Hypothesis, best: &Hypothesis) -> bool {
        let coordinates = base.fit.residuals.len() as f64;
        let share = 1.0 - (best.fit.cost - coordinates).max(0.0) / (base.fit.cost - coordinates).max(f64::MIN_POSITIVE);
        let gain = best.evidence.with_any() - base.evidence.with_any();
        share >= self.settings.least_share && gain >= self.settings.least_log_bayes_factor
    }

    /// Looks at the unseen episodes, where the fitted ones are closed: a gap may be left in those that no fit has seen.
    pub(super) fn looked_at_unseen(&mut self, named: &Named, base: &Hypothesis) -> Result<Looked, FinderError> {
        let verified = match &named.best {
            Some(best) if best.extent == Extent::Whole => {
                self.verified(base, &best.hypothesis, &named.ranking, None)?
            }
            _ => None,
        };
        let is_part = named.best.as_ref().is_some_and(|best| best.extent == Extent::Part);
        let p_value = verified.as_ref().and_then(|v| v.0.p_value);
        Ok(Looked { verified, is_left: is_part || p_value.is_some_and(|p| p <= self.settings.repaired_level) })
    }

    /// Why effects that leave something are not to be named.
    pub(super) fn objection(
        &self,
        base: &Hypothesis,
        best: &Hypothesis,
        extent: Extent,
        fitness: &Fitness,
    ) -> Option<String> {
        if extent == Extent::Part && !self.is_worth_naming(base, best) {
            return Some(sentences::refused(fitness));
        }
        best.at_its_limit().map(|(effect, limit)| sentences::stands_in(effect, limit))
    }

    /// What the repair is worth on the held-out episodes, and what pictures show of them; none where there are no episodes. Their
    /// p-value is asked for unless it is `known`.
    pub(super) fn verified(
        &mut self,
        base: &Hypothesis,
        best: &Hypothesis,
        ranking: &Ranking,
        known: Option<f64>,
    ) -> Result<Option<(Verification, Vec<Shown>)>, FinderError> {
        if self.held_out.is_empty() {
            return Ok(None);
        }
        self.telling.report(Stage::Verify, 0.0, None)?;
        let alike = ranking.alike(self.settings);
        let is_wrong = |h: &&Hypothesis| {
            let is_other = alike.iter().all(|a| !a.is_same(&h.candidates));
            h.depth != Depth::Promised && h.candidates.len() == 1 && !best.has(&h.candidates[0].name) && is_other
        };
        let wrong = ranking.hypotheses.iter().find(is_wrong);
        let (verifier, camera) = (self.verifier(), &self.question.model.camera.view);
        let (verification, [before, after]) =
            self.telling.in_rounds(Stage::Verify, |on_round| verifier.verify(base, best, wrong, known, on_round))?;
        let draws = before.draws.iter().zip(&after.draws);
        let shown = self.held_out.iter().zip(draws).map(|(case, (b, a))| Shown::held_out(case, b, a, camera));
        Ok(Some((verification, shown.collect())))
    }

    /// Whether unseen episodes refute the repair of `base` that came to `best`, which stands for all that are `alike`. The
    /// likelihoods are those at best fits: that the fitted episodes leave much open may make the better model the less likely one.
    /// So it is refuted where its own test doubts it, too, neither counts more of a finer simulation than the other, and none of
    /// those alike does better.
    pub(super) fn refusal(
        &mut self,
        verification: &Verification,
        is_left: bool,
        [base, best]: [&Hypothesis; 2],
        alike: &[&Hypothesis],
    ) -> Result<Option<Refusal>, FinderError> {
        let (settings, verifier) = (self.settings, self.verifier());
        let share = verification.share_explained.filter(|share| is_left && *share < settings.least_share);
        if let Some(share) = share {
            return Ok(Some(Refusal::ExplainsLittle(share)));
        }
        let is_as_fine = (base.grain == Grain::Fine) == (best.grain == Grain::Fine);
        let is_doubted = verification.p_value.is_some_and(|p| p <= settings.level) && is_as_fine;
        let loss = -verification.log_likelihood_gain;
        if !is_doubted || loss < settings.least_log_bayes_factor {
            return Ok(None);
        }
        let mut cost = |h: &Hypothesis| {
            self.telling.in_rounds(Stage::Verify, |on_round| Ok(verifier.predict(h, on_round)?.cost()))
        };
        let present = cost(base)?;
        for other in alike.iter().filter(|h| !h.is_same(&best.candidates)) {
            if 0.5 * (cost(other)? - present) < settings.least_log_bayes_factor {
                return Ok(None);
            }
        }
        Ok(Some(Refusal::LessLikely(loss)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Progress, Question, Telling};
    use super::*;
    use crate::candidate::Candidate;
    use crate::evidence::Evidence;
    use crate::fit::{Problem, Start};
    use crate::settings::Settings;
    use crate::toy::{self, Toy};
    use catenary_core::{Prior, seed};
    use std::ops::ControlFlow;

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn candidate(name: &str) -> Candidate {
        let prior = Prior::LogUniform { low: 1e-3, high: 0.1 };
        Candidate { name: name.into(), title: name.into(), prior, range: [0.0, 1.0], base: 0.0, odds: 1.0 }
    }

    /// What was fitted has a tip mass, or as much of what moves keypoints alike; what no fit has seen has none, or has something else.
    #[test]
    fn unseen_episodes_refute_a_repair_where_they_refute_all_that_are_alike() {
        let (toy, model) = (Toy { gain: 3.0 }, toy::model());
        let theta = [0.25, 2e4];
        let case =
            |effects: &[(&str, f64)], stream| toy::case(&toy, theta, effects).measured_anew(&mut seed::rng(5, stream));
        let [tip, drag] = ["tip_mass_kg", "linear_drag_n_s_m2"];
        let small = 0.004;
        let refusal = |unseen: &[(&str, f64)], is_grained: bool| {
            let held_out = [case(unseen, 1)];
            let fitted = |names: &[&str]| {
                let effects: Vec<(&str, f64)> = names.iter().map(|name| (*name, small)).collect();
                let cases = [case(&effects, 2)];
                let problem = Problem::of(&model, &cases, &toy, 40);
                let candidates: Vec<Candidate> = names.iter().map(|name| candidate(name)).collect();
                let unknowns = candidates.iter().fold(problem.unknowns.clone(), |all, c| all.with(c));
                let own = Problem { unknowns: unknowns.clone(), ..problem };
                let start = Start { point: vec![0.4; unknowns.columns()], tracks: own.measured() };
                let fit = own.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
                let evidence = Evidence { alone: 0.0, with: Vec::new() };
                let grain = if is_grained && !names.is_empty() { Grain::Fine } else { Grain::Unasked };
                let (depth, spread) = (Depth::Polished, Vec::new());
                Hypothesis { candidates, unknowns, cases: None, grain, fit, evidence, depth, spread }
            };
            let (base, best, other) = (fitted(&[]), fitted(&[tip]), fitted(&[drag]));
            let cases = [case(&[], 2)];
            let problem = Problem::of(&model, &cases, &toy, 40);
            let settings = Settings { finer_fidelity: None, ..Settings::default() };
            let question = Question { model: &model, measured: &[], held_out: &[], candidates: &[] };
            let mut listen = |_: &Progress| ControlFlow::Continue(());
            let telling = Telling { on_progress: &mut listen, conclusions: Vec::new() };
            let mut search = Search { question, problem: &problem, held_out: &held_out, settings: &settings, telling };
            let verification = search.verifier().verify(&base, &best, None, None, &mut go_on).unwrap().0;
            let asked = |search: &mut Search<'_>, v: &Verification, alike: &[&Hypothesis]| match search
                .refusal(v, false, [&base, &best], alike)
                .unwrap()
            {
                Some(Refusal::LessLikely(loss)) => loss,
                Some(Refusal::ExplainsLittle(_)) => panic!("nothing is left"),
                None => 0.0,
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
