//! The simulator: planar beam physics, effects, parameters, episodes, the vectorised environment, the scene and its picture, and the
//! simulated cell.
//!
//! Does: turn a model and its parameters into tracks, rewards, images and measurements, and prove itself against theory.
//! Does not: know ROS (the `node` feature does), read files or clocks, infer or train. Its workers are the one place where
//! pure code starts threads, and they change no bit of a result.

pub mod arm;
pub mod backend;
pub mod beam;
pub mod cell;
#[cfg(feature = "node")]
pub mod convert;
pub mod effects;
pub mod episode;
pub mod fingerprint;
pub mod model_text;
#[cfg(feature = "node")]
pub mod node;
pub mod parameters;
#[cfg(feature = "rapier_fem")]
pub mod rapier_fem;
pub mod render;
pub mod scene;
pub mod sensitivity;
pub mod simulator;
pub mod vector_env;
pub mod verification;
mod view;
pub mod workers;
pub mod world;

pub use backend::Backend;
pub use effects::Registry;
pub use fingerprint::fingerprint;
pub use simulator::BeamSimulator;
pub use vector_env::VectorEnv;
pub use world::World;
