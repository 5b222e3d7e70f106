//! Blindness of a test to gaps smaller than its noise.

use crate::evidence::Test;
use catenary_core::statistics::{QuantileMethod, quantile};

/// Share of the null data sets' median residual energy below which the noise of the model cannot be that of the data: half of
/// the variance, which noise that is correlated in time leaves by chance in a few independent moments at most.
const QUIET: f64 = 0.5;

/// Returns whether the residual energy is far below that of every null data set. A p-value of 1 contradicts the noise as one
/// of 0 contradicts the model.
pub fn is_too_quiet(test: &Test) -> bool {
    let middle = quantile(&test.null, 0.5, QuantileMethod::Nearest);
    test.null.first().is_some_and(|least| test.statistic < *least) && test.statistic < QUIET * middle
}

/// Root mean square of the largest gap that a test at `level` may not see, in standard deviations of the noise: the gap that alone
/// has the residual energy from which on the test rejects. Less hides beside noise, whose share is not known.
pub fn hidden_sds(test: &Test, level: f64) -> f64 {
    let critical = quantile(&test.null, 1.0 - level, QuantileMethod::Nearest);
    (critical / test.coordinates.max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test(statistic: f64) -> Test {
        let null = (0..99).map(|k| 180.0 + f64::from(k)).collect();
        Test { p_value: 1.0, statistic, null, null_left_out: 0, coordinates: 100 }
    }

    #[test]
    fn a_residual_of_less_than_half_of_the_noise_is_too_quiet() {
        assert!(is_too_quiet(&test(114.0)) && !is_too_quiet(&test(115.0)) && !is_too_quiet(&test(300.0)));
        assert!(!is_too_quiet(&Test { null: Vec::new(), ..test(0.0) }));
    }

    #[test]
    fn a_gap_hides_up_to_the_residual_energy_that_the_test_rejects() {
        assert!((hidden_sds(&test(10.0), 0.05) - 2.73_f64.sqrt()).abs() < 1e-12, "{}", hidden_sds(&test(10.0), 0.05));
    }
}
