//! Pictures that compare policies.

use super::axis;
use crate::report::number::plain;
use crate::report::palette::Role;
use crate::report::svg::{Anchor, Chart, Entry, FONT, Shape, Svg, WIDTH, text_width};
use anyhow::Result;

/// Mean of several paths of the hand.
pub struct MeanPath {
    /// Name in the legend.
    pub name: String,
    /// Colour of the line.
    pub role: Role,
    /// Mean place (x, z) after each step, m.
    pub points_m: Vec<[f64; 2]>,
    /// Root mean square distance of the paths from it, m.
    pub deviations_m: Vec<f64>,
    /// Mean distance from the goal, m.
    pub distances_m: Vec<f64>,
}

/// Picture of mean paths in the plane. The disc of a step has the deviation of the paths as its radius; the fuller its colour, the
/// nearer the object is to its goal. `farthest_m` is the distance of the palest disc.
pub fn mean_paths(title: &str, paths: &[MeanPath], target_m: [f64; 2], farthest_m: f64) -> Result<String> {
    let points = || paths.iter().flat_map(|p| p.points_m.iter()).chain([&target_m]);
    let (x, z) = (axis(points().map(|p| p[0]), 5, "x, m"), axis(points().map(|p| p[1]), 5, "z, m"));
    let mut chart = Chart::new(x, z, 220.0);
    let scale = (chart.x(1.0) - chart.x(0.0)).abs();
    let mut legend = Vec::new();
    for path in paths {
        let places: Vec<[f64; 2]> = path.points_m.iter().map(|p| chart.at(*p)).collect();
        chart.svg.path(&places, path.role.css(), 2.0, false);
        for ((place, deviation), distance) in places.iter().zip(&path.deviations_m).zip(&path.distances_m) {
            let colour = Role::Posterior.tint(1.0 - (distance / farthest_m).min(1.0));
            chart.svg.disc(*place, (scale * deviation).clamp(3.0, 40.0), &colour, 0.75);
        }
        legend.push(Entry::new(&path.name, Shape::Line, path.role));
    }
    let at = chart.at(target_m);
    chart.svg.triangle(at, 8.0, Role::Measured.css());
    legend.push(Entry::new("target", Shape::Triangle, Role::Measured));
    Ok(chart.figure(title, &legend))
}

/// Moments of an episode over each other.
pub struct Timelapse {
    /// Name in the legend.
    pub name: String,
    /// Colour of the last moment.
    pub role: Role,
    /// Line (x, z) of the object in each moment in m, from the hand on.
    pub lines_m: Vec<Vec<[f64; 2]>>,
}

/// Picture of episodes in the plane: the object in each moment, the later the darker, with a dot at the hand.
pub fn timelapses(title: &str, episodes: &[Timelapse], target_m: [f64; 2]) -> Result<String> {
    let points = || episodes.iter().flat_map(|e| e.lines_m.iter().flatten()).chain([&target_m]);
    let (x, z) = (axis(points().map(|p| p[0]), 5, "x, m"), axis(points().map(|p| p[1]), 5, "z, m"));
    let mut chart = Chart::new(x, z, 220.0);
    let mut legend = Vec::new();
    for episode in episodes {
        let last = episode.lines_m.len().saturating_sub(1).max(1) as f64;
        for (i, line) in episode.lines_m.iter().enumerate() {
            let colour = episode.role.tint(0.25 + 0.75 * i as f64 / last);
            let places: Vec<[f64; 2]> = line.iter().map(|p| chart.at(*p)).collect();
            chart.svg.path(&places, &colour, 1.5, false);
            if let Some(hand) = places.first() {
                chart.svg.disc(*hand, 2.5, &colour, 1.0);
            }
        }
        legend.push(Entry::new(&episode.name, Shape::Line, episode.role));
    }
    let at = chart.at(target_m);
    chart.svg.triangle(at, 8.0, Role::Measured.css());
    legend.push(Entry::new("target", Shape::Triangle, Role::Measured));
    Ok(chart.figure(title, &legend))
}

/// Picture of a square table of values, from the ground's colour at zero to full colour at the largest.
pub fn grid(title: &str, names: &[String], values: &[Vec<f64>], decimals: usize) -> String {
    let left = names.iter().map(|n| text_width(n)).fold(0.0, f64::max) + 8.0;
    let cell = (WIDTH - left - 4.0) / names.len().max(1) as f64;
    let height = (0.6 * cell).max(FONT + 8.0);
    let largest = values.iter().flatten().copied().fold(0.0, f64::max);
    let mut svg = Svg::default();
    for (i, (name, row)) in names.iter().zip(values).enumerate() {
        let top = FONT + 8.0 + i as f64 * height;
        let middle = top + 0.5 * height + 0.35 * FONT;
        svg.text([left - 6.0, middle], Anchor::End, Role::Measured.css(), name);
        for (j, value) in row.iter().enumerate() {
            let x = left + j as f64 * cell;
            let share = if largest > 0.0 { value / largest } else { 0.0 };
            svg.rectangle([x, top], [cell - 1.0, height - 1.0], &Role::Posterior.tint(0.6 * share), 1.0);
            svg.text([x + 0.5 * cell, middle], Anchor::Middle, Role::Measured.css(), &plain(*value, decimals));
        }
        let above = [left + (i as f64 + 0.5) * cell, FONT + 2.0];
        // A long name is cut, because the row has it, too.
        let fits = (cell / text_width("m")) as usize;
        svg.text(above, Anchor::Middle, Role::Measured.css(), &name.chars().take(fits).collect::<String>());
    }
    svg.figure(FONT + 12.0 + names.len() as f64 * height, title, &[])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_has_its_values_and_a_path_its_discs() {
        let names = ["U".to_owned(), "own".to_owned()];
        let svg = grid("t", &names, &[vec![0.0, 12.5], vec![12.5, 0.0]], 1);
        assert!(svg.matches("<rect").count() == 4 && svg.contains(">12.5<") && svg.contains(">own<"), "{svg}");
        let path = MeanPath {
            name: "U".into(),
            role: Role::Before,
            points_m: vec![[0.4, 0.4], [0.5, 0.3]],
            deviations_m: vec![0.0, 0.01],
            distances_m: vec![0.2, 0.0],
        };
        let svg = mean_paths("t", &[path], [0.6, 0.2], 0.2).unwrap();
        assert!(
            svg.matches("<circle").count() == 2 && svg.contains(">target<") && svg.contains(&Role::Posterior.tint(0.0)),
            "{svg}"
        );
    }

    #[test]
    fn a_timelapse_has_a_line_and_a_hand_for_each_moment_and_ends_in_its_colour() {
        let line = |x: f64| vec![[x, 0.4], [x + 0.01, 0.3]];
        let episode =
            Timelapse { name: "U".into(), role: Role::Before, lines_m: vec![line(0.4), line(0.5), line(0.6)] };
        let svg = timelapses("t", &[episode], [0.6, 0.2]).unwrap();
        assert!(svg.matches("<circle").count() == 3 && svg.contains(Role::Before.css()), "{svg}");
        assert!(svg.contains(&Role::Before.tint(0.25)), "{svg}");
    }
}
