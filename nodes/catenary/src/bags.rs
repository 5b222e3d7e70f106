//! `catenary record` and `catenary replay`.

use crate::cli::{RecordArgs, ReplayArgs};
use crate::interrupted::Interrupted;
use crate::output;
use anyhow::Result;
use catenary_bag::{RecordSettings, ReplaySettings, record, replay};
use catenary_shell::{Node, NodeBuilder, RosArgs};
use serde::Serialize;
use std::path::PathBuf;

/// A node of this program that ends with Ctrl-C.
fn node(name: &str) -> Result<Node> {
    let builder = NodeBuilder::new(name, &RosArgs::default())?;
    catenary_shell::end_on_signals(builder.shutdown())?;
    Ok(builder.build()?)
}

/// What was recorded.
#[derive(Debug, Serialize)]
struct Recorded {
    bag: PathBuf,
    messages: u64,
    topics: Vec<(String, u64)>,
}

/// Records until Ctrl-C.
pub fn run_record(arguments: &RecordArgs) -> Result<()> {
    let settings = RecordSettings {
        topics: arguments.topics.clone(),
        images: arguments.images,
        ..RecordSettings::new(arguments.out.clone())
    };
    // Before the middleware starts, whose warnings would come before the one line that helps.
    settings.check()?;
    let summary = record(&node("recorder")?, &settings)?;
    let recorded = Recorded { bag: summary.path, messages: summary.messages, topics: summary.topics };
    output::result(&arguments.output, &recorded, |r| {
        let rows = r.topics.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{n:>8} {name}"));
        let rows: Vec<String> = rows.collect();
        format!("{}: {} messages\n{}", r.bag.display(), r.messages, rows.join("\n"))
    })
}

/// What was replayed.
#[derive(Debug, Serialize)]
struct Replayed {
    bag: PathBuf,
    published: u64,
    failed: u64,
    left_out: Vec<String>,
}

/// Replays a bag once.
pub fn run_replay(arguments: &ReplayArgs) -> Result<()> {
    let settings = ReplaySettings {
        rate: arguments.rate,
        start_offset_s: arguments.start_offset_s,
        clock: arguments.clock,
        allow_replay: arguments.allow_replay,
        allow_others: arguments.allow_others,
        ..ReplaySettings::new(arguments.bag.clone())
    };
    settings.open()?;
    let node = node("replayer")?;
    let summary = replay(&node, &settings)?;
    let replayed = Replayed {
        bag: arguments.bag.clone(),
        published: summary.published,
        failed: summary.failed,
        left_out: summary.left_out,
    };
    output::result(&arguments.output, &replayed, |r| {
        let left_out: String = r.left_out.iter().map(|l| format!("\nnot replayed: {l}")).collect();
        format!("{}: {} messages published, {} lost{left_out}", r.bag.display(), r.published, r.failed)
    })?;
    match node.is_shutdown() {
        true => Err(Interrupted(format!(" after {} messages", replayed.published)).into()),
        false => Ok(()),
    }
}
