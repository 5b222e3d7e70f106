//! Input of a search.

use crate::template::Template;
use catenary_core::Model;
use catenary_core::episode::MeasuredTrack;
use track_fit::data::Candidate;

/// Input of a search. Validation and held-out episodes that contradict the model, while the fitted ones agree with it, are
/// fitted, too.
#[derive(Clone, Copy)]
pub struct Question<'a> {
    /// Present model.
    pub model: &'a Model,
    /// Measured episodes to which models are fitted.
    pub measured: &'a [MeasuredTrack],
    /// Validation episodes, which no fit sees, and which choose between models; may be empty. Without them no further effect
    /// is added to a first one.
    pub validation: &'a [MeasuredTrack],
    /// Held-out episodes, which choose no model, and verify or refute the result; may be empty.
    pub held_out: &'a [MeasuredTrack],
    /// Effects that the model may lack.
    pub candidates: &'a [Candidate],
    /// Templates of what may be missing where no effect explains the rest; may be empty.
    pub templates: &'a [Template],
}

impl<'a> Question<'a> {
    /// Input with the fitted episodes alone: no others, no effects, and no templates.
    pub fn of(model: &'a Model, measured: &'a [MeasuredTrack]) -> Self {
        Self { model, measured, validation: &[], held_out: &[], candidates: &[], templates: &[] }
    }
}
