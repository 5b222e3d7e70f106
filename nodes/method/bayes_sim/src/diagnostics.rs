//! Diagnostics of a posterior: predictive check, warnings and misfit.

mod parts;
mod predictive;
mod ranks;
mod selection;
mod support;
mod warnings;

pub use parts::Part;
pub use predictive::{Predictive, PredictiveCheck, Unchecked, nearest_order, out_of_view, predictive};
pub use ranks::Bands;
pub use support::support_warnings;
pub use warnings::{Edges, edge_warnings, fit_warnings, misfit};
