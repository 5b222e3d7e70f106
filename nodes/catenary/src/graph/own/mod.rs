//! Graph that a command starts for itself: in a DDS domain of its own, with its own arm.

mod cell;
mod domain;
mod running;

pub use cell::Cell;
pub use domain::OwnDomain;
pub use running::{Conditions, OwnGraph};
