//! Parameters: the command line with its files, names and remaps, and typed parameters with descriptions and limits.

pub(crate) mod args;
pub mod files;
pub(crate) mod help;
pub(crate) mod kinds;
pub(crate) mod model_file;
pub mod names;
pub(crate) mod spec;
pub(crate) mod store;
pub(crate) mod yaml;

#[cfg(test)]
mod tests;
