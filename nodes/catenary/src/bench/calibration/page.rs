//! HTML page of a calibration run: do the credible intervals hold as many hidden values as they should?

use super::report::{LEVEL, NINETY, Report, furthest_off, ninety_interval};
use crate::report::number::{percent, plain};
use crate::report::quantity::{Quantity, capital};
use crate::report::{Page, plots};
use bayes_sim::calibration::{LEVELS, Summary};

/// Renders the whole page.
pub fn page(report: &Report) -> String {
    let mut page = Page::new(&format!("Are the intervals of {} calibrated?", report.model));
    let (sentences, is_bad) = answer(report);
    page.answer(&sentences, is_bad);
    page.note(&format!(
        "{} objects were drawn from the prior, measured in simulation and inferred; {} s each.",
        report.truths,
        plain(report.wall_s_each, 1)
    ));
    page.heading("Share of hidden values that the intervals hold");
    let levels = LEVELS.map(|level| format!("{} interval", percent(level)));
    let mut head = vec!["check"];
    head.extend(levels.iter().map(String::as_str));
    head.push("p of exactness");
    page.table(&head, &report.checks.iter().map(row).collect::<Vec<_>>());
    // Two binomial standard deviations of the share, at the 90 % level.
    let [_, _, ninety, _] = LEVELS.map(|level| 2.0 * (level * (1.0 - level) / report.truths.max(1) as f64).sqrt());
    page.note(&format!(
        "By chance alone, the share in 90 % intervals of {} objects is off by up to {} percentage points.",
        report.truths,
        plain(100.0 * ninety, 0)
    ));
    page.heading("Cost of the widening");
    page.note(
        "Intervals are widened until they hold their share of the simulations that the networks did not train on.",
    );
    page.table(&["parameter", "90 % interval, not widened", "widened", "growth of the width"], &widening(report));
    page.heading("Ranks of the hidden values");
    page.note(
        "Above the diagonal on the left and below it on the right: intervals are too narrow. The reverse: too wide.",
    );
    for s in &report.checks {
        page.svg(&plots::calibration(&title(s), &s.values));
    }
    page.finish()
}

/// Answer in sentences, and `true` if the intervals are overconfident.
fn answer(report: &Report) -> (Vec<String>, bool) {
    let checks = &report.checks;
    // Bonferroni: each p-value is multiplied by the number of checks.
    let refuted: Vec<&Summary> = checks.iter().filter(|s| s.p_value * (checks.len() as f64) < LEVEL).collect();
    let (low, high) = checks.iter().map(|s| s.coverage[2]).fold((1.0_f64, 0.0_f64), |(a, b), c| (a.min(c), b.max(c)));
    let held = if percent(low) == percent(high) {
        percent(low)
    } else {
        format!("{} to {}", percent(low).replace(" %", ""), percent(high))
    };
    let held = format!("The 90 % intervals held {held} of {} hidden values.", report.truths);
    // Too few held values take precedence: overconfident intervals are the dangerous ones.
    let few: Vec<&&Summary> = refuted.iter().filter(|s| furthest_off(s).1 < furthest_off(s).0).collect();
    let words = |list: &[&&Summary]| list.iter().map(|s| name(s)).collect::<Vec<_>>().join(" and ");
    match (refuted.is_empty(), few.as_slice()) {
        (true, _) => (vec!["No check refutes the intervals.".into(), held], false),
        (false, []) => {
            let all: Vec<&&Summary> = refuted.iter().collect();
            let first = format!("Intervals hold more values than they should: those of {} are too wide.", words(&all));
            // Wide intervals waste information but mislead nobody, so that this is not marked as bad news.
            (vec![first, held, "They are safe to use, but less precise than the data allow.".into()], false)
        }
        (false, few) => {
            let first = format!(
                "Intervals hold fewer values than they should: those of {} are too narrow or biased.",
                words(few)
            );
            (vec![first, held], true)
        }
    }
}

/// Rows of the parameters: share of hidden values in 90 % intervals before and after the widening, and its cost.
fn widening(report: &Report) -> Vec<Vec<String>> {
    let held = |s: &Summary| {
        let [low, high] = ninety_interval(s).map(|share| plain(100.0 * share, 0));
        format!("{} ({low} to {high})", percent(s.coverage[NINETY]))
    };
    let row = |(i, (width, narrow)): (usize, (&f64, &f64))| {
        let (s, before) = (&report.checks[i], &report.narrow_checks[i]);
        vec![capital(&name(s)), held(before), held(s), percent(width / narrow - 1.0)]
    };
    report.widths.iter().zip(&report.narrow_widths).enumerate().map(row).collect()
}

fn row(s: &Summary) -> Vec<String> {
    // Three digits where the decision is near, two where it is not.
    let p = if s.p_value < 1e-3 { "< 0.001".to_owned() } else { plain(s.p_value, if s.p_value < 0.1 { 3 } else { 2 }) };
    std::iter::once(capital(&name(s)))
        .chain(s.coverage.iter().map(|c| format!("{} %", plain(100.0 * c, 1))))
        .chain([p])
        .collect()
}

/// Name of a check within a sentence.
fn name(s: &Summary) -> String {
    match s.name.as_str() {
        "density" => "all parameters together (density)".into(),
        "distance" => "all parameters together (distance)".into(),
        name => Quantity::of(name).title,
    }
}

fn title(s: &Summary) -> String {
    capital(&name(s))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(p_value: f64, coverage: [f64; 4]) -> Report {
        let check =
            |name: &str, p_value, coverage| Summary { name: name.into(), values: vec![0.2, 0.7], coverage, p_value };
        let checks = vec![check("length_m", 0.5, [0.5, 0.8, 0.9, 0.95]), check("density", p_value, coverage)];
        Report {
            model: "soft_bar".into(),
            parameters: vec!["length_m".into()],
            truths: 200,
            wall_s_each: 3.0,
            narrow_checks: checks.clone(),
            checks,
            widths: vec![0.11],
            narrow_widths: vec![0.1],
            verdict: String::new(),
        }
    }

    #[test]
    fn the_answer_tells_calibrated_narrow_and_wide_intervals_apart() {
        let said = |p, coverage| answer(&report(p, coverage));
        let (fine, is_bad) = said(0.3, [0.5, 0.79, 0.88, 0.94]);
        assert_eq!(
            fine,
            ["No check refutes the intervals.", "The 90 % intervals held 88 to 90 % of 200 hidden values."]
        );
        assert!(!is_bad);
        let (narrow, is_bad) = said(1e-4, [0.4, 0.7, 0.8, 0.9]);
        assert!(
            narrow[0].contains("fewer values than they should: those of all parameters together (density)") && is_bad,
            "{narrow:?}"
        );
        let (wide, is_bad) = said(1e-5, [0.67, 0.9, 0.95, 0.99]);
        assert!(wide[0].contains("more values than they should") && !is_bad, "{wide:?}");
    }

    #[test]
    fn the_page_calls_parameters_by_their_titles() {
        let page = page(&report(1e-9, [0.4, 0.7, 0.8, 0.9]));
        assert!(
            page.contains("<td>Length</td>") && page.contains("&lt; 0.001") && !page.contains("length_m"),
            "{page}"
        );
        assert_eq!(page.matches("<figure>").count(), 2);
        assert!(page.contains("<td>10 %</td>"), "growth of the width: {page}");
    }
}
