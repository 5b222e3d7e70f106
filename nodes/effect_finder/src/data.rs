//! Data of a search: measured episodes, the unknowns of a fit, and the candidate effects.

mod candidate;
mod episode;
mod offsets;
mod residuals;
mod template;
mod unknowns;

pub use candidate::Candidate;
pub use episode::MeasuredEpisode;
pub use offsets::{Offset, offsets_mm, rmse_mm};
pub use residuals::{Channel, Quantity};
pub use template::{Companion, Template};
pub use unknowns::{Scope, Unknown, Unknowns};
