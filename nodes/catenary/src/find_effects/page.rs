//! HTML page of a search: the answer, its evidence, and the detectable sizes.

use super::answer::{answer, most_probable, noise_words, pressing, repaired_with, times_the_noise};
use super::report::{Report, UsedEpisode};
use crate::exit::Misfit;
use crate::report::Page;
use crate::report::number::{millimetres, percent, plain};
use crate::report::palette::Role;
use crate::report::plots::densities::null_histogram;
use crate::report::plots::replay::{Fit, Plane, replay};
use crate::report::plots::search::{Bar, Entry, Interval, Panel, Ribbon, Shape, bars, intervals, panel};
use crate::report::quantity::Quantity;
use anyhow::Result;
use catenary_core::statistics::p_words;
use catenary_core::{Model, Prior};
use catenary_simulator::Registry;
use effect_finder::Verdict;
use effect_finder::evidence::{CompanionValue, Explanation, Magnitude};
use effect_finder::report::{
    Band, DetectionLimit, EpisodeBands, Estimate, Finding, Fitness, Localisation, Part, PlaneTrack, Verification,
};
use track_fit::data;

/// Largest number of explanations in the picture.
const RANKED: usize = 8;
/// Least number of explanations in the picture. Further ones need at least the probability `NEGLIGIBLE`.
const LEAST_RANKED: usize = 3;
const NEGLIGIBLE: f64 = 0.005;
/// Largest number of fitted episodes in the pictures, and of held-out ones.
const SHOWN: usize = 3;
/// Names of the two models on the page.
const PRESENT: &str = "present model";
const REPAIRED: &str = "repaired model";

/// Renders the whole page.
pub fn page(report: &Report, model: &Model, shown: &[EpisodeBands]) -> Result<String> {
    let finding = &report.finding;
    let mut page = Page::new(&format!("Missing effects of the model {}", report.model));
    page.answer(
        &answer(finding, report.episodes.len()),
        matches!(finding.verdict, Verdict::CannotSee | Verdict::NoneOfThese | Verdict::PriorTooNarrow),
    );
    let mut all: Vec<String> = finding.misfit.iter().map(|reason| Misfit::headline(reason)).collect();
    all.extend(report.warnings.iter().cloned());
    all.extend(doubts(finding));
    page.warnings(&all);
    page.heading("The model and its parameters");
    models(&mut page, finding, model);
    page.heading("Measured and predicted");
    page.note("The slider begins where model and recording differ most. Curves: keypoint at the tip; bands hold 90 % of a model's predictions.");
    for (title, episode) in chosen(shown, report).into_iter().take(2) {
        page.svg(&over_one_another(&title, episode));
    }
    for (title, episode) in chosen(shown, report).into_iter().take(2) {
        (0..2).for_each(|axis| page.svg(&overlay(&title, episode, 3, axis)));
    }
    if let Some(verification) = &finding.verification {
        page.svg(&gap(verification));
    }
    page.svg(&places("Errors of the present model", report));
    if !finding.explanations.is_empty() {
        page.heading("Competing explanations");
        explanations(&mut page, finding)?;
    }
    limits(&mut page, finding);
    page.heading("Details");
    details(&mut page, report, shown)?;
    Ok(page.finish())
}

/// Reasons for doubt: alternatives, trade-offs, and parameters at the edge of their priors.
fn doubts(finding: &Finding) -> Vec<String> {
    let mut doubts = Vec::new();
    let told = repaired_with(finding);
    if told.iter().any(|alike| alike.len() > 1) {
        let groups: Vec<String> =
            told.iter().map(|alike| alike.iter().map(|n| titles(n)).collect::<Vec<_>>().join(" or ")).collect();
        // Only a motion that does separate them is worth a hint.
        let motion = finding.separation.as_ref().filter(|s| s.separates());
        let hint = motion.map_or("", |_| " The motion in separating_motion.csv would separate them.");
        doubts.push(format!("These cannot be told apart in the recordings: {}.{hint}", groups.join("; ")));
    }
    for t in &finding.trade_offs {
        let [a, b] = [&t.between[0], &t.between[1]].map(|name| Quantity::of(name).title);
        doubts.push(match t.determined([&a, &b]) {
            Some(words) => format!("The recordings {words}: measure one of them."),
            None => format!("The {a} and the {b} trade off (correlation {:.2}): measure one of them.", t.correlation),
        });
    }
    if !finding.nearest.is_empty() {
        let words =
            "The repaired model below is that with the nearest effects (nearest.yaml); model.yaml has none of them.";
        doubts.push(words.into());
    }
    // The answer itself names what a prior that is too narrow presses.
    let pressing = pressing(finding);
    if finding.verdict != Verdict::PriorTooNarrow && !pressing.is_empty() {
        doubts.push(format!("At the edge of the prior: {}.", pressing.join(", ")));
    }
    doubts
}

/// Titles of the effects in a joined name.
fn titles(names: &str) -> String {
    names.split(" + ").map(|name| Quantity::of(name).title).collect::<Vec<_>>().join(" with ")
}

/// Table of both models: priors, values, and goodness of fit.
fn models(page: &mut Page, finding: &Finding, model: &Model) {
    let (present, repaired) = (&finding.present, finding.repaired.as_ref());
    let words =
        |e: Option<&Estimate>| e.map_or("-".to_owned(), |e| Quantity::of(&e.name).estimate(e.value, e.q05, e.q95));
    let find = |fitness: &'_ Fitness, name: &str| fitness.estimates.iter().find(|e| e.name == name).cloned();
    let mut names: Vec<&String> = present.estimates.iter().map(|e| &e.name).collect();
    let more = repaired.iter().flat_map(|r| &r.estimates).map(|e| &e.name);
    more.for_each(|name| {
        if !names.contains(&name) {
            names.push(name)
        }
    });
    let cells = |title: String, prior: String, value: &dyn Fn(&Fitness) -> String| {
        let own = [title, value(present)].into_iter();
        own.chain(repaired.map(value)).chain([prior]).collect::<Vec<String>>()
    };
    let mut rows: Vec<Vec<String>> = names
        .iter()
        .map(|name| {
            let prior = prior_of(model, name).map(|p| Quantity::of(name).prior(&p)).unwrap_or_default();
            cells(Quantity::of(name).title, prior, &|f| words(find(f, name).as_ref()))
        })
        .collect();
    let none = String::new;
    rows.push(cells("error (root mean square)".into(), none(), &|f| format!("{} mm", millimetres(f.rmse_mm))));
    rows.push(cells("residual".into(), none(), &|f| noise_words(&f.test)));
    rows.push(cells("p-value of the residual".into(), none(), &|f| p_words(f.test.p_value, f.test.null.len())));
    let head = [Some(""), Some(PRESENT), repaired.map(|_| REPAIRED), Some("prior")];
    page.table(&head.into_iter().flatten().collect::<Vec<_>>(), &rows);
    if let Some(repaired) = repaired {
        for e in &repaired.estimates {
            page.svg(&moved(e, find(present, &e.name).as_ref(), prior_of(model, &e.name).as_ref()));
        }
    }
}

/// Prior of a parameter or of an effect.
fn prior_of(model: &Model, name: &str) -> Option<Prior> {
    let own = model.theta.index_of(name).map(|i| model.theta.parameters()[i].prior.clone());
    own.or_else(|| Registry::shipped().find(name).map(|e| e.about().prior))
}

/// Picture of a parameter's intervals: its prior, and its values in both models.
fn moved(after: &Estimate, before: Option<&Estimate>, prior: Option<&Prior>) -> String {
    let quantity = Quantity::of(&after.name);
    // One unit for all rows of the picture.
    let largest = [Some(after), before].into_iter().flatten().map(|e| e.value.abs()).fold(0.0, f64::max);
    let scale = quantity.scale(largest);
    let row = |name: &str, values: [f64; 3], role| Interval {
        name: name.into(),
        values: values.map(|v| v * scale.factor),
        role,
    };
    let prior = prior.map(|p| row("prior", [p.from_unit(0.05), f64::NAN, p.from_unit(0.95)], Role::Prior));
    let before = before.map(|e| row(PRESENT, [e.q05, e.value, e.q95], Role::Before));
    let after = row(REPAIRED, [after.q05, after.value, after.q95], Role::After);
    let rows: Vec<Interval> = prior.into_iter().chain(before).chain([after]).collect();
    intervals(&format!("{}, 5 to 95 %", quantity.capital()), &quantity.axis(&scale), &rows)
}

/// Picture of the errors on held-out episodes.
fn gap(v: &Verification) -> String {
    let bar = |label: &str, mm: f64, role| Bar {
        label: label.into(),
        parts: vec![(mm, role, 1.0)],
        value: format!("{} mm", millimetres(mm)),
    };
    let mut all = vec![bar(PRESENT, v.before.rmse_mm, Role::Before), bar(REPAIRED, v.after.rmse_mm, Role::After)];
    let wrong = v
        .wrong_effect
        .as_ref()
        .map(|(name, score)| bar(&format!("with {} instead", titles(name)), score.rmse_mm, Role::Other));
    all.extend(wrong);
    all.extend(v.black_box_mm.map(|mm| bar("regression without physics", mm, Role::Other)));
    let floor = v.floor_mm.map(|mm| ("noise floor", mm, Role::Noise));
    bars("Error on recordings that were not fitted", "root mean square distance, mm", &all, floor, &[])
}

/// Fitted and held-out episodes in turn, each with a title.
fn chosen<'a>(shown: &'a [EpisodeBands], report: &'a Report) -> Vec<(String, &'a EpisodeBands)> {
    let of = |is_held_out: bool| shown.iter().filter(move |s| s.is_held_out == is_held_out).take(SHOWN);
    let title = |words: &str, episode: &UsedEpisode| format!("{words} ({})", episode.name);
    let mut fitted = of(false).zip(&report.episodes).map(|(s, e)| (title("Fitted", e), s));
    // Their bands follow one another.
    let unseen = report.validation.iter().chain(&report.held_out);
    let mut held_out = of(true).zip(unseen).map(|(s, e)| (title("Not fitted", e), s));
    let mut all = Vec::new();
    loop {
        let next = [fitted.next(), held_out.next()];
        if next.iter().all(Option::is_none) {
            return all;
        }
        all.extend(next.into_iter().flatten());
    }
}

/// Picture of one coordinate of a keypoint over an episode, mm.
fn overlay(title: &str, episode: &EpisodeBands, k: usize, axis: usize) -> String {
    let of = |places: &PlaneTrack| -> Vec<f64> { places.iter().map(|p| 1e3 * p[k][axis]).collect() };
    let ribbon = |name: &str, role, band: &Band| {
        let [low, middle, high] = [&band.q05, &band.median, &band.q95].map(of);
        let values = low.iter().zip(middle).zip(high).map(|((l, m), h)| [*l, m, h]).collect();
        Ribbon { name: name.into(), role, values }
    };
    let before = episode.before.as_ref().map(|band| ribbon(PRESENT, Role::Before, band));
    let after = episode.after.as_ref().map(|band| ribbon(REPAIRED, Role::After, band));
    let direction = ["x", "z"][axis];
    panel(
        &episode.times_s,
        &Panel {
            title: format!("{title}: {}, {}", keypoint(k), ["along x", "height"][axis]),
            label: format!("{direction}, mm"),
            measured: of(&episode.measured),
            ribbons: before.into_iter().chain(after).collect(),
        },
    )
}

/// Recording and both models over one another.
fn over_one_another(title: &str, episode: &EpisodeBands) -> String {
    let fit = |name: &str, role, band: &Band| Fit { name: name.into(), role, points: band.median.clone() };
    let before = episode.before.as_ref().map(|band| fit(PRESENT, Role::Before, band));
    let after = episode.after.as_ref().map(|band| fit(REPAIRED, Role::After, band));
    // The last one decides with which moment the slider begins: what the present model lacks is asked for.
    let fits: Vec<Fit> = after.into_iter().chain(before).collect();
    let plane = Plane { x: "x, m", y: "z, m", is_down: false };
    replay(title, &episode.times_s, &episode.measured, &fits, &plane)
}

/// Name of a keypoint.
fn keypoint(k: usize) -> String {
    match k {
        0 => "keypoint 1 (grip)".into(),
        3 => "keypoint 4 (tip)".into(),
        _ => format!("keypoint {}", k + 1),
    }
}

/// Picture of the residual of each part of the data, in units of the noise.
fn places(title: &str, report: &Report) -> String {
    let (places, level) = (&report.finding.places, report.settings.level);
    let bar = |p: &Localisation| {
        let times = p.mean_square.sqrt();
        // Faint bars are within the noise at the level of the tests.
        let opacity = if p.p_value <= level { 1.0 } else { 0.35 };
        Bar {
            label: part(&p.part, &report.episodes),
            parts: vec![(times, Role::Before, opacity)],
            value: plain(times, 1),
        }
    };
    let all: Vec<Bar> = places.iter().map(bar).collect();
    let legend = [
        Entry::new("more than noise", Shape::Area, Role::Before),
        Entry::pale("consistent with noise", Shape::Area, Role::Before),
    ];
    bars(title, "times the noise", &all, Some(("noise", 1.0, Role::Noise)), &legend)
}

/// Pictures and table of the probabilities of the explanations.
fn explanations(page: &mut Page, finding: &Finding) -> Result<()> {
    let bar = |label: String, [whole, rest]: [f64; 2], role| Bar {
        label,
        parts: vec![(whole, role, 1.0), (rest, role, 0.4)],
        value: percent(whole + rest),
    };
    let mut ranked: Vec<Bar> = finding
        .explanations
        .iter()
        .take(RANKED)
        .enumerate()
        .filter(|(i, e)| *i < LEAST_RANKED || e.probability + e.probability_in_part >= NEGLIGIBLE)
        .map(|(_, e)| bar(sizes(e), [e.probability, e.probability_in_part], Role::After))
        .collect();
    ranked.push(bar(
        "an effect that the library does not contain".into(),
        [0.0, finding.probability_of_unknown],
        Role::Other,
    ));
    ranked.push(bar("nothing is missing".into(), [finding.probability_of_none, 0.0], Role::Other));
    let legend = [
        Entry::new("explains all", Shape::Area, Role::After),
        Entry::pale("explains a part", Shape::Area, Role::After),
    ];
    page.svg(&bars("Probability of each explanation", "probability", &ranked, None, &legend));
    let rows: Vec<Vec<String>> = finding
        .explanations
        .iter()
        .map(|e| {
            vec![
                numbers(e),
                percent(e.probability),
                percent(e.probability_in_part),
                plain(e.log_bayes_factor, 1),
                plain(e.cosine_with_best, 2),
            ]
        })
        .collect();
    let head = ["effects", "explains all", "explains a part", "log Bayes factor", "cosine with the best"];
    page.details(&format!("All {} explanations", rows.len()), |page| {
        page.table(&head, &rows);
        Ok(())
    })
}

/// Effects of an explanation with their sizes. A picture has no room for companions.
fn sizes(e: &Explanation) -> String {
    let one = |m: &Magnitude| {
        let quantity = Quantity::of(&m.name);
        format!("{} {}", quantity.title, quantity.spread(m.value, m.sd))
    };
    e.effects.iter().map(one).collect::<Vec<_>>().join(" with ")
}

/// Effects of an explanation with their sizes and those of their companions.
fn numbers(e: &Explanation) -> String {
    let one = |m: &Magnitude| {
        let quantity = Quantity::of(&m.name);
        let companion = |c: &CompanionValue| {
            let quantity = Quantity::of(&c.name);
            format!(", {} {}", quantity.title, quantity.estimate(c.value, c.q05, c.q95))
        };
        let companions: String = m.companions.iter().map(companion).collect();
        format!("{} {}{companions}", quantity.title, quantity.spread(m.value, m.sd))
    };
    e.effects.iter().map(one).collect::<Vec<_>>().join(" with ")
}

/// Table of the smallest detectable sizes, with undetectable effects at its end.
fn limits(page: &mut Page, finding: &Finding) {
    if finding.limits.is_empty() {
        return;
    }
    page.heading("Detectable sizes");
    page.paragraph(
        "Smallest size of each effect that the test detects in four of five recordings like these, to first order. It is \
         larger for an effect that the parameters can compensate for. A smaller effect may be present undetected.",
    );
    let named = most_probable(finding);
    let found = |limit: &DetectionLimit| {
        let effects = finding.explanations.iter().flat_map(|e| &e.effects);
        let own = effects.clone().find(|e| e.name == limit.name).filter(|_| named.contains(&limit.name.as_str()));
        own.map_or_else(String::new, |e| Quantity::of(&e.name).spread(e.value, e.sd))
    };
    let row = |limit: &DetectionLimit, size: String| {
        let prior = Registry::shipped().find(&limit.name).map(|e| Quantity::of(&limit.name).prior(&e.about().prior));
        vec![Quantity::of(&limit.name).title, size, prior.unwrap_or_default(), found(limit)]
    };
    let shows = finding.limits.iter().filter_map(|l| l.size.map(|s| row(l, Quantity::of(&l.name).value(s))));
    let hidden = finding.limits.iter().filter(|l| l.size.is_none());
    let rows: Vec<Vec<String>> = shows.chain(hidden.map(|l| row(l, "not at any size".into()))).collect();
    page.table(&["effect", "smallest detectable size", "prior of the size", "estimate"], &rows);
}

/// Details: the steps of the search, the tests, all keypoints, and the recordings.
fn details(page: &mut Page, report: &Report, shown: &[EpisodeBands]) -> Result<()> {
    let finding = &report.finding;
    page.details("Steps of the search", |page| {
        page.list(&finding.conclusions);
        page.note(&format!("Verdict in verdict.json: {}.", finding.verdict.name()));
        for (name, reason) in &finding.left_out {
            page.paragraph(&format!("{} was left out: {reason}", Quantity::of(name).capital()));
        }
        anyhow::Ok(())
    })?;
    page.details("Is the residual noise?", |page| {
        for (name, fitness) in [(PRESENT, Some(&finding.present)), (REPAIRED, finding.repaired.as_ref())] {
            let Some(fitness) = fitness else { continue };
            let test = &fitness.test;
            page.svg(&null_histogram(
                &format!("The {name}: residual of {} times the noise", plain(times_the_noise(test), 1)),
                "squared deviations, variances of the noise",
                &test.null,
                test.statistic,
                test.p_value,
            ));
        }
        let place = |p: &Localisation| {
            let null_sets = finding.present.test.null.len();
            vec![
                part(&p.part, &report.episodes),
                plain(p.mean_square.sqrt(), 2),
                plain(p.excess, 1),
                p_words(p.p_value, null_sets),
            ]
        };
        let head = ["part of the data", "times the noise", "excess, sd", "p, corrected for all parts"];
        page.table(&head, &finding.places.iter().map(place).collect::<Vec<_>>());
        anyhow::Ok(())
    })?;
    page.details("All keypoints", |page| {
        for (title, episode) in chosen(shown, report) {
            (0..4).for_each(|k| (0..2).for_each(|axis| page.svg(&overlay(&title, episode, k, axis))));
        }
        anyhow::Ok(())
    })?;
    page.details("Recordings", |page| {
        let row = |kind: &'static str| {
            move |e: &UsedEpisode| {
                vec![e.name.clone(), kind.to_owned(), e.number.to_string(), e.bag.display().to_string()]
            }
        };
        let mut rows: Vec<Vec<String>> = report.episodes.iter().map(row("fitted")).collect();
        rows.extend(report.validation.iter().map(row("validation: chose between models")));
        rows.extend(report.held_out.iter().map(row("held out: chose nothing")));
        page.table(&["episode", "used", "number in its bag", "bag"], &rows);
        anyhow::Ok(())
    })
}

/// Part of the data in words; its window lies in one of the fitted `episodes`.
fn part(part: &Part, episodes: &[UsedEpisode]) -> String {
    match *part {
        Part::Quantity(data::Quantity::Keypoint { point, axis }) => {
            format!("{}, {} in the picture", keypoint(point), ["across", "up and down"][axis])
        }
        Part::Quantity(data::Quantity::Pose { axis }) => format!("arm, {}", ["x", "z", "pitch"][axis]),
        Part::Quantity(data::Quantity::Wrench { axis }) => {
            format!("wrench on the hand, {}", ["force along x", "force along z", "torque about y"][axis])
        }
        Part::Window { episode, from_s, to_s } => {
            format!("{}, {from_s:.2} to {to_s:.2} s", episodes[episode].name)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::answer::tests::named;
    use super::*;
    use effect_finder::report::{Combination, PressingValue, TradeOff};

    #[test]
    fn parameters_that_are_determined_only_together_are_told_without_a_gap() {
        let told = |combination| {
            let between = ["youngs_modulus_pa", "length_m"].map(str::to_owned);
            let trade_offs = vec![TradeOff { between, correlation: 0.99, combination }];
            let finding = Finding { verdict: Verdict::NoGap, pressing: Vec::new(), trade_offs, ..named() };
            doubts(&finding).join(" ")
        };
        let ratio = Combination { exponent: -1.0, relative_sd: 0.021, alone: [0.4, 0.38] };
        let expected = "The recordings determine Young's modulus / length to 2.1 %, and hardly either (Young's modulus to 40 %, \
                        length to 38 %): measure one of them.";
        assert_eq!(told(Some(ratio)), expected);
        assert_eq!(told(None), "The Young's modulus and the length trade off (correlation 0.99): measure one of them.");
    }

    #[test]
    fn values_at_a_bound_are_told_with_and_without_a_gap() {
        let value =
            PressingValue { name: "table_friction".into(), episode: 1, episode_name: "swing, episode 2".into() };
        let with = |verdict| Finding { verdict, pressing_values: vec![value.clone()], ..named() };
        let told = "At the edge of the prior: length, table friction of swing, episode 2.";
        for verdict in [Verdict::NoGap, Verdict::Named, Verdict::NoneOfThese] {
            assert_eq!(doubts(&with(verdict)), [told], "{verdict:?}");
        }
        assert_eq!(doubts(&with(Verdict::PriorTooNarrow)), [""; 0], "the answer tells it");
        let said = answer(&with(Verdict::PriorTooNarrow), 2);
        assert!(
            said[0].starts_with("The prior of the length and the table friction of swing, episode 2 is too narrow")
        );
        assert!(doubts(&Finding { pressing: Vec::new(), ..named() }).is_empty());
    }
}
