//! Episodes in a bag, and in the running graph.

mod clocks;
mod convert;
#[cfg(feature = "node")]
mod live;

use crate::error::BagError;
use crate::reader::{BagMessage, BagReader};
use catenary_core::episode::MeasuredTrack;
use catenary_core::{EpisodeLog, Model};
use catenary_msgs::Interface;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{EefDelta, EpisodeEvent, Keypoints, Observation};
use catenary_shell::contract;
use clocks::Clocks;
pub use convert::Feed;
#[cfg(feature = "node")]
pub use live::LiveEpisodes;
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Names of the topics from which an episode is assembled.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodeTopics {
    /// Keypoints, `/dlo/keypoints` by default.
    pub keypoints: String,
    /// Poses of the hand, `/panda/current_pose` by default.
    pub pose: String,
    /// Observations, `/policy/observation` by default.
    pub observation: String,
    /// Actions, `/policy/action` by default.
    pub action: String,
    /// Starts and ends of episodes, `/episode/event` by default.
    pub event: String,
}

impl Default for EpisodeTopics {
    fn default() -> Self {
        let name = |topic: contract::Topic| format!("/{}", topic.name);
        Self {
            keypoints: name(contract::KEYPOINTS),
            pose: name(contract::CURRENT_POSE),
            observation: name(contract::OBSERVATION),
            action: name(contract::ACTION),
            event: name(contract::EPISODE_EVENT),
        }
    }
}

impl EpisodeTopics {
    /// All five names.
    #[must_use]
    pub fn names(&self) -> [&str; 5] {
        [&self.keypoints, &self.pose, &self.observation, &self.action, &self.event]
    }
}

/// Reads all messages of a bag that concern episodes into a log.
///
/// Unreadable and meaningless messages are left out, with a note for each topic. Clocks that step or differ, and frames
/// other than the contract's, are noted, too.
///
/// # Errors
/// [`BagError::NoTopic`] if the bag has none of the topics, [`BagError::Type`] if a topic has another type.
pub fn read_episodes(bag: &BagReader, topics: &EpisodeTopics) -> Result<EpisodeLog, BagError> {
    // Types are checked once for each topic: a wrong type concerns all of its messages.
    let present = topics.names().into_iter().filter_map(|name| bag.topic(name));
    if present.clone().next().is_none() {
        return Err(BagError::NoTopic {
            path: bag.path().to_owned(),
            needed: topics.names().join(", "),
            found: bag.describe_topics(),
        });
    }
    for entry in present {
        let topic = &entry.topic;
        match &topic.name {
            name if *name == topics.keypoints => topic.check::<Keypoints>(),
            name if *name == topics.pose => topic.check::<PoseStamped>(),
            name if *name == topics.observation => topic.check::<Observation>(),
            name if *name == topics.action => topic.check::<EefDelta>(),
            _ => topic.check::<EpisodeEvent>(),
        }?;
    }
    let mut log = EpisodeLog::default();
    let mut clocks = Clocks::default();
    let mut left_out: BTreeMap<String, (u64, String)> = BTreeMap::new();
    for message in bag.messages_of(&topics.names()) {
        let (place, outcome) = match message {
            Ok(message) => (message.topic.name.clone(), record(&mut log, &mut clocks, topics, &message)),
            Err(error) => (bag.path().display().to_string(), Err(error.to_string())),
        };
        if let Err(reason) = outcome {
            left_out.entry(place).or_insert_with(|| (0, reason)).0 += 1;
        }
    }
    for (place, (count, first)) in left_out {
        // Errors of the reader begin with the path, which the note already has.
        let first = first.strip_prefix(&format!("{place}: ")).unwrap_or(&first);
        log.note(match count {
            1 => format!("{place}: 1 message left out: {first}"),
            _ => format!("{place}: {count} messages left out, the first: {first}"),
        });
    }
    clocks.notes(&topics.pose).into_iter().for_each(|note| log.note(note));
    Ok(log)
}

/// Doubts about the episodes of a bag: stamps, clocks, frames, meaningless messages, and ends by a fault. Empty for a
/// bag without episode topics.
#[must_use]
pub fn episode_notes(bag: &BagReader) -> Vec<String> {
    let topics = EpisodeTopics::default();
    // A bag of other topics, or of other types on them, is a valid bag without episodes.
    let Ok(log) = read_episodes(bag, &topics) else { return Vec::new() };
    let episodes = log.episodes();
    // Events without a complete episode are a defect; a bag without events was recorded for another purpose.
    if episodes.is_empty() && bag.topic(&topics.event).is_some_and(|t| t.messages > 0) {
        return log.episode(None).err().map(|error| error.to_string()).into_iter().collect();
    }
    let doubts = episodes.iter().flat_map(|episode| {
        episode.doubts().into_iter().map(move |doubt| format!("episode {}: {doubt}", episode.number))
    });
    log.notes().into_iter().chain(doubts).collect()
}

/// Reads the measured tracks of episodes of one object, for the frames and the camera of `model`.
///
/// `numbers` chooses the episodes: any number of them for a single bag, or one for each of several bags. The number 0
/// is the last complete episode. Without numbers, the last complete episode of each bag is read.
///
/// # Errors
/// [`BagError::Setting`] if numbers and bags do not fit or an episode comes twice; [`BagError::Episode`] if an episode
/// is absent or lacks records that the model's drive needs; and those of [`read_episodes`].
pub fn read_measured(bags: &[PathBuf], numbers: &[u32], model: &Model) -> Result<Vec<MeasuredTrack>, BagError> {
    let setting = |name, expected: &str, got: String| BagError::Setting { name, expected: expected.to_owned(), got };
    let chosen: Vec<(&PathBuf, u32)> = match (bags, numbers) {
        ([], _) => return Err(setting("bags", "at least one bag", "none".into())),
        (_, []) => bags.iter().map(|bag| (bag, 0)).collect(),
        ([bag], _) => numbers.iter().map(|number| (bag, *number)).collect(),
        _ if bags.len() == numbers.len() => bags.iter().zip(numbers.iter().copied()).collect(),
        _ => {
            let got = format!("{} episodes of {} bags", numbers.len(), bags.len());
            return Err(setting("episodes", "one for each bag, or none", got));
        }
    };
    let mut logs: BTreeMap<&PathBuf, EpisodeLog> = BTreeMap::new();
    let mut measured = Vec::new();
    let mut known = BTreeSet::new();
    for (bag, number) in chosen {
        if !logs.contains_key(bag) {
            logs.insert(bag, read_episodes(&BagReader::open(bag)?, &EpisodeTopics::default())?);
        }
        let failed = |reason| BagError::Episode { path: bag.clone(), reason };
        let episode = logs[bag].episode((number > 0).then_some(number)).map_err(failed)?;
        if !known.insert((bag, episode.number)) {
            let got = format!("episode {} of {} twice", episode.number, bag.display());
            return Err(setting("episodes", "each episode once", got));
        }
        measured.push(episode.measured(model).map_err(failed)?);
    }
    Ok(measured)
}

/// Feeds a message to the log and its times to the clocks. The error has the stamp of a message that was left out.
fn record(
    log: &mut EpisodeLog,
    clocks: &mut Clocks,
    topics: &EpisodeTopics,
    message: &BagMessage,
) -> Result<(), String> {
    fn feed<T: Feed + DeserializeOwned>(
        log: &mut EpisodeLog,
        clocks: &mut Clocks,
        message: &BagMessage,
    ) -> Result<(), String> {
        let record = message.decode::<T>().map_err(|e| e.to_string())?;
        let stamp_ns = record.stamp_ns();
        // A recorder that starts late receives old messages of latched topics, such as events. Their log times are its
        // own.
        if !is_latched(message) {
            clocks.push(&message.topic.name, message.log_time_ns, stamp_ns);
        }
        record.feed(log).map_err(|e| format!("stamp {:.6} s: {e}", stamp_ns as f64 * 1e-9))
    }
    match &message.topic.name {
        name if *name == topics.keypoints => feed::<Keypoints>(log, clocks, message),
        name if *name == topics.pose => feed::<PoseStamped>(log, clocks, message),
        name if *name == topics.observation => feed::<Observation>(log, clocks, message),
        name if *name == topics.action => feed::<EefDelta>(log, clocks, message),
        _ => feed::<EpisodeEvent>(log, clocks, message),
    }
}

/// True if a message may have been published long before it was logged. Events are latched by contract, even if a
/// converted bag has lost the profile; other topics are latched if a publisher offered it.
fn is_latched(message: &BagMessage) -> bool {
    message.topic.type_name == EpisodeEvent::TYPE_NAME || message.topic.qos.iter().any(|qos| qos.is_transient_local())
}
