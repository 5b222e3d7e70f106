//! `catenary find-effects`: disagreements of model and recordings, and the effects that explain them.

mod answer;
pub mod args;
mod local;
mod motion;
mod on_graph;
mod optional;
mod page;
mod report;

use crate::inputs::model_file;
use anyhow::Result;
use args::FindEffectsArgs;

/// Searches in this process, or with `--node` on the running graph.
pub fn run(arguments: &FindEffectsArgs) -> Result<()> {
    let (model, text) = model_file::read_with_text(&arguments.model)?;
    match &arguments.on_graph.node {
        Some(namespace) => on_graph::run(arguments, text, namespace),
        None => local::run(arguments, &model, &text),
    }
}
