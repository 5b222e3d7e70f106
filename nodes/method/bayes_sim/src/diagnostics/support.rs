//! Warnings about a prior whose support moved.

use crate::sequential::SupportMove;

/// Warnings about the parameters whose support moved, with all bounds, iterations and reasons. `moves` are those of an
/// inference, in order.
pub fn support_warnings(moves: &[SupportMove]) -> Vec<String> {
    let mut warnings: Vec<(&str, String)> = Vec::new();
    for m in moves {
        let words = format!("after iteration {} to {} ({})", m.iteration, bounds(m.to), m.because);
        match warnings.iter_mut().find(|(name, _)| *name == m.parameter) {
            Some((_, warning)) => *warning = format!("{warning}, {words}"),
            None => {
                let warning = format!("{}: the prior's support moved from {}: {words}", m.parameter, bounds(m.from));
                warnings.push((&m.parameter, warning));
            }
        }
    }
    warnings.into_iter().map(|(_, warning)| warning).collect()
}

/// Bounds in words, to four significant digits.
fn bounds([low, high]: [f64; 2]) -> String {
    // A number between them in decimals has no spurious digits such as those of 0.15000000000000002.
    let short = |v: f64| format!("{v:.3e}").parse().unwrap_or(v);
    format!("[{}, {}]", short(low), short(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_moved_parameter_has_a_warning_with_its_bounds_and_iterations() {
        let step = |iteration: usize, parameter: &str, from: [f64; 2], to: [f64; 2]| SupportMove {
            iteration,
            parameter: parameter.into(),
            from,
            to,
            because: format!("reason {iteration}"),
        };
        let moves = [
            step(1, "length_m", [0.1, 0.15], [0.1, 0.15 + 0.025]),
            step(2, "youngs_modulus_pa", [1e3, 5e4], [141.421356, 5e4]),
            step(3, "length_m", [0.1, 0.175], [0.1, 0.2125]),
        ];
        assert_eq!(
            support_warnings(&moves),
            [
                "length_m: the prior's support moved from [0.1, 0.15]: after iteration 1 to [0.1, 0.175] (reason 1), \
                 after iteration 3 to [0.1, 0.2125] (reason 3)",
                "youngs_modulus_pa: the prior's support moved from [1000, 50000]: after iteration 2 to [141.4, 50000] \
                 (reason 2)"
            ]
        );
        assert_eq!(support_warnings(&[]), Vec::<String>::new());
    }
}
