//! The conclusions of a search, in words.

use crate::case::Quantity;
use crate::localise::{self, Part, Place};
use crate::name::Fitted;
use crate::verdict::{Estimate, Fitness};

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
    format!("{meaning}: {:.0} squared deviations where {middle:.0} are usual, p = {:.3}", test.statistic, test.p_value)
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

/// Which candidates explain the disagreement: those of `group`, or where it is empty, at least `best`.
pub fn named(group: &[&Fitted], best: &Fitted) -> String {
    let words = |f: &&Fitted| {
        let e = &f.explanation;
        format!("{} ({} {}, probability {:.2})", e.title, e.name, short(e.value), e.probability)
    };
    match group {
        [] => format!("no candidate explains it better than none; the least bad is {}", words(&best)),
        [one] => format!("{} explains it best", words(one)),
        several => format!("cannot tell apart: {}", several.iter().map(words).collect::<Vec<_>>().join(", ")),
    }
}
