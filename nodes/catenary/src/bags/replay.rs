//! `catenary replay`: messages of a bag to the graph.

use super::args::ReplayArgs;
use super::node::node;
use crate::exit::{Given, Interrupted};
use crate::terminal::output;
use anyhow::Result;
use catenary_bag::replay;
use catenary_shell::RosArgs;
use serde::Serialize;
use std::path::PathBuf;

/// Result of `catenary replay`.
#[derive(Debug, Serialize)]
struct Replayed {
    bag: PathBuf,
    published: u64,
    failed: u64,
    left_out: Vec<String>,
}

/// Replays a bag once, or until Ctrl-C.
pub fn run(arguments: &ReplayArgs) -> Result<()> {
    let settings = arguments.settings().given()?;
    // The replayer is a node, so that its remaps take the form of a node's arguments.
    let remaps = arguments.remap.iter().flat_map(|rule| ["--remap".to_owned(), rule.clone()]);
    let (ros, _) = RosArgs::parse(std::iter::once("--ros-args".to_owned()).chain(remaps))?;
    let node = node("replayer", &ros)?;
    let summary = replay(&node, &settings)?;
    let replayed = Replayed {
        bag: settings.bag.clone(),
        published: summary.published,
        failed: summary.failed,
        left_out: summary.left_out,
    };
    output::result(&arguments.output, &replayed, |r| {
        let left_out: String = r.left_out.iter().map(|l| format!("\nnot replayed: {l}")).collect();
        format!("{}: {} messages published, {} lost{left_out}", r.bag.display(), r.published, r.failed)
    })?;
    match node.is_shutdown() {
        // A replay cut short by Ctrl-C is no success for a script that waits for it.
        true => Err(Interrupted(format!(" after {} messages", replayed.published)).into()),
        false => Ok(()),
    }
}
