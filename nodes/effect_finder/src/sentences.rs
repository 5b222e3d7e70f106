//! The conclusions of a search, in words.

use crate::candidate::Candidate;
use crate::case::Quantity;
use crate::hypothesis::Hypothesis;
use crate::localise::{self, Part, Place};
use crate::name::{Magnitude, Ranking};
use crate::separate::Separation;
use crate::settings::Settings;
use crate::trade_off::TradeOff;
use crate::verdict::{Estimate, Finding, Fitness};
use crate::verify::Verification;
use catenary_core::Fidelity;

/// A number with four figures.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 6) as usize };
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}

/// The best fit of the present model.
pub fn fitted(estimates: &[Estimate], rmse_mm: f64) -> String {
    let words = |e: &Estimate| format!("{} {} ({} to {})", e.name, short(e.value), short(e.q05), short(e.q95));
    let estimates: Vec<String> = estimates.iter().map(words).collect();
    format!("the present model fits best with {}; RMSE {rmse_mm:.1} mm", estimates.join(", "))
}

/// What the test of a model says.
pub fn detected(fitness: &Fitness, is_gap: bool) -> String {
    let test = &fitness.test;
    let middle = test.null.get(test.null.len() / 2).copied().unwrap_or(f64::NAN);
    let meaning = if is_gap { "more than noise is left" } else { "what is left is noise" };
    let less = match test.null_left_out {
        0 => String::new(),
        some => format!(", though {some} of {} data sets without a gap could not be fitted", some + test.null.len()),
    };
    let (statistic, p_value) = (test.statistic, test.p_value);
    format!("{meaning}: {statistic:.0} squared deviations where {middle:.0} are usual, p = {p_value:.3}{less}")
}

/// Where model and data disagree.
pub fn located(places: &[Place], level: f64) -> String {
    let onset = localise::onset(places, level).map(|p| match p.part {
        Part::Window { episode, from_s, to_s } => {
            format!("disagreement begins in episode {episode} between {from_s:.2} s and {to_s:.2} s")
        }
        Part::Quantity(_) => String::new(),
    });
    let worst = localise::worst_quantity(places, level).map(|p| match p.part {
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
        Part::Window { .. } => String::new(),
    });
    let words: Vec<String> = onset.into_iter().chain(worst).collect();
    if words.is_empty() { "the disagreement is spread over all times and keypoints".into() } else { words.join("; ") }
}

/// Which effects explain the disagreement.
pub fn named(ranking: &Ranking, settings: &Settings) -> String {
    let words = |h: &Hypothesis| {
        let explanation = ranking.hypotheses.iter().zip(&ranking.explanations).find(|(o, _)| o.is_same(&h.candidates));
        let effect = |e: &Magnitude| format!("{} ({} {} +- {})", e.title, e.name, short(e.value), short(e.sd));
        explanation.map_or(String::new(), |(_, e)| {
            let effects: Vec<String> = e.effects.iter().map(effect).collect();
            let probability = e.probability + e.probability_in_part;
            format!("{}, probability {probability:.2}", effects.join(" with "))
        })
    };
    match ranking.alike(settings).as_slice() {
        [] => match ranking.hypotheses.first() {
            None => "no candidate can act in this model".into(),
            Some(least) if ranking.unknown > ranking.none => format!(
                "a smooth error that no candidate makes explains it better than any, probability {:.2}; the least bad is {}",
                ranking.unknown,
                words(least)
            ),
            Some(least) => format!("no candidate explains it better than none; the least bad is {}", words(least)),
        },
        [one] => format!("{} explains it best", words(one)),
        several => format!("cannot tell apart: {}", several.iter().map(|h| words(h)).collect::<Vec<_>>().join("; ")),
    }
}

/// What the test of a model with effects says, beside the present one.
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

/// What effects come to where something is left beside them: by the episodes that were fitted, by the unseen ones, by both.
pub fn weighed(own: &[Magnitude], elsewhere: Option<&[f64]>, both: &[Magnitude]) -> String {
    let effects = |list: &[Magnitude]| -> String {
        let effect = |e: &Magnitude| format!("{} {} +- {}", e.name, short(e.value), short(e.sd));
        list.iter().map(effect).collect::<Vec<_>>().join(", ")
    };
    let words = format!("beside a smooth error of what is left: {}", effects(own));
    let Some(elsewhere) = elsewhere else { return words };
    let there = elsewhere.iter().map(|v| short(*v)).collect::<Vec<_>>().join(", ");
    format!("{words}; by the unseen episodes alone {there}, which counts as uncertainty: {}", effects(both))
}

/// That data tell an effect only together with something else.
pub fn traded(trade_off: &TradeOff) -> String {
    let [effect, other] = &trade_off.between;
    let (correlation, worth) = (trade_off.correlation, 100.0 * trade_off.worth());
    format!(
        "{effect} and {other} trade off (correlation {correlation:.2}): who measures one of them takes {worth:.0} % off what \
         these episodes leave open of the other"
    )
}

/// That what is left is too much for anything to be named.
pub fn refused(fitness: &Fitness) -> String {
    format!("none of these: with the best of them {:.1} mm are left, and that is too much to name it", fitness.rmse_mm)
}

/// That an effect which leaves something at the end of its range is nothing to name.
pub fn stands_in(effect: &Candidate, limit: f64) -> String {
    format!("none of these: {}, so that it stands in for something else", at_its_limit(effect, limit))
}

/// That it is not added to what is named.
pub fn not_added(effect: &Candidate, limit: f64) -> String {
    format!("{}: it is not added", at_its_limit(effect, limit))
}

fn at_its_limit(effect: &Candidate, limit: f64) -> String {
    format!(
        "{} goes to the end of its range ({} {}) and leaves more than noise",
        effect.title,
        effect.name,
        short(limit)
    )
}

/// That simulations of another fidelity are used from here on.
pub fn finer(fidelity: Fidelity) -> String {
    format!("coarse simulations err plainly here: all that follows is simulated at {} fidelity", fidelity.name())
}

/// That unseen episodes refute what was named.
pub fn refuted(share: f64) -> String {
    format!(
        "none of these: of what is more than noise in unseen episodes {:.0} % are explained",
        100.0 * share.max(0.0)
    )
}

/// That unseen episodes are less likely with what was named than without.
pub fn less_likely(loss: f64) -> String {
    format!("none of these: unseen episodes are less likely with them, by {loss:.1} nats")
}

/// That a further effect is not believed.
pub fn no_better(hypothesis: &Hypothesis, less_mm: f64, more_mm: f64) -> String {
    let last = hypothesis.candidates.last().map_or("", |c| c.title.as_str());
    format!("{last} does not help on unseen episodes, {less_mm:.1} -> {more_mm:.1} mm: it is not added")
}

/// That a further effect is not plain enough, where no unseen episode could tell.
pub fn not_plain(hypothesis: &Hypothesis, log_odds: f64) -> String {
    let last = hypothesis.candidates.last().map_or("", |c| c.title.as_str());
    format!("with {last}, too, it is {:.1} times as probable: that is not plain, and it is not added", log_odds.exp())
}

/// That the priors are too narrow.
pub fn narrow(pressing: &[String], p_value: f64) -> String {
    format!("{} at the edge of the prior; beyond it the gap closes (p = {p_value:.3})", pressing.join(", "))
}

/// What else closes a gap that closes beyond the edge of a prior.
pub fn at_the_edge(finding: &Finding) -> String {
    let pressing = finding.pressing.join(", ");
    match finding.found.as_slice() {
        [] => format!("no effect closes it with the prior of {pressing} as it is: open the prior, and search again"),
        found => {
            let groups: Vec<String> = found.iter().map(|alike| alike.join(" or ")).collect();
            format!(
                "either {pressing} lies beyond its prior, or the model lacks {}: measure it, or open the prior",
                groups.join(" and ")
            )
        }
    }
}

/// What held-out episodes say.
pub fn verified(v: &Verification) -> String {
    let mut words = format!(
        "RMSE on {} unseen episodes {:.1} -> {:.1} mm, noise floor {:.1} mm",
        v.episodes, v.before.rmse_mm, v.after.rmse_mm, v.floor_mm,
    );
    words += &match (v.gap_closed, v.interval) {
        (Some(closed), Some(interval)) => {
            let [low, high] = interval.map(|end| 100.0 * end);
            format!(": {:.0} % of the gap closed ({low:.0} to {high:.0} %)", 100.0 * closed)
        }
        (Some(_), None) => ": too small a gap to say how much of it is closed".into(),
        (None, _) => ": they show no gap".into(),
    };
    if let Some(p_value) = v.p_value {
        words += &format!("; that the rest of them is noise has p = {p_value:.3}");
    }
    if let Some((name, score)) = &v.wrong_effect {
        words += &format!("; with {name} in its place {:.1} mm", score.rmse_mm);
    }
    if let Some(black_box_mm) = v.black_box_mm {
        words += &format!("; a regression without physics {black_box_mm:.1} mm");
    }
    words
}

/// Which motion would tell apart what these data do not.
pub fn separated(separation: Option<&Separation>) -> String {
    match separation {
        None => "no motion was found that would tell them apart: the model has no task that says what a motion may be"
            .into(),
        Some(s) if !s.tells() => format!(
            "none of the motions that were tried would tell {} from {}: {:.1} squared deviations at most",
            s.between[0], s.between[1], s.deviations
        ),
        Some(s) => format!(
            "a motion that would tell {} from {}: {:.0} squared deviations, where {:.0} are usual",
            s.between[0], s.between[1], s.deviations, s.usual_deviations
        ),
    }
}
