//! Between target poses and a Panda.
//!
//! Does: judge every command before it reaches an arm (`gate`), plan the way to the start pose (`path`), check compliance
//! settings, know the arm's kinematics.
//! Does not: trust anybody, read clocks (times are arguments), control torques.

pub mod compliance;
pub mod gate;
pub mod kinematics;
pub mod path;
pub mod pose;

pub use compliance::Compliance;
pub use gate::{Clip, Command, GateSettings, Mode, Order, Refusal, Rejection, SafetyGate, Verdict};
pub use path::StartPath;
pub use pose::ArmPose;
