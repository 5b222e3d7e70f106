//! Process: a node with its threads, logs, health and services, from the command line to the orderly end.

pub(crate) mod builder;
pub(crate) mod ending;
pub(crate) mod health;
pub(crate) mod logging;
mod memory_limit;
pub(crate) mod network_loss;
pub(crate) mod node;
mod parameter_services;
pub(crate) mod ros_home;
pub(crate) mod run;
mod spinner;
pub(crate) mod states;
pub(crate) mod threads;
mod type_description;
