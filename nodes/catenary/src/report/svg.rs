//! Pictures as SVG text. Pictures are 380 units wide and texts 12 units high, legible at the width of a telephone's
//! screen.

use super::html::escape;
use super::palette::Role;
use super::ticks::Tick;
use std::fmt::Write;

/// Width of a picture.
pub const WIDTH: f64 = 380.0;
/// Height of a text.
pub const FONT: f64 = 12.0;
/// Average width of a character of DejaVu Sans, the widest of the usual system fonts.
const CHARACTER: f64 = 7.4;
const INK: &str = Role::INK;
const GRID: &str = Role::GRID;

/// Alignment of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Text starts at the point.
    Start,
    /// Text is centred at the point.
    Middle,
    /// Text ends at the point.
    End,
}

/// Shape of a series in the picture and the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Continuous line.
    Line,
    /// Dashed line.
    Dashes,
    /// Filled area.
    Area,
    /// Filled dots.
    Dots,
    /// Rings.
    Rings,
    /// Diagonal cross.
    Cross,
    /// Filled triangle.
    Triangle,
}

/// Entry of a legend.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name of the series.
    pub name: String,
    /// Shape of the series.
    pub shape: Shape,
    /// Colour as CSS.
    pub colour: String,
}

impl Entry {
    /// Entry in the colour of a role.
    pub fn new(name: impl Into<String>, shape: Shape, role: Role) -> Self {
        Self { name: name.into(), shape, colour: role.css().to_owned() }
    }

    /// Entry in a paler colour of a role.
    pub fn pale(name: impl Into<String>, shape: Shape, role: Role) -> Self {
        Self { name: name.into(), shape, colour: role.tint(0.4) }
    }
}

/// Picture under construction. The point (0, 0) is the upper left corner.
#[derive(Debug, Default)]
pub struct Svg {
    body: String,
}

impl Svg {
    /// Draws a straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: &str, width: f64) {
        self.path(&[from, to], colour, width, false);
    }

    /// Draws a line through points. Points that are not finite are left out.
    pub fn path(&mut self, points: &[[f64; 2]], colour: &str, width: f64, is_dashed: bool) {
        let dashes = if is_dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        let data = data(points);
        let _ = write!(
            self.body,
            "<path d=\"{data}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{dashes}/>"
        );
    }

    /// Draws a filled area.
    pub fn area(&mut self, points: &[[f64; 2]], colour: &str, opacity: f64) {
        let data = data(points);
        if !data.is_empty() {
            let _ = write!(self.body, "<path d=\"{data}Z\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>");
        }
    }

    /// Draws a filled rectangle with sharp edges.
    pub fn rectangle(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], colour: &str, opacity: f64) {
        let _ = write!(
            self.body,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{colour}\" \
             fill-opacity=\"{opacity}\" shape-rendering=\"crispEdges\"/>"
        );
    }

    /// Draws a disc.
    pub fn disc(&mut self, [x, y]: [f64; 2], radius: f64, colour: &str, opacity: f64) {
        let _ = write!(
            self.body,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>"
        );
    }

    /// Draws a ring with an edge of the ground, visible on any background.
    pub fn ring(&mut self, [x, y]: [f64; 2], radius: f64, colour: &str) {
        for (stroke, width) in [(Role::PAPER, 3.5), (colour, 1.5)] {
            let _ = write!(
                self.body,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"none\" stroke=\"{stroke}\" stroke-width=\"{width}\"/>"
            );
        }
    }

    /// Draws a cross with an edge of the ground, visible on any background.
    pub fn cross(&mut self, [x, y]: [f64; 2], size: f64, colour: &str) {
        for (stroke, width) in [(Role::PAPER, 6.0), (colour, 3.0)] {
            self.line([x - size, y - size], [x + size, y + size], stroke, width);
            self.line([x - size, y + size], [x + size, y - size], stroke, width);
        }
    }

    /// Draws a triangle.
    pub fn triangle(&mut self, [x, y]: [f64; 2], size: f64, colour: &str) {
        self.area(&[[x - size, y + 0.8 * size], [x + size, y + 0.8 * size], [x, y - size]], colour, 1.0);
    }

    /// Draws a PNG picture that fills a rectangle; `png` is in base 64.
    pub fn image(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], png: &str) {
        let _ = write!(
            self.body,
            "<image x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" preserveAspectRatio=\"none\" \
             href=\"data:image/png;base64,{png}\"/>"
        );
    }

    /// Draws a text with its base line at the point. The page's style adds an edge of the ground's colour, which separates it
    /// from lines.
    pub fn text(&mut self, [x, y]: [f64; 2], anchor: Anchor, colour: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = escape(text);
        let _ = write!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>"
        );
    }

    /// Draws a text from below to above, centred at the point.
    pub fn text_up(&mut self, [x, y]: [f64; 2], colour: &str, text: &str) {
        let text = escape(text);
        let _ = write!(
            self.body,
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\" fill=\"{colour}\">{text}</text>"
        );
    }

    /// Opens a group with these attributes. [`Svg::close`] closes it.
    pub fn open(&mut self, attributes: &str) {
        let _ = write!(self.body, "<g{attributes}>");
    }

    /// Closes the newest group.
    pub fn close(&mut self) {
        self.body.push_str("</g>");
    }

    /// Figure of a fixed size, which a narrow page scrolls, with a title above and a legend below.
    pub fn fixed_figure(self, [width, height]: [f64; 2], title: &str, legend: &[Entry]) -> String {
        let (title, body) = (escape(title), self.body);
        let legend: String = legend.iter().map(entry).collect();
        format!(
            "<figure class=\"fixed\"><figcaption>{title}</figcaption><div class=\"scroll\"><svg width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"{title}\" font-size=\"{FONT}\">{body}</svg></div>\
             <ul class=\"legend\">{legend}</ul></figure>"
        )
    }

    /// Figure with a title above and a legend below.
    pub fn figure(self, height: f64, title: &str, legend: &[Entry]) -> String {
        let (title, body) = (escape(title), self.body);
        let legend: String = legend.iter().map(entry).collect();
        let legend = if legend.is_empty() { legend } else { format!("<ul class=\"legend\">{legend}</ul>") };
        format!(
            "<figure><figcaption>{title}</figcaption><svg viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" \
             aria-label=\"{title}\" font-size=\"{FONT}\">{body}</svg>{legend}</figure>"
        )
    }
}

fn entry(e: &Entry) -> String {
    let mut swatch = Svg::default();
    let colour = &e.colour;
    match e.shape {
        Shape::Line => swatch.line([0.0, 7.0], [20.0, 7.0], colour, 2.5),
        Shape::Dashes => swatch.path(&[[0.0, 7.0], [20.0, 7.0]], colour, 2.0, true),
        Shape::Area => swatch.rectangle([2.0, 2.0], [16.0, 10.0], colour, 0.7),
        Shape::Dots => swatch.disc([10.0, 7.0], 3.0, colour, 1.0),
        Shape::Rings => swatch.ring([10.0, 7.0], 4.0, colour),
        Shape::Cross => swatch.cross([10.0, 7.0], 4.0, colour),
        Shape::Triangle => swatch.triangle([10.0, 7.0], 6.0, colour),
    }
    let (body, name) = (swatch.body, escape(&e.name));
    format!("<li><svg class=\"swatch\" viewBox=\"0 0 20 14\" aria-hidden=\"true\">{body}</svg>{name}</li>")
}

fn data(points: &[[f64; 2]]) -> String {
    let mut text = String::new();
    for [x, y] in points.iter().filter(|p| p.iter().all(|v| v.is_finite())) {
        let command = if text.is_empty() { 'M' } else { 'L' };
        let _ = write!(text, "{command}{x:.1} {y:.1}");
    }
    text
}

/// Estimated width of a text.
pub fn text_width(text: &str) -> f64 {
    CHARACTER * text.chars().count() as f64
}

/// Axis of a chart.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Value at the left or lower end.
    pub low: f64,
    /// Value at the other end.
    pub high: f64,
    /// Tick marks.
    pub ticks: Vec<Tick>,
    /// Label, with the unit.
    pub label: String,
}

/// Chart with two axes.
#[derive(Debug)]
pub struct Chart {
    /// Picture of the chart.
    pub svg: Svg,
    x: Axis,
    y: Axis,
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

impl Chart {
    /// Chart with grid, tick marks and labels; `height` is the height of the plot area.
    pub fn new(x: Axis, y: Axis, height: f64) -> Self {
        let widest = y.ticks.iter().map(|(_, label)| text_width(label)).fold(0.0, f64::max);
        let (left, top) = (widest.max(8.0) + 8.0, FONT + 12.0);
        let mut chart = Self { svg: Svg::default(), x, y, left, right: WIDTH - 12.0, top, bottom: top + height };
        chart.grid();
        chart
    }

    fn grid(&mut self) {
        let (x, y) = (self.x.clone(), self.y.clone());
        let mut free_from = 0.0;
        for (value, label) in &x.ticks {
            let at = self.x(*value);
            self.svg.line([at, self.top], [at, self.bottom], GRID, 1.0);
            let half = 0.5 * text_width(label);
            let middle = at.clamp(half, WIDTH - half);
            // A label that would touch the previous one is left out.
            if middle - half >= free_from {
                self.svg.text([middle, self.bottom + FONT + 4.0], Anchor::Middle, INK, label);
                free_from = middle + half + 4.0;
            }
        }
        for (value, label) in &y.ticks {
            let at = self.y(*value);
            self.svg.line([self.left, at], [self.right, at], GRID, 1.0);
            self.svg.text([self.left - 5.0, at + 0.35 * FONT], Anchor::End, INK, label);
        }
        self.svg.line([self.left, self.bottom], [self.right, self.bottom], INK, 1.0);
        self.svg.line([self.left, self.top], [self.left, self.bottom], INK, 1.0);
        self.svg.text([2.0, FONT], Anchor::Start, INK, &y.label);
        let middle = 0.5 * (self.left + self.right);
        self.svg.text([middle, self.bottom + 2.0 * FONT + 9.0], Anchor::Middle, INK, &x.label);
    }

    /// Horizontal position of a value.
    pub fn x(&self, value: f64) -> f64 {
        self.left + (value - self.x.low) / (self.x.high - self.x.low) * (self.right - self.left)
    }

    /// Vertical position of a value.
    pub fn y(&self, value: f64) -> f64 {
        self.bottom - (value - self.y.low) / (self.y.high - self.y.low) * (self.bottom - self.top)
    }

    /// Position of a point.
    pub fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.x(x), self.y(y)]
    }

    /// Upper left corner and size of the field.
    pub fn field(&self) -> ([f64; 2], [f64; 2]) {
        ([self.left, self.top], [self.right - self.left, self.bottom - self.top])
    }

    /// Finished figure.
    pub fn figure(self, title: &str, legend: &[Entry]) -> String {
        let height = self.bottom + 2.0 * FONT + 14.0;
        self.svg.figure(height, title, legend)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(label: &str, high: f64) -> Axis {
        Axis { low: 0.0, high, ticks: super::super::ticks::linear(0.0, high, 4), label: label.into() }
    }

    #[test]
    fn a_chart_has_its_labels_and_places_values() {
        let mut chart = Chart::new(axis("time, s", 2.0), axis("height, mm", 10.0), 100.0);
        assert_eq!(chart.y(0.0) - chart.y(10.0), 100.0);
        assert!(chart.x(2.0) <= WIDTH && chart.x(0.0) >= 16.0);
        let at = chart.at([1.0, f64::NAN]);
        chart.svg.path(&[at, [1.0, 1.0]], "red", 1.0, false);
        let figure = chart.figure("a < b", &[Entry::new("one", Shape::Line, Role::After)]);
        assert!(
            ["time, s", "height, mm", "a &lt; b", ">one<", "M1.0 1.0"].iter().all(|w| figure.contains(w)),
            "{figure}"
        );
        assert!(!figure.contains("NaN"), "{figure}");
    }

    #[test]
    fn labels_do_not_touch() {
        let ticks = (0..40).map(|i| (f64::from(i), format!("{i}000"))).collect();
        let crowded = Axis { low: 0.0, high: 39.0, ticks, label: String::new() };
        let figure = Chart::new(crowded, axis("y", 1.0), 50.0).figure("t", &[]);
        assert!(figure.matches("000</text>").count() < 14, "{figure}");
    }
}
