//! Records topics of the contract into a bag.
#![allow(clippy::disallowed_methods, reason = "recording follows the wall clock")]

use crate::backlog::Backlog;
use crate::error::BagError;
use crate::kinds::{self, Kind};
use crate::reader::reindex;
use crate::writer::{BagSummary, BagWriter, Compression, TopicId, WriterOptions};
use catenary_shell::contract::{self, Topic};
use catenary_shell::{Health, Node, Qos, Subscription, Throttle, Time, wall_now};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Wall time after which what came is in the file: what a killed recorder loses.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);
/// How often the writing thread looks whether it shall end.
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// Bytes that wait for the disk at most.
const BACKLOG_BYTES: usize = 256 << 20;
/// Messages that a subscription keeps at most, of large types and of others.
const DEPTHS: (u16, u16) = (16, 256);
/// Complaints about lost messages come at most this often.
const COMPLAIN: Duration = Duration::from_secs(5);

/// What is recorded, and whereto.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordSettings {
    /// Folder of the bag; it must not exist yet.
    pub out: PathBuf,
    /// Names of topics of the contract, with `*` at the end for all that begin so; none: all but `/clock`.
    pub topics: Vec<String>,
    /// Whether the camera's images are among all.
    pub images: bool,
    /// Compression of the chunks.
    pub compression: Compression,
}

impl RecordSettings {
    /// All topics but images and `/clock`, compressed.
    #[must_use]
    pub fn new(out: PathBuf) -> Self {
        Self { out, topics: Vec::new(), images: false, compression: Compression::default() }
    }

    /// Rejects topics that the contract does not have, and a folder that is there or cannot be made.
    ///
    /// # Errors
    /// [`BagError::Setting`], [`BagError::Exists`], [`BagError::Io`].
    pub fn check(&self) -> Result<(), BagError> {
        self.chosen()?;
        if self.out.exists() {
            return Err(BagError::Exists { path: self.out.clone() });
        }
        let parents = self.out.ancestors().skip(1).map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
        let Some(nearest) = parents.into_iter().find(|p| p.exists()) else { return Ok(()) };
        let refuse = |kind: ErrorKind| Err(BagError::io("make the folder", &self.out)(kind.into()));
        match std::fs::metadata(nearest) {
            Ok(found) if !found.is_dir() => refuse(ErrorKind::NotADirectory),
            Ok(found) if found.permissions().readonly() => refuse(ErrorKind::PermissionDenied),
            Ok(_) => Ok(()),
            Err(e) => Err(BagError::io("look at", nearest)(e)),
        }
    }

    /// The topics that are meant.
    fn chosen(&self) -> Result<Vec<&'static Topic>, BagError> {
        let all = contract::TOPICS.iter();
        if self.topics.is_empty() {
            let usual = |t: &&Topic| **t != contract::CLOCK && (self.images || **t != contract::IMAGE);
            return Ok(all.filter(usual).collect());
        }
        let mut chosen: Vec<&Topic> = Vec::new();
        for name in &self.topics {
            let bare = name.trim_start_matches('/');
            let meant = |t: &&Topic| match bare.strip_suffix('*') {
                Some(start) => t.name.trim_start_matches('/').starts_with(start),
                None => t.name.trim_start_matches('/') == bare,
            };
            let found: Vec<&Topic> = all.clone().filter(meant).collect();
            if found.is_empty() {
                let names: Vec<String> = all.map(|t| format!("/{}", t.name.trim_start_matches('/'))).collect();
                let expected = format!("some of {}", names.join(", "));
                return Err(BagError::Setting { name: "topics", expected, got: format!("{name:?}") });
            }
            chosen.extend(found.into_iter().filter(|t| !chosen.contains(t)).collect::<Vec<_>>());
        }
        Ok(chosen)
    }
}

/// Records until the node is told to end, then ends the bag in order.
///
/// A message is logged at the time at which it came, in the node's clock, and published at the time at which it was sent,
/// in the sender's. Under simulated time recording begins with the first `/clock`. The folder appears when all
/// subscriptions are there. A message is in the file a second after it came at the latest.
///
/// # Errors
/// [`BagError`]: unknown topics, an existing folder, the graph, the disk. A full disk ends the recording; the bag can be
/// read up to its last complete chunk.
pub fn record(node: &Node, settings: &RecordSettings) -> Result<BagSummary, BagError> {
    settings.check()?;
    let topics = settings.chosen()?;
    wait_for_clock(node);
    let backlog = Arc::new(Backlog::new(BACKLOG_BYTES));
    let mut subscriptions = Vec::new();
    let mut names = Vec::new();
    for (i, topic) in topics.iter().enumerate() {
        let kind = kind_of(topic)?;
        subscriptions.push(subscribe(node, topic, kind, i, &backlog)?);
        names.push((node.resolve(topic.name)?, kind, topic.qos));
    }
    let options = WriterOptions { compression: settings.compression, ..WriterOptions::default() };
    let mut bag = BagWriter::create(&settings.out, &options)?;
    let mut ids = Vec::new();
    for (name, kind, qos) in names {
        ids.push(bag.add_topic(&name, &kind.info, qos)?);
    }
    let counted = Arc::clone(&backlog);
    node.report_diagnostics(move |report| {
        let (messages, lost) = counted.counts();
        report.value("messages", messages).value("lost", lost);
        if lost > 0 {
            report.problem(Health::Error, "messages were lost because the disk is too slow");
        }
    })?;
    tracing::info!("recording {} topics into {}", topics.len(), settings.out.display());
    let written = write_until_shutdown(node, &mut bag, &ids, &backlog);
    drop(subscriptions);
    if let Err(error) = written {
        drop(bag);
        if let Err(also) = reindex(&settings.out) {
            tracing::warn!("metadata.yaml stays as it was at the start: {also}");
        }
        return Err(error);
    }
    let (_, lost) = backlog.counts();
    if lost > 0 {
        tracing::error!("{lost} messages were lost because the disk is too slow");
    }
    bag.finish()
}

fn wait_for_clock(node: &Node) {
    let waiting = || node.clock().is_simulated() && node.now() == Time::ZERO;
    if waiting() {
        tracing::info!("waiting for /clock");
    }
    while waiting() && !node.shutdown().wait_timeout(LOOK_PERIOD / 10) {}
}

fn kind_of(topic: &Topic) -> Result<&'static Kind, BagError> {
    kinds::find(topic.type_name).ok_or_else(|| BagError::Setting {
        name: "topics",
        expected: "topics whose type can be recorded".to_owned(),
        got: format!("{} of type {}", topic.name, topic.type_name),
    })
}

fn subscribe(
    node: &Node,
    topic: &Topic,
    kind: &Kind,
    number: usize,
    backlog: &Arc<Backlog>,
) -> Result<Subscription, BagError> {
    let (backlog, name) = (Arc::clone(backlog), topic.name);
    let mut complaint = Throttle::new(COMPLAIN);
    let inbox = Box::new(move |arrival| {
        if !backlog.push(number, arrival)
            && let Some(before) = complaint.pass(wall_now())
        {
            tracing::error!("{name}: a message was lost because the disk is too slow (and {before} before)");
        }
    });
    Ok(kind.subscribe(node, topic.name, reader_qos(topic.qos, kind), inbox)?)
}

/// The topic's profile, deep enough for bursts. What a latched topic keeps of the past stays the contract's.
fn reader_qos(qos: Qos, kind: &Kind) -> Qos {
    let depth = if kind.is_large { DEPTHS.0 } else { DEPTHS.1 };
    if qos.is_transient_local() { qos } else { qos.with_depth(qos.depth().max(depth)) }
}

fn write_until_shutdown(
    node: &Node,
    bag: &mut BagWriter,
    topics: &[TopicId],
    backlog: &Backlog,
) -> Result<(), BagError> {
    let mut flush_at = Instant::now() + FLUSH_PERIOD;
    loop {
        let ending = node.is_shutdown();
        let patience = if ending { Duration::ZERO } else { LOOK_PERIOD };
        match backlog.next(patience) {
            Some((number, arrival)) => {
                let sent = arrival.sent.unwrap_or(arrival.received);
                bag.write_cdr(topics[number], arrival.received.nanos(), sent.nanos(), &arrival.cdr)?;
            }
            None if ending => return Ok(()),
            None => {}
        }
        if Instant::now() >= flush_at {
            bag.flush()?;
            flush_at = Instant::now() + FLUSH_PERIOD;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(topics: &[&str], images: bool) -> Result<Vec<&'static str>, BagError> {
        let topics = topics.iter().map(|t| (*t).to_owned()).collect();
        let settings = RecordSettings { topics, images, ..RecordSettings::new("bag".into()) };
        Ok(settings.chosen()?.iter().map(|t| t.name).collect())
    }

    #[test]
    fn all_but_clock_and_images_are_recorded_unless_told_otherwise() {
        let usual = chosen(&[], false).unwrap();
        assert_eq!(usual.len(), contract::TOPICS.len() - 2);
        assert!(!usual.contains(&contract::CLOCK.name) && !usual.contains(&contract::IMAGE.name));
        assert!(chosen(&[], true).unwrap().contains(&contract::IMAGE.name));
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_refused_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let words = |out: PathBuf| RecordSettings::new(out).check().map_err(|e| e.to_string());
        assert!(words(file.join("bag")).unwrap_err().contains("cannot make the folder: not a directory"));
        assert!(words(file).unwrap_err().contains("expected a folder that does not exist yet"));
        assert_eq!(words(folder.path().join("a/b/bag")), Ok(()));
        assert_eq!(words("bag".into()), Ok(()));
    }

    #[test]
    fn topics_are_chosen_by_name_or_beginning() {
        let policy = ["policy/action", "policy/observation"];
        assert_eq!(chosen(&["/policy/*", "policy/action"], false).unwrap(), policy);
        assert_eq!(chosen(&["clock"], false).unwrap(), ["/clock"]);
        let error = chosen(&["/policy/acton"], false).unwrap_err().to_string();
        assert!(error.contains("/policy/acton") && error.contains("/policy/action"), "{error}");
    }

    #[test]
    fn subscriptions_are_deep_enough_for_bursts_but_hear_no_more_of_the_past() {
        let depth = |topic: Topic| reader_qos(topic.qos, kind_of(&topic).unwrap()).depth();
        assert_eq!((depth(contract::CURRENT_POSE), depth(contract::IMAGE), depth(contract::ARM_STATE)), (256, 16, 1));
    }
}
