//! Rules of the verdict, in one pure function.
//!
//! The search collects the evidence, because some of it must be simulated; [`decide`] alone judges it.

use super::verdict::Verdict;
use crate::evidence::Extent;
use crate::settings::Settings;

/// Evidence behind a verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct VerdictEvidence {
    /// p-value of the present model's test.
    pub p_value: f64,
    /// p-values of the present model on each validation and held-out episode; empty without any, or if the fitted episodes
    /// show a gap.
    pub further: Vec<f64>,
    /// The noise is larger than what the recordings show, and cannot be told from them.
    pub is_blind: bool,
    /// Parameters or values of episodes are at bounds of their priors, and the gap closes beyond these.
    pub closes_beyond_prior: bool,
    /// Best repair; none if no candidate model is more probable than the present model.
    pub repair: Option<RepairEvidence>,
}

/// Evidence on the best repair.
#[derive(Debug, Clone, PartialEq)]
pub struct RepairEvidence {
    /// Extent to which the effects explain the fitted episodes, by the test of the repaired model.
    pub extent: Extent,
    /// Share of the present model's excess residual energy that the effects remove from the fitted episodes.
    pub share_explained: f64,
    /// Gain in log evidence over the present model, both with a discrepancy, nats.
    pub gain_over_discrepancy: f64,
    /// An effect stands in for something else: it would have to lie beyond its prior.
    pub is_stand_in: bool,
    /// Gain in log posterior by a template in the place of all effects, nats; none if it is below `least_log_bayes_factor`, or if
    /// the likeliest rival keeps some of the effects.
    pub rival_gain: Option<f64>,
    /// Number of other explanations that the data do not tell from the best one.
    pub alternatives: usize,
    /// p-value of the validation episodes before the repaired model is weighed by them. None if the fitted episodes leave a
    /// residual, or without validation episodes.
    pub first_p_value: Option<f64>,
    /// Shares of the gap that the repair closes on the validation and on the held-out episodes; empty if these show no gap.
    pub closed: Vec<ClosedGap>,
    /// Comparison with the present model on validation episodes; none without such episodes, or before it is made.
    pub validation: Option<ValidationEvidence>,
    /// p-value of the repaired model on the held-out episodes; none without any, or before they are looked at.
    pub held_out_p_value: Option<f64>,
}

/// Evidence of the validation episodes on the best repair.
#[derive(Debug, Clone, PartialEq)]
pub struct ValidationEvidence {
    /// p-value of the repaired model.
    pub p_value: Option<f64>,
    /// Share of the present model's excess residual energy that the repair removes; none without such an excess.
    pub share_explained: Option<f64>,
    /// Gain in log likelihood by the repair, nats.
    pub log_likelihood_gain: f64,
    /// Both models have a fidelity correction, or neither has.
    pub is_equally_corrected: bool,
    /// Losses in log likelihood by the alternatives, nats; empty unless [`ValidationEvidence::is_doubtful`].
    pub alternative_losses: Vec<f64>,
}

/// Share of the gap that a repair closes on episodes that no fit has seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosedGap {
    /// Closed share.
    pub share: f64,
    /// Interval of the closed share, 5 to 95 %.
    pub interval: [f64; 2],
}

impl ClosedGap {
    /// Returns whether the repair may close nothing: the interval includes 0, or lies below it.
    pub fn may_be_nothing(&self) -> bool {
        self.interval[0] <= 0.0
    }
}

/// Evidence of the validation episodes on a further effect, beside the effects that are named already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportEvidence {
    /// Number of validation episodes.
    pub episodes: usize,
    /// Gain in log likelihood of these episodes by the effect, nats, with the size that the fitted episodes give it. Both
    /// models leave a discrepancy, the likeliest one of the model without the effect.
    pub log_likelihood_gain: f64,
    /// Root mean square distance of keypoints with the effect, relative to that without it.
    pub distance_ratio: f64,
    /// Log posterior odds of the model with the effect over that without it, by the fitted episodes, nats.
    pub log_odds: f64,
}

/// Root mean square distance on validation episodes with a further effect, relative to that without it, below which the
/// effect helps.
const HELPS: f64 = 0.98;

impl SupportEvidence {
    /// Returns whether a further effect is supported. Beside something that is missing, another effect almost always fits
    /// the fitted episodes better. Therefore it must also predict episodes that no fit has seen.
    pub fn is_enough(&self, settings: &Settings) -> bool {
        let least = settings.least_log_bayes_factor;
        self.episodes > 0 && self.log_likelihood_gain >= least && self.distance_ratio < HELPS && self.log_odds >= least
    }
}

/// Reason not to name the effects of a repair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Objection {
    /// The effects leave a residual. They gain less than `least_log_bayes_factor` over the present model, both with a discrepancy,
    /// or explain less than `least_share`.
    TooLittle,
    /// An effect stands in for something else: it would have to lie beyond its prior.
    StandIn,
    /// Something that no effect of the library is explains the data better than the effects do, by this many nats.
    Rival(f64),
    /// A residual is left, and the repair removes only this share of the validation episodes' excess residual energy.
    LittleValidated(f64),
    /// The repair and all alternatives make the validation episodes less likely; the repair by this many nats.
    LessLikely(f64),
    /// Episodes that no fit has seen show a gap, of which the repair may close nothing.
    ClosesNothing(ClosedGap),
    /// A residual is left on the fitted, the validation or the held-out episodes. Among blind worlds with something foreign, the
    /// names of such effects were wrong in nine of eleven.
    Residual,
}

/// Returns whether one of `count` validation and held-out episodes contradicts the present model, by its p-value.
///
/// Bonferroni: each of them is tested at `level / count`, so that a model that lacks nothing passes all of these tests with
/// a probability of at least 1 - `level`.
pub fn is_unlike(p_value: f64, count: usize, settings: &Settings) -> bool {
    p_value <= settings.level / count as f64
}

/// Verdict on the evidence.
pub fn decide(evidence: &VerdictEvidence, settings: &Settings) -> Verdict {
    let VerdictEvidence { p_value, further, .. } = evidence;
    if *p_value > settings.level && !further.iter().any(|p| is_unlike(*p, further.len(), settings)) {
        return if evidence.is_blind { Verdict::CannotSee } else { Verdict::NoGap };
    }
    if evidence.closes_beyond_prior {
        return Verdict::PriorTooNarrow;
    }
    match &evidence.repair {
        None => Verdict::NoneOfThese,
        Some(repair) if repair.objection(settings).is_some() => Verdict::NoneOfThese,
        Some(repair) if repair.alternatives > 0 => Verdict::CannotTellApart,
        Some(_) => Verdict::Named,
    }
}

impl RepairEvidence {
    /// Returns whether the repair leaves a residual: its test fails on the fitted, the validation or the held-out episodes.
    pub fn leaves_residual(&self, settings: &Settings) -> bool {
        let unseen = [self.first_p_value, self.held_out_p_value];
        self.extent == Extent::Part || unseen.into_iter().flatten().any(|p| p <= settings.repaired_level)
    }

    /// First reason not to name the effects, if there is one.
    pub fn objection(&self, settings: &Settings) -> Option<Objection> {
        self.refutation(settings).or_else(|| self.leaves_residual(settings).then_some(Objection::Residual))
    }

    /// First reason to discard the effects, if there is one. Effects with an [`Objection::Residual`] alone are the nearest ones.
    pub fn refutation(&self, settings: &Settings) -> Option<Objection> {
        let is_left = self.leaves_residual(settings);
        let is_worth_naming = self.share_explained >= settings.least_share
            && self.gain_over_discrepancy >= settings.least_log_bayes_factor;
        if self.extent == Extent::Part && !is_worth_naming {
            return Some(Objection::TooLittle);
        }
        if self.is_stand_in {
            return Some(Objection::StandIn);
        }
        if let Some(gain) = self.rival_gain {
            return Some(Objection::Rival(gain));
        }
        let refuted = self.validation.as_ref().and_then(|validation| validation.objection(is_left, settings));
        // An effect that fits and predicts nothing only imitates what is missing.
        let closes_nothing = || self.closed.iter().copied().find(ClosedGap::may_be_nothing);
        refuted.or_else(|| closes_nothing().map(Objection::ClosesNothing))
    }
}

impl ValidationEvidence {
    /// Reason of these episodes not to name the effects. `is_left` tells that the repair leaves a residual.
    fn objection(&self, is_left: bool, settings: &Settings) -> Option<Objection> {
        let share = self.share_explained.filter(|share| is_left && *share < settings.least_share);
        if let Some(share) = share {
            return Some(Objection::LittleValidated(share));
        }
        // One alternative that does better may be the true effect.
        let are_all_less_likely = self.alternative_losses.iter().all(|l| *l >= settings.least_log_bayes_factor);
        (self.is_doubtful(settings) && are_all_less_likely).then(|| Objection::LessLikely(self.loss()))
    }

    /// Loss in log likelihood by the repair, nats.
    fn loss(&self) -> f64 {
        -self.log_likelihood_gain
    }

    /// Returns whether the episodes speak against the repair itself.
    ///
    /// Likelihoods are compared at best fits, where a better model may lose by chance if the fitted episodes leave much
    /// open. Therefore the test of the repaired model must doubt it, too, and both models must be equally corrected.
    pub fn is_doubtful(&self, settings: &Settings) -> bool {
        let is_rejected = self.p_value.is_some_and(|p| p <= settings.level);
        is_rejected && self.is_equally_corrected && self.loss() >= settings.least_log_bayes_factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Repair that closes the gap, alone.
    fn repair() -> RepairEvidence {
        RepairEvidence {
            extent: Extent::Whole,
            share_explained: 0.9,
            gain_over_discrepancy: 10.0,
            is_stand_in: false,
            rival_gain: None,
            alternatives: 0,
            first_p_value: None,
            closed: Vec::new(),
            validation: None,
            held_out_p_value: None,
        }
    }

    /// Closed share of 0.19 with an interval from `low` to 0.39.
    fn closed(low: f64) -> ClosedGap {
        ClosedGap { share: 0.19, interval: [low, 0.39] }
    }

    /// Repair that leaves a residual of the fitted episodes.
    fn partial() -> RepairEvidence {
        RepairEvidence { extent: Extent::Part, ..repair() }
    }

    /// Validation episodes that support the repair.
    fn validation() -> ValidationEvidence {
        ValidationEvidence {
            p_value: Some(0.5),
            share_explained: Some(0.9),
            log_likelihood_gain: 20.0,
            is_equally_corrected: true,
            alternative_losses: Vec::new(),
        }
    }

    /// Validation episodes that make the repair less likely, with these losses of the alternatives.
    fn against(alternative_losses: Vec<f64>) -> ValidationEvidence {
        ValidationEvidence { p_value: Some(0.04), log_likelihood_gain: -5.0, alternative_losses, ..validation() }
    }

    fn with(repair: RepairEvidence, validation: ValidationEvidence) -> RepairEvidence {
        RepairEvidence { first_p_value: validation.p_value, validation: Some(validation), ..repair }
    }

    /// A row a rule. Levels are 0.05 and 0.01, the least share is 0.5, the least log Bayes factor is 3.
    #[test]
    fn each_rule_gives_its_verdict() {
        let rejected = ValidationEvidence { p_value: Some(0.005), ..validation() };
        let little = ValidationEvidence { share_explained: Some(0.3), ..rejected.clone() };
        let rows: Vec<(&str, Option<RepairEvidence>, Verdict)> = vec![
            ("no candidate is more probable than the present model", None, Verdict::NoneOfThese),
            ("effects close the gap", Some(repair()), Verdict::Named),
            (
                "another explanation is as good",
                Some(RepairEvidence { alternatives: 1, ..repair() }),
                Verdict::CannotTellApart,
            ),
            ("a residual is left", Some(partial()), Verdict::NoneOfThese),
            (
                "a residual outweighs alternatives",
                Some(RepairEvidence { alternatives: 1, ..partial() }),
                Verdict::NoneOfThese,
            ),
            (
                "held-out episodes leave a residual",
                Some(RepairEvidence { held_out_p_value: Some(0.01), ..repair() }),
                Verdict::NoneOfThese,
            ),
            (
                "held-out episodes leave none",
                Some(RepairEvidence { held_out_p_value: Some(0.011), ..repair() }),
                Verdict::Named,
            ),
            ("too small a share", Some(RepairEvidence { share_explained: 0.49, ..partial() }), Verdict::NoneOfThese),
            (
                "a discrepancy explains as much",
                Some(RepairEvidence { gain_over_discrepancy: 2.9, ..partial() }),
                Verdict::NoneOfThese,
            ),
            (
                "shares do not matter without a residual",
                Some(RepairEvidence { share_explained: 0.1, ..repair() }),
                Verdict::Named,
            ),
            (
                "a stand-in leaves a residual",
                Some(RepairEvidence { is_stand_in: true, ..partial() }),
                Verdict::NoneOfThese,
            ),
            ("a stand-in closes the gap", Some(RepairEvidence { is_stand_in: true, ..repair() }), Verdict::NoneOfThese),
            (
                "a template closes the gap better",
                Some(RepairEvidence { rival_gain: Some(3.0), ..repair() }),
                Verdict::NoneOfThese,
            ),
            ("validation episodes support the repair", Some(with(repair(), validation())), Verdict::Named),
            ("validation episodes leave a residual", Some(with(repair(), rejected.clone())), Verdict::NoneOfThese),
            (
                "a stand-in leaves a validation residual",
                Some(with(RepairEvidence { is_stand_in: true, ..repair() }, rejected)),
                Verdict::NoneOfThese,
            ),
            (
                "little of a validation residual is explained",
                Some(with(repair(), little.clone())),
                Verdict::NoneOfThese,
            ),
            (
                "a validation share without a residual",
                Some(with(repair(), ValidationEvidence { p_value: Some(0.5), ..little })),
                Verdict::Named,
            ),
            ("validation episodes are less likely", Some(with(repair(), against(vec![]))), Verdict::NoneOfThese),
            ("with all alternatives", Some(with(repair(), against(vec![3.1, 7.0]))), Verdict::NoneOfThese),
            ("an alternative does better", Some(with(repair(), against(vec![3.1, -2.0]))), Verdict::Named),
            (
                "the test does not doubt the repair",
                Some(with(repair(), ValidationEvidence { p_value: Some(0.06), ..against(vec![]) })),
                Verdict::Named,
            ),
            (
                "only one model is corrected",
                Some(with(repair(), ValidationEvidence { is_equally_corrected: false, ..against(vec![]) })),
                Verdict::Named,
            ),
            (
                "a small loss",
                Some(with(repair(), ValidationEvidence { log_likelihood_gain: -2.9, ..against(vec![]) })),
                Verdict::Named,
            ),
        ];
        for (rule, repair, verdict) in rows {
            let evidence = |p_value, further: &[f64], closes_beyond_prior| {
                let (further, repair) = (further.to_vec(), repair.clone());
                let seen = VerdictEvidence { p_value, further, is_blind: false, closes_beyond_prior, repair };
                let verdict = decide(&seen, &Settings::default());
                let blind = decide(&VerdictEvidence { is_blind: true, ..seen }, &Settings::default());
                let expected = if verdict == Verdict::NoGap { Verdict::CannotSee } else { verdict };
                assert_eq!(blind, expected, "{rule}, and the noise is not known");
                verdict
            };
            assert_eq!(evidence(0.05, &[], false), verdict, "{rule}");
            assert_eq!(evidence(0.051, &[], false), Verdict::NoGap, "{rule}, but the present model is not rejected");
            assert_eq!(evidence(0.051, &[0.026, 1.0], false), Verdict::NoGap, "{rule}, but each episode agrees");
            assert_eq!(evidence(0.051, &[1.0, 0.025], false), verdict, "{rule}, and one of two episodes contradicts");
            assert_eq!(evidence(0.05, &[], true), Verdict::PriorTooNarrow, "{rule}, but the gap closes beyond a prior");
        }
    }

    #[test]
    fn a_repair_that_may_close_nothing_of_a_gap_that_no_fit_saw_is_not_named() {
        let with_closed = |closed: &[ClosedGap], repair| RepairEvidence { closed: closed.to_vec(), ..repair };
        let alike = RepairEvidence { alternatives: 1, ..repair() };
        for (rule, repair, expected) in [
            ("of the validation episodes", with_closed(&[closed(-0.02)], repair()), Verdict::NoneOfThese),
            (
                "of the held-out episodes alone",
                with_closed(&[closed(0.1), closed(0.0)], with(repair(), validation())),
                Verdict::NoneOfThese,
            ),
            ("beside a residual", with_closed(&[closed(-0.02)], partial()), Verdict::NoneOfThese),
            ("beside alternatives", with_closed(&[closed(-0.02)], alike), Verdict::NoneOfThese),
            ("but it does", with_closed(&[closed(0.01); 2], with(repair(), validation())), Verdict::Named),
        ] {
            let evidence = VerdictEvidence {
                p_value: 0.05,
                further: Vec::new(),
                is_blind: false,
                closes_beyond_prior: false,
                repair: Some(repair),
            };
            assert_eq!(decide(&evidence, &Settings::default()), expected, "{rule}");
            let narrow = VerdictEvidence { closes_beyond_prior: true, ..evidence.clone() };
            assert_eq!(decide(&narrow, &Settings::default()), Verdict::PriorTooNarrow, "{rule}");
            let no_gap = VerdictEvidence { p_value: 0.051, ..evidence };
            assert_eq!(decide(&no_gap, &Settings::default()), Verdict::NoGap, "{rule}");
        }
    }

    /// A row a rule. The least log Bayes factor is 3.
    #[test]
    fn a_further_effect_needs_support() {
        let enough = SupportEvidence { episodes: 1, log_likelihood_gain: 3.0, distance_ratio: 0.97, log_odds: 3.0 };
        for (rule, evidence, expected) in [
            ("validation episodes support it", enough, true),
            ("there are no validation episodes", SupportEvidence { episodes: 0, ..enough }, false),
            ("a discrepancy does as well", SupportEvidence { log_likelihood_gain: 2.9, ..enough }, false),
            ("the keypoints are no closer", SupportEvidence { distance_ratio: 0.98, ..enough }, false),
            ("the fitted episodes do without it", SupportEvidence { log_odds: 2.9, ..enough }, false),
        ] {
            assert_eq!(evidence.is_enough(&Settings::default()), expected, "{rule}");
        }
    }

    #[test]
    fn the_first_objection_is_told() {
        let objection = |repair: RepairEvidence| repair.objection(&Settings::default());
        let little = ValidationEvidence { p_value: Some(0.005), share_explained: Some(-0.2), ..against(vec![]) };
        assert_eq!(
            objection(RepairEvidence { share_explained: 0.0, is_stand_in: true, ..partial() }),
            Some(Objection::TooLittle)
        );
        assert_eq!(
            objection(with(RepairEvidence { is_stand_in: true, ..repair() }, little.clone())),
            Some(Objection::StandIn)
        );
        assert_eq!(
            objection(with(RepairEvidence { rival_gain: Some(4.0), ..repair() }, little.clone())),
            Some(Objection::Rival(4.0))
        );
        assert_eq!(objection(with(repair(), little)), Some(Objection::LittleValidated(-0.2)));
        assert_eq!(objection(with(repair(), against(vec![4.0]))), Some(Objection::LessLikely(5.0)));
        let nothing = |repair| RepairEvidence { closed: vec![closed(0.1), closed(-0.02)], ..repair };
        assert_eq!(objection(nothing(with(repair(), against(vec![4.0])))), Some(Objection::LessLikely(5.0)));
        assert_eq!(objection(nothing(with(repair(), validation()))), Some(Objection::ClosesNothing(closed(-0.02))));
        assert_eq!(objection(with(repair(), validation())), None);
        assert_eq!(objection(partial()), Some(Objection::Residual));
        assert_eq!(partial().refutation(&Settings::default()), None, "effects with a residual are the nearest ones");
    }
}
