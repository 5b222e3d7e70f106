//! Pictures of posteriors and of their calibration.

use super::{HEIGHT, range, thinned};
use crate::report::number::plain;
use crate::report::palette::{DENSITY, Role, opacity};
use crate::report::quantity::Quantity;
use crate::report::svg::{Axis, Chart, Entry, Shape};
use crate::report::ticks;
use anyhow::{Context, Result};
use base64::Engine;
use catenary_core::statistics::{p_clause, uniformity_band};
use catenary_core::{Parameter, Posterior};
use std::io::Cursor;

/// Cells of a density along each axis.
pub(super) const CELLS: usize = 80;
/// Draws for a density without closed form.
pub(super) const DRAWS: usize = 40_000;
/// Draws for the window around a posterior.
const WINDOW_DRAWS: usize = 2_000;

/// Ratio of posterior to prior density for each parameter, with the truth if known. The prior has the constant ratio 1.
pub fn marginals(posterior: &Posterior, truth: Option<&[f64]>) -> Result<Vec<String>> {
    const BARS: usize = 60;
    // Bars need fewer draws than the cells of a picture.
    let draws = posterior.sample(DRAWS / 4, 0)?;
    let one = |(i, parameter): (usize, &Parameter)| {
        let mut counts = [0.0; BARS];
        for theta in &draws {
            let u = parameter.prior.to_unit(theta[i]).clamp(0.0, 1.0);
            counts[((u * BARS as f64) as usize).min(BARS - 1)] += BARS as f64 / draws.len() as f64;
        }
        let most = counts.iter().copied().fold(1.0, f64::max) * 1.1;
        let y = Axis { low: 0.0, high: most, ticks: ticks::linear(0.0, most, 4), label: "times the prior".into() };
        let mut chart = Chart::new(prior_axis(parameter, (0.0, 1.0)), y, 130.0);
        let corners = |c: usize| [(c as f64 / BARS as f64), ((c + 1) as f64 / BARS as f64)].map(|u| [u, counts[c]]);
        let outline = [[0.0, 0.0]].into_iter().chain((0..BARS).flat_map(corners)).chain([[1.0, 0.0]]);
        let outline: Vec<[f64; 2]> = outline.map(|p| chart.at(p)).collect();
        chart.svg.area(&outline, Role::Posterior.css(), 0.7);
        let (from, to) = (chart.at([0.0, 1.0]), chart.at([1.0, 1.0]));
        chart.svg.path(&[from, to], Role::Prior.css(), 2.0, true);
        let mut legend = vec![
            Entry::new("posterior", Shape::Area, Role::Posterior),
            Entry::new("prior", Shape::Dashes, Role::Prior),
        ];
        if let Some(theta) = truth {
            let u = parameter.prior.to_unit(theta[i]);
            let at = chart.at([u, 0.5 * most]);
            chart.svg.cross(at, 7.0, Role::Truth.css());
            legend.push(Entry::new("hidden truth", Shape::Cross, Role::Truth));
        }
        chart.figure(&Quantity::of(&parameter.name).capital(), &legend)
    };
    Ok(posterior.parameters.parameters().iter().enumerate().map(one).collect())
}

/// Cumulative share of hidden values over their rank; the diagonal means exact calibration. `values` must be sorted.
/// For exact posteriors, the band contains the whole curve in 95 of 100 cases.
pub fn calibration(title: &str, values: &[f64]) -> String {
    let share = |label: &str| Axis { low: 0.0, high: 1.0, ticks: ticks::linear(0.0, 1.0, 5), label: label.to_owned() };
    let mut chart = Chart::new(share("share of the posterior's draws"), share("share of hidden values"), HEIGHT);
    let count = values.len().max(1) as f64;
    let half = uniformity_band(count);
    let edge = |sign: f64| (0..=50).map(move |i| (f64::from(i) / 50.0, sign));
    let band: Vec<[f64; 2]> =
        edge(-1.0).chain(edge(1.0).rev()).map(|(v, sign)| chart.at([v, (v + sign * half).clamp(0.0, 1.0)])).collect();
    chart.svg.area(&band, Role::Prior.css(), 0.25);
    let diagonal = [chart.at([0.0, 0.0]), chart.at([1.0, 1.0])];
    chart.svg.path(&diagonal, Role::Prior.css(), 1.5, true);
    let steps: Vec<(f64, f64)> = values.iter().enumerate().map(|(i, v)| (*v, (i + 1) as f64 / count)).collect();
    let curve: Vec<[f64; 2]> = thinned(&steps).map(|(x, y)| chart.at([*x, *y])).collect();
    chart.svg.path(&curve, Role::Posterior.css(), 2.0, false);
    let legend = [
        Entry::new("these posteriors", Shape::Line, Role::Posterior),
        Entry::new("exact ones", Shape::Dashes, Role::Prior),
        Entry::new("chance", Shape::Area, Role::Prior),
    ];
    chart.figure(title, &legend)
}

/// Histogram of the null data sets' `values`, with a line at the measured value.
pub fn null_histogram(title: &str, x_label: &str, values: &[f64], measured: f64, p: f64) -> String {
    const BARS: usize = 24;
    let (low, high) = range(values.iter().copied().chain([measured]));
    let width = (high - low) / BARS as f64;
    let mut counts = [0usize; BARS];
    for v in values {
        counts[(((v - low) / width) as usize).min(BARS - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64 * 1.1;
    let x = Axis { low, high, ticks: ticks::linear(low, high, 4), label: x_label.to_owned() };
    let y_ticks = ticks::linear(0.0, most, 4).into_iter().filter(|(v, _)| v.fract() == 0.0);
    let y_ticks = y_ticks.map(|(v, _)| (v, plain(v, 0))).collect();
    let mut chart = Chart::new(x, Axis { low: 0.0, high: most, ticks: y_ticks, label: "data sets".into() }, 110.0);
    for (i, n) in counts.iter().enumerate().filter(|(_, n)| **n > 0) {
        let (from, to) = (chart.at([low + width * i as f64, *n as f64]), chart.at([low + width * (i + 1) as f64, 0.0]));
        chart.svg.rectangle(from, [to[0] - from[0], to[1] - from[1]], Role::Noise.css(), 1.0);
    }
    let line = [chart.at([measured, 0.0]), chart.at([measured, most])];
    chart.svg.path(&line, Role::Measured.css(), 3.0, false);
    let legend = [
        Entry::new("simulated without a gap", Shape::Area, Role::Noise),
        Entry::new(format!("measured, {}", p_clause(p, values.len())), Shape::Line, Role::Measured),
    ];
    chart.figure(title, &legend)
}

/// Axis of a parameter between two unit coordinates.
fn prior_axis(parameter: &Parameter, (low, high): (f64, f64)) -> Axis {
    let quantity = Quantity::of(&parameter.name);
    let (from, to) = (parameter.prior.from_unit(low), parameter.prior.from_unit(high));
    let scale = quantity.scale(from.abs().max(to.abs()));
    let ticks = ticks::of_prior(&parameter.prior, (low, high), scale.factor, 6);
    Axis { low, high, ticks, label: quantity.axis(&scale) }
}

/// Smallest and largest unit coordinate on an axis.
pub(super) type Window = (f64, f64);

/// Coordinate at a distance of `cells` cells from the low end of an axis of [`CELLS`].
fn along((low, high): Window, cells: f64) -> f64 {
    low + (high - low) * cells / CELLS as f64
}

/// Window of each axis: it holds the domains, the truth and the draws without the outermost 0.5 % on each side.
pub(super) fn windows(posterior: &Posterior, domains: &[Vec<f64>], truth: Option<&[f64]>) -> Result<Vec<Window>> {
    let unit = |theta: &[f64]| posterior.parameters.to_unit(theta);
    let draws: Vec<Vec<f64>> = posterior.sample(WINDOW_DRAWS, 0)?.iter().map(|t| unit(t)).collect();
    let marks: Vec<Vec<f64>> = domains.iter().map(Vec::as_slice).chain(truth).map(unit).collect();
    let of = |axis: usize| {
        let mut values: Vec<f64> = draws.iter().map(|u| u[axis]).collect();
        values.sort_by(f64::total_cmp);
        let inner = values[WINDOW_DRAWS / 200..WINDOW_DRAWS - WINDOW_DRAWS / 200].iter().copied();
        let (low, high) = range(inner.chain(marks.iter().map(|u| u[axis])));
        (low.max(0.0), high.min(1.0))
    };
    Ok((0..posterior.parameters.dimension()).map(of).collect())
}

/// Marginal density over two coordinates on a grid, not normalised. Row-major, with the second axis as rows.
pub(super) fn marginal_density(
    posterior: &Posterior,
    [i, j]: [usize; 2],
    [along_i, along_j]: [Window; 2],
) -> Result<Vec<f64>> {
    // The mixture itself is the marginal: its density needs no draws.
    if posterior.parameters.dimension() == 2 {
        let at = |index: usize| {
            let mut u = [0.0; 2];
            let centre = |window: (f64, f64), cell: usize| along(window, cell as f64 + 0.5);
            (u[i], u[j]) = (centre(along_i, index % CELLS), centre(along_j, index / CELLS));
            posterior.mixture.log_density(&u).exp()
        };
        return Ok((0..CELLS * CELLS).map(at).collect());
    }
    let mut counts = vec![0.0; CELLS * CELLS];
    for theta in posterior.sample(DRAWS, 0)? {
        let u = posterior.parameters.to_unit(&theta);
        let cell = |(low, high): (f64, f64), v: f64| {
            let share = (v - low) / (high - low);
            (0.0..1.0).contains(&share).then_some((share * CELLS as f64) as usize)
        };
        if let (Some(column), Some(row)) = (cell(along_i, u[i]), cell(along_j, u[j])) {
            counts[row * CELLS + column] += 1.0;
        }
    }
    Ok(smoothed(&counts))
}

/// Counts smoothed by a binomial kernel of five cells along each axis, to hide the grain of single draws.
fn smoothed(counts: &[f64]) -> Vec<f64> {
    const KERNEL: [f64; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];
    let pass = |values: &[f64], step: usize| -> Vec<f64> {
        let at = |index: usize| {
            let place = (index / step) % CELLS;
            let part = |(k, weight): (usize, &f64)| {
                let inside = (place + k).checked_sub(2).filter(|p| *p < CELLS)?;
                Some(weight * values[index + inside * step - place * step])
            };
            KERNEL.iter().enumerate().filter_map(part).sum()
        };
        (0..values.len()).map(at).collect()
    };
    pass(&pass(counts, 1), CELLS)
}

/// PNG picture of all cells in base 64, with the first row at the bottom.
pub(super) fn raster(density: &[f64]) -> Result<String> {
    let peak = density.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let side = CELLS as u32;
    // Transparent where there is no density, so that the ground of either scheme shows.
    let picture = image::RgbaImage::from_fn(side, side, |x, y| {
        let cell = (side - 1 - y) as usize * CELLS + x as usize;
        let [r, g, b] = DENSITY;
        image::Rgba([r, g, b, opacity(density[cell] / peak)])
    });
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).context("cannot draw a density")?;
    Ok(base64::engine::general_purpose::STANDARD.encode(png.into_inner()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{ParameterSpace, Prior};

    fn prior(names: &[&str]) -> Posterior {
        let p = |name: &&str| Parameter { name: (*name).into(), prior: Prior::LogUniform { low: 1.0, high: 10.0 } };
        Posterior::prior(ParameterSpace::new(names.iter().map(p).collect()).unwrap())
    }

    #[test]
    fn marginals_show_posterior_and_prior() {
        let all = marginals(&prior(&["length_m", "tip_mass_kg"]), None).unwrap();
        assert!(all.len() == 2 && all.iter().all(|svg| svg.contains(Role::Prior.css()) && svg.contains(">posterior<")));
        assert!(!all[0].contains("hidden truth"));
    }

    #[test]
    fn smoothing_keeps_the_total_up_to_the_kernels_sum() {
        let mut counts = vec![0.0; CELLS * CELLS];
        counts[40 * CELLS + 40] = 1.0;
        let smooth = smoothed(&counts);
        assert!((smooth.iter().sum::<f64>() - 256.0).abs() < 1e-9);
        assert!(smooth[40 * CELLS + 40] == 36.0 && smooth[41 * CELLS + 42] == 4.0);
    }

    #[test]
    fn a_histogram_says_how_improbable_the_measured_value_is() {
        let svg = null_histogram("t", "x", &[1.0, 2.0, 2.1, 5.0], 9.0, 0.2);
        assert!(svg.contains("measured, p &lt;= 0.2 (4 null data sets)"), "{svg}");
        assert!(calibration("length", &[0.1, 0.5]).contains(">exact ones<") && calibration("t", &[]).contains("<path"));
    }
}
