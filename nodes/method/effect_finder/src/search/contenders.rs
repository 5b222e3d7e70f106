//! Refinement of the most probable models, until their order rests on their best fits.

use super::context::{FOUND_SDS, LEAST_DECREASE, PARENTS, Search};
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Baseline, Effort, Hypothesis, Ranking, gain, lowest_cost};
use crate::settings::Settings;
use track_fit::data::Candidate;
use track_fit::fitting::{FidelityCorrection, Fit, Problem, Start, best_fit, fit_among_draws, is_beyond_noise};

/// Reduction of the number of draws and starts for a model that is not the most probable.
const FEWER: usize = 4;
/// Number of the most probable models among which single effects are searched for in their whole range, if the best of
/// all leaves more than noise.
const WIDE: usize = 6;
/// Least gain in log evidence of a smaller model that is fitted near the fit of a larger one.
const LEAST_GAIN: f64 = 1.0;
/// Discretisation error of a log Bayes factor: this share of the best one's, and at most this many nats.
const ERRING: f64 = 0.1;
const MOST_ERRING: f64 = 20.0;

impl Search<'_> {
    /// Refines the most probable models, and the models with one effect fewer than the best one. A further effect may
    /// only have led the fit into another local minimum, which a smaller model reaches as well. Returns the ranking,
    /// and whether a smaller model got better.
    pub(super) fn settle(
        &mut self,
        ranking: Ranking,
        base: &Hypothesis,
        baseline: &Baseline,
    ) -> Result<(Ranking, bool), FinderError> {
        let mut ranking = self.refine(ranking, base, baseline)?;
        let mut is_back = false;
        // Each step back removes an effect.
        for _ in 1..self.settings.most_effects {
            let Some(better) = self.stepped_back(&ranking.hypotheses, baseline)? else { break };
            let again = Ranking::new(self.problem, base, better, self.question.candidates.len(), self.settings)?;
            ranking = self.refine(again, base, baseline)?;
            is_back = true;
        }
        Ok((ranking, is_back))
    }

    /// Models with each part of the best one (one effect fewer) fitted near the fit of the best; none if no part fits
    /// better.
    fn stepped_back(
        &mut self,
        all: &[Hypothesis],
        baseline: &Baseline,
    ) -> Result<Option<Vec<Hypothesis>>, FinderError> {
        let Some(best) = all.first() else { return Ok(None) };
        let is_part = |h: &Hypothesis| h.candidates.len() + 1 == best.candidates.len() && h.is_part_of(best);
        let mut better = None;
        for (place, part) in all.iter().enumerate().filter(|(_, h)| is_part(h)) {
            // The best model's correction is valid near its fit, and the part is fitted there.
            let there =
                Hypothesis { episodes: best.episodes.clone(), correction: FidelityCorrection::Untried, ..part.clone() };
            let own = there.problem(self.problem);
            let start = |point| Start { point, tracks: own.measured() };
            let starts = there.starts_near(best).into_iter().map(start).collect();
            let fits = match self.reporter.with_progress(Stage::Name, |on_round| own.fit(starts, on_round)) {
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                // Without the effect the object may be impossible to simulate there.
                Err(_) => continue,
                Ok(fits) => fits,
            };
            let Some(fit) = fits.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost)) else { continue };
            let Some(evidence) = baseline.of(&part.candidates, &fit) else { continue };
            let new = Hypothesis { fit, evidence, effort: Effort::Fitted, ..there };
            if new.fit.cost < part.fit.cost - LEAST_DECREASE && gain(part, &new, self.settings) > LEAST_GAIN {
                let better: &mut Vec<Hypothesis> = better.get_or_insert_with(|| all.to_vec());
                better[place] = new;
            }
        }
        Ok(better)
    }

    /// Refines the most probable models until none is in doubt. A further effect may move the best values of all others
    /// into another local minimum. A coarse simulation may favour an effect by its error, which differs from that of
    /// the present model. Finally searches the whole range of [`unsearched_single`] models.
    fn refine(&mut self, mut ranking: Ranking, base: &Hypothesis, baseline: &Baseline) -> Result<Ranking, FinderError> {
        loop {
            let alike: Vec<Vec<Candidate>> =
                ranking.alike(self.settings).into_iter().map(|h| h.candidates.clone()).collect();
            let is_coarse =
                |h: &Hypothesis| h.correction == FidelityCorrection::Untried && self.settings.finer_fidelity.is_some();
            // Models within the discretisation error of the best one: their order is not settled.
            let explained = ranking.explanations.first().map_or(0.0, |e| e.log_bayes_factor);
            let near = (ERRING * explained).clamp(self.settings.least_log_bayes_factor, MOST_ERRING);
            let is_near =
                |place: usize, h: &Hypothesis| ranking.behind(place) < near || alike.iter().any(|a| h.is_same(a));
            // A model is refined if a better fit, or its own correction, may change the order at the top.
            let wants = |(place, h): (usize, &Hypothesis)| match h.effort {
                Effort::Linearised => place < PARENTS || is_near(place, h),
                Effort::Fitted => place < PARENTS || is_near(place, h) && is_coarse(h),
                Effort::Sampled => place == 0 || is_near(place, h) && is_coarse(h),
                Effort::Searched => is_near(place, h) && is_coarse(h),
            };
            let (place, refine_one) = match ranking.hypotheses.iter().enumerate().position(wants) {
                Some(place) => (place, self.refine_one(place, &ranking.hypotheses, base, baseline)),
                None => match unsearched_single(&ranking.hypotheses) {
                    Some(place) => (place, self.fit_best(&ranking.hypotheses[place], baseline)),
                    None => return Ok(ranking),
                },
            };
            let mut all = ranking.hypotheses;
            match refine_one {
                Ok(refine_one) => all[place] = refine_one,
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                // A model that was only linearised may be impossible to simulate at its minimum.
                Err(_) => drop(all.remove(place)),
            }
            ranking = Ranking::new(self.problem, base, all, self.question.candidates.len(), self.settings)?;
        }
    }

    /// Model number `place` after its next refinement.
    fn refine_one(
        &mut self,
        place: usize,
        all: &[Hypothesis],
        base: &Hypothesis,
        baseline: &Baseline,
    ) -> Result<Hypothesis, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let old = &all[place];
        match (old.effort, old.candidates.as_slice()) {
            (Effort::Linearised, [candidate]) => {
                let trial = self.linearised_single(base, candidate)?;
                self.reporter
                    .with_progress(Stage::Name, |on_round| trial.fitted(problem, lowest_cost(all), baseline, on_round))
            }
            (Effort::Sampled, _) if place > 0 && old.correction == FidelityCorrection::Untried => {
                self.correct(old, baseline)
            }
            (Effort::Searched, _) => self.correct(old, baseline),
            (Effort::Fitted, _) if place >= PARENTS => self.correct(old, baseline),
            _ if place == 0 => self.fit_best(old, baseline),
            _ => {
                let (draws, starts) = (settings.draws.div_ceil(FEWER), settings.starts.div_ceil(FEWER));
                let few = Settings { draws, starts, ..settings.clone() };
                let own = Problem { aim: all[0].fit.cost, ..old.problem(problem) };
                // The best model's minimum is a likely place for this one, too.
                let known = old.starts_near(&all[0]);
                let fit = self
                    .reporter
                    .with_progress(Stage::Name, |on_round| fit_among_draws(&own, known, &few.of_fits(), on_round))?;
                self.keep_better(old, fit, Effort::Sampled, baseline)
            }
        }
    }

    /// Model with its best fit.
    fn fit_best(&mut self, old: &Hypothesis, baseline: &Baseline) -> Result<Hypothesis, FinderError> {
        let (own, settings, known) = (old.problem(self.problem), self.settings, vec![old.fit.point.clone()]);
        let fit = self
            .reporter
            .with_progress(Stage::Name, |on_round| best_fit(&own, known, &settings.of_fits(), on_round))?;
        self.keep_better(old, fit, Effort::Searched, baseline)
    }

    /// The model with `fit` if that is better, marked with `effort` in any case. Far from the old fit, the fidelity
    /// correction is not valid any more. A fit with its own correction is replaced only by a fit whose own correction
    /// confirms it.
    fn keep_better(
        &mut self,
        old: &Hypothesis,
        fit: Fit,
        effort: Effort,
        baseline: &Baseline,
    ) -> Result<Hypothesis, FinderError> {
        let kept = Hypothesis { effort, ..old.clone() };
        let is_better = |fit: &Fit| fit.cost < old.fit.cost - LEAST_DECREASE;
        let evidence = baseline.of(&old.candidates, &fit).filter(|_| is_better(&fit));
        let Some(evidence) = evidence else { return Ok(kept) };
        let is_far = old.unknowns.are_apart(&fit.point, &old.fit.point);
        let correction = if is_far { FidelityCorrection::Untried } else { old.correction };
        let new = Hypothesis { fit, evidence, correction, ..kept.clone() };
        if !is_far || old.correction != FidelityCorrection::Applied {
            return Ok(new);
        }
        let asked = self.correct(&new, baseline)?;
        Ok(if asked.correction == FidelityCorrection::Applied && is_better(&asked.fit) { asked } else { kept })
    }
}

/// Next model with a single effect that was not searched in its whole range, if the best model has a single effect and
/// leaves more than noise. Its best fit may lie in a local minimum that no other start has reached.
fn unsearched_single(all: &[Hypothesis]) -> Option<usize> {
    let is_single = |h: &Hypothesis| h.candidates.len() == 1;
    all.first().filter(|best| is_single(best) && is_beyond_noise(&best.fit, FOUND_SDS))?;
    let is_unsearched = |h: &Hypothesis| is_single(h) && matches!(h.effort, Effort::Fitted | Effort::Sampled);
    all.iter().take(WIDE).position(is_unsearched)
}

#[cfg(test)]
mod tests {
    use super::super::find::find;
    use super::super::progress::{Progress, Reporter, Told};
    use super::super::question::Question;
    use super::*;
    use catenary_core::Fidelity;
    use std::ops::ControlFlow;
    use track_fit::noise::KeypointNoise;
    use track_fit::toy::twisted::{Mimic, folding_when_fine, misleading};
    use track_fit::toy::{self, Toy, candidate};

    const TRUTH: [f64; 2] = [0.25, 2e4];

    /// Search of fitted episodes alone.
    fn searching<'a>(
        question: Question<'a>,
        problem: &'a Problem<'a>,
        settings: &'a Settings,
        reporter: Reporter<'a>,
    ) -> Search<'a> {
        let noise = KeypointNoise::stated(question.model);
        Search { question, noise, problem, validation: &[], held_out: &[], settings, reporter }
    }

    fn settings() -> Settings {
        Settings { draws: 40, starts: 2, null_sets: 19, ..Settings::default() }
    }

    #[test]
    fn a_discretisation_error_is_not_named_as_a_second_effect() {
        let [hidden, other] = ["tip_mass_kg", "linear_drag_n_s_m2"];
        let simulator = Mimic { toy: Toy { gain: 3.0 }, error: 0.9, of: hidden, as_if: other };
        let measured = [toy::measured(&simulator.toy, TRUTH, &[(hidden, 0.05)])];
        // The error acts in every episode, so that validation episodes seem to support the second effect.
        let validation = measured.clone();
        let candidates = [candidate(hidden), candidate(other)];
        let model = toy::model();
        let question = Question { validation: &validation, candidates: &candidates, ..Question::of(&model, &measured) };
        let found = |finer_fidelity| {
            let settings = Settings { finer_fidelity, ..settings() };
            let outcome = find(question, &simulator, &settings, &mut |_| ControlFlow::Continue(())).unwrap();
            outcome.finding.found
        };
        assert_eq!(found(Some(Fidelity::Reference)), [[hidden]]);
        assert_eq!(found(None).len(), 2, "without the finer simulation the test would test nothing");
    }

    #[test]
    fn an_effect_in_another_local_minimum_is_found() {
        let [hidden, other] = ["tip_mass_kg", "linear_drag_n_s_m2"];
        let simulator = misleading(Toy { gain: 3.0 }, 0.23, hidden, 0.03);
        // An object that folds and has the effect at 0.05 looks like one that does not fold and has it at 0.02.
        let measured = [toy::measured(&simulator.toy, [0.22, 2e4], &[(hidden, 0.02)])];
        let candidates = [candidate(hidden), candidate(other)];
        let model = toy::model();
        let question = Question { candidates: &candidates, ..Question::of(&model, &measured) };
        let finding = find(question, &simulator, &settings(), &mut |_| ControlFlow::Continue(())).unwrap().finding;
        assert_eq!(finding.found, [[hidden]]);
        let value = finding.explanations[0].effects[0].value;
        assert!((value - 0.05).abs() < 5e-3, "{value}");
    }

    #[test]
    fn single_effects_that_leave_a_residual_are_searched_in_their_whole_range() {
        let toy = Toy { gain: 3.0 };
        let episodes = [toy::episode(&toy, TRUTH, &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        assert!(is_beyond_noise(&fit, FOUND_SDS), "{}", fit.cost);
        let single = |effort| Hypothesis {
            candidates: vec![candidate("linear_drag_n_s_m2")],
            unknowns: problem.unknowns.clone(),
            episodes: None,
            correction: FidelityCorrection::Applied,
            fit: fit.clone(),
            evidence: Baseline::new(&episodes, &fit).unwrap().evidence().clone(),
            effort,
            spread: Vec::new(),
        };
        let [searched, sampled, linearised] = [Effort::Searched, Effort::Sampled, Effort::Linearised].map(single);
        let all = [searched.clone(), linearised.clone(), sampled.clone()];
        assert_eq!(unsearched_single(&all), Some(2));
        assert_eq!(unsearched_single(&[vec![searched.clone(); WIDE], vec![sampled.clone()]].concat()), None);
        let mut closing = searched.clone();
        closing.fit.cost = closing.fit.residuals.len() as f64;
        assert_eq!(unsearched_single(&[closing, sampled.clone()]), None, "it leaves noise");
        let two = vec![candidate("tip_mass_kg"), candidate("linear_drag_n_s_m2")];
        assert_eq!(unsearched_single(&[Hypothesis { candidates: two, ..searched }, sampled]), None);
    }

    #[test]
    fn smaller_models_are_fitted_near_the_fit_of_a_larger_one() {
        let toy = Toy { gain: 3.0 };
        let episodes = [toy::episode(&toy, TRUTH, &[("tip_mass_kg", 0.05)])];
        let (model, settings) = (toy::model(), settings());
        let problem = Problem::of(&model, &episodes, &toy, 40);
        let mut go_on = || ControlFlow::Continue(());
        let base = best_fit(&problem, Vec::new(), &settings.of_fits(), &mut go_on).unwrap();
        let baseline = Baseline::new(&episodes, &base).unwrap();
        let hypothesis = |names: &[&str], rounds: usize| {
            let candidates: Vec<Candidate> = names.iter().map(|n| candidate(n)).collect();
            let unknowns = candidates.iter().fold(problem.unknowns.clone(), |all, c| all.with(c));
            let own = Problem { unknowns: unknowns.clone(), rounds, ..problem };
            let start = Start { point: vec![0.4; unknowns.columns()], tracks: own.measured() };
            let fit = own.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
            let evidence = baseline.of(&candidates, &fit).unwrap();
            let (episodes, effort, spread) = (None, Effort::Fitted, Vec::new());
            Hypothesis {
                candidates,
                unknowns,
                episodes,
                correction: FidelityCorrection::Applied,
                fit,
                evidence,
                effort,
                spread,
            }
        };
        // The smaller model is not fitted at all.
        let (pair, single) = (hypothesis(&["tip_mass_kg", "linear_drag_n_s_m2"], 40), hypothesis(&["tip_mass_kg"], 0));
        assert!(pair.fit.cost < 1e-3 && single.fit.cost > 100.0, "{} {}", pair.fit.cost, single.fit.cost);
        let question = Question::of(&model, &[]);
        let mut listen = |_: &Progress| ControlFlow::Continue(());
        let reporter = Reporter::new(&mut listen, Told::default());
        let mut search = searching(question, &problem, &settings, reporter);
        let better = search.stepped_back(&[pair.clone(), single], &baseline).unwrap().expect("it fits better");
        assert!(
            better[1].fit.cost < 1e-3 && better[1].correction == FidelityCorrection::Untried,
            "{}",
            better[1].fit.cost
        );
        assert!((better[1].magnitude(0).0 - 0.05).abs() < 1e-4);
        assert!(search.stepped_back(&better, &baseline).unwrap().is_none(), "it fits no better twice");
        let other = hypothesis(&["table_adhesion_n_m"], 0);
        assert!(search.stepped_back(&[pair, other], &baseline).unwrap().is_none(), "it is no part of the pair");
    }

    /// The coarse simulation fits a short object; the finer one folds it.
    #[test]
    fn an_unconfirmed_fit_does_not_replace_a_corrected_one() {
        let toy = || Toy { gain: 3.0 };
        let episodes = [toy::episode(&toy(), [0.22, 2e4], &[("tip_mass_kg", 0.05)])];
        let (model, settings, effect) = (toy::model(), settings(), candidate("tip_mass_kg"));
        let question = Question::of(&model, &[]);
        let taken = |simulator: &dyn catenary_core::DifferentiableSimulator| {
            let problem = Problem::of(&model, &episodes, simulator, 40);
            let unknowns = problem.unknowns.with(&effect);
            let own = Problem { unknowns: unknowns.clone(), ..problem };
            let fit = |rounds: usize| {
                let start = Start { point: vec![0.5; unknowns.columns()], tracks: own.measured() };
                let own = Problem { unknowns: unknowns.clone(), rounds, ..own };
                own.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap()
            };
            let (far, best) = (fit(0), fit(40));
            assert!(best.cost < 1e-3 && far.cost > 100.0, "{} {}", best.cost, far.cost);
            let baseline = Baseline::new(&episodes, &far).unwrap();
            let candidates = vec![effect.clone()];
            let evidence = baseline.of(&candidates, &far).unwrap();
            let (effort, correction, spread) = (Effort::Fitted, FidelityCorrection::Applied, Vec::new());
            let old =
                Hypothesis { candidates, unknowns, episodes: None, correction, fit: far, evidence, effort, spread };
            let mut listen = |_: &Progress| ControlFlow::Continue(());
            let reporter = Reporter::new(&mut listen, Told::default());
            let mut search = searching(question, &problem, &settings, reporter);
            let new = search.keep_better(&old, best, Effort::Searched, &baseline).unwrap();
            assert_eq!((new.effort, new.correction), (Effort::Searched, FidelityCorrection::Applied));
            new.fit.cost
        };
        assert!(taken(&toy()) < 1e-3, "it confirms it");
        assert!(taken(&folding_when_fine(toy(), 0.23)) > 100.0, "it refutes it");
    }
}
