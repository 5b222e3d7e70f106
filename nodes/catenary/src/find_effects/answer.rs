//! Answer of a search, in sentences.

use crate::report::number::{millimetres, percent, plain};
use crate::report::quantity::{Quantity, capital};
use catenary_core::statistics::p_clause;
use effect_finder::evidence::{CompanionValue, Test};
use effect_finder::report::{ClosedGap, Missing, PressingValue, StandIn, Verification, part_in_words};
use effect_finder::{Finding, Verdict};

/// Residual in units of the noise: square root of the test statistic over its median without a gap.
pub fn times_the_noise(test: &Test) -> f64 {
    let usual = test.null.get(test.null.len() / 2).copied().unwrap_or(test.coordinates as f64);
    (test.statistic / usual.max(f64::MIN_POSITIVE)).sqrt()
}

/// Residual in words: "3.1 times the noise".
pub fn noise_words(test: &Test) -> String {
    format!("{} times the noise", plain(times_the_noise(test), 1))
}

/// Answer in sentences; `episodes` were fitted.
pub fn answer(finding: &Finding, episodes: usize) -> Vec<String> {
    let mut sentences = by_verdict(finding, episodes);
    sentences.extend(finding.stand_ins.iter().map(stand_in));
    sentences.extend(finding.missing.as_ref().map(missing));
    sentences
}

/// Effect that stands in for something else: "Gravity tilt is not named: it would have to be ...".
fn stand_in(effect: &StandIn) -> String {
    let quantity = Quantity::of(&effect.name);
    let [low, high] = effect.prior.map(|v| quantity.value(v));
    format!(
        "{} is not named: it would have to be {}, beyond its prior of {low} to {high}, and stands in for something else.",
        capital(&quantity.title),
        quantity.value(effect.value)
    )
}

/// Form of what is missing: "It acts on the material (probability 0.98), like a bend at a place ...".
fn missing(missing: &Missing) -> String {
    let [from_s, to_s] = missing.phase_s.map(|time_s| plain(time_s, 1));
    format!(
        "What is missing acts on {} (probability {}), like a {}, and shows most from {from_s} to {to_s} s.",
        part_in_words(&missing.hook),
        plain(missing.probability, 2),
        missing.form.words(),
    )
}

fn by_verdict(finding: &Finding, episodes: usize) -> Vec<String> {
    let present = &finding.present;
    let (rmse, noise) = (millimetres(present.rmse_mm), noise_words(&present.test));
    let on = recordings(episodes);
    let left = format!("The error of the model is {rmse} mm on {on}, {noise}.");
    match finding.verdict {
        Verdict::NoGap => vec![
            format!(
                "The model explains {on}: nothing that {} could show is missing.",
                if episodes == 1 { "it" } else { "they" }
            ),
            format!(
                "Its error of {rmse} mm is that of the measurement noise ({noise}, {}).",
                p_clause(present.test.p_value, present.test.null.len())
            ),
        ],
        Verdict::CannotSee => {
            let size = finding.hidden_gap_mm.map_or(String::new(), |mm| format!(" of up to {} mm", millimetres(mm)));
            vec![
                format!("A gap{size} between the model and {on} could not be seen."),
                "The model file states more noise of the keypoints than the fast changes of the recording hold; the rest may be slow noise, or something that is missing from the model.".into(),
                left,
                "Measure the noise with an object at rest, state it in the model file, and search again.".into(),
            ]
        }
        Verdict::Named => {
            vec![format!("{} missing from the model.", subject(finding)), repair(finding, episodes)]
        }
        Verdict::CannotTellApart => vec![
            format!("{} missing from the model; the recordings cannot tell which.", alternatives(finding)),
            repair(finding, episodes),
        ],
        Verdict::NoneOfThese => {
            let mut sentences =
                vec!["Something is missing from the model, and no effect of the library explains it.".into(), left];
            if finding.nearest.is_empty() {
                sentences.extend(finding.verification.as_ref().and_then(closes_nothing));
            } else {
                let nearest = groups(finding, &finding.nearest);
                let (are, leave) = if finding.nearest.len() == 1 { ("is", "leaves") } else { ("are", "leave") };
                sentences.push(format!(
                    "Nearest {are} {nearest}, which {leave} a residual and may only imitate what is missing."
                ));
                sentences.push(repair(finding, episodes));
            }
            sentences
        }
        Verdict::PriorTooNarrow => {
            let names = pressing(finding);
            let mut sentences = vec![format!(
                "The prior of the {} is too narrow: the best value lies at its edge, and beyond it the model explains {on}.",
                names.join(" and the ")
            )];
            if !finding.found.is_empty() {
                sentences.push(format!("Or {} missing from the model.", alternatives(finding).to_lowercase()));
            }
            sentences.push(left);
            sentences
        }
    }
}

/// Sentence on a repair that may close nothing of the gap of the recordings that were not fitted.
fn closes_nothing(verification: &Verification) -> Option<String> {
    let ClosedGap { share, interval } = verification.closed().filter(ClosedGap::may_be_nothing)?;
    let [share, low, high] = [share, interval[0], interval[1]].map(|v| plain(100.0 * v, 0));
    Some(format!(
        "On the recordings that no fit saw the best repair closes {share} % of the gap ({low} to {high} %), which may be nothing."
    ))
}

/// Number of recordings in words: "the recording", "the 3 recordings".
fn recordings(count: usize) -> String {
    if count == 1 { "the recording".into() } else { format!("the {count} recordings") }
}

/// Titles of the parameters at a bound of their prior, and of the values of recordings that would have to lie beyond it.
pub fn pressing(finding: &Finding) -> Vec<String> {
    let parameters = finding.pressing.iter().map(|name| Quantity::of(name).title);
    let value = |v: &PressingValue| format!("{} of {}", Quantity::of(&v.name).title, v.episode_name);
    parameters.chain(finding.pressing_values.iter().map(value)).collect()
}

/// Names of the most probable effects.
pub fn most_probable(finding: &Finding) -> Vec<&str> {
    first_of_each(&finding.found).collect()
}

/// Groups of the effects that the repaired model has: the named ones, or the nearest.
pub fn repaired_with(finding: &Finding) -> &[Vec<String>] {
    if finding.found.is_empty() { &finding.nearest } else { &finding.found }
}

/// Names of the first effects of each group.
fn first_of_each(groups: &[Vec<String>]) -> impl Iterator<Item = &str> {
    groups.iter().filter_map(|alike| alike.first()).flat_map(|names| names.split(" + "))
}

/// Effect with its size: "tip mass of 0.23 kg (0.16 to 0.29)". Its companions follow in brackets.
fn effect(finding: &Finding, name: &str) -> String {
    let fitted = |name: &str| {
        let estimate = finding.repaired.iter().flat_map(|f| &f.estimates).find(|e| e.name == name);
        estimate.map(|e| Quantity::of(name).estimate(e.value, e.q05, e.q95))
    };
    let words = |name: &str, size: Option<String>| {
        let title = Quantity::of(name).title;
        size.map_or(title.clone(), |size| format!("{title} of {size}"))
    };
    let alone = finding.explanations.iter().flat_map(|e| &e.effects).find(|e| e.name == name);
    // 1.645 standard deviations: the 5 % and 95 % quantiles of a normal distribution.
    let size = alone.map(|e| Quantity::of(name).estimate(e.value, e.value - 1.645 * e.sd, e.value + 1.645 * e.sd));
    let companion = |c: &CompanionValue| {
        let size = fitted(&c.name).unwrap_or_else(|| Quantity::of(&c.name).estimate(c.value, c.q05, c.q95));
        words(&c.name, Some(size))
    };
    let companions: Vec<String> = alone.iter().flat_map(|e| &e.companions).map(companion).collect();
    let whole = words(name, fitted(name).or(size));
    if companions.is_empty() { whole } else { format!("{whole} [{}]", companions.join(", ")) }
}

/// Most probable effects with their sizes, and the verb: "Tip mass of 0.23 kg (0.16 to 0.29) is".
fn subject(finding: &Finding) -> String {
    let effects: Vec<String> = most_probable(finding).into_iter().map(|name| effect(finding, name)).collect();
    let verb = if effects.len() == 1 { "is" } else { "are" };
    capital(&format!("{} {verb}", effects.join(" and ")))
}

/// Each effect with its indistinguishable alternatives, and the verb.
fn alternatives(finding: &Finding) -> String {
    let verb = if finding.found.len() == 1 { "is" } else { "are" };
    capital(&format!("{} {verb}", groups(finding, &finding.found)))
}

/// Effects of groups, each with its indistinguishable alternatives.
fn groups(finding: &Finding, groups: &[Vec<String>]) -> String {
    let joined =
        |names: &String| names.split(" + ").map(|name| effect(finding, name)).collect::<Vec<_>>().join(" with ");
    let words = |alike: &Vec<String>| alike.iter().map(joined).collect::<Vec<_>>().join(" or ");
    groups.iter().map(words).collect::<Vec<_>>().join(", and ")
}

/// Sentence on the errors before and after the repair.
fn repair(finding: &Finding, episodes: usize) -> String {
    let Some(repaired) = &finding.repaired else { return String::new() };
    let with = if first_of_each(repaired_with(finding)).count() > 1 { "them" } else { "it" };
    let change = |before: f64, after: f64| {
        // A repair may raise the error on held-out episodes, and the sentence must not hide it.
        let verb = if after < before { "falls" } else { "goes" };
        (verb, format!("from {} to {} mm", millimetres(before), millimetres(after)))
    };
    let (verb, here) = change(finding.present.rmse_mm, repaired.rmse_mm);
    let words = format!("With {with} the error {verb} {here} on {}", recordings(episodes));
    match &finding.verification {
        None => format!("{words}. There was no other recording to verify it."),
        Some(v) => {
            let unseen = if v.episodes == 1 { "one that was".to_owned() } else { format!("{} that were", v.episodes) };
            let chose = if v.selects { "fitted, but chose between the models" } else { "used" };
            let closed = v.gap_closed.map(|share| format!(" ({} of the gap)", percent(share.clamp(0.0, 1.0))));
            let there = change(v.before.rmse_mm, v.after.rmse_mm).1;
            format!("{words} and {there} on {unseen} not {chose}{}.", closed.unwrap_or_default())
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use effect_finder::evidence::{Explanation, Magnitude};
    use effect_finder::report::{Estimate, Fitness, Form, Score};

    fn fitness(rmse_mm: f64, statistic: f64, estimates: Vec<Estimate>) -> Fitness {
        let null = (0..199).map(|i| 90.0 + 0.1 * f64::from(i)).collect();
        let p_value = if statistic > 110.0 { 1.0 / 200.0 } else { 0.4 };
        Fitness { estimates, test: Test { p_value, statistic, null, null_left_out: 0, coordinates: 100 }, rmse_mm }
    }

    /// Result of a search that names a tip mass and verifies it on one held-out episode.
    pub fn named() -> Finding {
        let mass = Estimate { name: "tip_mass_kg".into(), value: 0.2271, q05: 0.161, q95: 0.292 };
        let (name, title) = ("tip_mass_kg".into(), "tip mass".into());
        let magnitude = Magnitude { name, title, value: 0.2271, sd: 0.04, companions: Vec::new() };
        let score = |rmse_mm: f64| Score { rmse_mm, energy_mm: Some(rmse_mm) };
        Finding {
            verdict: Verdict::Named,
            misfit: None,
            noise: None,
            noise_doubt: None,
            hidden_gap_mm: None,
            joined: Vec::new(),
            conclusions: vec!["a step".into()],
            present: fitness(38.2, 2500.0, Vec::new()),
            places: Vec::new(),
            pressing: vec!["length_m".into()],
            pressing_values: Vec::new(),
            explanations: vec![Explanation {
                effects: vec![magnitude],
                statistic: 100.0,
                log_bayes_factor: 50.0,
                probability: 0.98,
                probability_in_part: 0.01,
                cosine_with_best: 1.0,
            }],
            presence: Vec::new(),
            left_out: Vec::new(),
            limits: Vec::new(),
            probability_of_none: 0.0,
            probability_of_unknown: 0.01,
            found: vec![vec!["tip_mass_kg".into()]],
            nearest: Vec::new(),
            missing: None,
            repaired: Some(fitness(7.44, 100.0, vec![mass])),
            stand_ins: Vec::new(),
            trade_offs: Vec::new(),
            discrepancy: None,
            verification: Some(Verification {
                episodes: 1,
                selects: false,
                before: score(27.8),
                after: score(17.9),
                floor_mm: Some(5.0),
                gap_closed: Some(0.43),
                interval: None,
                p_value: None,
                null_sets: 0,
                draws_left_out: 0,
                share_explained: None,
                log_likelihood_gain: 3.0,
                wrong_effect: None,
                black_box_mm: None,
            }),
            separation: None,
        }
    }

    #[test]
    fn the_answer_says_where_and_when_something_is_missing() {
        let form = Form {
            template: "template_local_curvature_rad".into(),
            title: "bend at a place".into(),
            size: 0.3,
            unit: "rad".into(),
            place: Some(0.35),
            frequency_hz: None,
        };
        let (hook, phase_s) = ("material".to_owned(), [0.52, 3.0]);
        let missing = Missing { hook, probability: 0.981, form, episode: 0, phase_s, alternatives: Vec::new() };
        let said = answer(&Finding { verdict: Verdict::NoneOfThese, missing: Some(missing), ..named() }, 1);
        let expected = "What is missing acts on the material (probability 0.98), like a bend at a place (0.35 of the length \
                        from the grip), and shows most from 0.5 to 3.0 s.";
        assert_eq!(said.last().map(String::as_str), Some(expected));
    }

    #[test]
    fn the_answer_names_a_group_once_with_each_of_its_numbers() {
        let companion = |name: &str, [value, q05, q95]: [f64; 3]| CompanionValue {
            name: name.into(),
            title: String::new(),
            value,
            q05,
            q95,
        };
        let companions = vec![
            companion("strand_slip_turn_rad", [0.2, 0.1, 0.3]),
            companion("strand_slip_spread", [12.0, 2.0, 80.0]),
        ];
        let (name, value, sd) = ("strand_friction_rad".to_owned(), 0.5, 0.1);
        let mut finding = Finding { found: vec![vec![name.clone()]], ..named() };
        finding.explanations[0].effects = vec![Magnitude { title: String::new(), name, value, sd, companions }];
        // The repaired model's estimate of a number replaces that of the explanation.
        let estimate = Estimate { name: "strand_slip_turn_rad".into(), value: 0.2, q05: 0.15, q95: 0.3 };
        finding.repaired = Some(fitness(7.4, 100.0, vec![estimate]));
        let expected = "Friction between strands of 29° (19 to 38) [turn at which strands slip of 11.5° (8.6 to 17.2), spread of the turns at which strands slip of 12 (2.0 to 80)] is missing from the model.";
        assert_eq!(answer(&finding, 1)[0], expected);
    }

    #[test]
    fn the_answer_says_that_a_repair_may_close_nothing() {
        let said = |interval| {
            let verification = Verification { gap_closed: Some(0.19), interval, ..named().verification.unwrap() };
            let none = Finding {
                verdict: Verdict::NoneOfThese,
                verification: Some(verification),
                found: Vec::new(),
                ..named()
            };
            answer(&none, 1).last().cloned().unwrap()
        };
        let expected = "On the recordings that no fit saw the best repair closes 19 % of the gap (-2 to 39 %), which may be nothing.";
        assert_eq!(said(Some([-0.02, 0.39])), expected);
        assert!(
            [None, Some([0.02, 0.39])].into_iter().all(|closed| said(closed).starts_with("The error of the model"))
        );
    }

    #[test]
    fn the_answer_says_what_is_nearest_and_that_it_may_imitate() {
        let nearest = named().found;
        let said = answer(&Finding { verdict: Verdict::NoneOfThese, found: Vec::new(), nearest, ..named() }, 1);
        let expected = "Nearest is tip mass of 0.23 kg (0.16 to 0.29), which leaves a residual and may only imitate what is missing.";
        assert_eq!(said[2], expected);
        assert!(said[3].starts_with("With it the error falls from 38 to 7.4 mm"), "{said:?}");
    }

    #[test]
    fn the_answer_names_the_effect_and_the_errors_before_and_after() {
        let said = answer(&named(), 1);
        assert_eq!(said[0], "Tip mass of 0.23 kg (0.16 to 0.29) is missing from the model.");
        assert_eq!(
            said[1],
            "With it the error falls from 38 to 7.4 mm on the recording and from 28 to 18 mm on one that was not used (43 % of the gap)."
        );
    }

    #[test]
    fn every_verdict_has_an_answer_without_names_of_fields() {
        for verdict in [
            Verdict::NoGap,
            Verdict::CannotSee,
            Verdict::Named,
            Verdict::CannotTellApart,
            Verdict::NoneOfThese,
            Verdict::PriorTooNarrow,
        ] {
            let found = vec![vec!["tip_mass_kg".into(), "density_change + rest_curvature_per_m".into()]];
            let said = answer(&Finding { verdict, found, ..named() }, 3).join(" ");
            assert!(!said.contains('_') && said.len() > 60, "{verdict:?}: {said}");
            assert!(said.chars().next().is_some_and(char::is_uppercase), "{said}");
        }
        let alike = Finding { verdict: Verdict::CannotTellApart, ..named() };
        assert!(answer(&alike, 1)[0].starts_with("Tip mass of 0.23 kg"), "{:?}", answer(&alike, 1));
        let none = Finding { verdict: Verdict::NoneOfThese, ..named() };
        assert_eq!(answer(&none, 1)[1], "The error of the model is 38 mm on the recording, 5.0 times the noise.");
        let fine = Finding { verdict: Verdict::NoGap, present: fitness(0.91, 99.0, Vec::new()), ..named() };
        let said = answer(&fine, 2).join(" ");
        assert!(said.contains("explains the 2 recordings") && said.contains("1.0 times the noise, p = 0.40"), "{said}");
    }
}
