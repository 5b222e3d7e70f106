//! Typed parameters: declared with a default, a description and limits, read by the node without waiting, and
//! listed, described and set from outside through the parameter services.

mod kinds;
pub(crate) mod services;
mod spec;
mod store;

#[cfg(test)]
mod tests;

pub use kinds::{ParamKind, Value};
pub use spec::ParamSpec;
pub use store::{Change, Description, Param, ParamError, Params};
