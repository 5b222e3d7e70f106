//! Corner plot of a posterior: every parameter on the diagonal, every pair below it.

use super::densities::{DRAWS, Window, marginal_density, raster, windows};
use crate::report::palette::Role;
use crate::report::quantity::Quantity;
use crate::report::svg::{Anchor, Entry, FONT, Shape, Svg, text_width};
use crate::report::ticks::{self, Tick};
use anyhow::Result;
use catenary_core::Posterior;

/// Side of a field by the number of parameters: two fit a telephone's screen.
const SIDES: [f64; 4] = [180.0, 140.0, 124.0, 116.0];
const GAP: f64 = 10.0;
/// Bars of a marginal.
const BARS: usize = 40;
const LINE: f64 = FONT + 2.0;

/// Axis of a parameter: its window in unit coordinates, tick marks, and title in lines.
struct Side {
    window: Window,
    ticks: Vec<Tick>,
    lines: Vec<String>,
}

/// Corner plot around the posterior, with the low-variance samples `domains` and, if known, the truth. The axes follow the prior:
/// logarithmic for a prior uniform in the logarithm.
///
/// # Errors
/// A posterior from which nothing can be drawn.
pub fn corner(posterior: &Posterior, domains: &[Vec<f64>], truth: Option<&[f64]>) -> Result<String> {
    let space = &posterior.parameters;
    let d = space.dimension();
    let side = SIDES[d.saturating_sub(2).min(SIDES.len() - 1)];
    let windows = windows(posterior, domains, truth)?;
    let sides: Vec<Side> = windows.iter().enumerate().map(|(i, w)| axis(posterior, i, *w, side)).collect();
    let widest = sides.iter().skip(1).flat_map(|s| &s.ticks).map(|(_, label)| text_width(label)).fold(0.0, f64::max);
    let lines = sides.iter().map(|s| s.lines.len()).max().unwrap_or(1) as f64;
    let (left, top) = (lines * LINE + widest + 10.0, 4.0);
    let at = |k: usize| k as f64 * (side + GAP);
    let draws: Vec<Vec<f64>> = posterior.sample(DRAWS / 4, 0)?.iter().map(|t| space.to_unit(t)).collect();
    let unit = |thetas: &[Vec<f64>]| -> Vec<Vec<f64>> { thetas.iter().map(|t| space.to_unit(t)).collect() };
    let (samples, truth) = (unit(domains), truth.map(|t| space.to_unit(t)));
    let mut svg = Svg::default();
    for (row, y) in sides.iter().enumerate() {
        for (column, x) in sides.iter().enumerate().take(row + 1) {
            let field = Field { corner: [left + at(column), top + at(row)], side, x: x.window, y: y.window };
            field.frame(&mut svg);
            if row == column {
                field.bars(&mut svg, draws.iter().map(|u| u[row]));
                if let Some(truth) = &truth {
                    let x = field.at([truth[row], 0.0])[0];
                    svg.line([x, field.corner[1]], [x, field.corner[1] + side], Role::Truth.css(), 2.0);
                }
            } else {
                let density = marginal_density(posterior, [column, row], [x.window, y.window])?;
                svg.image(field.corner, [side; 2], &raster(&density)?);
                samples.iter().for_each(|u| svg.ring(field.at([u[column], u[row]]), 3.5, Role::Measured.css()));
                if let Some(truth) = &truth {
                    svg.cross(field.at([truth[column], truth[row]]), 6.0, Role::Truth.css());
                }
            }
            if row + 1 == d {
                field.ticks_below(&mut svg, &x.ticks);
                for (i, line) in x.lines.iter().enumerate() {
                    let middle =
                        [field.corner[0] + 0.5 * side, field.corner[1] + side + FONT + 6.0 + (i + 1) as f64 * LINE];
                    svg.text(middle, Anchor::Middle, Role::INK, line);
                }
            }
            if column == 0 && row > 0 {
                field.ticks_left(&mut svg, &y.ticks);
                for (i, line) in y.lines.iter().enumerate() {
                    svg.text_up([FONT + i as f64 * LINE, field.corner[1] + 0.5 * side], Role::INK, line);
                }
            }
        }
    }
    let mut legend = vec![Entry::new("posterior", Shape::Area, Role::Posterior)];
    if !domains.is_empty() {
        legend.push(Entry::new("samples of it", Shape::Rings, Role::Measured));
    }
    if truth.is_some() {
        legend.push(Entry::new("hidden truth", Shape::Cross, Role::Truth));
    }
    let size = [left + at(d) - GAP + 14.0, top + at(d) - GAP + FONT + 10.0 + lines * LINE + 4.0];
    Ok(svg.fixed_figure(size, "Parameters and pairs of them, around the posterior", &legend))
}

/// Axis of a parameter in a window.
fn axis(posterior: &Posterior, i: usize, window: Window, side: f64) -> Side {
    let parameter = &posterior.parameters.parameters()[i];
    let quantity = Quantity::of(&parameter.name);
    let ends = [window.0, window.1].map(|u| parameter.prior.from_unit(u).abs());
    let scale = quantity.scale(ends[0].max(ends[1]));
    let ticks = ticks::of_prior(&parameter.prior, window, scale.factor, 5);
    Side { window, ticks, lines: wrapped(&quantity.axis(&scale), side) }
}

/// Words of a label in lines that fit a width.
fn wrapped(label: &str, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in label.split(' ') {
        match lines.last_mut() {
            Some(line) if text_width(line) + text_width(word) < width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Square field of two windows.
struct Field {
    corner: [f64; 2],
    side: f64,
    x: Window,
    y: Window,
}

impl Field {
    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let share = |v: f64, (low, high): Window| ((v - low) / (high - low)).clamp(0.0, 1.0);
        [self.corner[0] + self.side * share(x, self.x), self.corner[1] + self.side * (1.0 - share(y, self.y))]
    }

    fn frame(&self, svg: &mut Svg) {
        let ([x, y], s) = (self.corner, self.side);
        svg.path(&[[x, y], [x, y + s], [x + s, y + s], [x + s, y], [x, y]], Role::GRID, 1.0, false);
    }

    /// Histogram of values, as high as the field.
    fn bars(&self, svg: &mut Svg, values: impl Iterator<Item = f64>) {
        let mut counts = [0.0; BARS];
        let inside = values.map(|v| (v - self.x.0) / (self.x.1 - self.x.0)).filter(|s| (0.0..1.0).contains(s));
        inside.for_each(|s| counts[(s * BARS as f64) as usize] += 1.0);
        let most = counts.iter().copied().fold(1.0, f64::max) * 1.06;
        let place = |k: usize, count: f64| {
            let share = k as f64 / BARS as f64;
            [self.corner[0] + self.side * share, self.corner[1] + self.side * (1.0 - count / most)]
        };
        let steps = (0..BARS).flat_map(|k| [place(k, counts[k]), place(k + 1, counts[k])]);
        let outline: Vec<[f64; 2]> = [place(0, 0.0)].into_iter().chain(steps).chain([place(BARS, 0.0)]).collect();
        svg.area(&outline, Role::Posterior.css(), 0.7);
    }

    fn ticks_below(&self, svg: &mut Svg, ticks: &[Tick]) {
        let (bottom, mut free_from) = (self.corner[1] + self.side, self.corner[0] - GAP);
        for (value, label) in ticks {
            let (x, half) = (self.at([*value, 0.0])[0], 0.5 * text_width(label));
            svg.line([x, bottom], [x, bottom + 4.0], Role::INK, 1.0);
            // A label that would touch the one before is left out.
            if x - half >= free_from {
                svg.text([x, bottom + FONT + 5.0], Anchor::Middle, Role::INK, label);
                free_from = x + half + 4.0;
            }
        }
    }

    fn ticks_left(&self, svg: &mut Svg, ticks: &[Tick]) {
        for (value, label) in ticks {
            let y = self.corner[1] + self.side * (1.0 - (value - self.y.0) / (self.y.1 - self.y.0));
            svg.line([self.corner[0] - 4.0, y], [self.corner[0], y], Role::INK, 1.0);
            svg.text([self.corner[0] - 6.0, y + 0.35 * FONT], Anchor::End, Role::INK, label);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, ParameterSpace, Prior};

    #[test]
    fn a_corner_has_a_field_for_each_parameter_and_each_pair() {
        for names in [["length_m", "youngs_modulus_pa", "density_kg_m3"].as_slice(), &["length_m", "youngs_modulus_pa"]]
        {
            let p = |name: &&str| Parameter { name: (*name).into(), prior: Prior::LogUniform { low: 1.0, high: 10.0 } };
            let posterior = Posterior::prior(ParameterSpace::new(names.iter().map(p).collect()).unwrap());
            let (d, truth) = (names.len(), vec![2.0; names.len()]);
            let svg = corner(&posterior, &[vec![3.0; d]], Some(&truth)).unwrap();
            let pairs = d * (d - 1) / 2;
            assert_eq!(svg.matches("<image").count(), pairs, "{svg}");
            // Two circles a ring: one in each pair, and one in the legend.
            assert_eq!(svg.matches("<circle").count(), 2 * (pairs + 1));
            assert!(svg.contains(">length, m<") && svg.contains(">hidden truth<"), "{svg}");
        }
    }

    #[test]
    fn a_long_label_is_broken_between_words() {
        assert_eq!(wrapped("Young's modulus, kPa", 124.0), ["Young's modulus,", "kPa"]);
        assert_eq!(wrapped("length, m", 124.0), ["length, m"]);
    }
}
