//! Rivals of the named effects: fewer effects, or none, beside a template that is no effect of the library.
//!
//! Effects that imitate a missing thing fit it in part, and several of them may even leave only noise. Therefore the named
//! effects must explain the data better than a part of them with a template in the place of the others.

use super::context::{Best, Named, Search};
use super::missing::Depth;
use crate::error::FinderError;
use crate::evidence::{Baseline, Extent, Hypothesis, log_posterior};

/// Part of the named effects, or none of them, that is likelier beside a template than all of them together, by at least
/// `least_log_bayes_factor`.
pub(super) struct Rival {
    /// The model with this part; the present model if the template replaces all effects.
    pub model: Hypothesis,
    /// Log posterior less that of the named effects, nats. If these leave a residual, it has its template, too.
    pub gain: f64,
}

impl Search<'_> {
    /// Likeliest rival of the best model; none if all are less likely, or not by enough.
    pub(super) fn rival(
        &mut self,
        named: &Named,
        base: &Hypothesis,
        baseline: &Baseline,
    ) -> Result<Option<Rival>, FinderError> {
        let Some(Best { hypothesis, extent, .. }) = &named.best else { return Ok(None) };
        // A stand-in is not named anyway.
        if self.question.templates.is_empty() || hypothesis.stand_in().is_some() {
            return Ok(None);
        }
        let (candidates, settings) = (self.question.candidates.len(), self.settings);
        let log = |h: &Hypothesis| log_posterior(h, candidates, settings);
        let mut likeliest = (base, f64::NEG_INFINITY);
        for model in std::iter::once(base).chain(named.ranking.hypotheses.iter().filter(|h| h.is_part_of(hypothesis))) {
            let found = log(model) + self.gain_by_templates(model, baseline, Depth::Linear)?;
            if found > likeliest.1 {
                likeliest = (model, found);
            }
        }
        let model = likeliest.0;
        // A fit costs many simulations: only what linear models do not decide is fitted.
        for depth in [Depth::Linear, Depth::Fitted] {
            // Nothing is missing beside effects that leave only noise.
            let own = match extent {
                Extent::Whole => 0.0,
                Extent::Part => self.gain_by_templates(hypothesis, baseline, depth)?.max(0.0),
            };
            let found = match depth {
                Depth::Linear => likeliest.1,
                Depth::Fitted => log(model) + self.gain_by_templates(model, baseline, depth)?,
            };
            let gain = found - log(hypothesis) - own;
            if gain >= settings.least_log_bayes_factor {
                return Ok(Some(Rival { model: model.clone(), gain }));
            }
        }
        Ok(None)
    }
}
