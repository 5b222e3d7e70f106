//! Episodes in a bag, and in the running graph.

mod clocks;
mod convert;
#[cfg(feature = "node")]
mod live;

use crate::error::BagError;
use crate::latched;
use crate::reader::{BagMessage, BagReader};
use catenary_core::episode::{EpisodeError, MeasuredTrack};
use catenary_core::{Episode, EpisodeLog, Model};
use catenary_msgs::Interface;
use catenary_msgs::geometry_msgs::msg::{PoseStamped, WrenchStamped};
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
    /// Wrenches of the object on the hand, `/panda/external_wrench` by default.
    pub wrench: String,
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
            wrench: name(contract::EXTERNAL_WRENCH),
            observation: name(contract::OBSERVATION),
            action: name(contract::ACTION),
            event: name(contract::EPISODE_EVENT),
        }
    }
}

impl EpisodeTopics {
    /// All six names.
    #[must_use]
    pub fn names(&self) -> [&str; 6] {
        [&self.keypoints, &self.pose, &self.wrench, &self.observation, &self.action, &self.event]
    }

    /// Names of the streams: all but the events.
    fn streams(&self) -> [&str; 5] {
        [&self.keypoints, &self.pose, &self.wrench, &self.observation, &self.action]
    }
}

/// Greatest number of events of a bag: hours of episodes of a second. A longer list is no recording of episodes.
const MOST_EVENTS: usize = 100_000;
/// Number of records that are held in memory before episodes that are over are taken out.
const MOST_HELD: usize = 500_000;
/// Time in ns from the end of an episode after which its records are complete, by the stamps of the streams.
const SETTLED_NS: i64 = 10_000_000_000;
/// Share of the time between a start and an end within which both are logged if a late recorder received them together.
const TOGETHER: f64 = 0.2;

/// Checks the types of the topics that a bag has of `topics`.
///
/// # Errors
/// [`BagError::NoTopic`] if the bag has none of the topics, [`BagError::Type`] if a topic has another type.
fn check_topics(bag: &BagReader, topics: &EpisodeTopics) -> Result<(), BagError> {
    // Types are checked once for each topic: a wrong type concerns all of its messages.
    let present = topics.names().into_iter().filter_map(|name| bag.topic(name));
    // An arm publishes its wrench whatever it does: it makes no recording of episodes.
    if present.clone().all(|entry| entry.topic.name == topics.wrench) {
        return Err(BagError::NoTopic {
            path: bag.path().to_owned(),
            needed: topics.names().into_iter().filter(|name| *name != topics.wrench).collect::<Vec<_>>().join(", "),
            found: bag.describe_topics(),
        });
    }
    for entry in present {
        let topic = &entry.topic;
        match &topic.name {
            name if *name == topics.keypoints => topic.check::<Keypoints>(),
            name if *name == topics.pose => topic.check::<PoseStamped>(),
            name if *name == topics.wrench => topic.check::<WrenchStamped>(),
            name if *name == topics.observation => topic.check::<Observation>(),
            name if *name == topics.action => topic.check::<EefDelta>(),
            _ => topic.check::<EpisodeEvent>(),
        }?;
    }
    Ok(())
}

/// First of two readings of a bag: starts and ends of its episodes, numbers of all records, and doubts. No record of a
/// stream is kept, so memory does not grow with the bag.
fn survey(bag: &BagReader, topics: &EpisodeTopics) -> Result<EpisodeLog, BagError> {
    check_topics(bag, topics)?;
    let mut log = EpisodeLog::of_recording();
    log.survey();
    let mut clocks = Clocks::new(&topics.pose);
    let mut events = Events::default();
    let mut left_out: BTreeMap<String, (u64, String)> = BTreeMap::new();
    for message in bag.messages_of(&topics.names()) {
        let (place, outcome) = match message {
            Ok(message) => {
                // A far log time tells nothing about a clock.
                let is_usual = bag.is_usual_time(message.log_time_ns);
                log.set_in_order(is_usual);
                let clocks = Some(&mut clocks).filter(|_| is_usual);
                let outcome = record(&mut log, topics, &message, clocks, &mut events);
                (message.topic.name.clone(), outcome)
            }
            Err(error @ BagError::Interrupted { .. }) => return Err(error),
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
    clocks.notes().into_iter().for_each(|note| log.note(note));
    events.forget_latched(&mut log);
    Ok(log)
}

/// Second reading of a bag: the records of the episodes that `log` keeps. Episodes that are over are passed to `visit` as
/// soon as memory demands it.
fn fill(
    bag: &BagReader,
    topics: &EpisodeTopics,
    log: &mut EpisodeLog,
    mut visit: impl FnMut(Episode),
) -> Result<(), BagError> {
    let streams = topics.streams();
    let mut newest_ns: BTreeMap<String, i64> = BTreeMap::new();
    let mut most = MOST_HELD;
    let mut events = Events::default();
    for message in bag.messages_of(&streams) {
        let Some(message) = intact(message)? else { continue };
        log.set_in_order(bag.is_usual_time(message.log_time_ns));
        let Ok(stamp_ns) = record(log, topics, &message, None, &mut events) else { continue };
        match newest_ns.get_mut(&message.topic.name) {
            Some(newest) => *newest = stamp_ns.max(*newest),
            None => _ = newest_ns.insert(message.topic.name.clone(), stamp_ns),
        }
        if log.held() > most && !log.repeats() {
            let streams = [&topics.keypoints, &topics.pose].into_iter().filter_map(|name| newest_ns.get(name));
            let before_ns = streams.min().map_or(i64::MIN, |newest| newest.saturating_sub(SETTLED_NS));
            log.take_ended(before_ns).into_iter().for_each(&mut visit);
            most = log.held() + MOST_HELD;
        }
    }
    Ok(())
}

/// Message of the second reading; none for one whose damage was noted in the first reading.
fn intact(message: Result<BagMessage, BagError>) -> Result<Option<BagMessage>, BagError> {
    match message {
        Ok(message) => Ok(Some(message)),
        Err(error @ BagError::Interrupted { .. }) => Err(error),
        Err(_noted) => Ok(None),
    }
}

/// Reads all messages of a bag that concern complete episodes into a log.
///
/// Unreadable and meaningless messages are left out, with a note for each topic. Clocks that step or differ, and frames
/// other than the contract's, are noted, too. Episodes that were over when the recording began, and of which it holds the
/// latched events alone, are passed over.
///
/// # Errors
/// [`BagError::NoTopic`] if the bag has none of the topics, [`BagError::Type`] if a topic has another type.
pub fn read_episodes(bag: &BagReader, topics: &EpisodeTopics) -> Result<EpisodeLog, BagError> {
    let mut log = survey(bag, topics)?;
    log.keep_all();
    read_kept(bag, topics, &mut log)?;
    Ok(log)
}

/// Reads the records of the episodes that `log` keeps, all of them at once.
fn read_kept(bag: &BagReader, topics: &EpisodeTopics, log: &mut EpisodeLog) -> Result<(), BagError> {
    let streams = topics.streams();
    for message in bag.messages_of(&streams) {
        if let Some(message) = intact(message)? {
            log.set_in_order(bag.is_usual_time(message.log_time_ns));
            let _noted = record(log, topics, &message, None, &mut Events::default());
        }
    }
    Ok(())
}

/// Calls `visit` with each complete episode of a bag, about in order of their starts. Memory holds a few of them at a time,
/// whatever the length of the bag.
///
/// # Errors
/// [`BagError::Episode`] if there is no complete episode, and those of [`read_episodes`].
pub fn visit_episodes(bag: &BagReader, topics: &EpisodeTopics, mut visit: impl FnMut(Episode)) -> Result<(), BagError> {
    let mut log = survey(bag, topics)?;
    log.last().map_err(|reason| no_episode(bag, reason))?;
    log.keep_all();
    fill(bag, topics, &mut log, &mut visit)?;
    log.take_ended(i64::MAX).into_iter().for_each(visit);
    Ok(())
}

/// Error of a bag that lacks an episode. Of a split recording, another file may hold its events.
fn no_episode(bag: &BagReader, reason: EpisodeError) -> BagError {
    let reason = match (reason, latched::lacking(bag)) {
        (EpisodeError::NoEpisode { cause, found }, Some(note)) => {
            EpisodeError::NoEpisode { cause: format!("{note}: {cause}"), found }
        }
        (reason, _) => reason,
    };
    BagError::Episode { path: bag.path().to_owned(), reason }
}

/// Doubts about the episodes of a bag: stamps, clocks, frames, meaningless messages, and ends by a fault. Empty for a
/// bag without episode topics.
#[must_use]
pub fn episode_notes(bag: &BagReader) -> Vec<String> {
    let topics = EpisodeTopics::default();
    // A bag of other topics, or of other types on them, is a valid bag without episodes.
    let Ok(mut log) = survey(bag, &topics) else { return Vec::new() };
    // Events without a complete episode are a defect; a bag without events was recorded for another purpose.
    if log.complete().is_empty() && bag.topic(&topics.event).is_some_and(|t| t.messages > 0) {
        return log.episode(None).err().map(|error| error.to_string()).into_iter().collect();
    }
    let mut notes = log.notes();
    log.keep_all();
    let mut doubt = |episode: Episode| {
        notes.extend(episode.doubts().into_iter().map(|doubt| format!("episode {}: {doubt}", episode.number)));
    };
    // The caller of an interrupted program wants no notes.
    if fill(bag, &topics, &mut log, &mut doubt).is_err() {
        return Vec::new();
    }
    log.take_ended(i64::MAX).into_iter().for_each(doubt);
    notes
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
    let wanted = |number: u32| (number > 0).then_some(number);
    let mut logs: BTreeMap<&PathBuf, EpisodeLog> = BTreeMap::new();
    let mut measured = Vec::new();
    let mut known = BTreeSet::new();
    for (bag, number) in &chosen {
        let failed = |reason| BagError::Episode { path: (*bag).clone(), reason };
        if !logs.contains_key(bag) {
            let (reader, topics) = (BagReader::open(bag)?, EpisodeTopics::default());
            let mut log = survey(&reader, &topics)?;
            let numbers: Vec<Option<u32>> =
                chosen.iter().filter(|(of, _)| of == bag).map(|(_, number)| wanted(*number)).collect();
            log.keep(&numbers).map_err(|reason| no_episode(&reader, reason))?;
            read_kept(&reader, &topics, &mut log)?;
            logs.insert(bag, log);
        }
        let episode = logs[bag].episode(wanted(*number)).map_err(failed)?;
        if !known.insert((bag, episode.number)) {
            let got = format!("episode {} of {} twice", episode.number, bag.display());
            return Err(setting("episodes", "each episode once", got));
        }
        measured.push(episode.measured(model).map_err(failed)?);
    }
    Ok(measured)
}

/// Events of a bag with their log times, in order of these.
#[derive(Debug, Default)]
struct Events(Vec<Event>);

#[derive(Debug, Clone, Copy)]
struct Event {
    number: u32,
    is_start: bool,
    log_ns: i64,
    stamp_ns: i64,
}

impl Events {
    /// Fails if a bag has more events than a recording of episodes.
    fn check(&self) -> Result<(), String> {
        match self.0.len() < MOST_EVENTS {
            true => Ok(()),
            false => Err(format!("expected at most {MOST_EVENTS} events, got more")),
        }
    }

    fn push(&mut self, message: &BagMessage, event: &EpisodeEvent) {
        let (number, is_start) = (event.episode, event.event == EpisodeEvent::STARTED);
        self.0.push(Event { number, is_start, log_ns: message.log_time_ns, stamp_ns: event.stamp_ns() });
    }

    /// Forgets the episodes of which the bag holds the latched events alone: a recorder that begins after them receives
    /// these together, and nothing else of them.
    fn forget_latched(&self, log: &mut EpisodeLog) {
        let mut logged: BTreeMap<(u32, bool, i64), i64> = BTreeMap::new();
        self.0.iter().for_each(|e| _ = logged.entry((e.number, e.is_start, e.stamp_ns)).or_insert(e.log_ns));
        log.forget_latched(|number, [start_ns, end_ns]| {
            let times = logged.get(&(number, true, start_ns)).zip(logged.get(&(number, false, end_ns)));
            let lasted = end_ns.saturating_sub(start_ns) as f64;
            times.is_some_and(|(start, end)| (end.saturating_sub(*start) as f64).abs() <= TOGETHER * lasted)
        });
        // The oldest latched event may be an end. The later start with its number, of a runner that counts anew, is another
        // episode's.
        let mut starts: BTreeMap<u32, (usize, i64)> = BTreeMap::new();
        for (i, start) in self.0.iter().enumerate().filter(|(_, e)| e.is_start) {
            let (_first, earliest_ns) = starts.entry(start.number).or_insert((i, start.stamp_ns));
            *earliest_ns = start.stamp_ns.min(*earliest_ns);
        }
        for (i, end) in self.0.iter().enumerate().filter(|(_, e)| !e.is_start) {
            if starts.get(&end.number).is_some_and(|(first, earliest_ns)| *first > i && *earliest_ns >= end.stamp_ns) {
                log.forget_end(end.number, end.stamp_ns);
            }
        }
    }
}

/// Feeds a message to the log, and its times to the clocks. Returns its stamp in ns. The error has the stamp of a message that
/// was left out.
fn record(
    log: &mut EpisodeLog,
    topics: &EpisodeTopics,
    message: &BagMessage,
    clocks: Option<&mut Clocks>,
    events: &mut Events,
) -> Result<i64, String> {
    fn feed<T: Feed + DeserializeOwned>(
        log: &mut EpisodeLog,
        message: &BagMessage,
        clocks: Option<&mut Clocks>,
    ) -> Result<(i64, T), String> {
        let record = message.decode::<T>().map_err(|e| e.to_string())?;
        let stamp_ns = record.stamp_ns();
        // A recorder that starts late receives old messages of latched topics, such as events. Their log times are its
        // own.
        if let Some(clocks) = clocks.filter(|_| !is_latched(message)) {
            clocks.push(&message.topic.name, message.log_time_ns, stamp_ns);
        }
        record.feed(log).map_err(|e| format!("stamp {:.6} s: {e}", stamp_ns as f64 * 1e-9))?;
        Ok((stamp_ns, record))
    }
    Ok(match &message.topic.name {
        name if *name == topics.keypoints => feed::<Keypoints>(log, message, clocks)?.0,
        name if *name == topics.pose => feed::<PoseStamped>(log, message, clocks)?.0,
        // Its clock is that of the poses, which the same node publishes.
        name if *name == topics.wrench => feed::<WrenchStamped>(log, message, None)?.0,
        name if *name == topics.observation => feed::<Observation>(log, message, clocks)?.0,
        name if *name == topics.action => feed::<EefDelta>(log, message, clocks)?.0,
        _ => {
            events.check()?;
            let (stamp_ns, event) = feed::<EpisodeEvent>(log, message, clocks)?;
            events.push(message, &event);
            stamp_ns
        }
    })
}

/// True if a message may have been published long before it was logged. Events are latched by contract, even if a
/// converted bag has lost the profile; other topics are latched if a publisher offered it.
fn is_latched(message: &BagMessage) -> bool {
    message.topic.type_name == EpisodeEvent::TYPE_NAME || message.topic.qos.iter().any(|qos| qos.is_transient_local())
}
