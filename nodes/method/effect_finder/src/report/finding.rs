//! Finding of a search: verdict, figures and conclusions.

use super::decide::{Objection, VerdictEvidence, decide};
use super::detectable::DetectionLimit;
use super::further::FurtherTest;
use super::localisation::Localisation;
use super::missing::Missing;
use super::separation::Separation;
use super::trade_off::TradeOff;
use super::verdict::Verdict;
use super::verification::Verification;
use crate::evidence::{Discrepancy, Explanation, Magnitude, Ranking, Test};
use crate::settings::Settings;
use serde::{Deserialize, Serialize};
use track_fit::data::Candidate;
use track_fit::noise::KeypointNoise;

/// Estimate of a value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Name with unit.
    pub name: String,
    /// Value at the best fit.
    pub value: f64,
    /// Lower end of its interval of 90 %, at most the value: the 5 % quantile, or, if the value lies beyond a quantile, the end of
    /// the shortest interval that contains it.
    pub q05: f64,
    /// Upper end of its interval of 90 %, at least the value: the 95 % quantile, or as for the lower end.
    pub q95: f64,
}

/// Fit of a model with its test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fitness {
    /// Estimates of the shared unknowns.
    pub estimates: Vec<Estimate>,
    /// Test of the hypothesis that the model explains the data.
    pub test: Test,
    /// Root mean square distance between measured and simulated keypoints over all episodes, mm.
    pub rmse_mm: f64,
}

/// Beginning of the first conclusion if even the best model fits nothing of the recording.
pub const MISFIT: &str = "does not fit";

/// Finding of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Verdict.
    pub verdict: Verdict,
    /// Conclusions of the stages, in order.
    pub conclusions: Vec<String>,
    /// Reason for which even the best model fits nothing of the recording; none: the verdict may be used.
    #[serde(default)]
    pub misfit: Option<String>,
    /// Noise of the keypoints: stated, seen in the fitted episodes, and used.
    #[serde(default)]
    pub noise: Option<KeypointNoise>,
    /// Reason to doubt the model's noise, in a sentence, with what was done about it; none: it stands.
    #[serde(default)]
    pub noise_doubt: Option<String>,
    /// Root mean square distance of keypoints, mm, of the largest gap that may hide; none unless the verdict is that it cannot
    /// be seen.
    #[serde(default)]
    pub hidden_gap_mm: Option<f64>,
    /// Validation and held-out episodes that contradict the present model, although the episodes given as fitted agree with it.
    /// In this order they follow these among the fitted episodes of all other fields.
    #[serde(default)]
    pub joined: Vec<FurtherTest>,
    /// Present model.
    pub present: Fitness,
    /// Localisation of the disagreement, part by part.
    pub places: Vec<Localisation>,
    /// Parameters at a bound of their prior.
    pub pressing: Vec<String>,
    /// Values drawn anew for each episode that would have to lie outside of their prior.
    #[serde(default)]
    pub pressing_values: Vec<PressingValue>,
    /// Explanations by candidates, alone and together, the most probable first; empty without a gap.
    pub explanations: Vec<Explanation>,
    /// Probability of each candidate to be present, the largest first.
    pub presence: Vec<Presence>,
    /// Candidates that were left out, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Limits of detection in the fitted episodes, in the candidates' order.
    pub limits: Vec<DetectionLimit>,
    /// Probability that the present model lacks nothing; 1 if no candidate was tried.
    pub probability_of_none: f64,
    /// Probability that the present model lacks something that no candidate is.
    pub probability_of_unknown: f64,
    /// Named effects, or alternatives to a prior that is too narrow. A list for each effect: the most probable one,
    /// then the effects that cannot be told from it. Effects that replace it only together are joined by " + ".
    pub found: Vec<Vec<String>>,
    /// Effects nearest to what is missing, in the form of `found`: they explain the greater part of the gap and leave a residual, so
    /// that each may only imitate something else.
    #[serde(default)]
    pub nearest: Vec<Vec<String>>,
    /// Effects that would explain a part of the gap with a size beyond their prior: they stand in for something else, and are
    /// not named.
    pub stand_ins: Vec<StandIn>,
    /// Repaired model.
    pub repaired: Option<Fitness>,
    /// Trade-offs of the most probable effects, and of the parameters of the repaired model, or without a gap of the present one.
    pub trade_offs: Vec<TradeOff>,
    /// Likeliest discrepancy of the repaired model, or of the present one, if a residual is left.
    pub discrepancy: Option<Discrepancy>,
    /// Form of what is missing where effects leave a residual; none without a residual, or if no template explains more of it
    /// than a smooth discrepancy.
    #[serde(default)]
    pub missing: Option<Missing>,
    /// Verification of the repair on held-out episodes.
    pub verification: Option<Verification>,
    /// Motion that would separate the explanations.
    pub separation: Option<Separation>,
}

/// Value of an episode, drawn anew for each, that would have to lie outside of its prior.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PressingValue {
    /// Name with unit.
    pub name: String,
    /// Fitted episode, from 0.
    pub episode: usize,
    /// Name of the episode.
    pub episode_name: String,
}

/// Effect that stands in for something else.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StandIn {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Name in sentences.
    pub title: String,
    /// Size that it would need, in its unit.
    pub value: f64,
    /// Smallest and largest size that its prior allows.
    pub prior: [f64; 2],
}

/// Probability of an effect to be present, alone or with others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Presence {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Probability.
    pub probability: f64,
}

impl Finding {
    /// Adds a misfit if even the best model is farther off the measured keypoints than their own mean: `spread_mm` is
    /// their spread around it. Such a model predicts nothing of them, with any effects.
    pub(crate) fn judge(&mut self, spread_mm: Option<f64>) {
        let best_mm = self.repaired.iter().chain([&self.present]).map(|f| f.rmse_mm).fold(f64::INFINITY, f64::min);
        let Some(spread_mm) = spread_mm.filter(|spread_mm| best_mm > *spread_mm) else { return };
        let misfit = format!(
            "the best model is {best_mm:.1} mm off the measured keypoints on average, their own middle {spread_mm:.1} mm: check model, units, frames and clocks of the recording"
        );
        self.conclusions.insert(0, format!("{MISFIT}: {misfit}"));
        self.misfit = Some(misfit);
    }

    /// Finding of a search up to its localisation.
    pub(crate) fn without_gap(present: Fitness, places: Vec<Localisation>, pressing: Vec<String>) -> Self {
        Self {
            verdict: Verdict::NoGap,
            conclusions: Vec::new(),
            misfit: None,
            noise: None,
            noise_doubt: None,
            hidden_gap_mm: None,
            joined: Vec::new(),
            present,
            places,
            pressing,
            pressing_values: Vec::new(),
            explanations: Vec::new(),
            presence: Vec::new(),
            left_out: Vec::new(),
            limits: Vec::new(),
            probability_of_none: 1.0,
            probability_of_unknown: 0.0,
            found: Vec::new(),
            nearest: Vec::new(),
            stand_ins: Vec::new(),
            repaired: None,
            trade_offs: Vec::new(),
            discrepancy: None,
            missing: None,
            verification: None,
            separation: None,
        }
    }

    /// Parameters at a bound of their prior, and values of episodes that would have to lie beyond it.
    pub fn pressing_in_words(&self) -> Vec<String> {
        let value = |v: &PressingValue| format!("{} of {}", v.name, v.episode_name);
        self.pressing.iter().cloned().chain(self.pressing_values.iter().map(value)).collect()
    }

    /// Adds an effect that stands in for something else with the size `value`.
    pub(crate) fn add_stand_in(&mut self, effect: &Candidate, value: f64) {
        if self.stand_ins.iter().all(|s| s.name != effect.name) {
            let (name, title) = (effect.name.clone(), effect.title.clone());
            self.stand_ins.push(StandIn { name, title, value, prior: effect.support() });
        }
    }

    /// Replaces the sizes of the most probable effects.
    pub(crate) fn set_magnitudes(&mut self, effects: Vec<Magnitude>) {
        let is_same = |e: &&mut Explanation| {
            e.effects.len() == effects.len() && effects.iter().all(|own| e.effects.iter().any(|o| o.name == own.name))
        };
        if let Some(explanation) = self.explanations.iter_mut().find(is_same) {
            explanation.effects = effects;
        }
    }

    /// Takes over the verdict on the evidence. An objection takes all probability from the candidates. Those that leave a residual
    /// are the nearest ones, and alternatives to a prior that is too narrow are listed only if they close the gap.
    pub(crate) fn conclude(&mut self, evidence: &VerdictEvidence, settings: &Settings) {
        self.verdict = decide(evidence, settings);
        match evidence.repair.as_ref().and_then(|repair| repair.objection(settings)) {
            None => (),
            Some(Objection::LessLikely(_)) => self.withdraw(),
            // Within a prior that is too narrow, effects that leave a residual are no alternative.
            Some(Objection::Residual) if self.verdict == Verdict::PriorTooNarrow => self.found.clear(),
            Some(Objection::Residual) => {
                self.nearest = std::mem::take(&mut self.found);
                self.refute();
            }
            Some(_) => self.refute(),
        }
    }

    /// Withdraws all candidates: something is missing that none of them is.
    fn refute(&mut self) {
        (self.probability_of_unknown, self.probability_of_none) = (1.0, 0.0);
        self.presence.iter_mut().for_each(|p| p.probability = 0.0);
        self.explanations.iter_mut().for_each(|e| (e.probability, e.probability_in_part) = (0.0, 0.0));
        self.found.clear();
    }

    /// Withdraws candidates that do worse than the present model: the other probabilities keep their ratio.
    fn withdraw(&mut self) {
        let (none, unknown) = (self.probability_of_none, self.probability_of_unknown);
        self.refute();
        if none + unknown > 0.0 {
            (self.probability_of_none, self.probability_of_unknown) =
                (none / (none + unknown), unknown / (none + unknown));
        }
    }

    /// Takes over the probabilities of a ranking.
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
    fn a_misfit_is_the_first_conclusion() {
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
