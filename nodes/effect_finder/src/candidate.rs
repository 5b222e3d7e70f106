//! Effects that a model may lack.

use catenary_core::{Model, Prior};
use serde::{Deserialize, Serialize};

/// How far beyond its prior a fit may take an effect's magnitude: an effect that is larger than anyone expected should show
/// itself as that, and not as an effect of another kind.
const ROOM: f64 = 3.0;

/// An effect that may be what the model lacks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Name with its unit, as model files write it.
    pub name: String,
    /// Its name in a sentence.
    pub title: String,
    /// Distribution of its magnitude where it is unknown but present.
    pub prior: Prior,
    /// Least and greatest magnitude that makes sense; holds zero.
    pub range: [f64; 2],
    /// Magnitude that the model has fixed already; the candidate is a change of it.
    pub base: f64,
}

impl Candidate {
    /// Whether `model` could lack the effect of that name: it neither infers nor draws it.
    pub fn is_open(name: &str, model: &Model) -> bool {
        model.theta.index_of(name).is_none() && model.effects.iter().all(|e| e.name != name)
    }

    /// The values among which a fit looks for the effect's magnitude: from the base on, beyond the prior on both sides.
    pub fn search(&self) -> Prior {
        let (low, high) = self.prior.bounds();
        let from = if low < 0.0 { self.base + ROOM * low } else { self.base };
        Prior::Uniform { low: from.max(self.range[0]), high: (self.base + ROOM * high).min(self.range[1]) }
    }

    /// Density of the prior at the value `value`, per unit of it.
    pub fn density(&self, value: f64) -> f64 {
        let magnitude = value - self.base;
        let (low, high) = self.prior.bounds();
        match self.prior {
            _ if !(low..=high).contains(&magnitude) => 0.0,
            Prior::Uniform { .. } => 1.0 / (high - low),
            Prior::LogUniform { .. } => 1.0 / (magnitude * (high / low).ln()),
        }
    }

    /// Values at which a fit starts: quantiles of the prior.
    pub fn starts(&self) -> Vec<f64> {
        [0.15, 0.85].map(|u| self.base + self.prior.from_unit(u)).to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drag() -> Candidate {
        let prior = Prior::LogUniform { low: 1e-3, high: 0.3 };
        Candidate { name: "linear_drag_n_s_m2".into(), title: "drag".into(), prior, range: [0.0, 1e3], base: 0.0 }
    }

    #[test]
    fn a_search_begins_at_the_base_and_ends_beyond_the_prior() {
        let (low, high) = drag().search().bounds();
        assert!(low == 0.0 && (high - 0.9).abs() < 1e-12, "{low} to {high}");
        let tilt =
            Candidate { prior: Prior::Uniform { low: -0.1, high: 0.1 }, range: [-0.2, 1.5], base: 0.05, ..drag() };
        let Prior::Uniform { low, high } = tilt.search() else { panic!("linear") };
        assert!((low + 0.2).abs() < 1e-12 && (high - 0.35).abs() < 1e-12, "{low} to {high}");
    }

    #[test]
    fn the_density_of_a_prior_integrates_to_one() {
        let wide = Candidate { prior: Prior::Uniform { low: -0.1, high: 0.3 }, base: 1.0, ..drag() };
        for candidate in [drag(), wide] {
            let (low, high) = candidate.prior.bounds();
            let n = 200_000;
            let h = (high - low) / f64::from(n);
            let sum: f64 = (0..n).map(|i| candidate.density(candidate.base + low + h * (f64::from(i) + 0.5)) * h).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
    }
}
