//! `catenary reindex`: repair of a bag whose recorder was killed.

use super::args::ReindexArgs;
use crate::terminal::output;
use anyhow::Result;
use catenary_bag::{BagReader, reindex};
use serde::Serialize;
use std::path::PathBuf;

/// Result of `catenary reindex` for one bag.
#[derive(Debug, Serialize)]
struct Reindexed {
    bag: PathBuf,
    messages: u64,
    notes: Vec<String>,
}

/// Closes the files of each bag and rewrites its `metadata.yaml`.
pub fn run(arguments: &ReindexArgs) -> Result<()> {
    let mut all = Vec::new();
    for bag in arguments.bags.all() {
        let notes = reindex(bag)?;
        let messages = BagReader::open(bag)?.message_count();
        all.push(Reindexed { bag: bag.clone(), messages, notes });
    }
    output::one_or_several(&arguments.output, &all, |r| {
        let notes: String = r.notes.iter().map(|note| format!("\n{note}")).collect();
        format!("{}: {} messages{notes}", r.bag.display(), r.messages)
    })
}
