//! Which effects explain what is left: one, and where the best does not close the gap, more.

use super::{LEAST_DECREASE, Search, Stage};
use crate::calibrate::{is_beyond_noise, leaves_much, other_valleys};
use crate::candidate::Candidate;
use crate::case::Case;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::fit::OnRound;
use crate::hypothesis::{Depth, Grain, Hypothesis, Trial};
use crate::name::{Extent, Ranking};
use crate::sentences;
use crate::verdict::{Finding, Fitness};
use crate::verify::Verification;
use catenary_core::seed;
use rand::RngExt;

/// Models that are looked at more closely, of all the most probable.
pub(super) const PARENTS: usize = 3;
/// How many times fewer draws than those of a whole fit look for an effect elsewhere, and their random stream.
const ELSEWHERE: usize = 6;
const ELSEWHERE_STREAM: u64 = 2207;
/// Places of the same effect from which it is fitted.
const MOST_TRIALS: usize = 2;
/// Tests after which no smaller model is gone back to.
const MOST_TESTS: usize = 6;
/// Number of the test of what is gone back to in the end, beyond those of all others.
const LAST_TEST: usize = 100;
/// Standard deviations of noise that a model with one effect may leave beyond what is usual, so that none is looked for elsewhere.
pub(super) const FOUND_SDS: f64 = 2.0;
/// By how much a further effect must promise to lower the cost to be fitted.
const LEAST_PROMISE: f64 = 1.0;
/// What a further effect leaves of held-out episodes, over what is left without it, is at most this.
const LEAST_SHRINK: f64 = 0.98;

/// What naming came to.
pub(super) struct Named {
    pub ranking: Ranking,
    /// The most probable model with its test; none where none of the candidates is.
    pub best: Option<Best>,
}

/// The most probable model with effects.
pub(super) struct Best {
    pub hypothesis: Hypothesis,
    pub extent: Extent,
    pub fitness: Fitness,
}

impl<'a> Search<'a> {
    /// Models with one effect each, and where the best of them does not close the gap, with more.
    pub(super) fn name(
        &mut self,
        base: &Hypothesis,
        yardstick: &Yardstick,
        finding: &mut Finding,
    ) -> Result<Named, FinderError> {
        let candidates = self.question.candidates;
        let mut hypotheses = self.singles(base, yardstick, finding)?;
        let mut tested: Option<Best> = None;
        let mut effects = 0;
        for test in 1.. {
            effects += 1;
            let ranking = Ranking::new(self.problem, base, hypotheses, candidates.len(), self.settings)?;
            let (mut ranking, is_back) = self.settled(ranking, base, yardstick)?;
            // A smaller model fits better than it was known to: from it on, larger ones are looked for anew.
            let fewer = ranking.hypotheses.first().map_or(effects, |best| best.candidates.len());
            if is_back && fewer < effects && test <= MOST_TESTS {
                effects = fewer;
                let left = ranking.hypotheses.into_iter().filter(|h| h.candidates.len() <= fewer).collect();
                ranking = Ranking::new(self.problem, base, left, candidates.len(), self.settings)?;
            }
            let is_known = |t: &Best, best: &Hypothesis| {
                t.hypothesis.is_same(&best.candidates) && (t.hypothesis.fit.cost - best.fit.cost).abs() < LEAST_DECREASE
            };
            let is_new = |best: &Hypothesis| tested.as_ref().is_none_or(|t| !is_known(t, best));
            self.telling.conclude(Stage::Name, sentences::named(&ranking, self.settings))?;
            if let Some((hypothesis, extent)) = ranking.best().filter(|(best, _)| is_new(best)) {
                if let Some(last) = tested.take_if(|t| t.hypothesis.candidates.len() < hypothesis.candidates.len())
                    && !self.is_plain(&ranking, &last.hypothesis, hypothesis)?
                {
                    let ranking = self.gone_back(&ranking, last.hypothesis.candidates.len(), base)?;
                    return Ok(Named { ranking, best: Some(last) });
                }
                tested = Some(self.test(hypothesis.clone(), extent, finding, test)?);
            }
            let is_closed = tested.as_ref().is_some_and(|t| t.extent == Extent::Whole);
            let is_candidate = |c: &&Candidate| finding.left_out.iter().all(|(name, _)| *name != c.name);
            let usable: Vec<&Candidate> = candidates.iter().filter(is_candidate).collect();
            // Where the last effect has brought nothing, a further one is not looked for.
            let is_over = ranking.hypotheses.first().is_none_or(|first| first.candidates.len() < effects);
            if is_closed || is_over || effects >= self.settings.most_effects.min(usable.len()) {
                let best = tested.filter(|t| ranking.best().is_some_and(|(b, _)| b.is_same(&t.hypothesis.candidates)));
                return Ok(Named { ranking, best });
            }
            hypotheses = self.extended(ranking.hypotheses, effects, &usable, yardstick)?;
        }
        unreachable!("the last round returns")
    }

    /// The ranking of the models with so many effects at most.
    fn gone_back(&self, ranking: &Ranking, effects: usize, base: &Hypothesis) -> Result<Ranking, FinderError> {
        let left = ranking.hypotheses.iter().filter(|h| h.candidates.len() <= effects).cloned().collect();
        Ranking::new(self.problem, base, left, self.question.candidates.len(), self.settings)
    }

    /// Puts in the place of `named`, whose best model leaves something with an effect at the end of its range, the most probable
    /// one with fewer effects, if that has no such effect; says whether there is one. `verified` is what unseen episodes say.
    pub(super) fn without_stand_in(
        &mut self,
        named: &mut Named,
        verified: Option<&Verification>,
        base: &Hypothesis,
        yardstick: &Yardstick,
        finding: &Finding,
    ) -> Result<bool, FinderError> {
        let Some(best) = &named.best else { return Ok(false) };
        let Some((effect, limit)) = best.hypothesis.at_its_limit() else { return Ok(false) };
        let is_sound = |h: &Hypothesis| !h.has(&effect.name) && h.at_its_limit().is_none();
        for effects in (1..best.hypothesis.candidates.len()).rev() {
            let ranking = self.gone_back(&named.ranking, effects, base)?;
            let ranking = self.settled(ranking, base, yardstick)?.0;
            let Some((smaller, extent)) = ranking.best().filter(|(h, _)| is_sound(h)) else { continue };
            if let Some(verification) = verified {
                self.telling.conclude(Stage::Verify, sentences::verified(verification))?;
            }
            self.telling.conclude(Stage::Repair, sentences::not_added(effect, limit))?;
            let best = self.test(smaller.clone(), extent, finding, LAST_TEST)?;
            *named = Named { ranking, best: Some(best) };
            return Ok(true);
        }
        Ok(false)
    }

    /// Models with one effect each: those that promise most are fitted.
    fn singles(
        &mut self,
        base: &Hypothesis,
        yardstick: &Yardstick,
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
            self.telling.report(Stage::Name, 0.5 * i as f64 / candidates.len() as f64, None)?;
            match self.trial(base, candidate) {
                Ok(trial) => trials.push((candidate, trial)),
                Err(error) => left_out(candidate, error)?,
            }
        }
        trials.sort_by(|(_, a), (_, b)| a.promise.total_cmp(&b.promise));
        let mut hypotheses: Vec<Hypothesis> = Vec::new();
        for (i, (candidate, trial)) in trials.into_iter().enumerate() {
            let fitted = if i < self.settings.extensions {
                let aim = lowest(&hypotheses);
                self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, aim, yardstick, on_round))
            } else {
                trial.promised(yardstick)
            };
            match fitted {
                Ok(one) => hypotheses.push(one),
                Err(error) => left_out(candidate, error)?,
            }
        }
        let is_found = hypotheses.iter().any(|h| h.depth == Depth::Fitted && !is_beyond_noise(&h.fit, FOUND_SDS));
        if !is_found {
            self.found_elsewhere(&mut hypotheses, base, yardstick)?;
            finding.left_out.retain(|(name, _)| hypotheses.iter().all(|h| !h.has(name)));
        }
        Ok(hypotheses)
    }

    /// Models with one effect each, where they fit better far from where the present model fits: an effect's own valley may not be
    /// in sight from there, nor may it change anything there.
    fn found_elsewhere(
        &mut self,
        hypotheses: &mut Vec<Hypothesis>,
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<(), FinderError> {
        // What was not fitted has no cost that another could be less than.
        let known_cost = |all: &[Hypothesis], candidate: &Candidate| {
            let is_known = |h: &&Hypothesis| h.depth != Depth::Promised && h.has(&candidate.name);
            all.iter().find(is_known).map_or(base.fit.cost, |h| h.fit.cost)
        };
        // Beside a large gap what a finer simulation shows otherwise is next to nothing.
        let is_coarse_told = base.grain == Grain::Fine && !leaves_much(&base.fit);
        let plain = self.plain(base);
        let mut trials = self.in_other_valleys(&plain)?;
        if leaves_much(&base.fit) {
            trials.extend(self.among_draws(&plain)?);
        }
        let promises = |all: &[Hypothesis], candidate: &Candidate, trial: &Trial| {
            trial.promise < known_cost(all, candidate) - LEAST_PROMISE
        };
        trials.retain(|(candidate, trial)| promises(hypotheses, candidate, trial));
        trials.sort_by(|(_, a), (_, b)| a.promise.total_cmp(&b.promise));
        let mut seen: Vec<&str> = Vec::new();
        trials.retain(|(candidate, _)| {
            seen.push(&candidate.name);
            seen.iter().filter(|name| **name == candidate.name).count() <= MOST_TRIALS
        });
        trials.truncate(self.settings.extensions);
        for (candidate, trial) in trials {
            if !promises(hypotheses, candidate, &trial) {
                continue;
            }
            let (aim, problem) = (lowest(hypotheses), self.problem);
            let is_less = |h: &Hypothesis| h.fit.cost < known_cost(hypotheses, candidate) - LEAST_DECREASE;
            let fitted =
                self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, aim, yardstick, on_round));
            let found = match fitted {
                Ok(one) if is_less(&one) && is_coarse_told => {
                    Some(self.finer(&one, yardstick)?).filter(|h| h.grain == Grain::Fine && is_less(h))
                }
                Ok(one) => Some(one).filter(is_less),
                Err(FinderError::NoFit(_)) => None,
                Err(other) => return Err(other),
            };
            if let Some(found) = found {
                hypotheses.retain(|h| !h.has(&candidate.name));
                hypotheses.push(found);
            }
        }
        Ok(())
    }

    /// Looks at each candidate in the other valleys of the present model's cost: what it lacks may have led its fit into the wrong one.
    fn in_other_valleys(&mut self, plain: &Hypothesis) -> Result<Vec<(&'a Candidate, Trial)>, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let own = plain.problem(problem);
        let valleys = self
            .telling
            .in_rounds(Stage::Name, |on_round| other_valleys(&own, &plain.fit.point, settings, on_round))?;
        let mut trials = Vec::new();
        for fit in valleys {
            let there = Hypothesis { fit, ..plain.clone() };
            trials.extend(self.each_seen(|candidate, on_round| there.with(problem, candidate, on_round))?);
        }
        Ok(trials)
    }

    /// Looks at each candidate where the best of some draws of all priors lie.
    fn among_draws(&mut self, plain: &Hypothesis) -> Result<Vec<(&'a Candidate, Trial)>, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let mut rng = seed::rng(settings.seed, ELSEWHERE_STREAM);
        self.each_seen(|candidate, on_round| {
            let mut draw = |_| (0..=plain.unknowns.columns()).map(|_| rng.random()).collect();
            let draws: Vec<Vec<f64>> = (0..settings.draws.div_ceil(ELSEWHERE)).map(&mut draw).collect();
            plain.aside(candidate).elsewhere(problem, &draws, on_round)
        })
    }

    /// Looks at each candidate as `look` does; those that cannot be simulated there are not among what is seen.
    fn each_seen(
        &mut self,
        mut look: impl FnMut(&Candidate, OnRound<'_>) -> Result<Trial, FinderError>,
    ) -> Result<Vec<(&'a Candidate, Trial)>, FinderError> {
        let candidates = self.question.candidates;
        let mut trials = Vec::new();
        for (place, candidate) in candidates.iter().enumerate() {
            self.telling.report(Stage::Name, 0.5 * place as f64 / candidates.len() as f64, None)?;
            match self.telling.in_rounds(Stage::Name, |on_round| look(candidate, on_round)) {
                Ok(trial) => trials.push((candidate, trial)),
                Err(FinderError::NoFit(_)) => (),
                Err(other) => return Err(other),
            }
        }
        Ok(trials)
    }

    /// The present model without what a finer simulation of it shows otherwise: that says nothing of other places.
    fn plain(&self, base: &Hypothesis) -> Hypothesis {
        let cases: Vec<Case> = self.problem.cases.iter().map(Case::uncorrected).collect();
        Hypothesis { cases: Some(cases.into()), ..base.clone() }
    }

    /// A look at the present model with one effect.
    pub(super) fn trial(&mut self, base: &Hypothesis, candidate: &Candidate) -> Result<Trial, FinderError> {
        let problem = self.problem;
        let from = if leaves_much(&base.fit) { &self.plain(base) } else { base };
        self.telling.in_rounds(Stage::Name, |on_round| from.with(problem, candidate, on_round))
    }

    /// Whether a further effect predicts the held-out episodes better; where there are none, whether its probability is plain.
    fn is_plain(&mut self, ranking: &Ranking, less: &Hypothesis, more: &Hypothesis) -> Result<bool, FinderError> {
        if self.held_out.is_empty() {
            let behind = ranking.log_odds(more, less);
            let is_plain = behind > self.settings.least_log_bayes_factor;
            if !is_plain {
                self.telling.conclude(Stage::Name, sentences::not_plain(more, behind))?;
            }
            return Ok(is_plain);
        }
        let verifier = self.verifier();
        let mut rmse_mm = |h: &Hypothesis| {
            self.telling.in_rounds(Stage::Verify, |on_round| Ok(verifier.predict(h, on_round)?.score.rmse_mm))
        };
        let (less_mm, more_mm) = (rmse_mm(less)?, rmse_mm(more)?);
        let shrinks = more_mm < LEAST_SHRINK * less_mm;
        if !shrinks {
            self.telling.conclude(Stage::Verify, sentences::no_better(more, less_mm, more_mm))?;
        }
        Ok(shrinks)
    }

    /// The hypotheses, and those with an effect more than `effects` that promise most.
    fn extended(
        &mut self,
        mut hypotheses: Vec<Hypothesis>,
        effects: usize,
        candidates: &[&Candidate],
        yardstick: &Yardstick,
    ) -> Result<Vec<Hypothesis>, FinderError> {
        let parents: Vec<&Hypothesis> =
            hypotheses.iter().filter(|h| h.candidates.len() == effects).take(PARENTS).collect();
        let problem = self.problem;
        let mut trials: Vec<Trial> = Vec::new();
        for (i, parent) in parents.iter().enumerate() {
            for candidate in candidates.iter().filter(|c| !parent.has(&c.name)) {
                let is_known = |t: &Trial| parent.names().iter().all(|n| t.has(n)) && t.has(&candidate.name);
                if trials.iter().any(is_known) {
                    continue;
                }
                self.telling.report(Stage::Name, i as f64 / parents.len() as f64, None)?;
                match self.telling.in_rounds(Stage::Name, |on_round| parent.with(problem, candidate, on_round)) {
                    Ok(trial) if trial.promise < parent.fit.cost - LEAST_PROMISE => trials.push(trial),
                    Ok(_) => (),
                    Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                    // Nor does what cannot be simulated beside the others explain anything.
                    Err(_) => (),
                }
            }
        }
        trials.sort_by(|a, b| a.promise.total_cmp(&b.promise));
        trials.truncate(self.settings.extensions);
        for trial in trials {
            let aim = lowest(&hypotheses);
            match self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, aim, yardstick, on_round)) {
                Ok(one) => hypotheses.push(one),
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                Err(_) => (),
            }
        }
        Ok(hypotheses)
    }

    /// The test of a model with effects: where it fails plainly, something is left.
    fn test(
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
        self.telling.conclude(Stage::Repair, sentences::repaired(&hypothesis, &finding.present, &fitness, !closes))?;
        Ok(Best { hypothesis, extent, fitness })
    }
}

/// The least cost of all that were fitted.
pub(super) fn lowest(all: &[Hypothesis]) -> f64 {
    all.iter().filter(|h| h.depth != Depth::Promised).map(|h| h.fit.cost).fold(f64::INFINITY, f64::min)
}
