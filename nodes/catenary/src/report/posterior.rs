//! Table of a posterior and its prior.

use super::quantity::Quantity;
use catenary_core::Posterior;
use catenary_core::posterior::Marginal;

/// Header of the table. The last column needs a known truth.
pub const HEAD: [&str; 5] = ["parameter", "median", "90 % interval", "prior", "hidden truth"];

/// Rows of the table, one per parameter, with the true value if known.
pub fn rows(posterior: &Posterior, marginals: &[Marginal], truth: Option<&[f64]>) -> Vec<Vec<String>> {
    let space = &posterior.parameters;
    let row = |(i, m): (usize, &Marginal)| {
        let quantity = Quantity::of(&m.name);
        let words = quantity.estimate(m.median, m.q05, m.q95);
        let (value, interval) = words.split_once(" (").unwrap_or((&words, ""));
        let prior = space.index_of(&m.name).map(|i| quantity.prior(&space.parameters()[i].prior));
        let own = [quantity.title.clone(), value.to_owned(), interval.replace(')', ""), prior.unwrap_or_default()];
        own.into_iter().chain(truth.and_then(|t| t.get(i)).map(|v| quantity.value_within(*v, m.q95 - m.q05))).collect()
    };
    marginals.iter().enumerate().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Parameter, ParameterSpace, Prior};

    #[test]
    fn the_prior_and_the_truth_stand_beside_the_posterior() {
        let prior = Prior::Uniform { low: 0.2, high: 0.3 };
        let space = ParameterSpace::new(vec![Parameter { name: "length_m".into(), prior }]).unwrap();
        let marginal =
            Marginal { name: "length_m".into(), mean: 0.26, sd: 0.004, q05: 0.2541, median: 0.2607, q95: 0.2671 };
        let rows = rows(&Posterior::prior(space), &[marginal], Some(&[0.2604]));
        assert_eq!(rows, [["length", "261 mm", "254 to 267", "200 to 300 mm", "260 mm"]]);
    }
}
