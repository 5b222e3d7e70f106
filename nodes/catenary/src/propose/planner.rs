//! Planned recordings of a model.

use catenary_core::{GripTrajectory, Model};
use catenary_shell::Shutdown;
use catenary_simulator::BeamSimulator;
use std::ops::ControlFlow;
use track_fit::data::MeasuredEpisode;

/// Model and simulator with which motions are compared and checked.
pub struct Planner<'a> {
    /// Model of the object.
    pub model: &'a Model,
    /// Its simulator.
    pub simulator: &'a BeamSimulator,
    /// Settings of fits and simulations.
    pub settings: track_fit::Settings,
    /// Wish of the user to stop.
    pub shutdown: &'a Shutdown,
}

impl Planner<'_> {
    /// Fitting problem of recordings of these paths, which are not measured yet.
    pub fn episodes(&self, paths: &[&GripTrajectory]) -> Vec<MeasuredEpisode> {
        let planned =
            |path: &&GripTrajectory| MeasuredEpisode::planned_along(self.model, (*path).clone(), &self.settings);
        paths.iter().map(planned).collect()
    }

    /// Answer of a round: whether to go on.
    pub fn go_on(&self) -> ControlFlow<()> {
        if self.shutdown.is_triggered() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
