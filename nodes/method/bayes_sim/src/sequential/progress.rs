//! Progress reports of a running inference.

use super::iteration::Iteration;
use super::state::State;
use crate::network::Epoch;
use catenary_core::Posterior;
use std::ops::ControlFlow;

/// Progress report of a running inference.
#[derive(Debug)]
pub enum Progress<'a> {
    /// A part of the simulations or of a pass over the tracks is done. The caller may stop here.
    Working {
        /// Iteration, from 1.
        iteration: usize,
        /// Number of simulations so far.
        simulations: usize,
    },
    /// A network made a pass over the tracks.
    Epoch {
        /// Iteration, from 1.
        iteration: usize,
        /// Index of the network, from 0.
        network: usize,
        /// State of its training.
        epoch: Epoch,
    },
    /// A step of the refinement is done. The caller may stop here.
    Refining {
        /// Share of the refinement that is done; it only grows, and nears 1.
        share: f64,
        /// Number of simulations so far, with those of the networks.
        simulations: usize,
    },
    /// An iteration ended.
    Iteration {
        /// Account of the iteration.
        iteration: &'a Iteration,
        /// Total number of iterations.
        of: usize,
        /// Posterior after the iteration.
        posterior: &'a Posterior,
        /// State from which another process can continue.
        state: &'a State,
    },
}

/// Listener to each [`Progress`]. `Break` cancels the inference.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>;
