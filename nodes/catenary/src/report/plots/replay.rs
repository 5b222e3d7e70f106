//! Recording and fits over one another, moment by moment: a slider chooses the moment. Without scripts a few moments stand over one another.

use super::axis;
use crate::report::palette::Role;
use crate::report::svg::{Chart, Entry, Shape};
use crate::report::ticks;
use std::fmt::Write;

/// Largest number of moments of a slider.
const MOMENTS: usize = 60;
/// Moments of the picture without scripts.
const STILLS: usize = 5;

/// Keypoints of an object over time, from the hand on.
pub type Keypoints = Vec<[[f64; 2]; 4]>;

/// Keypoints that a model gives.
pub struct Fit {
    /// Name in the legend.
    pub name: String,
    /// Colour.
    pub role: Role,
    /// Keypoints at the times of the recording.
    pub points: Keypoints,
}

/// Labels of the two axes, and whether the second one points down, as in a picture.
pub struct Plane {
    /// Label of the first axis.
    pub x: &'static str,
    /// Label of the second axis.
    pub y: &'static str,
    /// True if the second coordinate grows downwards; the axis has its negative.
    pub is_down: bool,
}

/// Figure of a recording and its fits with a slider. It begins with the moment of the largest distance between the recording and the last fit.
/// Frames that a fit lacks show the recording alone.
pub fn replay(title: &str, times_s: &[f64], measured: &Keypoints, fits: &[Fit], plane: &Plane) -> String {
    let sign = if plane.is_down { -1.0 } else { 1.0 };
    let place = |p: &[f64; 2]| [p[0], sign * p[1]];
    let all = || measured.iter().chain(fits.iter().flat_map(|f| &f.points)).flatten().map(place);
    let (mut x, mut y) = (axis(all().map(|p| p[0]), 5, plane.x), axis(all().map(|p| p[1]), 5, plane.y));
    let height = 240.0;
    // Equal scales on both axes: shapes must not be distorted.
    let field = Chart::new(x.clone(), y.clone(), height).field().1;
    let units = ((x.high - x.low) / field[0]).max((y.high - y.low) / field[1]);
    for (axis, length) in [(&mut x, field[0]), (&mut y, field[1])] {
        let more = 0.5 * (units * length - (axis.high - axis.low));
        (axis.low, axis.high) = (axis.low - more, axis.high + more);
        axis.ticks = ticks::linear(axis.low, axis.high, 5);
    }
    let mut chart = Chart::new(x, y, height);
    let count = measured.len().min(times_s.len());
    let every = count.div_ceil(MOMENTS).max(1);
    let moments: Vec<usize> = (0..count).step_by(every).collect();
    let still = moments.len().div_ceil(STILLS).max(1);
    for (k, i) in moments.iter().enumerate() {
        let class = if k % still == 0 || k + 1 == moments.len() { " class=\"still\"" } else { "" };
        let line = |points: &[[f64; 2]; 4]| -> Vec<[f64; 2]> {
            points.iter().filter(|p| p.iter().all(|v| v.is_finite())).map(|p| chart.at(place(p))).collect()
        };
        let lines: Vec<(Vec<[f64; 2]>, Role)> =
            fits.iter().filter_map(|f| Some((line(f.points.get(*i)?), f.role))).collect();
        let seen = line(&measured[*i]);
        let svg = &mut chart.svg;
        svg.open(&format!("{class} data-t=\"{:.2}\"", times_s[*i]));
        for (points, role) in &lines {
            svg.path(points, role.css(), 2.5, false);
            points.iter().for_each(|p| svg.disc(*p, 3.0, role.css(), 1.0));
        }
        svg.path(&seen, Role::Measured.css(), 1.2, true);
        seen.iter().for_each(|p| svg.ring(*p, 4.0, Role::Measured.css()));
        svg.close();
    }
    let mut legend = vec![Entry::new("measured", Shape::Rings, Role::Measured)];
    legend.extend(fits.iter().map(|f| Entry::new(&f.name, Shape::Line, f.role)));
    let first = moments.iter().position(|i| *i >= worst(measured, fits.last(), count)).unwrap_or(0);
    let figure = chart.figure(title, &legend);
    let mut controls = String::new();
    let _ = write!(
        controls,
        "<div class=\"controls\"><button type=\"button\">play</button><input type=\"range\" min=\"0\" max=\"{}\" value=\"{first}\" \
         aria-label=\"moment\"><output></output></div>",
        moments.len().saturating_sub(1)
    );
    figure.replacen("<figure>", "<figure class=\"replay\">", 1).replacen("</svg>", &format!("</svg>{controls}"), 1)
}

/// Frame with the largest distance between recording and fit; 0 without a fit.
fn worst(measured: &Keypoints, fit: Option<&Fit>, count: usize) -> usize {
    let Some(fit) = fit else { return 0 };
    let off = |i: usize| -> f64 {
        let pairs = measured[i].iter().zip(fit.points.get(i).into_iter().flatten());
        let squares = pairs.map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2));
        squares.filter(|v| v.is_finite()).sum()
    };
    (0..count).max_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replay_has_a_group_for_each_moment_and_begins_with_the_worst() {
        let line = |x: f64| [0.0, 0.1, 0.2, 0.3].map(|z| [x, z]);
        let times: Vec<f64> = (0..10).map(|i| 0.1 * f64::from(i)).collect();
        let measured: Keypoints = times.iter().map(|t| line(*t)).collect();
        let mut points = measured.clone();
        points[7] = line(2.0);
        // A fit that ends early.
        points.truncate(9);
        let fit = Fit { name: "model".into(), role: Role::Posterior, points };
        let plane = Plane { x: "x, m", y: "z, m", is_down: false };
        let svg = replay("t", &times, &measured, &[fit], &plane);
        assert_eq!(svg.matches("data-t=").count(), 10, "{svg}");
        assert!(svg.contains("class=\"replay\"") && svg.contains("max=\"9\" value=\"7\""), "{svg}");
        // Without scripts, some moments are shown.
        assert!((3..=6).contains(&svg.matches("class=\"still\"").count()), "{svg}");
        assert!(replay("t", &[], &Vec::new(), &[], &plane).contains("<svg"));
    }
}
