//! What a search comes to.

use crate::detect::Test;
use crate::detectable::Limit;
use crate::discrepancy::Discrepancy;
use crate::localise::Place;
use crate::name::{Explanation, Magnitude, Ranking};
use crate::separate::Separation;
use crate::trade_off::TradeOff;
use crate::verify::Verification;
use serde::{Deserialize, Serialize};

/// The outcome of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The model explains the data up to their noise.
    NoGap,
    /// One effect, or several together, explain what the model did not.
    Named,
    /// Different effects would explain all of it, and the data do not tell them apart.
    CannotTellApart,
    /// One effect, or several together, explain the greater part of it, and others may do so nearly as well; something is left
    /// that no candidate explains.
    NamedInPart,
    /// There is a gap, and no candidate closes it, or what does stands in for something else, or unseen episodes speak against it.
    NoneOfThese,
    /// The parameters press on the edges of their priors, and the gap closes where these are opened. Effects that close it with
    /// the priors as they are, if there are any, are what else it may be.
    PriorTooNarrow,
}

impl Verdict {
    /// The name used in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::NoGap => "no_gap",
            Verdict::Named => "named",
            Verdict::CannotTellApart => "cannot_tell_apart",
            Verdict::NamedInPart => "named_in_part",
            Verdict::NoneOfThese => "none_of_these",
            Verdict::PriorTooNarrow => "prior_too_narrow",
        }
    }
}

/// A fitted value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Name with unit.
    pub name: String,
    /// Value at the best fit.
    pub value: f64,
    /// 5 % quantile.
    pub q05: f64,
    /// 95 % quantile.
    pub q95: f64,
}

/// A model, fitted and tested.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fitness {
    /// Values that all episodes share.
    pub estimates: Vec<Estimate>,
    /// The test of the hypothesis that the model explains the data.
    pub test: Test,
    /// Root mean square distance between measured and simulated keypoints over all episodes, mm.
    pub rmse_mm: f64,
}

/// Beginning of the first conclusion of a search whose best model fits nothing of the recording.
pub const MISFIT: &str = "does not fit";

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The outcome.
    pub verdict: Verdict,
    /// What each stage came to, in order.
    pub conclusions: Vec<String>,
    /// Why even the best model fits nothing of the recording; none: the verdict may be used.
    #[serde(default)]
    pub misfit: Option<String>,
    /// The present model.
    pub present: Fitness,
    /// Where the present model and the data disagree, part by part.
    pub places: Vec<Place>,
    /// Parameters that press on an edge of their prior.
    pub pressing: Vec<String>,
    /// What candidates explain, alone and together, the most probable first; empty where there is no gap.
    pub explanations: Vec<Explanation>,
    /// Probability of each candidate that it is present, the greatest first.
    pub presence: Vec<Presence>,
    /// Candidates that were left out, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Limits of detection of the candidates in the fitted episodes, in the candidates' order.
    pub limits: Vec<Limit>,
    /// Probability that the present model lacks nothing; 1 where no candidate was tried.
    pub probability_of_none: f64,
    /// Probability that it lacks something that no candidate is.
    pub probability_of_unknown: f64,
    /// The effects that the verdict names, or that it leaves open beside priors that are too narrow: for each, first the most
    /// probable, then those that cannot be told from it. Several effects that stand for it only together are joined by " + ".
    pub found: Vec<Vec<String>>,
    /// The model with the most probable effects.
    pub repaired: Option<Fitness>,
    /// What makes up for changes of the most probable effects.
    pub trade_offs: Vec<TradeOff>,
    /// What no candidate explains, where something is left: a smooth error of the repaired model, or of the present one.
    pub discrepancy: Option<Discrepancy>,
    /// What the repair is worth on episodes that no fit has seen.
    pub verification: Option<Verification>,
    /// A motion that would tell apart what these data do not.
    pub separation: Option<Separation>,
}

/// How likely an effect is to be present, alone or with others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Presence {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Its probability.
    pub probability: f64,
}

impl Finding {
    /// Judges whether the best model fits anything of keypoints that lie `spread_mm` about their own middle: one that is
    /// farther off than that predicts nothing of them, whatever effects it has.
    pub(crate) fn judge(&mut self, spread_mm: Option<f64>) {
        let best_mm = self.repaired.iter().chain([&self.present]).map(|f| f.rmse_mm).fold(f64::INFINITY, f64::min);
        let Some(spread_mm) = spread_mm.filter(|spread_mm| best_mm > *spread_mm) else { return };
        let misfit = format!(
            "the best model is {best_mm:.1} mm off the measured keypoints on average, their own middle {spread_mm:.1} mm: check model, units, frames and clocks of the recording"
        );
        self.conclusions.insert(0, format!("{MISFIT}: {misfit}"));
        self.misfit = Some(misfit);
    }

    /// The finding of a search that has come as far as localising, and no further.
    pub(crate) fn without_gap(present: Fitness, places: Vec<Place>, pressing: Vec<String>) -> Self {
        Self {
            verdict: Verdict::NoGap,
            conclusions: Vec::new(),
            misfit: None,
            present,
            places,
            pressing,
            explanations: Vec::new(),
            presence: Vec::new(),
            left_out: Vec::new(),
            limits: Vec::new(),
            probability_of_none: 1.0,
            probability_of_unknown: 0.0,
            found: Vec::new(),
            repaired: None,
            trade_offs: Vec::new(),
            discrepancy: None,
            verification: None,
            separation: None,
        }
    }

    /// Takes over the sizes of the most probable effects.
    pub(crate) fn set_magnitudes(&mut self, effects: Vec<Magnitude>) {
        let is_same = |e: &&mut Explanation| {
            e.effects.len() == effects.len() && effects.iter().all(|own| e.effects.iter().any(|o| o.name == own.name))
        };
        if let Some(explanation) = self.explanations.iter_mut().find(is_same) {
            explanation.effects = effects;
        }
    }

    /// Takes over that no candidate explains what there is, though some seemed to.
    pub(crate) fn refute(&mut self) {
        (self.verdict, self.probability_of_unknown, self.probability_of_none) = (Verdict::NoneOfThese, 1.0, 0.0);
        self.presence.iter_mut().for_each(|p| p.probability = 0.0);
        self.explanations.iter_mut().for_each(|e| (e.probability, e.probability_in_part) = (0.0, 0.0));
        self.found.clear();
    }

    /// Takes over that the candidates do worse than nothing: how probable the rest is remains as it was.
    pub(crate) fn withdraw(&mut self) {
        let (none, unknown) = (self.probability_of_none, self.probability_of_unknown);
        self.refute();
        if none + unknown > 0.0 {
            (self.probability_of_none, self.probability_of_unknown) =
                (none / (none + unknown), unknown / (none + unknown));
        }
    }

    /// Takes over how probable everything is.
    pub(crate) fn set_ranking(&mut self, ranking: &Ranking) {
        self.explanations.clone_from(&ranking.explanations);
        self.probability_of_none = ranking.none;
        self.probability_of_unknown = ranking.unknown;
        self.presence.clear();
        for explanation in &ranking.explanations {
            let own = explanation.probability + explanation.probability_in_part;
            for effect in &explanation.effects {
                match self.presence.iter_mut().find(|p| p.name == effect.name) {
                    Some(known) => known.probability += own,
                    None => self.presence.push(Presence { name: effect.name.clone(), probability: own }),
                }
            }
        }
        self.presence.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_whose_best_model_predicts_nothing_says_so_first() {
        let fitness = |rmse_mm| Fitness {
            estimates: Vec::new(),
            test: Test { statistic: 1.0, coordinates: 1, null: Vec::new(), null_left_out: 0, p_value: 0.05 },
            rmse_mm,
        };
        let judged = |present: f64, repaired: Option<f64>, spread_mm: Option<f64>| {
            let mut finding = Finding::without_gap(fitness(present), Vec::new(), Vec::new());
            finding.conclusions.push("an earlier one".into());
            finding.repaired = repaired.map(fitness);
            finding.judge(spread_mm);
            finding
        };
        let wrong = judged(2e6, Some(500.0), Some(90.0));
        assert!(wrong.misfit.is_some() && wrong.conclusions[0].starts_with(MISFIT), "{:?}", wrong.conclusions);
        assert!(wrong.conclusions[0].contains("500.0 mm") && wrong.conclusions[0].contains("90.0 mm"));
        assert!(judged(f64::NAN, None, Some(90.0)).misfit.is_some());
        assert_eq!(judged(2e6, Some(30.0), Some(90.0)).misfit, None);
        assert_eq!(judged(30.0, None, None).conclusions, ["an earlier one"]);
    }
}
