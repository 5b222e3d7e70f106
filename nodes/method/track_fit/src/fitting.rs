//! Fits of a model to measured tracks: many starts, damped Gauss-Newton steps, Laplace's posterior, and refits.

mod excess;
mod fidelity;
mod laplace;
mod levenberg_marquardt;
mod linearise;
mod minima;
mod modes;
mod multi_start;
mod probe;
mod problem;
mod refit;
mod simulate;
mod step;

pub use excess::{is_beyond_noise, leaves_more_than_noise, leaves_much, noise_inflation, wrench_inflation};
pub use fidelity::{CorrectedFit, FidelityCorrection, calibrated, corrected_fit};
pub use laplace::{Laplace, PRIOR_PRECISION};
pub use linearise::Known;
pub use minima::other_minima;
pub use modes::modes;
pub use multi_start::{best_fit, fit_among_draws};
pub use probe::Probe;
pub use problem::{Fit, LinearisedStart, OnRound, Problem, Start};
pub use refit::SimulatedSet;
pub use step::is_bound_active;
