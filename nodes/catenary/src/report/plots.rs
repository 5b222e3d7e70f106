//! The pictures of the report, as SVG text.

pub mod search;

use crate::figures::figures;
use anyhow::{Result, anyhow};
use catenary_core::Posterior;
use plotters::prelude::*;

const SIZE: (u32, u32) = (720, 420);
const PALETTE: [RGBColor; 7] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 160, 44),
    RGBColor(148, 103, 189),
    RGBColor(255, 127, 14),
    RGBColor(140, 86, 75),
    RGBColor(90, 90, 90),
];
/// Cells of a heatmap along each axis.
const CELLS: usize = 80;

/// One line of a plot.
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Its points.
    pub points: Vec<(f64, f64)>,
}

/// Lines over a common axis.
pub fn lines(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> Result<String> {
    let all = || series.iter().flat_map(|s| s.points.iter());
    let (x0, x1) = range(all().map(|p| p.0));
    let (y0, y1) = range(all().map(|p| p.1));
    draw(|root| {
        let mut chart = ChartBuilder::on(root)
            .caption(title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(x0..x1, y0..y1)
            .map_err(plot_error)?;
        chart.configure_mesh().x_desc(x_label).y_desc(y_label).light_line_style(WHITE).draw().map_err(plot_error)?;
        for (i, s) in series.iter().enumerate() {
            let colour = PALETTE[i % PALETTE.len()];
            chart
                .draw_series(LineSeries::new(s.points.iter().copied(), colour.stroke_width(2)))
                .map_err(plot_error)?
                .label(&s.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2)));
        }
        if series.len() < 2 {
            return Ok(());
        }
        let mut legend = chart.configure_series_labels();
        legend.position(SeriesLabelPosition::LowerRight);
        legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3)).draw().map_err(plot_error)
    })
}

/// What a heatmap shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// The whole support of the prior.
    Prior,
    /// Where the posterior is.
    Posterior,
}

/// Density of a posterior over two of its parameters, the low-variance domain samples (theta) and, where it is known, the
/// truth. Axes are the parameters' units, spaced as the prior spreads them: logarithmic where it is uniform in the logarithm.
pub fn heatmap(
    posterior: &Posterior,
    axes: [usize; 2],
    extent: Extent,
    domains: &[Vec<f64>],
    truth: Option<&[f64]>,
) -> Result<String> {
    let [i, j] = axes;
    let window = window(posterior, axes, extent, domains, truth)?;
    let [(i0, i1), (j0, j1)] = window;
    let parameters = posterior.parameters.parameters();
    let (pi, pj) = (&parameters[i], &parameters[j]);
    let density = marginal_density(posterior, axes, window)?;
    let peak = density.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    draw(|root| {
        let mut chart = ChartBuilder::on(root)
            .caption("posterior density, domain samples (circles), truth (cross)", ("sans-serif", 16))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(70)
            .build_cartesian_2d(i0..i1, j0..j1)
            .map_err(plot_error)?;
        let cell = |index: usize| {
            let (column, row) = (index % CELLS, index / CELLS);
            let (x, z) = (|c: usize| along((i0, i1), c as f64), |r: usize| along((j0, j1), r as f64));
            Rectangle::new([(x(column), z(row)), (x(column + 1), z(row + 1))], shade(density[index] / peak).filled())
        };
        chart.draw_series((0..CELLS * CELLS).map(cell)).map_err(plot_error)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc(&pi.name)
            .y_desc(&pj.name)
            .x_label_formatter(&|u| figures(pi.prior.from_unit(*u)))
            .y_label_formatter(&|u| figures(pj.prior.from_unit(*u)))
            .draw()
            .map_err(plot_error)?;
        let place = |theta: &[f64]| (pi.prior.to_unit(theta[i]), pj.prior.to_unit(theta[j]));
        let circles = domains.iter().map(|t| Circle::new(place(t), 5, WHITE.stroke_width(2)));
        chart.draw_series(circles).map_err(plot_error)?;
        if let Some(theta) = truth {
            chart.draw_series([Cross::new(place(theta), 8, RED.stroke_width(3))]).map_err(plot_error)?;
        }
        Ok(())
    })
}

/// The end effector's path in an episode.
pub struct Path {
    /// Its name in the legend.
    pub name: String,
    /// (x, z) in m at each observation.
    pub points_m: Vec<[f64; 2]>,
    /// Reward after each step: one fewer.
    pub rewards: Vec<f64>,
}

/// Paths of the end effector in the plane, each with the reward of every step as the size of its dots.
pub fn paths(paths: &[Path], target_m: [f64; 2]) -> Result<String> {
    let points = || paths.iter().flat_map(|p| p.points_m.iter()).chain([&target_m]);
    let (x0, x1) = range(points().map(|p| p[0]));
    let (z0, z1) = range(points().map(|p| p[1]));
    draw(|root| {
        let mut chart = ChartBuilder::on(root)
            .caption("end effector, dot size: reward after the step", ("sans-serif", 16))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(x0..x1, z0..z1)
            .map_err(plot_error)?;
        chart.configure_mesh().x_desc("x, m").y_desc("z, m").light_line_style(WHITE).draw().map_err(plot_error)?;
        for (i, Path { name, points_m, rewards }) in paths.iter().enumerate() {
            let colour = PALETTE[i % PALETTE.len()];
            chart
                .draw_series(LineSeries::new(points_m.iter().map(|p| (p[0], p[1])), colour.stroke_width(1)))
                .map_err(plot_error)?
                .label(name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2)));
            let dots = points_m.iter().skip(1).zip(rewards).map(|(p, r)| {
                let size = (2.0 + 8.0 * r.max(0.0)) as i32;
                Circle::new((p[0], p[1]), size, colour.mix(0.5).filled())
            });
            chart.draw_series(dots).map_err(plot_error)?;
        }
        let mark = TriangleMarker::new((target_m[0], target_m[1]), 10, BLACK.filled());
        let drawn = chart.draw_series([mark]).map_err(plot_error)?;
        drawn.label("target").legend(|(x, y)| TriangleMarker::new((x + 9, y), 5, BLACK.filled()));
        let mut legend = chart.configure_series_labels();
        legend.position(SeriesLabelPosition::LowerLeft);
        legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3)).draw().map_err(plot_error)
    })
}

/// Least and greatest unit coordinate on each axis.
type Window = [(f64, f64); 2];

/// The coordinate `cells` cells from the low end of an axis of [`CELLS`].
fn along((low, high): (f64, f64), cells: f64) -> f64 {
    low + (high - low) * cells / CELLS as f64
}

/// What an extent means: for the posterior, its draws but for the outermost 0.5 % on each side, the domains and the truth.
fn window(
    posterior: &Posterior,
    axes: [usize; 2],
    extent: Extent,
    domains: &[Vec<f64>],
    truth: Option<&[f64]>,
) -> Result<Window> {
    const DRAWS: usize = 2_000;
    if extent == Extent::Prior {
        return Ok([(0.0, 1.0); 2]);
    }
    let unit = |theta: &[f64]| posterior.parameters.to_unit(theta);
    let draws: Vec<Vec<f64>> = posterior.sample(DRAWS, 0)?.iter().map(|t| unit(t)).collect();
    let marks: Vec<Vec<f64>> = domains.iter().map(Vec::as_slice).chain(truth).map(unit).collect();
    Ok(axes.map(|axis| {
        let mut values: Vec<f64> = draws.iter().map(|u| u[axis]).collect();
        values.sort_by(f64::total_cmp);
        let inner = values[DRAWS / 200..DRAWS - DRAWS / 200].iter().copied();
        let (low, high) = range(inner.chain(marks.iter().map(|u| u[axis])));
        (low.max(0.0), high.min(1.0))
    }))
}

/// Marginal density over two coordinates on a grid of cells, row-major with the second axis as rows, not normalised.
fn marginal_density(posterior: &Posterior, [i, j]: [usize; 2], [along_i, along_j]: Window) -> Result<Vec<f64>> {
    const DRAWS: usize = 40_000;
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
    Ok(counts)
}

/// A colour from dark blue over green to yellow for 0 to 1.
fn shade(value: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 5] =
        [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
    let scaled = value.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let k = (scaled as usize).min(STOPS.len() - 2);
    let mix = |c: usize| (STOPS[k][c] + (scaled - k as f64) * (STOPS[k + 1][c] - STOPS[k][c])) as u8;
    RGBColor(mix(0), mix(1), mix(2))
}

/// Least and greatest value with a margin; a unit range around a single value or where there is none.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let margin = if high > low { 0.06 * (high - low) } else { 0.5 };
    (low - margin, high + margin)
}

type Root<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw(paint: impl FnOnce(&Root<'_>) -> Result<()>) -> Result<String> {
    draw_sized(SIZE, paint)
}

fn draw_sized(size: (u32, u32), paint: impl FnOnce(&Root<'_>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE).map_err(plot_error)?;
        paint(&root)?;
        root.present().map_err(plot_error)?;
    }
    Ok(svg)
}

fn plot_error<E: std::fmt::Display>(e: E) -> anyhow::Error {
    anyhow!("cannot draw: {e}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, ParameterSpace, Prior};

    #[test]
    fn pictures_show_every_series_sample_and_the_truth() {
        let p = |name: &str| Parameter { name: name.into(), prior: Prior::LogUniform { low: 1.0, high: 10.0 } };
        let posterior = Posterior::prior(ParameterSpace::new(vec![p("a"), p("b")]).unwrap());
        for extent in [Extent::Prior, Extent::Posterior] {
            let svg =
                heatmap(&posterior, [0, 1], extent, &[vec![2.0, 3.0], vec![4.0, 5.0]], Some(&[2.0, 2.0])).unwrap();
            assert_eq!(svg.matches("<circle").count(), 2);
        }
        let svg = heatmap(&posterior, [0, 1], Extent::Prior, &[], None).unwrap();
        assert!(svg.contains(">a<") || svg.contains("a\n"), "axis names are missing");
        let series = [Series { name: "one".into(), points: vec![(0.0, 1.0), (1.0, 2.0)] }];
        assert!(lines("t", "x", "y", &series).unwrap().contains("one"));
        assert!(lines("empty", "x", "y", &[]).is_ok());
    }
}
