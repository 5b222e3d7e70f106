//! Closer looks at the most probable models, until their order rests on fits that are as good as they get.

use super::naming::PARENTS;
use super::{LEAST_DECREASE, Search, Stage};
use crate::calibrate::{best_fit, refined};
use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::fit::Start;
use crate::hypothesis::{Depth, Hypothesis};
use crate::name::Ranking;
use crate::settings::Settings;

/// How many times fewer draws and starts look for the best fit of a model that is not the most probable.
const FEWER: usize = 4;
/// By how much the log evidence of a model must rise where it is fitted from where a larger one fits.
const LEAST_GAIN: f64 = 1.0;

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
        while let Some(better) = self.stepped_back(&ranking.hypotheses, yardstick)? {
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
            let there = Hypothesis { cases: best.cases.clone(), is_fine: best.is_fine, ..part.clone() };
            let own = there.problem(self.problem);
            let start = |point| Start { point, tracks: own.measured() };
            let starts = there.where_fits(best).into_iter().map(start).collect();
            let fits = match self.telling.in_rounds(Stage::Name, |on_round| own.fit(starts, on_round)) {
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                // Without the effect there may be nothing that can be simulated.
                Err(_) => continue,
                Ok(fits) => fits.into_iter().flatten(),
            };
            let Some(fit) = fits.min_by(|a, b| a.cost.total_cmp(&b.cost)) else { continue };
            let Some(evidence) = yardstick.of(&part.candidates, &fit) else { continue };
            if evidence.alone > part.evidence.alone + LEAST_GAIN {
                let better: &mut Vec<Hypothesis> = better.get_or_insert_with(|| all.to_vec());
                better[place] = Hypothesis { fit, evidence, depth: Depth::Fitted, ..there };
            }
        }
        Ok(better)
    }

    /// Looks closer at the most probable hypotheses. With an effect more, the best values of all others may lie in another valley;
    /// and a coarse simulation may suit one effect by its errors, which are another one's than the present model's.
    fn polished(
        &mut self,
        mut ranking: Ranking,
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Ranking, FinderError> {
        loop {
            let alike: Vec<Vec<Candidate>> =
                ranking.alike(self.settings).into_iter().map(|h| h.candidates.clone()).collect();
            let is_coarse = |h: &Hypothesis| !h.is_fine && self.settings.finer_fidelity.is_some();
            let wants = |(place, h): (usize, &Hypothesis)| match h.depth {
                Depth::Promised => place < PARENTS || alike.iter().any(|a| h.is_same(a)),
                Depth::Fitted => place < PARENTS,
                Depth::Glanced => place == 0 || place < PARENTS && is_coarse(h),
                Depth::Polished => place < PARENTS && is_coarse(h),
            };
            let Some(place) = ranking.hypotheses.iter().enumerate().position(wants) else { return Ok(ranking) };
            let mut all = ranking.hypotheses;
            match self.closer(place, &all, base, yardstick) {
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
                self.telling.in_rounds(Stage::Name, |on_round| trial.fitted(problem, yardstick, on_round))
            }
            (Depth::Glanced | Depth::Polished, _) if !old.is_fine && (place > 0 || old.depth == Depth::Polished) => {
                self.finer(old, yardstick)
            }
            _ => {
                let (draws, starts) = (settings.draws.div_ceil(FEWER), settings.starts.div_ceil(FEWER));
                let few = Settings { draws, starts, ..settings.clone() };
                let own = old.problem(problem);
                let (known, how, depth) = match place {
                    0 => (vec![old.fit.point.clone()], settings, Depth::Polished),
                    _ => (old.where_fits(&all[0]), &few, Depth::Glanced),
                };
                let fit = self.telling.in_rounds(Stage::Name, |on_round| best_fit(&own, known, how, on_round))?;
                Ok(match yardstick.of(&old.candidates, &fit) {
                    Some(evidence) if fit.cost < old.fit.cost - LEAST_DECREASE => {
                        Hypothesis { fit, evidence, depth, ..old.clone() }
                    }
                    _ => Hypothesis { depth, ..old.clone() },
                })
            }
        }
    }

    /// The hypothesis, fitted with what a finer simulation of itself shows otherwise, where that fits better.
    fn finer(&mut self, old: &Hypothesis, yardstick: &Yardstick) -> Result<Hypothesis, FinderError> {
        let own = old.problem(self.problem);
        let finer = self.settings.finer_fidelity.unwrap_or(self.settings.fidelity);
        let done = self.telling.in_rounds(Stage::Name, |on_round| refined(&own, old.fit.clone(), finer, on_round));
        let unchanged = Hypothesis { is_fine: true, ..old.clone() };
        match done {
            Err(cancelled @ FinderError::Cancelled(_)) => Err(cancelled),
            // It cannot be simulated finer.
            Err(_) => Ok(unchanged),
            Ok((cases, fit)) => Ok(match yardstick.of(&old.candidates, &fit) {
                Some(evidence) => Hypothesis { cases: Some(cases.into()), fit, evidence, ..unchanged },
                None => unchanged,
            }),
        }
    }
}
