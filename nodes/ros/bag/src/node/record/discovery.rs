//! Subscriptions of a recording: to the contract's topics at once, to all others when they are published.

use super::settings::RecordSettings;
use crate::error::BagError;
use crate::node::backlog::Backlog;
use crate::node::kinds::Source;
use crate::writer::{BagWriter, TopicId};
use catenary_msgs::Interface;
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{Node, PublishedTopic, Qos, Subscription, Throttle, contract, wall_now};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Greatest depth of a subscription, for large types and for others.
const DEPTHS: (u16, u16) = (16, 256);
/// Least time between two log lines about lost messages.
const COMPLAIN: Duration = Duration::from_secs(5);
/// Time after which a topic that was named and is not published is logged.
const PATIENCE: Duration = Duration::from_secs(2);

/// Topic that is recorded.
struct RecordedTopic {
    /// Name before remapping.
    topic: String,
    type_name: String,
    qos: Qos,
    /// Index of its subscription.
    number: usize,
    /// True if a message of it was received.
    came: Arc<AtomicBool>,
}

/// Topic that is subscribed to, but not yet in the bag.
struct PendingTopic {
    name: String,
    source: Source,
    offered: Qos,
}

/// Topics of a recording.
pub(super) struct Topics<'a> {
    node: &'a Node,
    settings: &'a RecordSettings,
    backlog: Arc<Backlog>,
    taken: BTreeMap<String, RecordedTopic>,
    expected: Vec<PendingTopic>,
    subscriptions: Vec<Option<Subscription>>,
    ids: Vec<TopicId>,
    /// Sentences about topics that are not recorded in full. Each is logged once.
    warned: Arc<Mutex<BTreeSet<String>>>,
    since: Instant,
    is_patient: bool,
}

impl<'a> Topics<'a> {
    /// Subscribes to the contract's topics.
    pub(super) fn subscribe(
        node: &'a Node,
        settings: &'a RecordSettings,
        backlog: Arc<Backlog>,
        warned: Arc<Mutex<BTreeSet<String>>>,
    ) -> Result<Self, BagError> {
        let mut topics = Self {
            node,
            settings,
            backlog,
            taken: BTreeMap::new(),
            expected: Vec::new(),
            subscriptions: Vec::new(),
            ids: Vec::new(),
            warned,
            since: Instant::now(),
            is_patient: true,
        };
        for topic in settings.agreed(|name| node.resolve(name).unwrap_or_default()) {
            let Some(source) = Source::find(topic.type_name) else { continue };
            let name = node.resolve(topic.name)?;
            topics.add(topic.name, &name, &source, topic.qos)?;
            topics.expected.push(PendingTopic { name, source, offered: topic.qos });
        }
        Ok(topics)
    }

    /// Adds the topics that are already subscribed to to the bag. Returns their number.
    pub(super) fn add_pending(&mut self, bag: &mut BagWriter) -> Result<usize, BagError> {
        for PendingTopic { name, source, offered } in std::mem::take(&mut self.expected) {
            self.ids.push(bag.add_topic(&name, &source.topic_type(), &[offered])?);
        }
        Ok(self.ids.len())
    }

    /// Id in the bag of the topic with this subscription index.
    pub(super) fn id(&self, number: usize) -> TopicId {
        self.ids[number]
    }

    /// Subscribes to newly published topics, and checks the publishers of known ones.
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
            self.warn_of_missing();
        }
        Ok(())
    }

    fn warn_once(&mut self, topic: &str, what: &str) {
        let mut warned = self.warned.lock().unwrap_or_else(PoisonError::into_inner);
        if warned.insert(format!("{topic}: {what}")) {
            tracing::warn!("{topic}: {what}");
        }
    }

    /// Subscribes again with a weaker profile if a publisher is not heard. If that could lose messages, it only warns.
    fn check(&mut self, topic: &PublishedTopic) -> Result<(), BagError> {
        let Some(taken) = self.taken.get(&topic.name) else { return Ok(()) };
        let (qos, number) = (taken.qos, taken.number);
        if taken.type_name != topic.type_name {
            let what = format!("not recorded as {}, because its type was another before", topic.type_name);
            self.warn_once(&topic.name, &what);
            return Ok(());
        }
        let unheard = topic.offered.iter().filter(|offered| qos.unheard(**offered).is_some()).count();
        let wanted = offered_by_all(&topic.offered).with_depth(qos.depth());
        let wanted = self.settings.overrides.apply(&topic.name, wanted);
        // A new subscription loses messages of publishers that are already heard, and may repeat latched messages.
        let is_free = !taken.came.load(Ordering::Relaxed) || unheard == topic.offered.len();
        if unheard == 0 {
            return Ok(());
        }
        if !is_free || wanted == qos {
            self.warn_once(&topic.name, &format!("a publisher offers less than {qos}, and is not recorded"));
            return Ok(());
        }
        let (before, Some(source)) = (taken.topic.clone(), Source::find(&topic.type_name)) else { return Ok(()) };
        // The old subscription ends first: two would record each message twice.
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
        // A bag has one type for each topic, and the publishers give no hint which of them is meant.
        if published.iter().any(|other| other.name == topic.name && other.type_name != *kind) {
            self.warn_once(&topic.name, "not recorded, because it has several types");
            return Ok(());
        }
        let Some(source) = Source::find(kind) else {
            self.warn_once(
                &topic.name,
                &format!("not recorded: {kind} is not built in, and no .msg file of it is on AMENT_PREFIX_PATH"),
            );
            return Ok(());
        };
        let mut offered = topic.offered.clone();
        offered.dedup();
        let id = bag.add_topic(&topic.name, &source.topic_type(), &offered)?;
        self.add(&topic.name, &topic.name, &source, offered_by_all(&topic.offered))?;
        self.ids.push(id);
        tracing::info!("{}: recorded from now on", topic.name);
        Ok(())
    }

    /// Subscribes to `topic`, whose name after remapping is `name`.
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

    /// Creates the subscription with this index.
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
                tracing::error!("{said}: a message was lost because the disk is too slow ({before} before it)");
            }
        });
        let deep = reader_qos(qos, source);
        self.subscriptions[number] = Some(source.subscribe(self.node, topic, deep, inbox)?);
        let type_name = source.topic_type().name.to_owned();
        self.taken.insert(name.to_owned(), RecordedTopic { topic: topic.to_owned(), type_name, qos, number, came });
        Ok(())
    }

    fn warn_of_missing(&mut self) {
        let is_known = |name: &str| {
            contract::topic(name).is_some() || self.node.resolve(name).is_ok_and(|n| self.taken.contains_key(&n))
        };
        let named = self.settings.filter.topics.iter().filter(|name| !name.ends_with('*'));
        let missing: Vec<String> = named.filter(|name| !is_known(name)).cloned().collect();
        for name in missing {
            let near = nearest(&name).map(|n| format!("; did you mean {n}?")).unwrap_or_default();
            self.warn_once(&name, &format!("nobody publishes it yet{near}"));
        }
        let overridden = self.settings.overrides.topics().filter(|name| !self.taken.contains_key(*name));
        let unused: Vec<String> = overridden.map(str::to_owned).collect();
        for name in unused {
            let near = nearest(&name).filter(|near| *near != name).map(|n| format!("; did you mean {n}?"));
            let why = "its QoS override has no effect so far, because the topic is not recorded";
            self.warn_once(&name, &format!("{why}{}", near.unwrap_or_default()));
        }
    }
}

/// Name of the contract within an edit distance of two from `name`.
fn nearest(name: &str) -> Option<String> {
    let bare: Vec<char> = name.trim_start_matches('/').chars().collect();
    // Levenshtein distance with one row of the table.
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

/// Strongest profile that all publishers offer, as rosbag2 adapts to them.
fn offered_by_all(offered: &[Qos]) -> Qos {
    let depth = Qos::DEFAULT.depth();
    match (offered.iter().all(|q| q.is_reliable()), offered.iter().all(|q| q.is_transient_local())) {
        (true, true) => Qos::ReliableTransientLocal { depth },
        (true, false) => Qos::Reliable { depth },
        (false, _) => Qos::BestEffort { depth },
    }
}

/// Profile of a subscription: `qos`, deep enough for bursts.
///
/// A latched topic keeps its depth, which decides how much of the past is repeated. Transforms are the exception: with
/// a depth of one, a broadcaster's transform would replace that of another.
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
        assert_eq!(offered_by_all(&[latched, latched]), latched);
        assert_eq!(offered_by_all(&[latched, reliable]), reliable);
        assert_eq!(offered_by_all(&[latched, best]), best);
    }

    #[test]
    fn a_name_that_is_nearly_right_is_recognised() {
        assert_eq!(nearest("/dlo/keypoint").as_deref(), Some("/dlo/keypoints"));
        assert_eq!(nearest("tf_statc").as_deref(), Some("/tf_static"));
        assert_eq!(nearest("/lab/notes"), None);
    }
}
