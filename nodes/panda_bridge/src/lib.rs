//! Between target poses and a Panda.
//!
//! Does: judge every command before it reaches an arm (`gate`), plan the way to the start pose (`path`), lead an arm or a
//! controller along it (`arm`), check compliance settings, know the arm's kinematics. With the feature `node`: serve the
//! contract's side of an arm (`node::front`), and relay targets to a ROS 2 Cartesian impedance controller (`node::relay`).
//! Does not: trust anybody, read clocks (times are arguments, or the plant's), control torques.

pub mod arm;
pub mod compliance;
#[cfg(feature = "node")]
pub mod convert;
pub mod gate;
pub mod kinematics;
#[cfg(feature = "node")]
pub mod node;
pub mod path;
pub mod pose;

pub use arm::{Arm, ArmError, ArmSettings, Plant, Progress};
pub use compliance::Compliance;
pub use gate::{Clip, Command, GateSettings, Mode, Order, Refusal, Rejection, Rivals, SafetyGate, StepPeriod, Verdict};
pub use path::StartPath;
pub use pose::ArmPose;
