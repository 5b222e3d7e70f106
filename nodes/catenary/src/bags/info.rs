//! `catenary info`: contents and damage of a bag.

use super::args::InfoArgs;
use crate::exit::{Given, Interrupted, WrongInput};
use crate::terminal::output;
use anyhow::Result;
use catenary_bag::{BagReader, TopicCount, Verified, episode_notes, latched_elsewhere};
use catenary_shell::Shutdown;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One topic of a bag.
#[derive(Debug, Serialize)]
struct TopicInfo {
    name: String,
    #[serde(rename = "type")]
    type_name: String,
    encoding: String,
    /// Type and encoding in words.
    #[serde(skip)]
    kind: String,
    messages: u64,
    type_hash: Option<String>,
    offered_qos: Vec<String>,
}

/// Result of `catenary info` for one bag.
#[derive(Debug, Serialize)]
struct BagInfo {
    bag: PathBuf,
    messages: u64,
    /// Number of messages that can be read; `None` if only the index was read.
    readable: Option<u64>,
    start_ns: Option<i64>,
    duration_s: f64,
    files: Vec<PathBuf>,
    topics: Vec<TopicInfo>,
    /// Entries about the recording as a whole, from its metadata.
    custom_data: BTreeMap<String, String>,
    /// Missing, damaged or doubtful parts of the bag, one sentence each.
    notes: Vec<String>,
}

/// Largest number of damaged places that are listed one by one.
const LISTED: usize = 10;

impl BagInfo {
    fn new(bag: &BagReader, index_only: bool) -> Self {
        let mut notes = [bag.notes(), bag.far_notes()].concat();
        notes.extend(latched_elsewhere(bag));
        let verified = (!index_only).then(|| bag.verify());
        if let Some(Verified { readable, damaged, damage }) = &verified {
            if *readable != bag.message_count() {
                let (path, all) = (bag.path().display(), bag.message_count());
                notes.push(format!("{path}: {readable} of {all} messages can be read"));
            }
            notes.extend(damage.iter().take(LISTED).cloned());
            let more = damaged.saturating_sub(LISTED as u64);
            notes.extend((more > 0).then(|| format!("and {more} more damaged places")));
            let is_new = |note: &String| !repeats(note, damage, bag.path());
            notes.extend(episode_notes(bag).into_iter().filter(is_new));
        }
        let topic = |t: &TopicCount| TopicInfo {
            name: t.topic.name.clone(),
            type_name: t.topic.type_name.clone(),
            encoding: t.topic.encoding.clone(),
            kind: t.topic.describe_type(),
            messages: t.messages,
            type_hash: t.topic.type_hash.clone(),
            offered_qos: t.topic.qos.iter().map(ToString::to_string).collect(),
        };
        Self {
            bag: bag.path().to_owned(),
            messages: bag.message_count(),
            readable: verified.map(|verified| verified.readable),
            start_ns: bag.span_ns().map(|(first, _)| first),
            duration_s: bag.span_ns().map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9),
            files: bag.files().map(Path::to_owned).collect(),
            topics: bag.topics().iter().map(topic).collect(),
            custom_data: bag.custom_data().clone(),
            notes,
        }
    }

    /// Error text for a bag that had messages, or whose files are damaged, and of which nothing can be read. `missing` are the notes of its files.
    fn unreadable(&self, missing: &[String]) -> Option<String> {
        let had_some = self.messages > 0 || !missing.is_empty();
        (self.readable == Some(0) && had_some).then(|| {
            let reason = self.notes.first().map_or("no message is whole", String::as_str);
            let reason = reason.strip_prefix(&format!("{}: ", self.bag.display())).unwrap_or(reason);
            format!("{}: nothing in it can be read: {reason}", self.bag.display())
        })
    }

    fn text(&self) -> String {
        let files = if self.files.len() == 1 { String::new() } else { format!(" in {} files", self.files.len()) };
        let index = if self.readable.is_none() { ", by the index alone" } else { "" };
        let head =
            format!("{}: {} messages in {:.3} s{files}{index}", self.bag.display(), self.messages, self.duration_s);
        let row = |t: &TopicInfo| {
            let head = format!("{:>8} {} [{}]", t.messages, t.name, t.kind);
            // One line if it fits a terminal of 80 columns.
            match t.offered_qos.as_slice() {
                [] => head,
                [one] if head.len() + 1 + one.len() <= 80 => format!("{head} {one}"),
                several => format!("{head}\n{:>8} {}", "", several.join(&format!("\n{:>8} ", ""))),
            }
        };
        let rows = self.topics.iter().map(row);
        let data = self.custom_data.iter().map(|(key, text)| format!("{key}: {text}"));
        std::iter::once(head).chain(rows).chain(data).chain(self.notes.iter().cloned()).collect::<Vec<_>>().join("\n")
    }
}

/// True if a note on the episodes only repeats one of the damaged places of the bag at `path`.
fn repeats(note: &str, damage: &[String], path: &Path) -> bool {
    // Notes name the bag first, and leave its path out of the reason that follows.
    let prefix = format!("{}: ", path.display());
    damage.iter().any(|place| note.ends_with(place.strip_prefix(&prefix).unwrap_or(place)))
}

/// Prints the contents of each bag, and which parts are missing or damaged.
pub fn run(arguments: &InfoArgs) -> Result<()> {
    // A long reading looks at the signal.
    catenary_shell::end_on_signals(&Shutdown::new())?;
    let bags = arguments.bags.all().iter().map(|bag| BagReader::open(bag)).collect::<Result<Vec<_>, _>>().given()?;
    let infos: Vec<BagInfo> = bags.iter().map(|bag| BagInfo::new(bag, arguments.index_only)).collect();
    if catenary_shell::is_signalled() {
        return Err(Interrupted(String::new()).into());
    }
    output::one_or_several(&arguments.output, &infos, BagInfo::text)?;
    match bags.iter().zip(&infos).find_map(|(bag, info)| info.unreadable(bag.notes())) {
        Some(what) => Err(WrongInput::error(what)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bag_without_a_readable_message_is_an_error_and_an_empty_one_is_not() {
        let info = |messages, readable, notes: &[&str]| BagInfo {
            bag: "b".into(),
            messages,
            readable,
            start_ns: None,
            duration_s: 0.0,
            files: Vec::new(),
            topics: Vec::new(),
            custom_data: BTreeMap::new(),
            notes: notes.iter().map(|note| (*note).to_owned()).collect(),
        };
        let notes = ["b: 0 of 7 messages can be read".to_owned()];
        let words = info(7, Some(0), &[&notes[0]]).unreadable(&[]).unwrap();
        assert_eq!(words, "b: nothing in it can be read: 0 of 7 messages can be read");
        assert!(info(0, Some(0), &["b/b_0.mcap: damaged"]).unreadable(&["b/b_0.mcap: damaged".into()]).is_some());
        assert_eq!(info(0, Some(0), &["b: 0 episodes"]).unreadable(&[]), None);
        assert_eq!(info(7, Some(1), &[]).unreadable(&notes), None);
        assert_eq!(info(7, None, &[]).unreadable(&notes), None, "by the index alone nothing is known");
    }

    #[test]
    fn a_damaged_place_is_named_once() {
        let bag = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/swing");
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<PathBuf> = std::fs::read_dir(&bag).unwrap().map(|entry| entry.unwrap().path()).collect();
        for path in &names {
            let mut bytes = std::fs::read(path).unwrap();
            if path.extension().is_some_and(|ending| ending == "mcap") {
                // In the middle of the file lies a chunk of messages, whose checksum does not hold any more.
                let middle = bytes.len() / 2;
                bytes[middle] ^= 0xff;
            }
            std::fs::write(folder.path().join(path.file_name().unwrap()), bytes).unwrap();
        }
        for place in [folder.path().to_owned(), folder.path().join("swing_0.mcap")] {
            let bag = BagReader::open(&place).unwrap();
            let damage = bag.verify().damage;
            let notes = BagInfo::new(&bag, false).notes;
            assert!(!damage.is_empty(), "{notes:?}");
            for place in damage {
                let reason = place.split_once(": ").unwrap().1;
                assert_eq!(notes.iter().filter(|note| note.ends_with(reason)).count(), 1, "{reason}: {notes:?}");
            }
        }
    }
}
