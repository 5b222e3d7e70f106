//! The language every crate of catenary speaks.
//!
//! Does: the types that algorithms exchange (parameters, tracks, episodes, mixtures, cameras, keypoints, policies,
//! the model file) and the two traits through which inference and training reach a simulator.
//! Does not: know ROS, read files or clocks, start threads, simulate, train. No tensor library and no physics engine.

pub mod camera;
pub mod env;
pub mod episode;
pub mod grip;
pub mod hash;
pub mod image;
pub mod keypoints;
pub mod matrix;
pub mod mixture;
pub mod mlp;
pub mod model;
pub mod observation;
pub mod parameter;
pub mod policy;
pub mod posterior;
pub mod regions;
pub mod seed;
pub mod simulator;
pub mod spelling;
pub mod task;
pub mod track;

pub use camera::Camera;
pub use env::{Env, EnvError, Transition};
pub use episode::{Episode, EpisodeLog};
pub use grip::{GripPose, GripTrajectory};
pub use image::{LabelMask, RgbImage, RgbView};
pub use keypoints::{KeypointOrder, Keypoints};
pub use mixture::Mixture;
pub use mlp::Mlp;
pub use model::{Model, ModelError};
pub use observation::Observation;
pub use parameter::{Parameter, ParameterSpace, Prior, Weighted};
pub use policy::Policy;
pub use posterior::Posterior;
pub use simulator::{DifferentiableSimulator, Drive, Fidelity, SimulationRequest, Simulator, SimulatorError};
pub use task::{DeltaAnchor, Goal, Judge, Task};
pub use track::{Frame, Track};
