//! Sizes of a sampling.

/// Sizes of a sampling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Walkers of the ensemble.
    pub walkers: usize,
    /// Moves of each walker in a block at the posterior.
    pub block: usize,
    /// Most blocks.
    pub blocks: usize,
}

impl Default for Budget {
    fn default() -> Self {
        Self { walkers: 256, block: 16, blocks: 4 }
    }
}
