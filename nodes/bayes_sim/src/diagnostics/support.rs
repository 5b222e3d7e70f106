//! Warnings about a prior whose support moved.

use crate::sequential::{Iteration, SupportMove};
use catenary_core::ParameterSpace;

/// Warnings about parameters whose support moved during `iterations`, from the model's `stated` one to the `used` one.
pub fn support_warnings(stated: &ParameterSpace, used: &ParameterSpace, iterations: &[Iteration]) -> Vec<String> {
    let pairs = stated.parameters().iter().zip(used.parameters());
    let warning = |(stated, used): (&catenary_core::Parameter, &catenary_core::Parameter)| {
        let of = |i: &Iteration| -> Option<(usize, SupportMove)> {
            let found = i.moves.iter().find(|m| m.parameter == stated.name)?;
            Some((i.iteration, found.clone()))
        };
        let moves: Vec<(usize, SupportMove)> = iterations.iter().filter_map(of).collect();
        let (_, first) = moves.first()?;
        let ([low, high], (to_low, to_high)) = (first.from, used.prior.bounds());
        let because: Vec<String> =
            moves.iter().map(|(number, m)| format!("after iteration {number}, {}", m.because)).collect();
        Some(format!(
            "{}: the prior's support moved from {low} to {high} of the model file to {to_low} to {to_high}: {}",
            stated.name,
            because.join("; ")
        ))
    };
    pairs.filter_map(warning).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, Prior};

    #[test]
    fn a_moved_support_is_named_with_its_bounds_and_reasons() {
        let space = |high: f64| {
            let named = |name: &str, high| Parameter { name: name.into(), prior: Prior::Uniform { low: 0.0, high } };
            ParameterSpace::new(vec![named("length_m", high), named("friction", 1.0)]).unwrap()
        };
        let iteration = |number: usize, bounds: Option<[f64; 2]>| {
            let step = |[from, to]: [f64; 2]| SupportMove {
                parameter: "length_m".into(),
                from: [0.0, from],
                to: [0.0, to],
                because: format!("reason {number}"),
            };
            Iteration {
                iteration: number,
                simulations: 100 * number,
                tracks: 100,
                unusable: 0,
                loss: 0.0,
                effective_sample_size: 100.0,
                proposal_volume: 1.0,
                epochs: 1,
                moves: bounds.map(step).into_iter().collect(),
            }
        };
        let all = [iteration(1, Some([1.0, 1.5])), iteration(2, None), iteration(3, Some([1.5, 2.25]))];
        let words = support_warnings(&space(1.0), &space(2.25), &all);
        let expected = "length_m: the prior's support moved from 0 to 1 of the model file to 0 to 2.25: after iteration 1, \
                        reason 1; after iteration 3, reason 3";
        assert_eq!(words, [expected]);
        assert_eq!(support_warnings(&space(1.0), &space(1.0), &all[1..2]), Vec::<String>::new());
    }
}
