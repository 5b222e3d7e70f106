//! Settings of a fit.

use catenary_core::Fidelity;

/// Settings of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Draws of the prior among which a fit chooses its starts. More draws find the best of several local minima.
    pub draws: usize,
    /// Number of draws from which a fit starts.
    pub starts: usize,
    /// Fidelity of the simulations. A coarse one suffices if a finer one corrects it.
    pub fidelity: Fidelity,
    /// Fallback fidelity when the discretisation error exceeds 20 % of the noise variance, too much for a correction;
    /// none: no fallback.
    pub fallback_fidelity: Option<Fidelity>,
    /// Finer fidelity that corrects the discretisation error of the simulations; none: no correction.
    pub finer_fidelity: Option<Fidelity>,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            draws: 400,
            starts: 8,
            fidelity: Fidelity::Fast,
            fallback_fidelity: Some(Fidelity::FineMesh),
            finer_fidelity: Some(Fidelity::Reference),
            seed: 0,
        }
    }
}
