//! Figures of each group of cases under each rule.

use super::cases::BARS;
use super::line::Line;
use catenary_core::statistics::{mean, median, wilson_interval};
use serde::Serialize;

/// Figures of one group of cases under one rule. Shares and means are over cases and parameters.
#[derive(Debug, Serialize)]
pub struct Row {
    group: String,
    rule: String,
    /// Number of cases.
    cases: usize,
    /// Share of 90 % intervals that contain the truth, with its 95 % interval by Wilson.
    coverage: f64,
    coverage_95: [f64; 2],
    /// Share of the parameters whose support at the end contains the truth.
    held: f64,
    /// Median error of a mean, in widths of the prior support.
    error: f64,
    /// Median width of a 90 % interval, in widths of the prior support.
    width: f64,
    /// Mean error of each parameter's mean in its own unit, and of its decimal logarithm.
    absolute: Vec<f64>,
    decades: Vec<f64>,
    /// Mean number of moves of an inference.
    moves: f64,
    /// Share of the inferences whose support moved.
    moved: f64,
}

/// Figures of all groups and rules, in the order of their first runs, and of all bars together.
#[derive(Debug, Serialize)]
pub struct Report {
    rows: Vec<Row>,
    /// Mean wall time of an inference, s.
    wall_s_each: f64,
}

impl Report {
    /// Summarises the runs.
    pub fn new(lines: &[Line]) -> Self {
        let mut names: Vec<(&str, &str)> = Vec::new();
        for line in lines {
            let name = (line.group.as_str(), line.rule.as_str());
            if !names.contains(&name) {
                names.push(name);
            }
        }
        // Rules of a group stand together.
        names.sort_by_key(|(group, _)| lines.iter().position(|line| line.group == *group));
        let own = |group: &str, rule: &str, of: &dyn Fn(&str) -> bool| {
            Row::new(
                [group, rule],
                &lines.iter().filter(|line| line.rule == rule && of(&line.group)).collect::<Vec<_>>(),
            )
        };
        let mut rows: Vec<Row> = names.iter().map(|(group, rule)| own(group, rule, &|of| of == *group)).collect();
        let mut rules: Vec<&str> = Vec::new();
        for (_, rule) in names.iter().filter(|(group, _)| BARS.contains(group)) {
            if !rules.contains(rule) {
                rules.push(rule);
                rows.push(own("bars", rule, &|group| BARS.contains(&group)));
            }
        }
        Self { rows, wall_s_each: mean(&lines.iter().map(|line| line.wall_s).collect::<Vec<_>>()) }
    }
}

impl Row {
    /// Figures of the runs `own`.
    fn new([group, rule]: [&str; 2], own: &[&Line]) -> Self {
        let all = |of: fn(&Line) -> &[f64]| own.iter().flat_map(|line| of(line).to_vec()).collect::<Vec<f64>>();
        let shares = |of: fn(&Line) -> &[bool]| {
            let flags: Vec<bool> = own.iter().flat_map(|line| of(line).to_vec()).collect();
            (flags.iter().filter(|flag| **flag).count(), flags.len())
        };
        let by_parameter = |of: fn(&Line) -> &[f64]| {
            let count = own.first().map_or(0, |line| of(line).len());
            (0..count).map(|i| mean(&own.iter().map(|line| of(line)[i]).collect::<Vec<_>>())).collect()
        };
        let share = |(hits, trials): (usize, usize)| hits as f64 / trials.max(1) as f64;
        let (hits, trials) = shares(|line| &line.inside_90);
        let moves: Vec<f64> = own.iter().map(|line| line.moves as f64).collect();
        Self {
            group: group.to_owned(),
            rule: rule.to_owned(),
            cases: own.len(),
            coverage: share((hits, trials)),
            coverage_95: wilson_interval(hits, trials),
            held: share(shares(|line| &line.held)),
            error: median(&mut all(|line| &line.error)),
            width: median(&mut all(|line| &line.width)),
            absolute: by_parameter(|line| &line.absolute),
            decades: by_parameter(|line| &line.decades),
            moves: mean(&moves),
            moved: share((moves.iter().filter(|n| **n > 0.0).count(), moves.len())),
        }
    }
}

/// Table for the terminal.
pub fn words(report: &Report) -> String {
    let head = format!(
        "{:<9} {:<7} {:>5} {:>20} {:>7} {:>7} {:>7} {:>7} {:>7}",
        "group", "support", "cases", "in 90 % intervals", "held", "error", "width", "moved", "moves"
    );
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let line = |r: &Row| {
        let [low, high] = r.coverage_95.map(|share| format!("{:.0}", 100.0 * share));
        format!(
            "{:<9} {:<7} {:>5} {:>20} {:>7} {:>7.3} {:>7.3} {:>7} {:>7.1}",
            r.group,
            r.rule,
            r.cases,
            format!("{} ({low} to {high})", percent(r.coverage)),
            percent(r.held),
            r.error,
            r.width,
            percent(r.moved),
            r.moves
        )
    };
    let units = |r: &Row| {
        let list = |values: &[f64]| values.iter().map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(", ");
        format!(
            "{:<9} {:<7} mean errors {}; of the decimal logarithms {}",
            r.group,
            r.rule,
            list(&r.absolute),
            list(&r.decades)
        )
    };
    let notes = [
        "held: parameters whose support at the end contains the truth. error, width: medians of the mean's error and of the \
         90 % interval, in widths of the prior support."
            .to_owned(),
        format!("{:.1} s each", report.wall_s_each),
    ];
    let lines =
        [head].into_iter().chain(report.rows.iter().map(line)).chain(report.rows.iter().map(units)).chain(notes);
    lines.collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_the_group_and_the_rule() {
        let line = |group: &str, rule: &str, inside: bool, moves: usize| Line {
            case: 0,
            group: group.into(),
            rule: rule.into(),
            truth: vec![0.25, 1e4],
            beyond: vec![0.2, 0.0],
            inside_90: vec![inside, true],
            error: vec![0.1, 0.3],
            width: vec![0.2, 0.2],
            absolute: vec![0.01, 100.0],
            decades: vec![0.1, 0.2],
            held: vec![inside, true],
            moves,
            wall_s: 2.0,
        };
        let lines = [
            line("outside", "fixed", false, 0),
            line("dlo_0", "fixed", false, 0),
            line("outside", "edge", true, 2),
            line("outside", "edge", true, 0),
            line("dlo_3", "fixed", true, 0),
        ];
        let report = Report::new(&lines);
        let names: Vec<_> = report.rows.iter().map(|r| (r.group.as_str(), r.rule.as_str(), r.cases)).collect();
        let expected = [
            ("outside", "fixed", 1),
            ("outside", "edge", 2),
            ("dlo_0", "fixed", 1),
            ("dlo_3", "fixed", 1),
            ("bars", "fixed", 2),
        ];
        assert_eq!(names, expected);
        assert_eq!((report.rows[0].coverage, report.rows[1].coverage), (0.5, 1.0));
        assert_eq!((report.rows[1].moves, report.rows[1].moved, report.rows[0].held), (1.0, 0.5, 0.5));
        assert_eq!((report.rows[1].error, &report.rows[1].absolute), (0.2, &vec![0.01, 100.0]));
        assert!(words(&report).contains("outside   edge        2"), "{}", words(&report));
    }
}
