//! Statistics of samples: mean, standard deviation, quantiles, medians, Wilson's interval, and the Kolmogorov-Smirnov
//! test of uniformity.
//!
//! The crate `statrs` is not used for them. Its quantile is Hyndman and Fan's type 8, which would change every figure in a
//! report. Its Kolmogorov-Smirnov test has an exact p-value that refuses ties, which ranks have, and overflows from 144
//! values on; its asymptotic one has no correction for few values: at 60 values it returns 0.057 where 0.05 is right.

/// Standard normal quantile of a two-sided interval of 90 %.
pub const Z_90: f64 = 1.645;
/// Standard normal quantile of a two-sided interval of 95 %.
pub const Z_95: f64 = 1.959_964;

/// Mean of `values`; NaN for none.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Sample variance of `values`, with n - 1 in the denominator; NaN for fewer than two.
pub fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

/// Sample standard deviation of `values`, the root of [`variance`].
pub fn sd(values: &[f64]) -> f64 {
    variance(values).sqrt()
}

/// Choice of the value at the position of a quantile, which usually lies between two order statistics. The names are
/// those of `numpy.quantile`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QuantileMethod {
    /// Linear interpolation between the two order statistics: Hyndman and Fan's type 7 (1996).
    Linear,
    /// Nearest order statistic.
    Nearest,
    /// Lower of the two order statistics.
    Lower,
}

/// Quantile `q` (0 to 1) of the sorted values; NaN for none.
///
/// Its position among the n order statistics, counted from 0, is q (n - 1) with every method. Summaries of draws take
/// [`QuantileMethod::Nearest`]. The other methods exist because a change would change figures or random streams:
/// `Linear` for the predictive band, `Lower` for bootstrap intervals and for thresholds of densities.
pub fn quantile(sorted: &[f64], q: f64, method: QuantileMethod) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let position = q * last as f64;
    let at = |i: usize| sorted[i.min(last)];
    match method {
        QuantileMethod::Linear => {
            let (below, share) = (position.floor() as usize, position.fract());
            at(below) + share * (at(below + 1) - at(below))
        }
        QuantileMethod::Nearest => at(position.round() as usize),
        QuantileMethod::Lower => at(position as usize),
    }
}

/// Median of `values`, which it sorts: the mean of the two middle values of an even number. NaN for none.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
    }
}

/// High median of `values`, which it sorts: the larger of the two middle values of an even number, so always one of the
/// values. None for none.
pub fn median_high(values: &mut [f64]) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// High median of places, coordinate by coordinate. None for none.
pub fn median_place(places: impl Iterator<Item = [f64; 2]> + Clone) -> Option<[f64; 2]> {
    let median = |i: usize| median_high(&mut places.clone().map(|place| place[i]).collect::<Vec<f64>>());
    Some([median(0)?, median(1)?])
}

/// 95 % interval `[low, high]` of a probability, after `hits` in `trials` (Wilson 1927).
pub fn wilson_interval(hits: usize, trials: usize) -> [f64; 2] {
    let n = trials as f64;
    let share = hits as f64 / n;
    let (middle, square) = (share + Z_95 * Z_95 / (2.0 * n), Z_95 * Z_95 / n);
    let half = Z_95 * (share * (1.0 - share) / n + Z_95 * Z_95 / (4.0 * n * n)).sqrt();
    // Rounding may carry an end beyond a share's range.
    [((middle - half) / (1.0 + square)).max(0.0), ((middle + half) / (1.0 + square)).min(1.0)]
}

/// Factor that makes the distance of n values follow Kolmogorov's limiting distribution (Stephens 1970).
fn stephens(n: f64) -> f64 {
    n.sqrt() + 0.12 + 0.11 / n.sqrt()
}

/// Terms of the series of Kolmogorov's distribution. The hundredth is below 1e-300 wherever the series is used.
const TERMS: i32 = 100;

/// p-value of the Kolmogorov-Smirnov test that the sorted `values` come from the uniform distribution on 0 .. 1.
pub fn uniformity(sorted: &[f64]) -> f64 {
    let n = sorted.len() as f64;
    if sorted.is_empty() {
        return 1.0;
    }
    let gap = |(i, v): (usize, &f64)| (v - i as f64 / n).abs().max(((i + 1) as f64 / n - v).abs());
    let greatest = sorted.iter().enumerate().map(gap).fold(0.0, f64::max);
    let scaled = stephens(n) * greatest;
    // Below 0.2 the p-value is 1 to twelve digits, and the alternating series converges slowly.
    if scaled < 0.2 {
        return 1.0;
    }
    let term = |k: i32| 2.0 * f64::from(1 - 2 * ((k - 1) % 2)) * (-2.0 * f64::from(k * k) * scaled * scaled).exp();
    (1..=TERMS).map(term).sum::<f64>().clamp(0.0, 1.0)
}

/// Half width of the band around the diagonal that contains the whole empirical distribution function of `count`
/// uniform values in 95 of 100 cases.
pub fn uniformity_band(count: f64) -> f64 {
    // 1.358 is the quantile 0.95 of Kolmogorov's distribution.
    1.358 / stephens(count)
}

/// p-value of a test against `null_sets` simulated data sets, in words: "0.30". The least possible value is 1 / (1 +
/// `null_sets`). The true p-value may be smaller, so that it is written as a bound, rounded up: "<= 0.005 (199 null data
/// sets)".
pub fn p_words(p: f64, null_sets: usize) -> String {
    let least = 1.0 / (1.0 + null_sets as f64);
    if p <= least * (1.0 + 1e-9) {
        let digits = 1 - least.log10().floor() as i32;
        let unit = 10f64.powi(-digits);
        // The margin keeps 0.005, which is 50.00000000000001 units, from being rounded up.
        let bound = (least / unit - 1e-6).ceil() * unit;
        let text = format!("{bound:.*}", digits.max(0) as usize);
        let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        return format!("<= {short} ({null_sets} null data sets)");
    }
    // Below 0.1 a third decimal tells p-values apart; more null data sets need more decimals.
    let decimals = if p < 0.0995 { (-least.log10() - 1e-9).ceil().max(3.0) as usize } else { 2 };
    format!("{p:.decimals$}")
}

/// [`p_words`] as a clause: "p = 0.30", "p <= 0.005 (199 null data sets)".
pub fn p_clause(p: f64, null_sets: usize) -> String {
    let words = p_words(p, null_sets);
    if words.starts_with('<') { format!("p {words}") } else { format!("p = {words}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed;
    use rand::RngExt;

    const METHODS: [QuantileMethod; 3] = [QuantileMethod::Linear, QuantileMethod::Nearest, QuantileMethod::Lower];

    /// Expected values: `numpy.quantile(values, q, method=...)`.
    #[test]
    fn quantiles_are_those_of_numpy() {
        let values = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
        let at = |q: f64| METHODS.map(|method| quantile(&values, q, method));
        assert_eq!(at(0.0), [1.0; 3]);
        assert_eq!(at(1.0), [32.0; 3]);
        assert_eq!(at(0.25), [2.5, 2.0, 2.0]);
        assert_eq!(at(0.35), [3.5, 4.0, 2.0]);
        assert!(
            METHODS.iter().all(|method| quantile(&[], 0.5, *method).is_nan() && quantile(&[3.0], 0.9, *method) == 3.0)
        );
    }

    #[test]
    fn medians_differ_for_an_even_number_alone() {
        assert_eq!((median(&mut [3.0, 1.0, 2.0]), median_high(&mut [3.0, 1.0, 2.0])), (2.0, Some(2.0)));
        assert_eq!((median(&mut [4.0, 1.0, 2.0, 3.0]), median_high(&mut [4.0, 1.0, 2.0, 3.0])), (2.5, Some(3.0)));
        assert!(median(&mut []).is_nan() && median_high(&mut []).is_none());
    }

    #[test]
    fn mean_and_standard_deviation_are_those_of_a_sample() {
        assert_eq!((mean(&[1.0, 2.0, 3.0, 4.0]), variance(&[1.0, 2.0, 3.0, 4.0])), (2.5, 5.0 / 3.0));
        assert!(mean(&[]).is_nan() && sd(&[1.0]).is_nan());
    }

    /// Expected values: `scipy.stats.binomtest(hits, trials).proportion_ci(method="wilson")`.
    #[test]
    fn wilson_intervals_are_those_of_scipy() {
        for (hits, trials, [low, high]) in
            [(5, 100, [0.02154, 0.11175]), (0, 10, [0.0, 0.27753]), (10, 10, [0.72247, 1.0])]
        {
            let [l, h] = wilson_interval(hits, trials);
            assert!((l - low).abs() < 1e-5 && (h - high).abs() < 1e-5, "{hits} of {trials}: {l} to {h}");
        }
    }

    #[test]
    fn the_test_of_uniformity_has_the_error_that_it_states() {
        let values = |i: u64| {
            let mut rng = seed::rng(6, i);
            let mut values: Vec<f64> = (0..60).map(|_| rng.random()).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let refused = (0..1_000).filter(|&i| uniformity(&values(i)) < 0.05).count();
        // 50 expected, with a standard deviation of 7.
        assert!((22..78).contains(&refused), "{refused} of 1000");
        let bent: Vec<f64> = values(1).iter().map(|v| v * v).collect();
        assert!(uniformity(&bent) < 1e-2 && uniformity(&[]) == 1.0 && uniformity(&[0.5]) > 0.8);
    }

    #[test]
    fn the_band_is_the_distance_at_which_the_test_rejects() {
        let n = 60;
        let shifted: Vec<f64> =
            (0..n).map(|i| (f64::from(i) + 1.0) / f64::from(n) - uniformity_band(f64::from(n))).collect();
        assert!((uniformity(&shifted) - 0.05).abs() < 1e-3, "{}", uniformity(&shifted));
    }

    #[test]
    fn a_p_value_at_the_floor_is_a_bound() {
        assert_eq!(p_words(1.0 / 200.0, 199), "<= 0.005 (199 null data sets)");
        assert_eq!(p_words(2.0 / 200.0, 199), "0.010");
        assert_eq!(p_words(0.45, 199), "0.45");
        assert_eq!([p_words(0.002, 999), p_words(0.0002, 9999)], ["0.002", "0.0002"]);
        let bound = |null_sets: usize| p_words(1.0 / (1.0 + null_sets as f64), null_sets);
        assert_eq!(
            [19, 99, 999].map(bound).map(|words| words.split(' ').nth(1).unwrap().to_owned()),
            ["0.05", "0.01", "0.001"]
        );
        assert_eq!(bound(130), "<= 0.0077 (130 null data sets)", "1/131 is 0.00763: a bound is rounded up");
        assert_eq!(bound(0), "<= 1 (0 null data sets)");
        assert_eq!(p_clause(0.005, 199), "p <= 0.005 (199 null data sets)");
        assert_eq!(p_clause(0.3, 199), "p = 0.30");
    }
}
