//! Closer looks at the most probable models, until their order rests on fits that are as good as they get.

use super::naming::{FOUND_SDS, PARENTS, lowest};
use super::{LEAST_DECREASE, Search, Stage};
use crate::calibrate::{Refined, best_fit, fit_among_draws, is_beyond_noise, refined};
use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::fit::{Fit, Problem, Start};
use crate::hypothesis::{Depth, Grain, Hypothesis};
use crate::name::{Ranking, gain};
use crate::settings::Settings;

/// How many times fewer draws and starts look for the best fit of a model that is not the most probable.
const FEWER: usize = 4;
/// Models among which those with one effect are looked for everywhere where the best of all leaves more than noise.
const WIDE: usize = 6;
/// By how much the log evidence of a model must rise where it is fitted from where a larger one fits.
const LEAST_GAIN: f64 = 1.0;
/// What errors of coarse simulations may be worth, as a share of the log Bayes factor of the best, and at most, in nats.
const ERRING: f64 = 0.1;
const MOST_ERRING: f64 = 20.0;

impl Search<'_> {
    /// Looks closer at the most probable hypotheses, and where the best has several effects at those with one fewer: what a
    /// further effect seemed to explain may lie in another valley, into which it led. Says whether one of those got better.
    pub(super) fn settled(
        &mut self,
        ranking: Ranking,
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<(Ranking, bool), FinderError> {
        let mut ranking = self.polished(ranking, base, yardstick)?;
        let mut is_back = false;
        // Each way back takes an effect away.
        for _ in 1..self.settings.most_effects {
            let Some(better) = self.stepped_back(&ranking.hypotheses, yardstick)? else { break };
            let again = Ranking::new(self.problem, base, better, self.question.candidates.len(), self.settings)?;
            ranking = self.polished(again, base, yardstick)?;
            is_back = true;
        }
        Ok((ranking, is_back))
    }

    /// The hypotheses, those with one effect fewer than the first fitted from where it fits; none where no fit is better.
    fn stepped_back(
        &mut self,
        all: &[Hypothesis],
        yardstick: &Yardstick,
    ) -> Result<Option<Vec<Hypothesis>>, FinderError> {
        let Some(best) = all.first() else { return Ok(None) };
        let is_part = |h: &Hypothesis| {
            h.candidates.len() + 1 == best.candidates.len() && h.candidates.iter().all(|c| best.has(&c.name))
        };
        let mut better = None;
        for (place, part) in all.iter().enumerate().filter(|(_, h)| is_part(h)) {
            let there = Hypothesis { cases: best.cases.clone(), grain: Grain::Unasked, ..part.clone() };
            let own = there.problem(self.problem);
            let start = |point| Start { point, tracks: own.measured() };
            let starts = there.where_fits(best).into_iter().map(start).collect();
            let fits = match self.telling.in_rounds(Stage::Name, |on_round| own.fit(starts, on_round)) {
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                // Without the effect there may be nothing that can be simulated.
                Err(_) => continue,
                Ok(fits) => fits,
            };
            let Some(fit) = fits.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost)) else { continue };
            let Some(evidence) = yardstick.of(&part.candidates, &fit) else { continue };
            let new = Hypothesis { fit, evidence, depth: Depth::Fitted, ..there };
            if new.fit.cost < part.fit.cost - LEAST_DECREASE && gain(part, &new, self.settings) > LEAST_GAIN {
                let better: &mut Vec<Hypothesis> = better.get_or_insert_with(|| all.to_vec());
                better[place] = new;
            }
        }
        Ok(better)
    }

    /// Looks closer at the most probable hypotheses. With an effect more, the best values of all others may lie in another valley;
    /// and a coarse simulation may suit one effect by its errors, which are another one's than the present model's.
    /// Where none of them is in doubt, looks at those that are [`overlooked`].
    fn polished(
        &mut self,
        mut ranking: Ranking,
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Ranking, FinderError> {
        loop {
            let alike: Vec<Vec<Candidate>> =
                ranking.alike(self.settings).into_iter().map(|h| h.candidates.clone()).collect();
            let is_coarse = |h: &Hypothesis| h.grain == Grain::Unasked && self.settings.finer_fidelity.is_some();
            // What the errors of coarse simulations may have put behind.
            let explained = ranking.explanations.first().map_or(0.0, |e| e.log_bayes_factor);
            let near = (ERRING * explained).clamp(self.settings.least_log_bayes_factor, MOST_ERRING);
            let is_near =
                |place: usize, h: &Hypothesis| ranking.behind(place) < near || alike.iter().any(|a| h.is_same(a));
            let wants = |(place, h): (usize, &Hypothesis)| match h.depth {
                Depth::Promised => place < PARENTS || is_near(place, h),
                Depth::Fitted => place < PARENTS || is_near(place, h) && is_coarse(h),
                Depth::Glanced => place == 0 || is_near(place, h) && is_coarse(h),
                Depth::Polished => is_near(place, h) && is_coarse(h),
            };
            let (place, closer) = match ranking.hypotheses.iter().enumerate().position(wants) {
                Some(place) => (place, self.closer(place, &ranking.hypotheses, base, yardstick)),
                None => match overlooked(&ranking.hypotheses) {
                    Some(place) => (place, self.best(&ranking.hypotheses[place], yardstick)),
                    None => return Ok(ranking),
                },
            };
            let mut all = ranking.hypotheses;
            match closer {
                Ok(closer) => all[place] = closer,
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                // What promised something cannot be simulated.
                Err(_) => drop(all.remove(place)),
            }
            ranking = Ranking::new(self.problem, base, all, self.question.candidates.len(), self.settings)?;
        }
    }

    /// The hypothesis at `place` after the next closer look.
    fn closer(
        &mut self,
        place: usize,
        all: &[Hypothesis],
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Hypothesis, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let old = &all[place];
        match (old.depth, old.candidates.as_slice()) {
            (Depth::Promised, [candidate]) => {
                let trial = self.trial(base, candidate)?;
                self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, lowest(all), yardstick, on_round))
            }
            (Depth::Glanced, _) if place > 0 && old.grain == Grain::Unasked => self.finer(old, yardstick),
            (Depth::Polished, _) => self.finer(old, yardstick),
            (Depth::Fitted, _) if place >= PARENTS => self.finer(old, yardstick),
            _ if place == 0 => self.best(old, yardstick),
            _ => {
                let (draws, starts) = (settings.draws.div_ceil(FEWER), settings.starts.div_ceil(FEWER));
                let few = Settings { draws, starts, ..settings.clone() };
                let own = Problem { aim: all[0].fit.cost, ..old.problem(problem) };
                let known = old.where_fits(&all[0]);
                let fit =
                    self.telling.in_rounds(Stage::Name, |on_round| fit_among_draws(&own, known, &few, on_round))?;
                self.or_fitted(old, fit, Depth::Glanced, yardstick)
            }
        }
    }

    /// The hypothesis, fitted as well as it can be.
    fn best(&mut self, old: &Hypothesis, yardstick: &Yardstick) -> Result<Hypothesis, FinderError> {
        let (own, settings, known) = (old.problem(self.problem), self.settings, vec![old.fit.point.clone()]);
        let fit = self.telling.in_rounds(Stage::Name, |on_round| best_fit(&own, known, settings, on_round))?;
        self.or_fitted(old, fit, Depth::Polished, yardstick)
    }

    /// The hypothesis with that fit where it is better, looked at that closely in any case. Far from where it was, what a finer
    /// simulation shows otherwise is another thing: a fit that this confirmed gives way to none that it refutes.
    fn or_fitted(
        &mut self,
        old: &Hypothesis,
        fit: Fit,
        depth: Depth,
        yardstick: &Yardstick,
    ) -> Result<Hypothesis, FinderError> {
        let kept = Hypothesis { depth, ..old.clone() };
        let is_better = |fit: &Fit| fit.cost < old.fit.cost - LEAST_DECREASE;
        let evidence = yardstick.of(&old.candidates, &fit).filter(|_| is_better(&fit));
        let Some(evidence) = evidence else { return Ok(kept) };
        let is_far = old.unknowns.are_apart(&fit.point, &old.fit.point);
        let grain = if is_far { Grain::Unasked } else { old.grain };
        let new = Hypothesis { fit, evidence, grain, ..kept.clone() };
        if !is_far || old.grain != Grain::Fine {
            return Ok(new);
        }
        let asked = self.finer(&new, yardstick)?;
        Ok(if asked.grain == Grain::Fine && is_better(&asked.fit) { asked } else { kept })
    }

    /// The hypothesis, fitted with what a finer simulation of itself shows otherwise, where that fits.
    pub(super) fn finer(&mut self, old: &Hypothesis, yardstick: &Yardstick) -> Result<Hypothesis, FinderError> {
        let own = old.problem(self.problem);
        let finer = self.settings.finer_fidelity.unwrap_or(self.settings.fidelity);
        let done = self.telling.in_rounds(Stage::Name, |on_round| refined(&own, old.fit.clone(), finer, on_round))?;
        let (Refined { cases, fit, grain }, coarse) = (done, Hypothesis { grain: Grain::Coarse, ..old.clone() });
        Ok(match yardstick.of(&old.candidates, &fit).filter(|_| grain == Grain::Fine) {
            Some(evidence) => Hypothesis { cases: Some(cases.into()), grain, fit, evidence, ..coarse },
            None => coarse,
        })
    }
}

/// Where the best model has one effect and leaves more than noise: the next such that was not looked for in the whole support of the priors.
/// Its best fit may lie in a valley that no look from the others' has reached.
fn overlooked(all: &[Hypothesis]) -> Option<usize> {
    let is_single = |h: &Hypothesis| h.candidates.len() == 1;
    all.first().filter(|best| is_single(best) && is_beyond_noise(&best.fit, FOUND_SDS))?;
    let is_overlooked = |h: &Hypothesis| is_single(h) && matches!(h.depth, Depth::Fitted | Depth::Glanced);
    all.iter().take(WIDE).position(is_overlooked)
}

#[cfg(test)]
mod tests {
    use super::super::{Progress, Question, Telling, find};
    use super::*;
    use crate::toy::{self, Mimic, Toy};
    use catenary_core::{Fidelity, Prior};
    use std::ops::ControlFlow;

    const TRUTH: [f64; 2] = [0.25, 2e4];

    fn candidate(name: &str) -> Candidate {
        let prior = Prior::LogUniform { low: 1e-3, high: 0.1 };
        Candidate { name: name.into(), title: name.into(), prior, range: [0.0, 1.0], base: 0.0, odds: 1.0 }
    }

    fn settings() -> Settings {
        Settings { draws: 40, starts: 2, null_sets: 19, ..Settings::default() }
    }

    #[test]
    fn errors_of_a_coarse_simulation_are_no_second_effect() {
        let [hidden, other] = ["tip_mass_kg", "linear_drag_n_s_m2"];
        let simulator = Mimic { toy: Toy { gain: 3.0 }, error: 0.9, of: hidden, as_if: other };
        let measured = [toy::measured(&simulator.toy, TRUTH, &[(hidden, 0.05)])];
        let candidates = [candidate(hidden), candidate(other)];
        let model = toy::model();
        let question = Question { model: &model, measured: &measured, held_out: &[], candidates: &candidates };
        let found = |finer_fidelity| {
            let settings = Settings { finer_fidelity, ..settings() };
            let outcome = find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap();
            outcome.finding.found
        };
        assert_eq!(found(Some(Fidelity::Reference)), [[hidden]]);
        assert_eq!(found(None).len(), 2, "without the finer simulation the test would test nothing");
    }

    #[test]
    fn an_effect_whose_valley_the_present_model_does_not_lie_in_is_found() {
        let [hidden, other] = ["tip_mass_kg", "linear_drag_n_s_m2"];
        let simulator = toy::misleading(Toy { gain: 3.0 }, 0.23, hidden, 0.03);
        // What folds and has the effect at 0.05 looks as if it did not fold and had it at 0.02.
        let measured = [toy::measured(&simulator.toy, [0.22, 2e4], &[(hidden, 0.02)])];
        let candidates = [candidate(hidden), candidate(other)];
        let model = toy::model();
        let question = Question { model: &model, measured: &measured, held_out: &[], candidates: &candidates };
        let finding = find(question, &simulator, &settings(), &mut |_| ControlFlow::Continue(())).unwrap().finding;
        assert_eq!(finding.found, [[hidden]]);
        let value = finding.explanations[0].effects[0].value;
        assert!((value - 0.05).abs() < 5e-3, "{value}");
    }

    #[test]
    fn of_models_that_leave_more_than_noise_some_are_looked_for_everywhere() {
        let toy = Toy { gain: 3.0 };
        let cases = [toy::case(&toy, TRUTH, &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        assert!(is_beyond_noise(&fit, FOUND_SDS), "{}", fit.cost);
        let single = |depth| Hypothesis {
            candidates: vec![candidate("linear_drag_n_s_m2")],
            unknowns: problem.unknowns.clone(),
            cases: None,
            grain: Grain::Fine,
            fit: fit.clone(),
            evidence: Yardstick::new(&cases, &fit).unwrap().evidence().clone(),
            depth,
            spread: Vec::new(),
        };
        let [polished, glanced, promised] = [Depth::Polished, Depth::Glanced, Depth::Promised].map(single);
        let all = [polished.clone(), promised.clone(), glanced.clone()];
        assert_eq!(overlooked(&all), Some(2));
        assert_eq!(overlooked(&[vec![polished.clone(); WIDE], vec![glanced.clone()]].concat()), None);
        let mut closing = polished.clone();
        closing.fit.cost = closing.fit.residuals.len() as f64;
        assert_eq!(overlooked(&[closing, glanced.clone()]), None, "it leaves noise");
        let two = vec![candidate("tip_mass_kg"), candidate("linear_drag_n_s_m2")];
        assert_eq!(overlooked(&[Hypothesis { candidates: two, ..polished }, glanced]), None);
    }

    #[test]
    fn where_a_larger_model_fits_smaller_ones_are_fitted_from() {
        let toy = Toy { gain: 3.0 };
        let cases = [toy::case(&toy, TRUTH, &[("tip_mass_kg", 0.05)])];
        let (model, settings) = (toy::model(), settings());
        let problem = Problem::of(&model, &cases, &toy, 40);
        let mut go_on = || ControlFlow::Continue(());
        let base = best_fit(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let yardstick = Yardstick::new(&cases, &base).unwrap();
        let hypothesis = |names: &[&str], rounds: usize| {
            let candidates: Vec<Candidate> = names.iter().map(|n| candidate(n)).collect();
            let unknowns = candidates.iter().fold(problem.unknowns.clone(), |all, c| all.with(c));
            let own = Problem { unknowns: unknowns.clone(), rounds, ..problem };
            let start = Start { point: vec![0.4; unknowns.columns()], tracks: own.measured() };
            let fit = own.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
            let evidence = yardstick.of(&candidates, &fit).unwrap();
            let (cases, depth, spread) = (None, Depth::Fitted, Vec::new());
            Hypothesis { candidates, unknowns, cases, grain: Grain::Fine, fit, evidence, depth, spread }
        };
        // The smaller model has not been fitted at all.
        let (pair, single) = (hypothesis(&["tip_mass_kg", "linear_drag_n_s_m2"], 40), hypothesis(&["tip_mass_kg"], 0));
        assert!(pair.fit.cost < 1e-3 && single.fit.cost > 100.0, "{} {}", pair.fit.cost, single.fit.cost);
        let question = Question { model: &model, measured: &[], held_out: &[], candidates: &[] };
        let mut listen = |_: &Progress| ControlFlow::Continue(());
        let telling = Telling { on_progress: &mut listen, conclusions: Vec::new() };
        let mut search = Search { question, problem: &problem, held_out: &[], settings: &settings, telling };
        let better = search.stepped_back(&[pair.clone(), single], &yardstick).unwrap().expect("it fits better");
        assert!(better[1].fit.cost < 1e-3 && better[1].grain == Grain::Unasked, "{}", better[1].fit.cost);
        assert!((better[1].magnitude(0).0 - 0.05).abs() < 1e-4);
        assert!(search.stepped_back(&better, &yardstick).unwrap().is_none(), "it fits no better twice");
        let other = hypothesis(&["table_adhesion_n_m"], 0);
        assert!(search.stepped_back(&[pair, other], &yardstick).unwrap().is_none(), "it is no part of the pair");
    }

    /// The coarse simulation fits where the object is short; the finer one folds it there.
    #[test]
    fn a_fit_that_the_finer_simulation_refutes_takes_the_place_of_none_that_it_confirms() {
        let toy = || Toy { gain: 3.0 };
        let cases = [toy::case(&toy(), [0.22, 2e4], &[("tip_mass_kg", 0.05)])];
        let (model, settings, effect) = (toy::model(), settings(), candidate("tip_mass_kg"));
        let question = Question { model: &model, measured: &[], held_out: &[], candidates: &[] };
        let taken = |simulator: &dyn catenary_core::DifferentiableSimulator| {
            let problem = Problem::of(&model, &cases, simulator, 40);
            let unknowns = problem.unknowns.with(&effect);
            let own = Problem { unknowns: unknowns.clone(), ..problem };
            let fit = |rounds: usize| {
                let start = Start { point: vec![0.5; unknowns.columns()], tracks: own.measured() };
                let own = Problem { unknowns: unknowns.clone(), rounds, ..own };
                own.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap()
            };
            let (far, best) = (fit(0), fit(40));
            assert!(best.cost < 1e-3 && far.cost > 100.0, "{} {}", best.cost, far.cost);
            let yardstick = Yardstick::new(&cases, &far).unwrap();
            let candidates = vec![effect.clone()];
            let evidence = yardstick.of(&candidates, &far).unwrap();
            let (depth, grain, spread) = (Depth::Fitted, Grain::Fine, Vec::new());
            let old = Hypothesis { candidates, unknowns, cases: None, grain, fit: far, evidence, depth, spread };
            let mut listen = |_: &Progress| ControlFlow::Continue(());
            let telling = Telling { on_progress: &mut listen, conclusions: Vec::new() };
            let mut search = Search { question, problem: &problem, held_out: &[], settings: &settings, telling };
            let new = search.or_fitted(&old, best, Depth::Polished, &yardstick).unwrap();
            assert_eq!((new.depth, new.grain), (Depth::Polished, Grain::Fine));
            new.fit.cost
        };
        assert!(taken(&toy()) < 1e-3, "it confirms it");
        assert!(taken(&toy::folding_when_fine(toy(), 0.23)) > 100.0, "it refutes it");
    }
}
