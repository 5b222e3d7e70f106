//! One simulated episode: conditions, the simulation of beam, arm and camera, and the steps of a task.

mod conditions;
mod run;
mod simulation;
mod steps;

pub use conditions::{Conditions, jittered_target};
pub use run::run;
pub use simulation::EpisodeSimulation;
pub use steps::{StopCriterion, never_stop, verdict};

pub(crate) use conditions::effects_of;
#[cfg(feature = "rapier_fem")]
pub(crate) use simulation::keypoint_fractions;
#[cfg(feature = "rapier_fem")]
pub(crate) use steps::{Path, execute, frame, given};
