//! Verification of the simulator: comparison with theory, orders of convergence, and random episodes at the edges of
//! the parameter ranges.
//!
//! No reference is fitted. Each is a closed form, a quadrature, or a solver of the beam's differential equations
//! without nodes or elements.

mod at_rest;
mod comparison;
mod derivatives;
mod elastica;
mod error;
mod hand_path;
mod in_motion;
mod on_table;
mod orders;
mod runge_kutta;
mod specimen;
mod stress;
#[cfg(test)]
mod tests;
mod theory;
mod vibration;

pub use comparison::{Comparison, Row};
pub use derivatives::{DerivativeReport, DerivativeRow, DerivativeTrial};
pub use error::VerificationError;
pub use hand_path::{path_of_actions, random_actions, random_hand_path};
pub use orders::{ConvergenceOrder, Refinement, orders};
pub use stress::{Extreme, Stress, StressReport, StressedEpisode, default_extremes};
pub use theory::table;
