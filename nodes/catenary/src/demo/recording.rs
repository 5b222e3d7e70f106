//! Recording of an episode: whether it is whole, and its fingerprint.

use anyhow::{Context, Result, bail, ensure};
use catenary_bag::{BagMessage, BagReader, EpisodeTopics};
use catenary_core::identity;
use catenary_msgs::msg::EpisodeEvent;
use catenary_shell::stamp;
use std::collections::BTreeMap;
use std::path::Path;

/// Returns the fingerprint of the last episode of a bag: of its keypoints, poses, observations and actions, stamps included. With `is_whole`,
/// as in lock step, a recording that lacks a pose or the first or last keypoints is an error.
///
/// # Errors
/// A bag that cannot be read, without a whole episode, or with a gap.
pub fn fingerprint(path: &Path, is_whole: bool) -> Result<String> {
    let topics = EpisodeTopics::default();
    let bag = BagReader::open(path)?;
    let messages: Vec<BagMessage> = bag.messages_of(&topics.names()).collect::<Result<_, _>>()?;
    let of = |name: &str| messages.iter().filter(|m| m.topic.name == name).collect::<Vec<_>>();
    let (mut start, mut end) = (None, None);
    for message in of(&topics.event) {
        let event: EpisodeEvent = message.decode()?;
        let at_ns = stamp::from_msg(&event.header.stamp).nanos();
        match event.event {
            EpisodeEvent::STARTED => (start, end) = (Some(at_ns), None),
            _ => end = Some(at_ns),
        }
    }
    let (Some(start_ns), Some(end_ns)) = (start, end) else {
        bail!("{}: expected the start and the end of an episode, the recorder missed one", path.display())
    };
    let mut told = BTreeMap::new();
    for name in [&topics.keypoints, &topics.pose, &topics.observation, &topics.action] {
        let mut inside: Vec<(i64, &[u8])> = Vec::new();
        for message in of(name) {
            let at_ns = header_ns(&message.data).with_context(|| format!("{}: {name}", path.display()))?;
            if (start_ns..=end_ns).contains(&at_ns) {
                inside.push((at_ns, &message.data));
            }
        }
        inside.sort_unstable();
        told.insert(name.as_str(), inside);
    }
    if is_whole {
        for name in [&topics.keypoints, &topics.pose] {
            let stamps: Vec<i64> = told[name.as_str()].iter().map(|(at_ns, _)| *at_ns).collect();
            let ends = [stamps.first().copied(), stamps.last().copied()];
            ensure!(
                ends == [Some(start_ns), Some(end_ns)],
                "{}: {name}: expected messages from {start_ns} to {end_ns} ns, got {ends:?}",
                path.display()
            );
        }
        let poses = &told[topics.pose.as_str()];
        let gaps = || poses.windows(2).map(|pair| pair[1].0 - pair[0].0);
        ensure!(gaps().min() == gaps().max(), "{}: {}: a message is missing", path.display(), topics.pose);
    }
    Ok(format!("{:016x}", identity::fingerprint(&told)))
}

/// Stamp of a message that begins with a header, ns.
fn header_ns(cdr: &[u8]) -> Option<i64> {
    let word = |at: usize| cdr.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    Some(i64::from(word(4)?.cast_signed()) * 1_000_000_000 + i64::from(word(8)?))
}
