//! Outcome of a search: finding, repaired model, and predictive bands for pictures.

use super::bands::EpisodeBands;
use super::finding::Finding;
use catenary_core::Model;

/// Outcome of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Finding with its verdict.
    pub finding: Finding,
    /// Repaired model, if effects were found.
    pub model: Option<Model>,
    /// Model with the effects nearest to what is missing, if there are such.
    pub nearest: Option<Model>,
    /// Predictive bands, one entry an episode: fitted episodes first, then held-out ones.
    pub shown: Vec<EpisodeBands>,
}
