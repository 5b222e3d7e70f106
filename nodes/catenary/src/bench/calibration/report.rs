//! Report of a calibration run: share of truths in the intervals, and the verdict on it.

use bayes_sim::calibration::{LEVELS, Summary};
use catenary_core::statistics::wilson_interval;
use serde::Serialize;

/// Level of all tests together below which the posteriors count as miscalibrated.
pub const LEVEL: f64 = 0.05;

/// Result of a calibration run.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Name of the model.
    pub model: String,
    /// Names of the inferred parameters.
    pub parameters: Vec<String>,
    /// Number of truths.
    pub truths: usize,
    /// Mean wall time of an inference, s.
    pub wall_s_each: f64,
    /// Checks, by parameter and of all parameters together.
    pub checks: Vec<Summary>,
    /// Mean width of each parameter's 90 % interval as a share of the prior.
    pub widths: Vec<f64>,
    /// Checks before the widening of the intervals.
    pub narrow_checks: Vec<Summary>,
    /// Mean widths before it.
    pub narrow_widths: Vec<f64>,
    /// Verdict in a sentence.
    pub verdict: String,
}

/// Verdict in one sentence. It names the checks that hold too few truths and those that hold too many, each at its
/// worst level. The p-values are corrected for the number of checks.
pub fn verdict(checks: &[Summary]) -> String {
    let p = |s: &Summary| (s.p_value * checks.len() as f64).min(1.0);
    let refuted = |is_few: bool| {
        let says = |s: &&Summary| p(s) < LEVEL && (furthest_off(s).1 < furthest_off(s).0) == is_few;
        let one = |s: &Summary| {
            let (nominal, held) = furthest_off(s);
            format!("{} ({:.0} % in {:.0} %, p = {:.1e})", s.name, 100.0 * held, 100.0 * nominal, p(s))
        };
        checks.iter().filter(says).map(one).collect::<Vec<_>>().join(", ")
    };
    let least = checks.iter().map(p).fold(1.0, f64::min);
    match (refuted(true).as_str(), refuted(false).as_str()) {
        ("", "") => {
            format!("calibrated: no check of {} refutes it (p = {least:.2}, corrected for their number)", checks.len())
        }
        (few, "") => format!("not calibrated: too few truths are held by {few}"),
        ("", many) => format!("not calibrated, and cautious: more truths are held than should be by {many}"),
        (few, many) => format!("not calibrated: too few truths are held by {few}; and more than should be by {many}"),
    }
}

/// Nominal share and held share at the level where the two differ most, in binomial standard deviations.
pub fn furthest_off(s: &Summary) -> (f64, f64) {
    let pairs = LEVELS.into_iter().zip(s.coverage);
    let off = |(nominal, held): &(f64, f64)| (held - nominal).abs() / (nominal * (1.0 - nominal)).sqrt();
    pairs.max_by(|a, b| off(a).total_cmp(&off(b))).expect("there are levels")
}

/// Index of the level 90 % in [`LEVELS`].
pub const NINETY: usize = 2;

/// 95 % interval of the share of truths at the level 90 %.
pub fn ninety_interval(s: &Summary) -> [f64; 2] {
    let trials = s.values.len();
    wilson_interval((s.coverage[NINETY] * trials as f64).round() as usize, trials)
}

/// Rows of the checks, each followed by its row before the widening.
fn rows(report: &Report) -> Vec<Vec<String>> {
    let row = |name: String, s: &Summary| {
        let coverage = s.coverage.iter().map(|c| format!("{:.1} %", 100.0 * c));
        let [low, high] = ninety_interval(s).map(|share| format!("{:.1}", 100.0 * share));
        std::iter::once(name).chain(coverage).chain([format!("{low} to {high}"), format!("{:.3}", s.p_value)]).collect()
    };
    let pairs = report.checks.iter().zip(&report.narrow_checks);
    pairs.flat_map(|(s, narrow)| [row(s.name.clone(), s), row("  not widened".to_owned(), narrow)]).collect()
}

const HEAD: [&str; 7] = ["check", "50 %", "80 %", "90 %", "95 %", "of 90 %", "p of uniformity"];

/// Mean widths of the intervals, with their growth by the widening.
fn widths(report: &Report) -> Vec<String> {
    let pairs = report.parameters.iter().zip(&report.widths).zip(&report.narrow_widths);
    let line = |((name, width), narrow): ((&String, &f64), &f64)| {
        format!("{name}: {width:.4} of the prior, {narrow:.4} not widened (+{:.0} %)", 100.0 * (width / narrow - 1.0))
    };
    pairs.map(line).collect()
}

/// Table and verdict for the terminal.
pub fn words(report: &Report) -> String {
    let line = |cells: Vec<String>| {
        cells
            .iter()
            .enumerate()
            .map(|(i, c)| format!("{c:<width$}", width = [24, 9, 9, 9, 9, 15, 0][i]))
            .collect::<String>()
    };
    let mut lines = vec![line(HEAD.map(str::to_owned).to_vec())];
    lines.extend(rows(report).into_iter().map(line));
    lines.push("of 90 %: 95 % interval (Wilson) of the share in 90 % intervals".to_owned());
    lines.push("mean width of 90 % intervals:".to_owned());
    lines.extend(widths(report));
    lines.push(format!("{} truths, {:.1} s each", report.truths, report.wall_s_each));
    lines.push(report.verdict.clone());
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_check_stands_above_its_figures_before_the_widening() {
        let check = |ninety: f64| Summary {
            name: "length_m".into(),
            p_value: 0.5,
            coverage: [0.5, 0.8, ninety, 0.95],
            values: vec![0.5; 100],
        };
        let report = Report {
            model: "soft_bar".into(),
            parameters: vec!["length_m".into()],
            truths: 100,
            wall_s_each: 1.0,
            checks: vec![check(0.9)],
            widths: vec![0.11],
            narrow_checks: vec![check(0.82)],
            narrow_widths: vec![0.1],
            verdict: "calibrated".into(),
        };
        let words = words(&report);
        // Wilson's interval of 90 of 100, and of 82 of 100.
        let expected = [
            "90.0 %   95.0 %   82.6 to 94.5",
            "82.0 %   95.0 %   73.3 to 88.3",
            "0.1100 of the prior, 0.1000 not widened (+10 %)",
        ];
        assert!(expected.iter().all(|part| words.contains(part)), "{words}");
    }

    #[test]
    fn a_verdict_names_what_is_too_narrow_and_what_is_too_wide() {
        let check = |name: &str, p_value: f64, coverage: [f64; 4]| Summary {
            name: name.into(),
            values: Vec::new(),
            coverage,
            p_value,
        };
        let fine = check("fine", 0.5, [0.5, 0.8, 0.88, 0.95]);
        let few = check("few", 1e-4, [0.45, 0.75, 0.8, 0.93]);
        // Two thirds of the truths lie in the interval of one half, while the outer intervals hold their share.
        let many = check("many", 1e-5, [0.67, 0.85, 0.89, 0.95]);
        let near = check("near", 0.03, [0.5, 0.8, 0.85, 0.95]);
        assert!(verdict(&[fine.clone(), near]).starts_with("calibrated: no check of 2 refutes it (p = 0.06"));
        assert_eq!(
            verdict(&[fine.clone(), few.clone()]),
            "not calibrated: too few truths are held by few (80 % in 90 %, p = 2.0e-4)"
        );
        let cautious =
            "not calibrated, and cautious: more truths are held than should be by many (67 % in 50 %, p = 2.0e-5)";
        assert_eq!(verdict(&[fine, many.clone()]), cautious);
        let both = verdict(&[few, many]);
        assert!(both.ends_with("; and more than should be by many (67 % in 50 %, p = 2.0e-5)"), "{both}");
    }
}
