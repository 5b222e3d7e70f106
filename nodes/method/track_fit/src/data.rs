//! Data of a fit: measured episodes, the unknowns, and the candidate effects.

mod candidate;
mod episode;
mod offsets;
mod residuals;
mod unknowns;

pub use candidate::{Candidate, Companion};
pub use episode::MeasuredEpisode;
pub use offsets::{Offset, offsets_mm, rmse_mm};
pub use residuals::{Channel, Quantity};
pub use unknowns::{Scope, Unknown, Unknowns};
