//! `catenary infer`: a posterior over the model's parameters from bags.

pub mod args;
pub mod local;
pub mod on_graph;
mod page;
mod predicted;
pub mod words;

use crate::inputs::model_file;
use anyhow::Result;
use args::InferArgs;

/// Infers in this process, or with `--node` on the running graph.
pub fn run(arguments: &InferArgs) -> Result<()> {
    let (model, text) = model_file::read_with_text(&arguments.model)?;
    match &arguments.on_graph.node {
        Some(namespace) => on_graph::run(arguments, &model, text, namespace),
        None => local::run(arguments, &model),
    }
}
