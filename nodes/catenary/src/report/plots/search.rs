//! The pictures of a search for effects.

use super::{PALETTE, draw_sized, plot_error, range};
use anyhow::Result;
use plotters::prelude::*;

const WIDTH: u32 = 720;
/// Height of a bar with its label.
const BAR_PX: u32 = 26;
/// Share of a picture's width that labels of bars have.
const LABEL_PX: u32 = 230;
/// Share of what a picture shows that is left free for its legend: beside bars, above a histogram and above a panel.
const BESIDE: f64 = 0.4;
const ABOVE_CELLS: f64 = 0.3;
const ABOVE_LINES: f64 = 0.6;

/// One bar, in parts that follow one another.
pub struct Bar {
    /// What it stands for.
    pub label: String,
    /// Lengths of its parts; part i has colour i.
    pub parts: Vec<f64>,
}

/// Horizontal bars with a line across all of them, where there is one. `names` are those of the parts.
pub fn bars(title: &str, x_label: &str, names: &[&str], bars: &[Bar], line: Option<(&str, f64)>) -> Result<String> {
    let longest = bars.iter().map(|b| b.parts.iter().sum::<f64>()).chain(line.map(|l| l.1)).fold(0.0, f64::max);
    let has_legend = names.len() + usize::from(line.is_some()) > 1;
    let room = if has_legend { 1.0 + BESIDE } else { 1.08 };
    let right = if longest > 0.0 && longest.is_finite() { room * longest } else { 1.0 };
    let count = bars.len().max(1);
    draw_sized((WIDTH, 120 + BAR_PX * count as u32), |root| {
        let mut chart = ChartBuilder::on(root)
            .caption(title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(LABEL_PX)
            .build_cartesian_2d(0.0..right, 0.0..count as f64)
            .map_err(plot_error)?;
        let label = |y: &f64| {
            let place = count as f64 - 0.5 - y;
            let is_middle = (place - place.round()).abs() < 1e-6 && place >= 0.0;
            if is_middle {
                bars.get(place.round() as usize).map_or(String::new(), |b| b.label.clone())
            } else {
                String::new()
            }
        };
        chart
            .configure_mesh()
            .disable_y_mesh()
            .x_desc(x_label)
            .y_labels(2 * count + 1)
            .y_label_formatter(&label)
            .light_line_style(WHITE)
            .draw()
            .map_err(plot_error)?;
        for (part, name) in names.iter().enumerate() {
            let colour = PALETTE[part % PALETTE.len()];
            let rectangle = |(i, bar): (usize, &Bar)| {
                let from: f64 = bar.parts.iter().take(part).sum();
                let to = from + bar.parts.get(part).copied().unwrap_or(0.0);
                let y = (count - 1 - i) as f64;
                Rectangle::new([(from, y + 0.15), (to, y + 0.85)], colour.filled())
            };
            let drawn = chart.draw_series(bars.iter().enumerate().map(rectangle)).map_err(plot_error)?;
            drawn.label(*name).legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 18, y + 5)], colour.filled()));
        }
        if let Some((name, x)) = line {
            let drawn = chart
                .draw_series([PathElement::new(vec![(x, 0.0), (x, count as f64)], BLACK.stroke_width(2))])
                .map_err(plot_error)?;
            drawn.label(name).legend(|(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], BLACK.stroke_width(2)));
        }
        if !has_legend {
            return Ok(());
        }
        let mut legend = chart.configure_series_labels();
        legend.position(SeriesLabelPosition::LowerRight);
        legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3)).draw().map_err(plot_error)
    })
}

/// How often values fall into each of `cells` cells, with a line at `mark`.
pub fn histogram(title: &str, x_label: &str, values: &[f64], (name, mark): (&str, f64)) -> Result<String> {
    const CELLS: usize = 30;
    let (x0, x1) = range(values.iter().copied().chain([mark]));
    let width = (x1 - x0) / CELLS as f64;
    let mut counts = [0usize; CELLS];
    for v in values {
        counts[(((v - x0) / width) as usize).min(CELLS - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    draw_sized((WIDTH, 320), |root| {
        let mut chart = ChartBuilder::on(root)
            .caption(title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(x0..x1, 0.0..(1.0 + ABOVE_CELLS) * most)
            .map_err(plot_error)?;
        chart
            .configure_mesh()
            .x_desc(x_label)
            .y_desc("data sets")
            .light_line_style(WHITE)
            .draw()
            .map_err(plot_error)?;
        let cell = |(i, n): (usize, &usize)| {
            let from = x0 + width * i as f64;
            Rectangle::new([(from, 0.0), (from + width, *n as f64)], PALETTE[0].mix(0.6).filled())
        };
        chart.draw_series(counts.iter().enumerate().map(cell)).map_err(plot_error)?;
        let line = PathElement::new(vec![(mark, 0.0), (mark, 1.05 * most)], RED.stroke_width(3));
        let drawn = chart.draw_series([line]).map_err(plot_error)?;
        drawn.label(name).legend(|(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], RED.stroke_width(3)));
        let mut legend = chart.configure_series_labels();
        legend.position(SeriesLabelPosition::UpperRight);
        legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3)).draw().map_err(plot_error)
    })
}

/// An interval with its middle, for one parameter.
pub struct Interval {
    /// Name of the model.
    pub name: String,
    /// 5 %, best value, 95 %.
    pub values: [f64; 3],
}

/// Intervals of parameters, a row each with an axis of its own.
pub fn intervals(title: &str, rows: &[(String, Vec<Interval>)]) -> Result<String> {
    const ROW_PX: u32 = 92;
    draw_sized((WIDTH, 40 + ROW_PX * rows.len().max(1) as u32), |root| {
        let root = root.titled(title, ("sans-serif", 18)).map_err(plot_error)?;
        for (area, (parameter, intervals)) in root.split_evenly((rows.len().max(1), 1)).iter().zip(rows) {
            let (x0, x1) = range(intervals.iter().flat_map(|i| i.values));
            let mut chart = ChartBuilder::on(area)
                .margin(6)
                .x_label_area_size(34)
                .y_label_area_size(LABEL_PX)
                .build_cartesian_2d(x0..x1, 0.0..intervals.len().max(1) as f64)
                .map_err(plot_error)?;
            chart
                .configure_mesh()
                .disable_y_mesh()
                .disable_y_axis()
                .x_desc(parameter)
                .x_labels(6)
                .light_line_style(WHITE)
                .draw()
                .map_err(plot_error)?;
            for (i, Interval { name, values: [low, best, high] }) in intervals.iter().enumerate() {
                let y = intervals.len() as f64 - 0.5 - i as f64;
                let colour = PALETTE[i % PALETTE.len()];
                chart
                    .draw_series([PathElement::new(vec![(*low, y), (*high, y)], colour.stroke_width(4))])
                    .map_err(plot_error)?;
                chart.draw_series([Circle::new((*best, y), 5, colour.filled())]).map_err(plot_error)?;
                let (_, y_px) = chart.backend_coord(&(x0, y));
                let top = area.get_base_pixel().1;
                area.draw_text(name, &("sans-serif", 13).into_text_style(area).color(&colour), (16, y_px - top - 7))
                    .map_err(plot_error)?;
            }
        }
        Ok(())
    })
}

/// A curve with a band about it.
pub struct Ribbon {
    /// Its name in the legend.
    pub name: String,
    /// Lower edge, middle and upper edge at each of the times.
    pub values: Vec<[f64; 3]>,
}

/// Small pictures side by side: in each measured dots, and ribbons.
pub struct Panel {
    /// What its vertical axis shows.
    pub label: String,
    /// What was measured.
    pub measured: Vec<f64>,
    /// What models predict.
    pub ribbons: Vec<Ribbon>,
}

/// Panels in two columns over a common time.
pub fn panels(title: &str, times_s: &[f64], panels: &[Panel]) -> Result<String> {
    const PANEL_PX: u32 = 190;
    let rows = panels.len().div_ceil(2).max(1);
    draw_sized((1040, 40 + PANEL_PX * rows as u32), |root| {
        let root = root.titled(title, ("sans-serif", 18)).map_err(plot_error)?;
        let (t0, t1) = range(times_s.iter().copied());
        for (place, (area, panel)) in root.split_evenly((rows, 2)).iter().zip(panels).enumerate() {
            let all = panel.ribbons.iter().flat_map(|r| r.values.iter().flatten());
            let (y0, mut y1) = range(all.chain(&panel.measured).copied());
            if place == 0 {
                y1 += ABOVE_LINES * (y1 - y0);
            }
            let mut chart = ChartBuilder::on(area)
                .margin(6)
                .x_label_area_size(28)
                .y_label_area_size(56)
                .build_cartesian_2d(t0..t1, y0..y1)
                .map_err(plot_error)?;
            chart
                .configure_mesh()
                .x_desc("s")
                .y_desc(&panel.label)
                .x_labels(8)
                .y_labels(5)
                .light_line_style(WHITE)
                .draw()
                .map_err(plot_error)?;
            for (i, ribbon) in panel.ribbons.iter().enumerate() {
                let colour = PALETTE[[1, 0][i % 2]];
                let at = |k: usize| times_s.iter().zip(&ribbon.values).map(move |(t, v)| (*t, v[k]));
                let outline: Vec<(f64, f64)> =
                    at(0).chain(at(2).collect::<Vec<_>>().into_iter().rev()).filter(|p| p.1.is_finite()).collect();
                chart.draw_series([Polygon::new(outline, colour.mix(0.25).filled())]).map_err(plot_error)?;
                let middle = at(1).filter(|p| p.1.is_finite());
                let drawn = chart.draw_series(LineSeries::new(middle, colour.stroke_width(1))).map_err(plot_error)?;
                drawn
                    .label(&ribbon.name)
                    .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 14, y)], colour.stroke_width(3)));
            }
            let dots = times_s.iter().zip(&panel.measured).filter(|(_, v)| v.is_finite());
            let drawn =
                chart.draw_series(dots.map(|(t, v)| Circle::new((*t, *v), 2, BLACK.filled()))).map_err(plot_error)?;
            drawn.label("measured").legend(|(x, y)| Circle::new((x + 7, y), 2, BLACK.filled()));
            if place == 0 {
                let mut legend = chart.configure_series_labels();
                legend.position(SeriesLabelPosition::UpperRight).label_font(("sans-serif", 11));
                legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3)).draw().map_err(plot_error)?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_name_what_they_stand_for() {
        let all = [("one", 0.7), ("two", 0.2)].map(|(label, v)| Bar { label: label.into(), parts: vec![v, 0.1] });
        let svg = bars("t", "x", &["whole", "part"], &all, Some(("floor", 0.4))).unwrap();
        assert!(["one", "two", "whole", "part", "floor"].iter().all(|w| svg.contains(w)), "{svg}");
        assert!(bars("nothing", "x", &["a"], &[], None).is_ok());
    }

    #[test]
    fn other_pictures_hold_their_series_and_bear_nothing_at_all() {
        let svg = histogram("t", "x", &[1.0, 2.0, 2.1, 5.0], ("mark", 9.0)).unwrap();
        assert!(svg.contains("mark"));
        let row = vec![Interval { name: "before".into(), values: [1.0, 2.0, 3.0] }];
        assert!(intervals("t", &[("length_m".into(), row)]).unwrap().contains("length_m"));
        let ribbon = Ribbon { name: "present model".into(), values: vec![[0.0, 1.0, 2.0], [f64::NAN; 3]] };
        let panel = Panel { label: "x".into(), measured: vec![1.0, f64::NAN], ribbons: vec![ribbon] };
        assert!(panels("t", &[0.0, 0.1], &[panel]).unwrap().contains("present model"));
        assert!(panels("t", &[], &[]).is_ok() && intervals("t", &[]).is_ok());
    }
}
