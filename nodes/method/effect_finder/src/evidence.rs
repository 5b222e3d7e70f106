//! Evidence: tests against noise, marginal likelihoods with and without a discrepancy, candidate models and their ranking.

mod detection;
mod discrepancy;
mod hypothesis;
mod linear_model;
mod linearised;
mod magnitude;
mod marginal;
mod ranking;

pub use detection::{Detection, NullFit, Test, detect, p_value};
pub use discrepancy::{Discrepancy, Whitening, gain_beside_discrepancy};
pub use hypothesis::{Effort, Hypothesis, lowest_cost};
pub use linear_model::{LinearModel, Refined, WeighedModel, Weighing};
pub use linearised::LinearisedModel;
pub use magnitude::{CompanionValue, Magnitude};
pub use marginal::{Baseline, Evidence};
pub use ranking::{Explanation, Extent, Ranking, gain, groups, joined, log_posterior};
