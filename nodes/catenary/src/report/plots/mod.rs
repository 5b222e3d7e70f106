//! Pictures of the reports.

pub mod corner;
pub mod densities;
pub mod policies;
pub mod replay;
pub mod search;

pub use corner::corner;
pub use densities::{calibration, marginals};

use super::palette::Role;
use super::svg::{Axis, Chart, Entry, Shape};
use super::ticks;
use anyhow::Result;

/// Height of a picture's field.
const HEIGHT: f64 = 190.0;
/// Colours and shapes of curves without a role, in order.
const CURVES: [(Role, Shape); 4] = [
    (Role::Posterior, Shape::Line),
    (Role::Other, Shape::Line),
    (Role::Prior, Shape::Dashes),
    (Role::Posterior, Shape::Dashes),
];
/// Largest number of points drawn of a curve: about one per unit of the picture's width of 380.
const POINTS: usize = 300;

/// Line of a plot.
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points (x, y).
    pub points: Vec<(f64, f64)>,
}

/// Picture of lines over common axes. Policies have the colours of their roles.
pub fn lines(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> Result<String> {
    let all = || series.iter().flat_map(|s| s.points.iter());
    let mut chart = Chart::new(axis(all().map(|p| p.0), 5, x_label), axis(all().map(|p| p.1), 5, y_label), HEIGHT);
    let mut legend = Vec::new();
    for (i, s) in series.iter().enumerate() {
        let (role, shape) = Role::of_policy(&s.name).map_or(CURVES[i % CURVES.len()], |role| (role, Shape::Line));
        let points: Vec<[f64; 2]> = thinned(&s.points).map(|(x, y)| chart.at([*x, *y])).collect();
        chart.svg.path(&points, role.css(), 2.0, shape == Shape::Dashes);
        legend.push(Entry::new(&s.name, shape, role));
    }
    // A single curve is named by the title.
    let legend = if legend.len() > 1 { legend } else { Vec::new() };
    Ok(chart.figure(title, &legend))
}

/// Path of the end effector in an episode.
pub struct Path {
    /// Name in the legend.
    pub name: String,
    /// Position (x, z) at each observation, m.
    pub points_m: Vec<[f64; 2]>,
    /// Reward after each step, one fewer than the observations.
    pub rewards: Vec<f64>,
}

/// Picture of paths of the end effector in the plane. The size of a dot is the reward of its step.
pub fn paths(paths: &[Path], target_m: [f64; 2]) -> Result<String> {
    let points = || paths.iter().flat_map(|p| p.points_m.iter()).chain([&target_m]);
    let (x, z) = (axis(points().map(|p| p[0]), 5, "x, m"), axis(points().map(|p| p[1]), 5, "z, m"));
    let mut chart = Chart::new(x, z, 240.0);
    let mut legend = Vec::new();
    for (i, Path { name, points_m, rewards }) in paths.iter().enumerate() {
        let role = Role::of_policy(name).unwrap_or(CURVES[i % CURVES.len()].0);
        let places: Vec<[f64; 2]> = points_m.iter().map(|p| chart.at(*p)).collect();
        chart.svg.path(&places, role.css(), 1.5, false);
        for (place, reward) in places.iter().skip(1).zip(rewards) {
            chart.svg.disc(*place, 2.0 + 6.0 * reward.clamp(0.0, 1.0), role.css(), 0.5);
        }
        legend.push(Entry::new(name, Shape::Line, role));
    }
    let at = chart.at(target_m);
    chart.svg.triangle(at, 8.0, Role::Measured.css());
    legend.push(Entry::new("target", Shape::Triangle, Role::Measured));
    Ok(chart.figure("Path of the hand; larger dots: larger rewards", &legend))
}

/// Axis that contains all values, with a margin.
fn axis(values: impl Iterator<Item = f64>, most: usize, label: &str) -> Axis {
    let (low, high) = range(values);
    Axis { low, high, ticks: ticks::linear(low, high, most), label: label.to_owned() }
}

/// Smallest and largest value with a margin. The range has unit length around a single value, and is 0 to 1 without
/// values.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let margin = if high > low { 0.06 * (high - low) } else { 0.5 };
    (low - margin, high + margin)
}

/// Every n-th value and the last one, so that about [`POINTS`] remain.
fn thinned<T>(values: &[T]) -> impl Iterator<Item = &T> {
    let every = values.len().div_ceil(POINTS).max(1);
    let last = values.len().saturating_sub(1);
    values.iter().enumerate().filter(move |(i, _)| i % every == 0 || *i == last).map(|(_, v)| v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_have_the_same_colours_on_every_picture() {
        let series = ["pi1", "pi0"].map(|name| Series { name: name.into(), points: vec![(0.0, 1.0), (1.0, 2.0)] });
        let svg = lines("t", "x", "y", &series).unwrap();
        let path = |name: &str| Path { name: name.into(), points_m: vec![[0.0, 0.1], [0.2, 0.1]], rewards: vec![0.5] };
        let plane = paths(&[path("pi1")], [0.5, 0.1]).unwrap();
        assert!(svg.contains(Role::Before.css()) && svg.contains(Role::After.css()) && svg.contains(">pi0<"));
        assert!(plane.contains(Role::After.css()) && !plane.contains(Role::Before.css()) && plane.contains(">target<"));
        assert!(lines("empty", "x", "y", &[]).is_ok());
    }

    #[test]
    fn long_curves_are_thinned_and_keep_their_end() {
        let all: Vec<usize> = (0..10_001).collect();
        let kept: Vec<usize> = thinned(&all).copied().collect();
        assert!(kept.len() <= POINTS + 1 && kept[0] == 0 && kept.last() == Some(&10_000), "{}", kept.len());
        assert_eq!(thinned(&all[..7]).count(), 7);
    }
}
