//! Trade-offs: pairs of values that the data determine only together.

use crate::evidence::Hypothesis;
use serde::{Deserialize, Serialize};
use track_fit::data::Scope;
use track_fit::fitting::Laplace;

/// Least correlation of a trade-off. At sqrt(1 - r^2) = 1/2, knowing one value halves the uncertainty of the other.
const LEAST_CORRELATION: f64 = 0.866;

/// Effect and another unknown that make up for each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TradeOff {
    /// Effect, and parameter or other effect.
    pub between: [String; 2],
    /// Correlation of both, all other unknowns free.
    pub correlation: f64,
}

impl TradeOff {
    /// Share of the uncertainty of one value that knowing the other would remove.
    pub fn worth(&self) -> f64 {
        1.0 - (1.0 - self.correlation.powi(2)).max(0.0).sqrt()
    }
}

/// Trade-offs of the model's effects at its fit, the strongest first; none if the Gauss-Newton matrix is not positive
/// definite. The spread between conditions does not count, because it is no doubt about these data.
pub fn trade_offs(found: &Hypothesis) -> Vec<TradeOff> {
    let Some(posterior) = Laplace::of(&found.fit) else { return Vec::new() };
    let correlations = posterior.correlations(0..found.unknowns.columns());
    let list = found.unknowns.list();
    let effects = list.len() - found.candidates.len()..list.len();
    let others = |effect: usize| (0..effect).filter(|i| list[*i].scope == Scope::Shared).map(move |i| (effect, i));
    let mut all: Vec<TradeOff> = effects
        .flat_map(others)
        .map(|(effect, other)| {
            let [e, o] = [effect, other].map(|i| found.unknowns.column(i, 0));
            let between = [list[effect].name.clone(), list[other].name.clone()];
            TradeOff { between, correlation: correlations[(e, o)] }
        })
        .filter(|t| t.correlation.abs() >= LEAST_CORRELATION)
        .collect();
    all.sort_by(|a, b| b.correlation.abs().total_cmp(&a.correlation.abs()));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Effort, Evidence};
    use catenary_core::{Model, Prior};
    use nalgebra::{DMatrix, DVector};
    use track_fit::data::{Candidate, Unknowns};
    use track_fit::fitting::{FidelityCorrection, Fit};

    /// Model with two effects. The first changes the data like `alike` times the stiffness and the episode's own
    /// unknown.
    fn found(alike: f64, spread: Vec<f64>) -> Hypothesis {
        let model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let prior = Prior::Uniform { low: -0.02, high: 0.02 };
        let candidate = |name: &str| Candidate {
            name: name.into(),
            title: String::new(),
            prior: prior.clone(),
            range: [-1.0, 1.0],
            base: 0.0,
            odds: 1.0,
        };
        let candidates = ["tip_mass_kg", "table_height_m"].map(candidate).to_vec();
        let unknowns = candidates.iter().fold(Unknowns::of(&model, 1), |u, c| u.with(c));
        let n = unknowns.columns();
        assert!(n > 4, "something is drawn for each episode");
        let mut jacobian: DMatrix<f64> = 300.0 * DMatrix::identity(n, n);
        (jacobian[(1, n - 2)], jacobian[(2, n - 2)]) = (300.0 * alike, 300.0 * alike);
        let fit = Fit { point: vec![0.5; n], cost: 0.0, residuals: DVector::zeros(n), jacobian, tracks: Vec::new() };
        let evidence = Evidence { alone: 0.0, with: Vec::new() };
        let (correction, effort) = (FidelityCorrection::Untried, Effort::Searched);
        Hypothesis { candidates, unknowns, episodes: None, correction, fit, evidence, effort, spread }
    }

    #[test]
    fn an_effect_trades_off_with_a_correlated_parameter() {
        // With columns e_1 and e_n + a (e_1 + e_2), the correlation is -a / sqrt(1 + a^2).
        let [one] = trade_offs(&found(3.0, Vec::new())).try_into().unwrap();
        assert_eq!(one.between, ["tip_mass_kg", "youngs_modulus_pa"]);
        assert!((one.correlation + 3.0 / 10f64.sqrt()).abs() < 1e-3, "{one:?}");
        assert!((one.worth() - (1.0 - 0.1f64.sqrt())).abs() < 1e-3, "{one:?}");
        assert_eq!(
            trade_offs(&found(3.0, vec![0.2, 0.0])),
            [one],
            "conditions that differ are no doubt about these data"
        );
        assert_eq!(trade_offs(&found(1.0, Vec::new())), []);
    }
}
