//! Sentences of the conclusions of a search.

use super::bands::EpisodeBands;
use super::decide::{ClosedGap, Objection, SupportEvidence};
use super::finding::{Estimate, Finding, Fitness};
use super::further::FurtherTest;
use super::localisation::{Localisation, Part, onset, worst_quantity};
use super::missing::{Missing, part_in_words};
use super::separation::Separation;
use super::trade_off::TradeOff;
use super::verification::Verification;
use crate::evidence::{CompanionValue, Hypothesis, Magnitude, Ranking, Test};
use crate::settings::Settings;
use catenary_core::Fidelity;
use catenary_core::statistics::p_clause;
use track_fit::data::{Candidate, Quantity};

/// Number with four significant figures.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 6) as usize };
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}

/// Best fit of the present model.
pub fn fitted(estimates: &[Estimate], rmse_mm: f64) -> String {
    let words = |e: &Estimate| format!("{} {} ({} to {})", e.name, short(e.value), short(e.q05), short(e.q95));
    let estimates: Vec<String> = estimates.iter().map(words).collect();
    format!("the present model fits best with {}; RMSE {rmse_mm:.1} mm", estimates.join(", "))
}

/// Result of a model's test.
pub fn detected(fitness: &Fitness, is_gap: bool) -> String {
    let test = &fitness.test;
    let middle = test.null.get(test.null.len() / 2).copied().unwrap_or(f64::NAN);
    let meaning = if is_gap { "the residual exceeds noise" } else { "the residual is noise" };
    let less = match test.null_left_out {
        0 => String::new(),
        some => format!("; {some} of {} null data sets could not be fitted", some + test.null.len()),
    };
    let (statistic, p) = (test.statistic, p_clause(test.p_value, test.null.len()));
    format!("{meaning}: residual energy {statistic:.0}, median of the null data sets {middle:.0}, {p}{less}")
}

/// Validation and held-out episodes that agree with the present model as the fitted ones do; `tests` is not empty.
pub fn alike(tests: &[FurtherTest]) -> String {
    let least = tests.iter().min_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let p = least.map_or(String::new(), |test| p_clause(test.p_value, test.null_sets));
    match tests.len() {
        1 => format!("the further episode agrees with the model, too: {p}"),
        count => format!("the {count} further episodes agree with the model, too: the least {p}"),
    }
}

/// Validation and held-out episodes that contradict the present model, while the fitted ones agree with it.
pub fn unlike(tests: &[FurtherTest]) -> String {
    let words = |test: &FurtherTest| format!("{}, {}", test.name, p_clause(test.p_value, test.null_sets));
    let list = tests.iter().map(words).collect::<Vec<_>>().join(", and ");
    let held_out: Vec<&str> = tests.iter().filter(|t| t.is_held_out).map(|t| t.name.as_str()).collect();
    let lost = match held_out.as_slice() {
        [] => String::new(),
        [one] => format!("; {one} is no longer held out, and cannot verify the result"),
        several => format!("; {} are no longer held out, and cannot verify the result", several.join(" and ")),
    };
    let (what, them) = match tests.len() {
        1 => ("another episode contradicts".to_owned(), "it"),
        count => (format!("{count} other episodes contradict"), "them"),
    };
    format!("{what} the model: {list}; the search goes on with {them} among the fitted episodes{lost}")
}

/// Warning about a noise of the model that is larger than the data's; none if the residual is as large as that of some null data set.
/// With such a noise the test sees no gap that is smaller than it.
pub fn noise_doubt(test: &Test) -> Option<String> {
    let least = *test.null.first()?;
    let middle = test.null[test.null.len() / 2];
    (test.statistic < least).then(|| {
        let (statistic, count) = (test.statistic, test.null.len());
        let factor = (middle / statistic.max(f64::MIN_POSITIVE)).sqrt();
        let factor = if factor < 100.0 { format!("about {factor:.1} times") } else { "more than 100 times".to_owned() };
        format!(
            "the noise of the model is {factor} that of the data (residual energy {statistic:.0}, and at least {least:.0} in {count} null data sets): a gap smaller than it is not seen; check camera.keypoint_noise_px, and arm.pose_noise_m if the arm's path is predicted"
        )
    })
}

/// Gap that may hide in a noise that is not known; none if its size has no measure in the plane of motion.
pub fn unseen(hidden_gap_mm: Option<f64>) -> String {
    let size =
        hidden_gap_mm.map_or(String::new(), |mm| format!(" of up to {mm:.1} mm (root mean square of the keypoints)"));
    format!(
        "cannot see: a gap{size} may hide in the stated noise; measure the noise of the keypoints with an object at rest, state it as camera.keypoint_noise_px, and search again"
    )
}

/// Localisation of the disagreement. `names` are those of the fitted episodes.
pub fn located(places: &[Localisation], level: f64, names: &[&str]) -> String {
    let begin = onset(places, level).map(|p| match p.part {
        Part::Window { episode, from_s, to_s } => {
            format!("disagreement begins in {} between {from_s:.2} s and {to_s:.2} s", names[episode])
        }
        Part::Quantity(_) => String::new(),
    });
    let worst = worst_quantity(places, level).map(|p| match p.part {
        Part::Quantity(Quantity::Keypoint { point, axis }) => {
            let direction = ["along", "across"][axis];
            format!(
                "it is largest at keypoint {point} from the grip, {direction} the image's rows ({:.1} times the noise)",
                p.mean_square.sqrt()
            )
        }
        Part::Quantity(Quantity::Pose { axis }) => {
            let what = ["x", "z", "pitch"][axis];
            format!("it is largest in the arm's {what} ({:.1} times the noise)", p.mean_square.sqrt())
        }
        Part::Quantity(Quantity::Wrench { axis }) => {
            let what = ["force along x", "force along z", "torque about y"][axis];
            format!("it is largest in the {what} on the hand ({:.1} times the noise)", p.mean_square.sqrt())
        }
        Part::Window { .. } => String::new(),
    });
    let words: Vec<String> = begin.into_iter().chain(worst).collect();
    if words.is_empty() { "the disagreement is spread over all times and keypoints".into() } else { words.join("; ") }
}

/// Companion of an effect after the effect's own size: ", strand_slip_turn_rad 0.17 (0.12 to 0.25)".
fn companion(of: &CompanionValue) -> String {
    format!(", {} {} ({} to {})", of.name, short(of.value), short(of.q05), short(of.q95))
}

/// Ranking of the explanations.
pub fn named(ranking: &Ranking, settings: &Settings) -> String {
    let words = |h: &Hypothesis| {
        let explanation = ranking.hypotheses.iter().zip(&ranking.explanations).find(|(o, _)| o.is_same(&h.candidates));
        let effect = |e: &Magnitude| {
            let companions: String = e.companions.iter().map(companion).collect();
            format!("{} ({} {} +- {}{companions})", e.title, e.name, short(e.value), short(e.sd))
        };
        explanation.map_or(String::new(), |(_, e)| {
            let effects: Vec<String> = e.effects.iter().map(effect).collect();
            let probability = e.probability + e.probability_in_part;
            format!("{}, probability {probability:.2}", effects.join(" with "))
        })
    };
    match ranking.alike(settings).as_slice() {
        [] => match ranking.hypotheses.first() {
            None => "no effect of the library can act in this model".into(),
            Some(least) if ranking.unknown > ranking.none => format!(
                "a smooth discrepancy explains it better than every effect, probability {:.2}; the best effect is {}",
                ranking.unknown,
                words(least)
            ),
            Some(least) => {
                format!("no effect explains it better than the present model; the best effect is {}", words(least))
            }
        },
        [one] => format!("{} explains it best", words(one)),
        several => format!("cannot tell apart: {}", several.iter().map(|h| words(h)).collect::<Vec<_>>().join("; ")),
    }
}

/// Meaning of the intervals of a group of numbers, which may trade off along a curve.
pub const LOCAL_INTERVALS: &str = "the intervals of the numbers of one effect are local, and may be too narrow where the numbers trade off: `catenary infer`, with their own priors in the model, gives their posterior";

/// Test of a repaired model, beside the present one.
pub fn repaired(hypothesis: &Hypothesis, present: &Fitness, fitness: &Fitness, is_gap: bool) -> String {
    let titles: Vec<&str> = hypothesis.candidates.iter().map(|c| c.title.as_str()).collect();
    format!(
        "with {} RMSE {:.1} -> {:.1} mm; {}",
        titles.join(" and "),
        present.rmse_mm,
        fitness.rmse_mm,
        detected(fitness, is_gap)
    )
}

/// Sizes of effects that leave a residual: by the fitted episodes, by the validation episodes alone, and by both.
pub fn weighed(own: &[Magnitude], elsewhere: Option<&[f64]>, both: &[Magnitude]) -> String {
    let effects = |list: &[Magnitude]| -> String {
        let effect = |e: &Magnitude| {
            let companions: String = e.companions.iter().map(companion).collect();
            format!("{} {} +- {}{companions}", e.name, short(e.value), short(e.sd))
        };
        list.iter().map(effect).collect::<Vec<_>>().join(", ")
    };
    let words = format!("with the residual counted as a discrepancy: {}", effects(own));
    let Some(elsewhere) = elsewhere else { return words };
    let there = elsewhere.iter().map(|v| short(*v)).collect::<Vec<_>>().join(", ");
    format!(
        "{words}; the validation episodes alone give {there}; with the difference counted as uncertainty: {}",
        effects(both)
    )
}

/// Trade-off between an effect and another unknown, or between two parameters.
pub fn traded(trade_off: &TradeOff) -> String {
    let [one, other] = &trade_off.between;
    if let Some(words) = trade_off.determined([one, other]) {
        return format!("the recordings {words}");
    }
    let (correlation, worth) = (trade_off.correlation, 100.0 * trade_off.worth());
    format!(
        "{one} and {other} trade off (correlation {correlation:.2}): measuring one of them \
         reduces the uncertainty of the other by {worth:.0} %"
    )
}

/// Reason not to name the effects of `repair`, whose distance on the fitted episodes is `rmse_mm`.
pub fn objected(objection: Objection, repair: &Hypothesis, rmse_mm: f64) -> String {
    let reason = match objection {
        Objection::TooLittle => format!("the best explanation leaves {rmse_mm:.1} mm, too much to be named"),
        Objection::StandIn => repair.stand_in().map_or(String::new(), |(effect, value)| stand_in(effect, value)),
        Objection::Rival(gain) => {
            format!("something that is no effect of the library explains the recording better, by {gain:.1} nats")
        }
        Objection::LittleValidated(share) => {
            let percent = 100.0 * share.max(0.0);
            format!("they explain {percent:.0} % of the excess residual energy of validation episodes")
        }
        Objection::LessLikely(loss) => format!("they make validation episodes less likely, by {loss:.1} nats"),
        Objection::ClosesNothing(ClosedGap { share, interval }) => {
            let [low, high] = interval.map(|end| 100.0 * end);
            format!(
                "on the recordings that no fit saw the repair closes {:.0} % of the gap ({low:.0} to {high:.0} %), which may be nothing",
                100.0 * share
            )
        }
        Objection::Residual => {
            let titles: Vec<&str> = repair.candidates.iter().map(|c| c.title.as_str()).collect();
            format!(
                "nearest is {}, which leaves a residual and may only imitate what is missing",
                titles.join(" with ")
            )
        }
    };
    format!("none of these: {reason}")
}

/// Named effects of which a part is likelier beside something else.
pub fn rivalled(part: &Hypothesis, gain: f64) -> String {
    let titles: Vec<&str> = part.candidates.iter().map(|c| c.title.as_str()).collect();
    format!(
        "{} beside something that is no effect of the library explains the recording better, by {gain:.1} nats: the other effects are not added",
        titles.join(" and ")
    )
}

/// Reason not to add a stand-in to the named effects.
pub fn not_added(effect: &Candidate, value: f64) -> String {
    format!("{}: it is not added", stand_in(effect, value))
}

fn stand_in(effect: &Candidate, value: f64) -> String {
    let [low, high] = effect.support().map(short);
    format!(
        "{} stands in for something else: {} would have to be {}, beyond its prior of {low} to {high}",
        effect.title,
        effect.name,
        short(value)
    )
}

/// Change to the fallback fidelity.
pub fn finer(fidelity: Fidelity) -> String {
    format!("the coarse simulation errs too much here: the search goes on at {} fidelity", fidelity.name())
}

/// Reason not to add a further effect that validation episodes do not support.
pub fn not_supported(hypothesis: &Hypothesis, evidence: &SupportEvidence) -> String {
    let last = hypothesis.candidates.last().map_or("", |c| c.title.as_str());
    match evidence.episodes {
        0 => format!("{last} would explain more; another recording must show it, too (--validate): it is not added"),
        _ => format!(
            "the episodes do not support {last} (log odds {:.1}; validation episodes: gain {:.1} nats beside a discrepancy, distance times {:.2}): it is not added",
            evidence.log_odds, evidence.log_likelihood_gain, evidence.distance_ratio
        ),
    }
}

/// Priors that are too narrow. The p-value exceeds the level of the test, so that it is no bound.
pub fn narrow(pressing: &[String], p_value: f64) -> String {
    format!("{} at a bound of the prior; beyond it the gap closes (p = {p_value:.3})", pressing.join(", "))
}

/// Parameters and values of episodes at a bound of their prior, where opened priors do not close a gap, or none is left.
pub fn at_bound(pressing: &[String]) -> String {
    format!("at a bound of the prior, beyond which the best value may lie: {}", pressing.join(", "))
}

/// Alternatives to a prior that is too narrow.
pub fn at_the_edge(finding: &Finding) -> String {
    let pressing = finding.pressing_in_words().join(", ");
    match finding.found.as_slice() {
        [] => format!("no effect closes the gap within the prior of {pressing}: widen the prior, and search again"),
        found => {
            let groups: Vec<String> = found.iter().map(|alike| alike.join(" or ")).collect();
            format!(
                "either {pressing} lies beyond its prior, or the model lacks {}: measure {pressing}, or widen the prior",
                groups.join(" and ")
            )
        }
    }
}

/// Result on validation or held-out episodes.
pub fn verified(v: &Verification) -> String {
    let floor = v.floor_mm.map_or("unknown".to_owned(), |mm| format!("{mm:.1} mm"));
    let mut words = format!(
        "RMSE on {} {} episodes {:.1} -> {:.1} mm, noise floor {floor}",
        v.episodes,
        if v.selects { "validation" } else { "held-out" },
        v.before.rmse_mm,
        v.after.rmse_mm,
    );
    words += &match (v.gap_closed, v.interval) {
        (Some(closed), Some(interval)) => {
            let [low, high] = interval.map(|end| 100.0 * end);
            format!(": {:.0} % of the gap closed ({low:.0} to {high:.0} %)", 100.0 * closed)
        }
        (Some(_), None) => ": too small a gap to say how much of it is closed".into(),
        (None, _) if v.floor_mm.is_none() => ": none of its repeats could be simulated".into(),
        (None, _) => ": they show no gap".into(),
    };
    if let Some(p_value) = v.p_value {
        words += &format!("; test of the remaining residual: {}", p_clause(p_value, v.null_sets));
    }
    if let Some((name, score)) = &v.wrong_effect {
        words += &format!("; with {name} instead {:.1} mm", score.rmse_mm);
    }
    if let Some(black_box_mm) = v.black_box_mm {
        words += &format!("; a regression without physics {black_box_mm:.1} mm");
    }
    if v.draws_left_out > 0 {
        words += &format!("; {} draws of the predictions could not be simulated", v.draws_left_out);
    }
    words
}

/// Draws that are missing in the pictures of the fitted episodes.
pub fn left_out_of_pictures(left_out: usize, bands: &[EpisodeBands], is_repaired: bool) -> String {
    let lacks_band = [
        ("present", bands.iter().any(|b| b.before.is_none())),
        ("repaired", is_repaired && bands.iter().any(|b| b.after.is_none())),
    ];
    let lacking: Vec<&str> = lacks_band.iter().filter(|(_, lacks)| *lacks).map(|(model, _)| *model).collect();
    let rest = match lacking.as_slice() {
        [] => String::new(),
        models => format!("; too few are left for a band of the {} model", models.join(" and of the ")),
    };
    format!("pictures: {left_out} draws of the posterior could not be simulated and are left out{rest}")
}

/// Form of what is missing.
pub fn missing(found: Option<&Missing>) -> String {
    let Some(found) = found else {
        return "what is missing has no form: no template explains more than a smooth discrepancy".into();
    };
    let [from_s, to_s] = found.phase_s;
    let others: Vec<String> =
        found.alternatives.iter().map(|a| format!("{} {:.2}", part_in_words(&a.hook), a.probability)).collect();
    let or = if others.is_empty() { String::new() } else { format!("; otherwise {}", others.join(", ")) };
    format!(
        "what is missing acts on {}, probability {:.2}, like a {}, and shows most between {from_s:.2} s and {to_s:.2} s{or}",
        part_in_words(&found.hook),
        found.probability,
        found.form.words(),
    )
}

/// Motion that would separate two explanations.
pub fn separated(separation: Option<&Separation>) -> String {
    match separation {
        None => {
            "no motion was found that would tell them apart: the model has no task, whose workspace bounds a motion"
                .into()
        }
        Some(s) if !s.separates() => format!(
            "none of the motions that were tried would tell {} from {}: residual energy {:.1} at most",
            s.between[0], s.between[1], s.deviations
        ),
        Some(s) => format!(
            "a motion that would tell {} from {}: residual energy {:.0}, {:.0} for the median motion",
            s.between[0], s.between[1], s.deviations, s.usual_deviations
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Band, Score};

    #[test]
    fn the_least_possible_p_value_is_said_to_be_a_bound() {
        let said = |p_value| {
            let test = Test { p_value, statistic: 900.0, null: vec![100.0; 199], null_left_out: 0, coordinates: 100 };
            detected(&Fitness { estimates: Vec::new(), test, rmse_mm: 3.0 }, true)
        };
        assert!(said(1.0 / 200.0).ends_with(", p <= 0.005 (199 null data sets)"), "{}", said(1.0 / 200.0));
        assert!(said(2.0 / 200.0).ends_with(", p = 0.010"), "{}", said(2.0 / 200.0));
    }

    #[test]
    fn a_noise_that_is_too_large_is_doubted() {
        let test = |statistic: f64| {
            let null = (0..99).map(|k| 180.0 + f64::from(k)).collect();
            Test { p_value: 1.0, statistic, null, null_left_out: 0, coordinates: 200 }
        };
        assert_eq!(noise_doubt(&test(181.0)), None);
        let doubt = noise_doubt(&test(57.0)).unwrap();
        assert!(
            doubt.starts_with("the noise of the model is about 2.0 times that of the data (residual energy 57"),
            "{doubt}"
        );
        assert!(noise_doubt(&test(0.0)).unwrap().contains("more than 100 times"));
    }

    #[test]
    fn a_verification_says_its_bound_its_missing_floor_and_its_missing_draws() {
        let score = Score { rmse_mm: 4.0, energy_mm: None };
        let verification = Verification {
            selects: true,
            episodes: 1,
            before: score,
            after: score,
            floor_mm: None,
            gap_closed: None,
            interval: None,
            p_value: Some(1.0 / 100.0),
            null_sets: 99,
            draws_left_out: 7,
            share_explained: None,
            log_likelihood_gain: 0.0,
            wrong_effect: None,
            black_box_mm: None,
        };
        let words = verified(&verification);
        assert!(words.contains("noise floor unknown: none of its repeats could be simulated"), "{words}");
        assert!(words.contains("p <= 0.01 (99 null data sets)") && words.contains("7 draws"), "{words}");
        let known = verified(&Verification { floor_mm: Some(1.5), draws_left_out: 0, ..verification });
        assert!(known.contains("noise floor 1.5 mm: they show no gap") && !known.contains("draws"), "{known}");
    }

    #[test]
    fn a_picture_without_a_band_is_told() {
        let lacking = |before, after| {
            let bands = EpisodeBands { is_held_out: false, times_s: Vec::new(), measured: Vec::new(), before, after };
            left_out_of_pictures(12, &[bands], true)
        };
        let band = || Some(Band { q05: Vec::new(), median: Vec::new(), q95: Vec::new() });
        assert!(lacking(band(), band()).ends_with("12 draws of the posterior could not be simulated and are left out"));
        assert!(lacking(band(), None).ends_with("too few are left for a band of the repaired model"));
        assert!(lacking(None, None).ends_with("of the present and of the repaired model"));
    }
}
