//! `catenary record`: topics of the graph into a bag.

use super::args::RecordArgs;
use super::node::node;
use crate::exit::Given;
use crate::terminal::output;
use anyhow::Result;
use catenary_bag::record;
use catenary_shell::RosArgs;
use serde::Serialize;
use std::path::PathBuf;

/// Result of `catenary record`.
#[derive(Debug, Serialize)]
struct Recorded {
    bag: PathBuf,
    messages: u64,
    topics: Vec<(String, u64)>,
    files: Vec<String>,
}

/// Records until Ctrl-C.
pub fn run(arguments: &RecordArgs) -> Result<()> {
    // Checked before the middleware starts: its warnings would hide the one line that explains the error.
    let settings = arguments.settings().given()?;
    let simulated = ["--ros-args", "-p", "use_sim_time:=true"].map(str::to_owned);
    let (ros, _) = RosArgs::parse(simulated.into_iter().filter(|_| arguments.use_sim_time))?;
    let summary = record(&node("recorder", &ros)?, &settings)?;
    let recorded =
        Recorded { bag: summary.path, messages: summary.messages, topics: summary.topics, files: summary.files };
    output::result(&arguments.output, &recorded, |r| {
        let rows = r.topics.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{n:>8} {name}"));
        let rows: Vec<String> = rows.collect();
        let files = if r.files.len() > 1 { format!(" in {} files", r.files.len()) } else { String::new() };
        format!("{}: {} messages{files}\n{}", r.bag.display(), r.messages, rows.join("\n"))
    })
}
