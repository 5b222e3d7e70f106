//! Endpoints of a node: publishers, subscriptions, services and actions, and the report of their health.

pub(crate) mod action;
pub(crate) mod diagnostics;
pub(crate) mod intake;
mod late_join;
pub(crate) mod latest;
pub(crate) mod neighbours;
pub(crate) mod publisher;
pub(crate) mod raw;
pub(crate) mod service;
pub(crate) mod stamp_check;
mod subscribe;
pub(crate) mod subscription;
pub(crate) mod tally;
