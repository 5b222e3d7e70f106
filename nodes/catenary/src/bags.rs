//! `catenary record`, `catenary replay`, `catenary info` and `catenary reindex`.

mod arguments;
mod named;

use crate::interrupted::Interrupted;
use crate::output;
use crate::wrong_input::Given;
use anyhow::Result;
pub use arguments::{InfoArgs, RecordArgs, ReindexArgs, ReplayArgs};
use catenary_bag::{BagReader, TopicCount, episode_notes, record, reindex, replay};
use catenary_shell::{Node, NodeBuilder, RosArgs};
pub use named::Bags;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A node of this program that ends with Ctrl-C.
fn node(name: &str, arguments: &RosArgs) -> Result<Node> {
    let builder = NodeBuilder::new(name, arguments)?;
    catenary_shell::end_on_signals(builder.shutdown())?;
    Ok(builder.build()?)
}

/// What was recorded.
#[derive(Debug, Serialize)]
struct Recorded {
    bag: PathBuf,
    messages: u64,
    topics: Vec<(String, u64)>,
    files: Vec<String>,
}

/// Records until Ctrl-C.
pub fn run_record(arguments: &RecordArgs) -> Result<()> {
    // Before the middleware starts, whose warnings would come before the one line that helps.
    let settings = arguments.settings().given()?;
    let summary = record(&node("recorder", &RosArgs::default())?, &settings)?;
    let recorded =
        Recorded { bag: summary.path, messages: summary.messages, topics: summary.topics, files: summary.files };
    output::result(&arguments.output, &recorded, |r| {
        let rows = r.topics.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{n:>8} {name}"));
        let rows: Vec<String> = rows.collect();
        let files = if r.files.len() > 1 { format!(" in {} files", r.files.len()) } else { String::new() };
        format!("{}: {} messages{files}\n{}", r.bag.display(), r.messages, rows.join("\n"))
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

/// Replays a bag once, or until Ctrl-C.
pub fn run_replay(arguments: &ReplayArgs) -> Result<()> {
    let settings = arguments.settings().given()?;
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
        true => Err(Interrupted(format!(" after {} messages", replayed.published)).into()),
        false => Ok(()),
    }
}

/// A topic of a bag.
#[derive(Debug, Serialize)]
struct TopicInfo {
    name: String,
    #[serde(rename = "type")]
    type_name: String,
    messages: u64,
    type_hash: Option<String>,
    offered_qos: Vec<String>,
}

/// What a bag holds.
#[derive(Debug, Serialize)]
struct BagInfo {
    bag: PathBuf,
    messages: u64,
    /// Messages that can be read; none: the index alone was looked at.
    readable: Option<u64>,
    start_ns: Option<i64>,
    duration_s: f64,
    files: Vec<PathBuf>,
    topics: Vec<TopicInfo>,
    /// What is missing, damaged or doubtful.
    notes: Vec<String>,
}

/// Damaged places that are listed; of more the number is said.
const LISTED: usize = 10;

impl BagInfo {
    fn new(bag: &BagReader, index_only: bool) -> Self {
        let mut notes = bag.notes().to_vec();
        let verified = (!index_only).then(|| bag.verify());
        if let Some((readable, damage)) = &verified {
            if *readable != bag.message_count() {
                let (path, all) = (bag.path().display(), bag.message_count());
                notes.push(format!("{path}: {readable} of {all} messages can be read"));
            }
            notes.extend(damage.iter().take(LISTED).cloned());
            let more = damage.len().saturating_sub(LISTED);
            notes.extend((more > 0).then(|| format!("and {more} more damaged places")));
            notes.extend(episode_notes(bag));
        }
        let topic = |t: &TopicCount| TopicInfo {
            name: t.topic.name.clone(),
            type_name: t.topic.type_name.clone(),
            messages: t.messages,
            type_hash: t.topic.type_hash.clone(),
            offered_qos: t.topic.qos.iter().map(ToString::to_string).collect(),
        };
        Self {
            bag: bag.path().to_owned(),
            messages: bag.message_count(),
            readable: verified.map(|(readable, _)| readable),
            start_ns: bag.span_ns().map(|(first, _)| first),
            duration_s: bag.span_ns().map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9),
            files: bag.files().map(Path::to_owned).collect(),
            topics: bag.topics().iter().map(topic).collect(),
            notes,
        }
    }

    fn text(&self) -> String {
        let files = if self.files.len() == 1 { String::new() } else { format!(" in {} files", self.files.len()) };
        let index = if self.readable.is_none() { ", by the index alone" } else { "" };
        let head =
            format!("{}: {} messages in {:.3} s{files}{index}", self.bag.display(), self.messages, self.duration_s);
        let row = |t: &TopicInfo| {
            let head = format!("{:>8} {} [{}]", t.messages, t.name, t.type_name);
            // In one line where it fits a terminal.
            match t.offered_qos.as_slice() {
                [] => head,
                [one] if head.len() + 1 + one.len() <= 80 => format!("{head} {one}"),
                several => format!("{head}\n{:>8} {}", "", several.join(&format!("\n{:>8} ", ""))),
            }
        };
        let rows = self.topics.iter().map(row);
        std::iter::once(head).chain(rows).chain(self.notes.iter().cloned()).collect::<Vec<_>>().join("\n")
    }
}

/// Says what a bag holds, and what of it is missing or damaged.
pub fn run_info(arguments: &InfoArgs) -> Result<()> {
    let bags = arguments.bags.all().iter().map(|bag| BagReader::open(bag)).collect::<Result<Vec<_>, _>>().given()?;
    let infos: Vec<BagInfo> = bags.iter().map(|bag| BagInfo::new(bag, arguments.index_only)).collect();
    output::one_or_several(&arguments.output, &infos, BagInfo::text)
}

/// What was missing of a bag, and what it holds now.
#[derive(Debug, Serialize)]
struct Reindexed {
    bag: PathBuf,
    messages: u64,
    notes: Vec<String>,
}

/// Finishes the files of a bag and writes its `metadata.yaml` anew.
pub fn run_reindex(arguments: &ReindexArgs) -> Result<()> {
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
