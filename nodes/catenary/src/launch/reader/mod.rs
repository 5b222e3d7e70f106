//! Reader of launch files: elements, attributes, substitutions and typed values.

mod element;
mod file;
mod functions;
mod namespace;
mod package;
mod parameter;
mod process;
mod python;
mod scope;
mod state;
mod substitution;
#[cfg(test)]
mod tests;
mod value;

pub use file::read;
