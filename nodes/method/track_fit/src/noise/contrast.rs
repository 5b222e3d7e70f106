//! Powers of divided differences of a series, and their variances for white noise.

use super::series::Series;
use nalgebra::SMatrix;

/// Square of a two-dimensional standard normal vector: its median, 2 ln 2.
const MEDIAN_SQUARE: f64 = 1.386_294;
/// Square in variances beyond which a difference is an outlier: white noise has one in 20 000.
const OUTLIER: f64 = 20.0;
/// Effective number of differences below which their shapes tell nothing; the coordinates then count as those of a curve with
/// two coefficients, of eight.
const FEW: f64 = 3.0;
const FEW_INDEPENDENT: f64 = 0.25;

/// Powers of the differences of a coordinate.
pub struct Powers {
    /// Mean square of differences of successive frames.
    pub each: f64,
    /// Mean square of differences of every second frame.
    pub second: f64,
    /// Variances of both means, and their covariance, for independent coordinates with unit variance, halved.
    pub squares: [f64; 3],
    /// Share of the coordinates that err independently.
    pub independent: f64,
}

/// Divided difference of a few frames, with weights of unit norm.
struct Window {
    /// Index of its first frame.
    first: usize,
    /// Distance between its frames.
    stride: usize,
    weights: Vec<f64>,
    /// Differences of each keypoint; none where a place repeats, or for outliers.
    values: [Option<[f64; 2]>; 4],
}

/// Powers of the differences of `order`; none without differences of every second frame.
pub fn powers(series: &[Series], order: usize) -> Option<Powers> {
    let of = |stride: usize| -> Vec<Vec<Window>> {
        let mut all: Vec<Vec<Window>> = series.iter().map(|s| windows(s, order, stride)).collect();
        drop_outliers(&mut all);
        all
    };
    let (each, second) = (of(1), of(2));
    let (power, count) = mean_square(&each)?;
    let (second_power, second_count) = mean_square(&second)?;
    let sum = |a: &[Vec<Window>], b: &[Vec<Window>]| -> f64 { a.iter().zip(b).map(|(a, b)| overlap(a, b)).sum() };
    let squares = [
        sum(&each, &each) / (count * count),
        sum(&second, &second) / (second_count * second_count),
        sum(&each, &second) / (count * second_count),
    ];
    let independent = independent(&each, 1.0 / squares[0]);
    Some(Powers { each: power, second: second_power, squares, independent })
}

fn windows(series: &Series, order: usize, stride: usize) -> Vec<Window> {
    let span = order * stride;
    let frames = |first: usize| (0..=order).map(move |j| first + j * stride);
    let window = |first: usize| {
        let times: Vec<f64> = frames(first).map(|i| series.times_s[i]).collect();
        let weights = divided_difference(&times)?;
        let values = std::array::from_fn(|k| {
            // The first frame of the window may repeat one before it.
            let is_fresh = (first + 1..=first + span).all(|i| series.fresh[i][k]);
            let sum = |axis: usize| frames(first).zip(&weights).map(|(i, w)| w * series.values[i][k][axis]).sum();
            is_fresh.then(|| [sum(0), sum(1)])
        });
        Some(Window { first, stride, weights, values })
    };
    (0..series.times_s.len().saturating_sub(span)).filter_map(window).collect()
}

/// Weights of the divided difference at `times`, scaled to unit norm; none for equal times.
fn divided_difference(times: &[f64]) -> Option<Vec<f64>> {
    let span = times[times.len() - 1] - times[0];
    let product =
        |j: usize| -> f64 { (0..times.len()).filter(|m| *m != j).map(|m| (times[j] - times[m]) / span).product() };
    let raw: Vec<f64> = (0..times.len()).map(|j| 1.0 / product(j)).collect();
    let norm = raw.iter().map(|w| w * w).sum::<f64>().sqrt();
    norm.is_finite().then(|| raw.into_iter().map(|w| w / norm).collect())
}

fn square(value: [f64; 2]) -> f64 {
    value[0] * value[0] + value[1] * value[1]
}

/// Leaves out the differences far beyond the median one of their keypoint: an impact, or a keypoint that was mistaken.
fn drop_outliers(all: &mut [Vec<Window>]) {
    for k in 0..4 {
        let mut squares: Vec<f64> = all.iter().flatten().filter_map(|w| w.values[k]).map(square).collect();
        let most = OUTLIER * catenary_core::statistics::median(&mut squares) / MEDIAN_SQUARE;
        for window in all.iter_mut().flatten() {
            window.values[k] = window.values[k].filter(|v| square(*v) <= most);
        }
    }
}

/// Mean square of a coordinate's differences, and their number; none without any.
fn mean_square(all: &[Vec<Window>]) -> Option<(f64, f64)> {
    let values: Vec<[f64; 2]> = all.iter().flatten().flat_map(|w| w.values.into_iter().flatten()).collect();
    let count = 2.0 * values.len() as f64;
    (count > 0.0).then(|| (values.into_iter().map(square).sum::<f64>() / count, count))
}

/// Sum of the squared correlations between the differences of `a` and of `b`, coordinate by coordinate.
fn overlap(a: &[Window], b: &[Window]) -> f64 {
    let mut sum = 0.0;
    for one in a {
        let end = |w: &Window| w.first + w.stride * (w.weights.len() - 1);
        let from = b.partition_point(|w| end(w) < one.first);
        for other in b[from..].iter().take_while(|w| w.first <= end(one)) {
            let both = (0..4).filter(|k| one.values[*k].is_some() && other.values[*k].is_some()).count();
            sum += 2.0 * both as f64 * correlation(one, other).powi(2);
        }
    }
    sum
}

/// Correlation between two differences of white noise.
fn correlation(one: &Window, other: &Window) -> f64 {
    let weight = |of: &Window, frame: usize| {
        let at = frame.checked_sub(of.first).filter(|d| d % of.stride == 0)?;
        of.weights.get(at / of.stride).copied()
    };
    let frames = (0..one.weights.len()).map(|j| one.first + j * one.stride);
    frames.zip(&one.weights).filter_map(|(i, w)| Some(w * weight(other, i)?)).sum()
}

/// Share of the coordinates that err independently: the participation ratio of their covariance matrix S, trace(S)^2 /
/// (8 trace(S^2)), corrected for the number of differences as those of a Wishart matrix are. `effective` is the number of independent squares
/// of all coordinates.
fn independent(all: &[Vec<Window>], effective: f64) -> f64 {
    let n = effective / 8.0;
    if n < FEW {
        return FEW_INDEPENDENT;
    }
    let mut sum = SMatrix::<f64, 8, 8>::zeros();
    for window in all.iter().flatten() {
        let flat = SMatrix::<f64, 8, 1>::from_fn(|r, _| window.values[r / 2].map_or(0.0, |v| v[r % 2]));
        sum += flat * flat.transpose();
    }
    let share = (sum * sum).trace() / sum.trace().powi(2);
    let squares = (share * n - 1.0) / (n + 1.0 - 2.0 * share);
    (1.0 / (8.0 * squares.max(1.0 / 8.0))).clamp(1.0 / 8.0, 1.0)
}
