//! Round tick marks: 1, 2 or 5 times a power of ten.

use super::number::plain;
use catenary_core::Prior;

/// Value of a tick mark, and its label.
pub type Tick = (f64, String);

/// Tick marks from `low` to `high`, at most about `most`.
pub fn linear(low: f64, high: f64, most: usize) -> Vec<Tick> {
    if !(low.is_finite() && high.is_finite() && low < high) || most == 0 {
        return Vec::new();
    }
    let raw = (high - low) / most as f64;
    let decade = 10f64.powf(raw.log10().floor());
    let rounded = |m: &f64| m * decade >= raw * (1.0 - 1e-9);
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().find(rounded).unwrap_or(10.0) * decade;
    // The factor guards against a logarithm just below a whole number.
    let decimals = (-(step * 1.000_001).log10().floor()).clamp(0.0, 12.0) as usize;
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|i| (i as f64 * step, plain(i as f64 * step, decimals))).collect()
}

/// Tick marks of a logarithmic axis. An axis too short for three of them gets linear ones.
pub fn logarithmic(low: f64, high: f64, most: usize) -> Vec<Tick> {
    if !(low > 0.0 && low < high && high.is_finite()) {
        return Vec::new();
    }
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let within = |mantissas: &[f64]| -> Vec<Tick> {
        let all = decades.clone().flat_map(|k| mantissas.iter().map(move |m| (*m, k)));
        let ticks = all.map(|(m, k)| (m * 10f64.powi(k), (-k).max(0) as usize));
        let inside = ticks.filter(|(v, _)| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(v));
        inside.map(|(v, decimals)| (v, plain(v, decimals))).collect()
    };
    let kinds = [within(&[1.0, 2.0, 5.0]), within(&[1.0, 5.0]), within(&[1.0])];
    match kinds.into_iter().find(|ticks| ticks.len() <= most.max(2)) {
        Some(ticks) if ticks.len() > 2 => ticks,
        Some(_) => linear(low, high, most),
        None => {
            let all = within(&[1.0]);
            let every = all.len().div_ceil(most.max(2));
            all.into_iter().step_by(every).collect()
        }
    }
}

/// Tick marks of an axis that follows `prior`, between two unit coordinates. Each has its position in unit coordinates
/// and its label, the value times `factor`. Marks too close to the previous one are left out.
pub fn of_prior(prior: &Prior, (low, high): (f64, f64), factor: f64, most: usize) -> Vec<Tick> {
    let ends = (prior.from_unit(low) * factor, prior.from_unit(high) * factor);
    let ticks = match prior {
        Prior::LogUniform { .. } => logarithmic(ends.0, ends.1, most),
        _ => linear(ends.0, ends.1, most),
    };
    let apart = 0.7 * (high - low) / most.max(1) as f64;
    let mut kept: Vec<Tick> = Vec::new();
    for (value, label) in ticks {
        let u = prior.to_unit(value / factor);
        if kept.last().is_none_or(|(before, _)| u - before >= apart) {
            kept.push((u, label));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: &[Tick]) -> Vec<&str> {
        ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    #[test]
    fn linear_ticks_are_round() {
        assert_eq!(labels(&linear(0.195, 0.305, 6)), ["0.20", "0.22", "0.24", "0.26", "0.28", "0.30"]);
        assert_eq!(labels(&linear(0.0, 16.0, 5)), ["0", "5", "10", "15"]);
        assert_eq!(labels(&linear(-0.4, 0.4, 4)), ["-0.4", "-0.2", "0.0", "0.2", "0.4"]);
        assert_eq!(labels(&linear(0.0, 30_720.0, 4)), ["0", "10 000", "20 000", "30 000"]);
        assert!(linear(1.0, 1.0, 5).is_empty() && linear(f64::NAN, 1.0, 5).is_empty());
    }

    #[test]
    fn logarithmic_ticks_are_round() {
        assert_eq!(labels(&logarithmic(1.0, 50.0, 6)), ["1", "2", "5", "10", "20", "50"]);
        assert_eq!(labels(&logarithmic(1e-3, 10.0, 5)), ["0.001", "0.01", "0.1", "1", "10"]);
        assert_eq!(labels(&logarithmic(6.1, 8.2, 6)), ["6.5", "7.0", "7.5", "8.0"], "under a decade they are linear");
        assert!(logarithmic(0.0, 1.0, 5).is_empty());
    }

    #[test]
    fn ticks_of_a_prior_are_placed_in_its_unit_coordinates() {
        let prior = Prior::LogUniform { low: 1e3, high: 1e5 };
        let ticks = of_prior(&prior, (0.0, 1.0), 1e-3, 3);
        assert_eq!(labels(&ticks), ["1", "10", "100"]);
        assert!((ticks[1].0 - 0.5).abs() < 1e-12, "{ticks:?}");
    }

    #[test]
    fn ticks_are_few_lie_inside_and_are_one_two_or_five_times_a_power_of_ten() {
        let spans = (0..40).map(|i| 10f64.powf(-4.0 + 0.23 * f64::from(i)));
        for (i, span) in spans.enumerate() {
            for most in 3..9 {
                let low = (i as f64 - 17.0) * 0.37 * span;
                let (high, slack) = (low + span, 1e-6 * span);
                let ticks = linear(low, high, most);
                assert!(!ticks.is_empty() && ticks.len() <= most + 1, "{low} to {high}: {}", ticks.len());
                assert!(ticks.iter().all(|(v, _)| (low - slack..=high + slack).contains(v)), "{low} to {high}");
                for pair in ticks.windows(2) {
                    let step = pair[1].0 - pair[0].0;
                    let mantissa = step / 10f64.powf((step * 1.000_001).log10().floor());
                    assert!([1.0, 2.0, 5.0].iter().any(|m| (mantissa - m).abs() < 1e-3), "{step}");
                    assert!(pair[0].1 != pair[1].1, "two ticks read {}", pair[0].1);
                }
            }
        }
    }
}
