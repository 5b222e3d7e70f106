//! Report of a search: verdict and its rules, sentences, localisation, verification on held-out episodes, repair.

mod agreement;
mod bands;
mod black_box;
mod blind;
mod decide;
mod detectable;
mod draws;
mod finding;
mod further;
mod localisation;
mod missing;
mod outcome;
mod phase;
mod repair;
mod scores;
pub(crate) mod sentences;
mod separation;
mod trade_off;
mod verdict;
mod verification;
mod verifier;

pub use agreement::Agreement;
pub(crate) use bands::fitted_bands;
pub use bands::{Band, EpisodeBands, PlaneTrack};
pub use blind::{hidden_sds, is_too_quiet};
pub use decide::{
    ClosedGap, Objection, RepairEvidence, SupportEvidence, ValidationEvidence, VerdictEvidence, decide, is_unlike,
};
pub use detectable::{DetectionLimit, detectable_size, limits};
pub use finding::{Estimate, Finding, Fitness, MISFIT, Presence, PressingValue, StandIn};
pub(crate) use further::index_among_all;
pub use further::{FurtherTest, join, unlike};
pub use localisation::{Localisation, Part, localise, onset, worst_quantity};
pub use missing::{Alternative, Form, Missing, part_in_words};
pub use outcome::Outcome;
pub use phase::{Phase, shows_most};
pub use repair::repaired;
pub use separation::{Separation, separate};
pub use trade_off::{Combination, TradeOff, trade_offs};
pub use verdict::Verdict;
pub use verification::{Score, Verification};
pub(crate) use verifier::PREDICTIONS;
pub use verifier::{Prediction, Verifier};
