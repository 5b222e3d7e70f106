//! Closer looks at the most probable models, until their order rests on fits that are as good as they get.

use super::naming::PARENTS;
use super::{LEAST_DECREASE, Search, Stage};
use crate::calibrate::{best_fit, refined};
use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::evidence::Yardstick;
use crate::hypothesis::{Depth, Hypothesis};
use crate::name::Ranking;
use crate::settings::Settings;

/// How many times fewer draws and starts look for the best fit of a model that is not the most probable.
const FEWER: usize = 4;

impl Search<'_> {
    /// Looks closer at the most probable hypotheses. With an effect more, the best values of all others may lie in another valley;
    /// and a coarse simulation may suit one effect by its errors, which are another one's than the present model's.
    pub(super) fn polish(
        &mut self,
        mut ranking: Ranking,
        base: &Hypothesis,
        yardstick: &Yardstick,
    ) -> Result<Ranking, FinderError> {
        loop {
            let alike: Vec<Vec<Candidate>> =
                ranking.alike(self.settings).into_iter().map(|h| h.candidates.clone()).collect();
            let is_coarse = |h: &Hypothesis| h.cases.is_none() && self.settings.finer_fidelity.is_some();
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
            (Depth::Promised, [candidate]) => self.telling.in_rounds(Stage::Name, |on_round| {
                base.with(problem, candidate, on_round)?.fitted(problem, yardstick, on_round)
            }),
            (Depth::Glanced | Depth::Polished, _)
                if old.cases.is_none() && (place > 0 || old.depth == Depth::Polished) =>
            {
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

    /// The hypothesis, fitted with what a finer simulation of itself shows otherwise. One that cannot be simulated finer
    /// stays with what the present model's shows.
    fn finer(&mut self, old: &Hypothesis, yardstick: &Yardstick) -> Result<Hypothesis, FinderError> {
        let own = old.problem(self.problem);
        let finer = self.settings.finer_fidelity.unwrap_or(self.settings.fidelity);
        let done = self.telling.in_rounds(Stage::Name, |on_round| refined(&own, old.fit.clone(), finer, on_round));
        let (cases, fit) = match done {
            Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
            Err(_) => (own.cases.to_vec(), old.fit.clone()),
            Ok(done) => done,
        };
        let evidence = yardstick.of(&old.candidates, &fit).ok_or_else(FinderError::curvature)?;
        Ok(Hypothesis { cases: Some(cases.into()), fit, evidence, ..old.clone() })
    }
}
