#![doc = include_str!("../README.md")]

pub mod arm;
pub mod compliance;
#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod fci;
pub mod gate;
pub mod kinematics;
pub mod law;
#[cfg(feature = "node")]
pub mod node;
pub mod path;
pub mod pose;
pub mod speed;

pub use arm::{Arm, ArmError, ArmSettings, Plant, Progress, Surroundings};
pub use compliance::Compliance;
pub use gate::{
    Clip, Command, GateSettings, Heard, Mode, Order, Refusal, Rejection, Rivals, SafetyGate, StepPeriod, Stranger,
    Verdict, Writer,
};
pub use path::StartPath;
pub use pose::ArmPose;
pub use speed::SpeedLimit;
