//! Subscriptions of a recording: those of the contract at once, all others when somebody publishes them.

use super::settings::RecordSettings;
use crate::backlog::Backlog;
use crate::error::BagError;
use crate::kinds::Source;
use crate::writer::{BagWriter, TopicId};
use catenary_msgs::Interface;
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{Node, PublishedTopic, Qos, Subscription, Throttle, contract, wall_now};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Messages that a subscription keeps at most, of large types and of others.
const DEPTHS: (u16, u16) = (16, 256);
/// Complaints about lost messages come at most this often.
const COMPLAIN: Duration = Duration::from_secs(5);
/// After this time a topic that was named and that nobody publishes is mentioned.
const PATIENCE: Duration = Duration::from_secs(2);

/// A topic that is recorded.
struct Taken {
    /// Its name before remapping.
    topic: String,
    type_name: String,
    qos: Qos,
    /// Its place among the subscriptions.
    number: usize,
    /// Whether a message of it came.
    came: Arc<AtomicBool>,
}

/// A topic that is subscribed to and not in the bag yet.
struct Expected {
    name: String,
    source: Source,
    offered: Qos,
}

/// The topics of a recording.
pub(super) struct Topics<'a> {
    node: &'a Node,
    settings: &'a RecordSettings,
    backlog: Arc<Backlog>,
    taken: BTreeMap<String, Taken>,
    expected: Vec<Expected>,
    subscriptions: Vec<Option<Subscription>>,
    ids: Vec<TopicId>,
    /// Topics that are not recorded in full, with the reason; each is logged once.
    told: Arc<Mutex<BTreeSet<String>>>,
    since: Instant,
    is_patient: bool,
}

impl<'a> Topics<'a> {
    /// Subscribes to the contract's topics.
    pub(super) fn subscribe(
        node: &'a Node,
        settings: &'a RecordSettings,
        backlog: Arc<Backlog>,
        told: Arc<Mutex<BTreeSet<String>>>,
    ) -> Result<Self, BagError> {
        let mut topics = Self {
            node,
            settings,
            backlog,
            taken: BTreeMap::new(),
            expected: Vec::new(),
            subscriptions: Vec::new(),
            ids: Vec::new(),
            told,
            since: Instant::now(),
            is_patient: true,
        };
        for topic in settings.agreed(|name| node.resolve(name).unwrap_or_default()) {
            let Some(source) = Source::find(topic.type_name) else { continue };
            let name = node.resolve(topic.name)?;
            topics.add(topic.name, &name, &source, topic.qos)?;
            topics.expected.push(Expected { name, source, offered: topic.qos });
        }
        Ok(topics)
    }

    /// Puts the topics that are subscribed to already into the bag.
    pub(super) fn enter(&mut self, bag: &mut BagWriter) -> Result<usize, BagError> {
        for Expected { name, source, offered } in std::mem::take(&mut self.expected) {
            self.ids.push(bag.add_topic(&name, &source.topic_type(), &[offered])?);
        }
        Ok(self.ids.len())
    }

    /// The bag's number of the topic with this number.
    pub(super) fn id(&self, number: usize) -> TopicId {
        self.ids[number]
    }

    /// Takes what others publish by now.
    pub(super) fn discover(&mut self, bag: &mut BagWriter) -> Result<(), BagError> {
        let published = self.node.published_topics();
        for topic in &published {
            match self.taken.get(&topic.name) {
                Some(_) => self.check(topic)?,
                None if self.settings.takes(&[&topic.name], &topic.type_name) => self.take(topic, &published, bag)?,
                None => {}
            }
        }
        if self.is_patient && self.since.elapsed() >= PATIENCE {
            self.is_patient = false;
            self.tell_of_missing();
        }
        Ok(())
    }

    fn tell(&mut self, topic: &str, what: &str) {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.insert(format!("{topic}: {what}")) {
            tracing::warn!("{topic}: {what}");
        }
    }

    /// Asks for less where a publisher is not heard, as long as nothing is lost by it; says so otherwise.
    fn check(&mut self, topic: &PublishedTopic) -> Result<(), BagError> {
        let Some(taken) = self.taken.get(&topic.name) else { return Ok(()) };
        let (qos, number) = (taken.qos, taken.number);
        if taken.type_name != topic.type_name {
            let what = format!("not recorded as {}, because its type was another before", topic.type_name);
            self.tell(&topic.name, &what);
            return Ok(());
        }
        let unheard = topic.offered.iter().filter(|offered| qos.unheard(**offered).is_some()).count();
        let wanted = heard_from_all(&topic.offered).with_depth(qos.depth());
        let wanted = self.settings.overrides.apply(&topic.name, wanted);
        // To ask anew loses messages of those that are heard by now, and may repeat what they latched.
        let is_free = !taken.came.load(Ordering::Relaxed) || unheard == topic.offered.len();
        if unheard == 0 {
            return Ok(());
        }
        if !is_free || wanted == qos {
            self.tell(&topic.name, &format!("a publisher offers less than {qos}, and is not recorded"));
            return Ok(());
        }
        let (before, Some(source)) = (taken.topic.clone(), Source::find(&topic.type_name)) else { return Ok(()) };
        tracing::info!("{}: a publisher offers less than {qos}; recorded as {wanted}", topic.name);
        self.subscriptions[number] = None;
        self.subscribe_to(&before, &topic.name, &source, wanted, number)
    }

    fn take(
        &mut self,
        topic: &PublishedTopic,
        published: &[PublishedTopic],
        bag: &mut BagWriter,
    ) -> Result<(), BagError> {
        let kind = &topic.type_name;
        if published.iter().any(|other| other.name == topic.name && other.type_name != *kind) {
            self.tell(&topic.name, "not recorded, because it has several types");
            return Ok(());
        }
        let Some(source) = Source::find(kind) else {
            self.tell(
                &topic.name,
                &format!("not recorded: {kind} is not built in, and no .msg file of it is on AMENT_PREFIX_PATH"),
            );
            return Ok(());
        };
        let mut offered = topic.offered.clone();
        offered.dedup();
        let id = bag.add_topic(&topic.name, &source.topic_type(), &offered)?;
        self.add(&topic.name, &topic.name, &source, heard_from_all(&topic.offered))?;
        self.ids.push(id);
        tracing::info!("{}: recorded from now on", topic.name);
        Ok(())
    }

    /// Subscribes to `topic`, which is called `name` after remapping.
    fn add(&mut self, topic: &str, name: &str, source: &Source, qos: Qos) -> Result<(), BagError> {
        let number = self.subscriptions.len();
        self.subscriptions.push(None);
        let qos = self.settings.overrides.apply(name, qos);
        self.subscribe_to(topic, name, source, qos, number)
    }

    /// Ends all subscriptions.
    pub(super) fn end(&mut self) {
        self.subscriptions.iter_mut().for_each(|subscription| *subscription = None);
    }

    /// Makes the subscription with this number.
    fn subscribe_to(
        &mut self,
        topic: &str,
        name: &str,
        source: &Source,
        qos: Qos,
        number: usize,
    ) -> Result<(), BagError> {
        let (backlog, said) = (Arc::clone(&self.backlog), name.to_owned());
        let came = Arc::<AtomicBool>::default();
        let mark = Arc::clone(&came);
        let mut complaint = Throttle::new(COMPLAIN);
        let inbox = Box::new(move |arrival| {
            mark.store(true, Ordering::Relaxed);
            if !backlog.push(number, arrival)
                && let Some(before) = complaint.pass(wall_now())
            {
                tracing::error!("{said}: a message was lost because the disk is too slow (and {before} before)");
            }
        });
        let deep = reader_qos(qos, source);
        self.subscriptions[number] = Some(source.subscribe(self.node, topic, deep, inbox)?);
        let type_name = source.topic_type().name.to_owned();
        self.taken.insert(name.to_owned(), Taken { topic: topic.to_owned(), type_name, qos, number, came });
        Ok(())
    }

    fn tell_of_missing(&mut self) {
        let is_known = |name: &str| {
            contract::topic(name).is_some() || self.node.resolve(name).is_ok_and(|n| self.taken.contains_key(&n))
        };
        let named = self.settings.filter.topics.iter().filter(|name| !name.ends_with('*'));
        let missing: Vec<String> = named.filter(|name| !is_known(name)).cloned().collect();
        for name in missing {
            let near = nearest(&name).map(|n| format!("; did you mean {n}?")).unwrap_or_default();
            self.tell(&name, &format!("nobody publishes it yet{near}"));
        }
    }
}

/// The name of the contract that is one or two letters from `name`.
fn nearest(name: &str) -> Option<String> {
    let bare: Vec<char> = name.trim_start_matches('/').chars().collect();
    let distance = |other: &str| {
        let mut row: Vec<usize> = (0..=bare.len()).collect();
        for (i, letter) in other.chars().enumerate() {
            let mut diagonal = std::mem::replace(&mut row[0], i + 1);
            for (j, mine) in bare.iter().enumerate() {
                let changed = diagonal + usize::from(letter != *mine);
                diagonal = row[j + 1];
                row[j + 1] = changed.min(row[j] + 1).min(diagonal + 1);
            }
        }
        row[bare.len()]
    };
    let names = contract::TOPICS.iter().map(|t| t.name.trim_start_matches('/'));
    names.map(|n| (distance(n), n)).filter(|(d, _)| *d <= 2).min().map(|(_, n)| format!("/{n}"))
}

/// The most that can be asked for of all publishers, as rosbag2 adapts to them.
fn heard_from_all(offered: &[Qos]) -> Qos {
    let depth = Qos::DEFAULT.depth();
    match (offered.iter().all(|q| q.is_reliable()), offered.iter().all(|q| q.is_transient_local())) {
        (true, true) => Qos::ReliableTransientLocal { depth },
        (true, false) => Qos::Reliable { depth },
        (false, _) => Qos::BestEffort { depth },
    }
}

/// The topic's profile, deep enough for bursts. What a latched topic keeps of the past stays as it was asked for, but for
/// transforms: a single one would drive out that of another broadcaster.
fn reader_qos(qos: Qos, source: &Source) -> Qos {
    let depth = if source.is_large() { DEPTHS.0 } else { DEPTHS.1 };
    let is_state = qos.is_transient_local() && source.topic_type().name != TFMessage::TYPE_NAME;
    if is_state { qos } else { qos.with_depth(qos.depth().max(depth)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_shell::contract::Topic;

    #[test]
    fn subscriptions_are_deep_enough_for_bursts_but_hear_no_more_of_the_past() {
        let depth = |topic: Topic| reader_qos(topic.qos, &Source::find(topic.type_name).unwrap()).depth();
        assert_eq!((depth(contract::CURRENT_POSE), depth(contract::IMAGE), depth(contract::ARM_STATE)), (256, 16, 1));
        assert_eq!(depth(contract::TF_STATIC), 256);
    }

    #[test]
    fn a_subscription_asks_for_what_every_publisher_offers() {
        let [best, reliable, latched] =
            [Qos::BestEffort { depth: 10 }, Qos::Reliable { depth: 10 }, Qos::ReliableTransientLocal { depth: 10 }];
        assert_eq!(heard_from_all(&[latched, latched]), latched);
        assert_eq!(heard_from_all(&[latched, reliable]), reliable);
        assert_eq!(heard_from_all(&[latched, best]), best);
    }

    #[test]
    fn a_name_that_is_nearly_right_is_recognised() {
        assert_eq!(nearest("/dlo/keypoint").as_deref(), Some("/dlo/keypoints"));
        assert_eq!(nearest("tf_statc").as_deref(), Some("/tf_static"));
        assert_eq!(nearest("/lab/notes"), None);
    }
}
