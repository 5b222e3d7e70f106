//! Least-squares fits of a model to measured tracks, by Levenberg and Marquardt's method within the priors' support.
//!
//! Many data sets of the same episodes are fitted in step, so that each round is one batch for the simulator.

use crate::data::{Channel, MeasuredEpisode, Unknowns};
use catenary_core::{DifferentiableSimulator, Model, Track};
use nalgebra::{DMatrix, DVector};
use std::ops::ControlFlow;

/// Decrease of the cost under which a fit ends. The cost itself scatters by about ten.
const DECREASE: f64 = 0.02;

/// Callback after each round of a fit; it returns whether to go on.
pub type OnRound<'a> = &'a mut dyn FnMut() -> ControlFlow<()>;

/// Fitting problem: episodes, unknowns, and stopping rules.
pub struct Problem<'a> {
    /// Simulator of the model.
    pub simulator: &'a dyn DifferentiableSimulator,
    /// Unknowns of the fit.
    pub unknowns: Unknowns,
    /// Fitted episodes.
    pub episodes: &'a [MeasuredEpisode],
    /// Most rounds of a fit, with the linearisation of its start as the first.
    pub rounds: usize,
    /// Keeps the shared unknowns at their start values, and fits the others alone.
    pub is_shared_held: bool,
    /// Decrease of the cost under which a fit ends.
    pub decrease: f64,
    /// Cost of the best other model: a fit far above it ends sooner. Infinite if there is none.
    pub aim: f64,
}

/// Data set with the start of its fit.
#[derive(Debug, Clone)]
pub struct Start {
    /// Point in unit coordinates, one number a column of the unknowns.
    pub point: Vec<f64>,
    /// Measured tracks, one an episode.
    pub tracks: Vec<Track>,
}

/// Start with its linearisation.
#[derive(Debug, Clone)]
pub struct LinearisedStart {
    /// Measured tracks, one an episode.
    pub tracks: Vec<Track>,
    /// Linearisation of the model at the start.
    pub fit: Fit,
}

/// Linearisation of the model at a point: residuals, Jacobian and cost.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Point in unit coordinates.
    pub point: Vec<f64>,
    /// Residual energy T: sum of squares of the residuals.
    pub cost: f64,
    /// Whitened residuals: measured less simulated, in standard deviations of the noise, a row a channel; then one row
    /// for each Gaussian prior.
    pub residuals: DVector<f64>,
    /// Jacobian of the simulated values by the coordinates, with the rows and the unit of the residuals.
    pub jacobian: DMatrix<f64>,
    /// Simulated tracks, one an episode. After [`linear_minimum`](Fit::linear_minimum), still the tracks of the old
    /// point.
    pub tracks: Vec<Track>,
}

impl Fit {
    /// Half the gradient of the cost by the coordinates.
    pub fn gradient(&self) -> DVector<f64> {
        -(self.jacobian.transpose() * &self.residuals)
    }

    /// Gauss-Newton matrix: half the curvature of the cost by the coordinates.
    pub fn curvature(&self) -> DMatrix<f64> {
        self.jacobian.transpose() * &self.jacobian
    }

    /// Linearisation in standard deviations of a noise of `inflation` times the variance. The first `measured` rows are
    /// measured; the others belong to Gaussian priors, and stay.
    #[must_use]
    pub fn at_noise(mut self, inflation: f64, measured: usize) -> Self {
        let scale = inflation.sqrt().recip();
        self.residuals.rows_mut(0, measured).scale_mut(scale);
        self.jacobian.rows_mut(0, measured).scale_mut(scale);
        self.cost = self.residuals.norm_squared();
        self
    }

    /// Step from this point to `point`.
    pub(super) fn step_to(&self, point: &[f64]) -> DVector<f64> {
        DVector::from_iterator(point.len(), point.iter().zip(&self.point).map(|(a, b)| a - b))
    }
}

impl<'a> Problem<'a> {
    /// Problem of fitting `model` to `episodes`.
    pub fn of(
        model: &Model,
        episodes: &'a [MeasuredEpisode],
        simulator: &'a dyn DifferentiableSimulator,
        rounds: usize,
    ) -> Self {
        let unknowns = Unknowns::of(model, episodes.len());
        let (is_shared_held, decrease, aim) = (false, DECREASE, f64::INFINITY);
        Problem { simulator, unknowns, episodes, rounds, is_shared_held, decrease, aim }
    }
}

impl Problem<'_> {
    /// Rows of the residuals.
    pub fn channels(&self) -> Vec<Channel> {
        self.episodes.iter().enumerate().flat_map(|(i, episode)| episode.channels(i)).collect()
    }

    /// Measured tracks, one an episode.
    pub fn measured(&self) -> Vec<Track> {
        self.episodes.iter().map(|c| c.measured.clone()).collect()
    }
}
