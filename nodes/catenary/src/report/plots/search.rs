//! Pictures for the report of a search for effects.

use super::{axis, range, thinned};
use crate::report::palette::Role;
use crate::report::svg::{Anchor, Axis, Chart, FONT, Svg, WIDTH, text_width};
pub use crate::report::svg::{Entry, Shape};
use crate::report::ticks;

/// Height of a bar, and of a bar with its label.
const BAR: f64 = 12.0;
const ROW: f64 = 36.0;
const INK: &str = Role::INK;

/// Bar made of consecutive parts.
pub struct Bar {
    /// Label above the bar.
    pub label: String,
    /// Length, colour and opacity of each part.
    pub parts: Vec<(f64, Role, f64)>,
    /// Total length in words.
    pub value: String,
}

/// Picture of horizontal bars under their labels, optionally with a line across all of them.
pub fn bars(title: &str, x_label: &str, bars: &[Bar], line: Option<(&str, f64, Role)>, legend: &[Entry]) -> String {
    let longest = bars.iter().map(|b| b.parts.iter().map(|p| p.0).sum::<f64>()).chain(line.map(|l| l.1));
    let longest = longest.filter(|v| v.is_finite()).fold(0.0, f64::max);
    let high = if longest > 0.0 { longest } else { 1.0 };
    let widest = bars.iter().map(|b| text_width(&b.value)).fold(0.0, f64::max);
    let (left, right) = (4.0, WIDTH - widest - 10.0);
    let x = |value: f64| left + value / high * (right - left);
    let bottom = ROW * bars.len().max(1) as f64 + 4.0;
    let mut svg = Svg::default();
    for (value, label) in ticks::linear(0.0, high, 5) {
        svg.line([x(value), 2.0], [x(value), bottom], Role::GRID, 1.0);
        let half = 0.5 * text_width(&label);
        svg.text([x(value).max(half), bottom + FONT + 3.0], Anchor::Middle, INK, &label);
    }
    let mut legend = legend.to_vec();
    if let Some((name, value, role)) = line {
        svg.path(&[[x(value), 2.0], [x(value), bottom]], role.css(), 2.5, true);
        legend.push(Entry::new(name, Shape::Dashes, role));
    }
    for (i, bar) in bars.iter().enumerate() {
        let top = ROW * i as f64 + FONT + 6.0;
        svg.text([left, top - 4.0], Anchor::Start, INK, &bar.label);
        let mut from = 0.0;
        for (length, role, opacity) in &bar.parts {
            let to = from + if length.is_finite() { *length } else { 0.0 };
            svg.rectangle([x(from), top], [x(to) - x(from), BAR], role.css(), *opacity);
            from = to;
        }
        svg.text([x(from) + 5.0, top + BAR - 1.5], Anchor::Start, INK, &bar.value);
    }
    svg.line([left, 2.0], [left, bottom], INK, 1.0);
    svg.text([0.5 * WIDTH, bottom + 2.0 * FONT + 8.0], Anchor::Middle, INK, x_label);
    svg.figure(bottom + 2.0 * FONT + 14.0, title, &legend)
}

/// Interval of a parameter with its best value.
pub struct Interval {
    /// Name above the interval.
    pub name: String,
    /// Values at 5 %, best, and 95 %. The best value of a prior is NaN.
    pub values: [f64; 3],
    /// Colour of the interval.
    pub role: Role,
}

/// Picture of intervals of one parameter under their names.
pub fn intervals(title: &str, x_label: &str, rows: &[Interval]) -> String {
    let (low, high) = range(rows.iter().flat_map(|i| i.values));
    let x_axis = Axis { low, high, ticks: ticks::linear(low, high, 5), label: x_label.to_owned() };
    let y_axis = Axis { low: 0.0, high: rows.len().max(1) as f64, ticks: Vec::new(), label: String::new() };
    let mut chart = Chart::new(x_axis, y_axis, 34.0 * rows.len().max(1) as f64);
    for (i, Interval { name, values: [least, best, most], role }) in rows.iter().enumerate() {
        let y = chart.y(rows.len() as f64 - 0.72 - i as f64);
        let ends = [[chart.x(*least), y], [chart.x(*most), y]];
        chart.svg.path(&ends, role.css(), 5.0, false);
        if best.is_finite() {
            let at = [chart.x(*best), y];
            chart.svg.disc(at, 5.5, role.css(), 1.0);
        }
        let half = 0.5 * text_width(name);
        // The name is kept inside the picture, whatever the interval.
        let left = chart.field().0[0];
        let middle = (0.5 * (ends[0][0] + ends[1][0])).clamp(left + half + 4.0, WIDTH - half - 12.0);
        chart.svg.text([middle, y - 9.0], Anchor::Middle, INK, name);
    }
    chart.figure(title, &[])
}

/// Curve with a band around it.
pub struct Ribbon {
    /// Name in the legend.
    pub name: String,
    /// Colour of the curve and its band.
    pub role: Role,
    /// Lower edge, middle and upper edge at each of the times.
    pub values: Vec<[f64; 3]>,
}

/// Measured values and predictions over time.
pub struct Panel {
    /// Title of the picture.
    pub title: String,
    /// Label of the vertical axis, with the unit.
    pub label: String,
    /// Measured values.
    pub measured: Vec<f64>,
    /// Predictions.
    pub ribbons: Vec<Ribbon>,
}

/// Picture of measured dots and the models' ribbons over time.
pub fn panel(times_s: &[f64], panel: &Panel) -> String {
    let all = panel.ribbons.iter().flat_map(|r| r.values.iter().flatten()).chain(&panel.measured).copied();
    let mut chart = Chart::new(axis(times_s.iter().copied(), 6, "time, s"), axis(all, 4, &panel.label), 120.0);
    let mut legend = Vec::new();
    for ribbon in &panel.ribbons {
        let rows: Vec<(f64, [f64; 3])> = times_s.iter().copied().zip(ribbon.values.iter().copied()).collect();
        let rows: Vec<(f64, [f64; 3])> =
            thinned(&rows).copied().filter(|(_, v)| v.iter().all(|v| v.is_finite())).collect();
        let edge = |k: usize| -> Vec<[f64; 2]> { rows.iter().map(|(t, v)| chart.at([*t, v[k]])).collect() };
        let (lower, middle, upper) = (edge(0), edge(1), edge(2));
        let outline: Vec<[f64; 2]> = lower.into_iter().chain(upper.into_iter().rev()).collect();
        chart.svg.area(&outline, ribbon.role.css(), 0.35);
        chart.svg.path(&middle, ribbon.role.css(), 1.5, false);
        legend.push(Entry::new(&ribbon.name, Shape::Area, ribbon.role));
    }
    let dots: Vec<(f64, f64)> = times_s.iter().copied().zip(panel.measured.iter().copied()).collect();
    for (t, v) in thinned(&dots).filter(|(_, v)| v.is_finite()) {
        let at = chart.at([*t, *v]);
        chart.svg.disc(at, 1.7, Role::Measured.css(), 1.0);
    }
    legend.push(Entry::new("measured", Shape::Dots, Role::Measured));
    chart.figure(&panel.title, &legend)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_their_labels_values_and_legend() {
        let all = [("one", 0.7), ("two", 0.2)].map(|(label, v)| Bar {
            label: label.into(),
            parts: vec![(v, Role::After, 1.0), (0.1, Role::After, 0.4)],
            value: format!("{v} mm"),
        });
        let legend = [Entry::new("whole", Shape::Area, Role::After)];
        let svg = bars("t", "x", &all, Some(("floor", 0.4, Role::Noise)), &legend);
        assert!(["one", "two", "0.7 mm", "whole", "floor"].iter().all(|w| svg.contains(w)), "{svg}");
        let empty = bars("nothing", "x", &[], None, &[]);
        assert!(empty.contains("<svg") && !empty.contains("NaN"), "{empty}");
    }

    #[test]
    fn intervals_and_panels_show_their_series_and_accept_empty_ones() {
        let row = |name: &str, best| Interval { name: name.into(), values: [1.0, best, 3.0], role: Role::Before };
        let svg = intervals("Length", "mm", &[row("before", 2.0), row("prior", f64::NAN)]);
        assert!(
            svg.contains("before")
                && svg.contains("prior")
                && !svg.contains("NaN")
                && svg.matches("<circle").count() == 1
        );
        let ribbon =
            Ribbon { name: "present model".into(), role: Role::Before, values: vec![[0.0, 1.0, 2.0], [f64::NAN; 3]] };
        let one =
            Panel { title: "t".into(), label: "x, mm".into(), measured: vec![1.0, f64::NAN], ribbons: vec![ribbon] };
        let svg = panel(&[0.0, 0.1], &one);
        assert!(svg.contains("present model") && !svg.contains("NaN"), "{svg}");
        let nothing = Panel { title: "t".into(), label: "x".into(), measured: vec![], ribbons: vec![] };
        assert!(panel(&[], &nothing).contains("<svg") && intervals("t", "x", &[]).contains("<svg"));
    }
}
