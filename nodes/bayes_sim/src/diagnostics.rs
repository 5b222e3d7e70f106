//! Diagnostics of a posterior: predictive check, warnings and misfit.

mod predictive;
mod support;
mod warnings;

pub use predictive::{Predictive, PredictiveCheck, Unchecked, nearest_order, out_of_view, predictive};
pub use support::support_warnings;
pub use warnings::{edge_warnings, fit_warnings, misfit};
