//! Fidelity corrections of candidate models.

use super::context::Search;
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Baseline, Hypothesis};
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::{CorrectedFit, FidelityCorrection, corrected_fit};

impl Search<'_> {
    /// Model with its own fidelity correction, if that fits.
    pub(super) fn correct(&mut self, old: &Hypothesis, baseline: &Baseline) -> Result<Hypothesis, FinderError> {
        let own = old.problem(self.problem);
        let finer = self.settings.finer_fidelity.unwrap_or(self.settings.fidelity);
        let done = self
            .reporter
            .with_progress(Stage::Name, |on_round| corrected_fit(&own, old.fit.clone(), finer, on_round))?;
        let (CorrectedFit { episodes, fit, correction }, coarse) =
            (done, Hypothesis { correction: FidelityCorrection::Rejected, ..old.clone() });
        Ok(match baseline.of(&old.candidates, &fit).filter(|_| correction == FidelityCorrection::Applied) {
            Some(evidence) => Hypothesis { episodes: Some(episodes.into()), correction, fit, evidence, ..coarse },
            None => coarse,
        })
    }

    /// Present model without its fidelity correction, which is not valid elsewhere.
    pub(super) fn uncorrected(&self, base: &Hypothesis) -> Hypothesis {
        let episodes: Vec<MeasuredEpisode> = self.problem.episodes.iter().map(MeasuredEpisode::uncorrected).collect();
        Hypothesis { episodes: Some(episodes.into()), ..base.clone() }
    }
}
