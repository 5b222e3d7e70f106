//! Input of a search.

use crate::data::Candidate;
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;

/// Input of a search.
#[derive(Clone, Copy)]
pub struct Question<'a> {
    /// Present model.
    pub model: &'a Model,
    /// Measured episodes to which models are fitted.
    pub measured: &'a [MeasuredTrack],
    /// Held-out episodes by which a repair is judged; may be empty.
    pub held_out: &'a [MeasuredTrack],
    /// Effects that the model may lack.
    pub candidates: &'a [Candidate],
}
