//! Account of the widening of a posterior.

use serde::{Deserialize, Serialize};

/// Widening of a posterior until its 90 % intervals hold 90 % of the simulations that the networks held out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Widening {
    /// Number of held-out simulations in the last iteration's training, summed over the networks.
    pub held_out: usize,
    /// Factor of the mixture's standard deviations, by parameter (D).
    pub factors: Vec<f64>,
    /// Share of held-out simulations in their 90 % intervals before, by parameter (D).
    pub coverage_before: Vec<f64>,
    /// Width of the posterior's 90 % interval before, by parameter (D), in the parameter's unit.
    pub width_before: Vec<f64>,
}
