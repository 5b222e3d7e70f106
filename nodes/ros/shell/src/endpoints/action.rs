//! Actions: servers that run each goal on its own thread, and clients with a timeout on every wait.

mod client;
mod goal;
mod goals;
mod server;
mod status;

pub use client::{ActionClient, RunningGoal};
pub use goal::{Concurrency, Decision, GoalHandle, Outcome};
pub use server::ActionServer;
pub use status::Status;
