#![doc = include_str!("../README.md")]

pub mod arm;
pub mod backend;
pub mod beam;
pub mod effects;
pub mod episode;
pub mod episode_model;
pub mod fingerprint;
mod imperfect_camera;
pub mod model_text;
pub mod parameters;
#[cfg(feature = "rapier_fem")]
pub mod rapier_fem;
pub mod sensitivity;
pub mod simulator;
pub mod vector_env;
pub mod verification;
pub mod workers;
mod wrench_sensor;

pub use backend::Backend;
pub use effects::Registry;
pub use episode_model::EpisodeModel;
pub use fingerprint::fingerprint;
pub use simulator::BeamSimulator;
pub use vector_env::VectorEnv;
