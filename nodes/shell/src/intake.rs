//! Intakes: each subscription counts here the messages it received, used, doubted and dropped, and says why.
//!
//! `/diagnostics` of the node reports every intake, and the log names each kind of flaw, at most every few seconds.

use crate::clock::{Clock, wall_now};
use crate::diagnostics::Report;
use crate::error::ShellError;
use crate::interface::Msg;
use crate::node::Node;
use crate::qos::Qos;
use crate::stamp_check::StampCheck;
use crate::subscription::{Latest, Queue, Received, Subscription};
use crate::tally::{Findings, Flaw, Moment, Names, Publishers, Tally};
use crate::time::Time;
use crate::watchdog::Throttle;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Least time between two log lines about one kind of flaw.
const COMPLAIN: Duration = Duration::from_secs(5);

/// Topic, message type and profile of a publisher.
pub(crate) type Publisher = (String, String, Qos);

/// Intakes of a node.
pub(crate) struct Intakes {
    started: Instant,
    clock: Clock,
    all: Mutex<Vec<Weak<Shared>>>,
}

/// Counter of one subscription. Clones count together; the intake is reported until the last is dropped.
#[derive(Clone)]
pub struct Intake {
    shared: Arc<Shared>,
}

struct Shared {
    /// Name before remapping.
    topic: String,
    /// Absolute name.
    resolved: String,
    type_name: &'static str,
    qos: Qos,
    noun: &'static str,
    started: Instant,
    clock: Clock,
    tally: Mutex<Tally>,
    complaints: Mutex<BTreeMap<&'static str, Throttle>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Intakes {
    pub(crate) fn new(clock: &Clock) -> Self {
        Self { started: Instant::now(), clock: clock.clone(), all: Mutex::new(Vec::new()) }
    }

    /// Reports every intake that is left. `publishers`: those of other participants.
    pub(crate) fn report(&self, publishers: &[Publisher], report: &mut Report) {
        let mut all = lock(&self.all);
        all.retain(|intake| intake.strong_count() > 0);
        let left: Vec<Arc<Shared>> = all.iter().filter_map(Weak::upgrade).collect();
        drop(all);
        for shared in left {
            let known = of_topic(&shared, publishers);
            let Findings { problems, values } = lock(&shared.tally).report(&shared.resolved, &known, shared.now());
            for (key, value) in &values {
                report.value(key, value);
            }
            for (health, text) in &problems {
                report.problem(*health, text);
            }
        }
    }
}

/// Publishers of an intake's topic.
fn of_topic(shared: &Shared, publishers: &[Publisher]) -> Publishers {
    let mut known = Publishers::default();
    for (_, type_name, offered) in publishers.iter().filter(|(name, _, _)| *name == shared.resolved) {
        if type_name != shared.type_name {
            known.unheard.push(format!("it publishes {type_name}, expected {}", shared.type_name));
        } else if let Some(why) = shared.qos.unheard(*offered) {
            known.unheard.push(why);
        } else {
            known.fitting += 1;
        }
    }
    known.unheard.dedup();
    known
}

impl Shared {
    fn now(&self) -> Moment {
        Moment { uptime: self.started.elapsed(), clock: self.clock.now() }
    }
}

impl Intake {
    /// Sets whether the node needs the topic now: silence and a stream of nothing but bad messages are errors then.
    pub fn need(&self, needed: bool) {
        lock(&self.shared.tally).need(needed, self.shared.now());
    }

    /// Whether the node needs the topic now.
    #[must_use]
    pub fn is_needed(&self) -> bool {
        lock(&self.shared.tally).is_needed()
    }

    /// Counts a flaw of a message that is used all the same.
    pub fn doubt(&self, flaw: &Flaw) {
        lock(&self.shared.tally).doubt(flaw);
        self.complain(flaw, "doubtful");
    }

    /// Doubts a message whose stamp is zero, out of order or far from the node's clock.
    pub fn check_stamp(&self, check: &mut StampCheck, stamp: Time) {
        if let Some(flaw) = check.flaw(stamp, self.shared.clock.now()) {
            self.doubt(&flaw);
        }
    }

    /// Counts a message; the error is the reason for which it is dropped.
    pub(crate) fn count(&self, outcome: Result<(), Flaw>) {
        let flaw = outcome.err();
        lock(&self.shared.tally).message(self.shared.now(), flaw.as_ref());
        if let Some(flaw) = flaw {
            self.complain(&flaw, "dropped");
        }
    }

    fn complain(&self, flaw: &Flaw, fate: &str) {
        let mut complaints = lock(&self.shared.complaints);
        let throttle = complaints.entry(flaw.kind).or_insert_with(|| Throttle::new(COMPLAIN));
        if let Some(more) = throttle.pass(wall_now()) {
            let (topic, noun, why) = (&self.shared.resolved, self.shared.noun, &flaw.detail);
            tracing::warn!("{topic}: {noun} {fate}: {why} ({more} more before)");
        }
    }
}

impl Node {
    /// Counter of the messages of a topic, for [`Node::take`]. While the topic is needed ([`Intake::need`]), silence
    /// longer than `patience` is an error.
    ///
    /// # Errors
    /// [`ShellError::Name`].
    pub fn intake<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        names: Names,
        patience: Duration,
    ) -> Result<Intake, ShellError> {
        self.new_intake::<M>(topic, qos, Some(names), patience)
    }

    /// Counter of a topic of which only publishers that are not heard are reported.
    pub(crate) fn plain_intake<M: Msg>(&self, topic: &str, qos: Qos) -> Result<Intake, ShellError> {
        self.new_intake::<M>(topic, qos, None, Duration::MAX)
    }

    fn new_intake<M: Msg>(
        &self,
        topic: &str,
        qos: Qos,
        names: Option<Names>,
        patience: Duration,
    ) -> Result<Intake, ShellError> {
        let intakes = self.intakes();
        let (started, clock) = (intakes.started, intakes.clock.clone());
        let now = Moment { uptime: started.elapsed(), clock: clock.now() };
        let shared = Arc::new(Shared {
            topic: topic.to_owned(),
            resolved: self.resolve(topic)?,
            type_name: M::TYPE_NAME,
            qos,
            noun: names.map_or("message", |names| names.one),
            started,
            clock,
            tally: Mutex::new(Tally::new(names, patience, now)),
            complaints: Mutex::new(BTreeMap::new()),
        });
        lock(&intakes.all).push(Arc::downgrade(&shared));
        Ok(Intake { shared })
    }

    /// Calls `callback` with every message of an intake's topic, as [`Node::subscription`] does. A message whose callback
    /// gives a flaw counts as dropped.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn take<M: Msg>(
        &self,
        intake: &Intake,
        mut callback: impl FnMut(Received<M>) -> Result<(), Flaw> + Send + 'static,
    ) -> Result<Subscription, ShellError> {
        let (counted, counting) = (intake.clone(), intake.clone());
        self.subscribe::<M>(&intake.shared.topic, intake.shared.qos, Some(counted), move |received| {
            counting.count(callback(received));
        })
    }

    /// Keeps the newest message of an intake's topic that `check` finds no flaw in.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn take_latest<M: Msg>(
        &self,
        intake: &Intake,
        check: impl FnMut(&M) -> Result<(), Flaw> + Send + 'static,
    ) -> Result<Latest<M>, ShellError> {
        Latest::start(self, intake, check)
    }

    /// Queues the messages of an intake's topic, `capacity` at most, as [`Node::queue`] does.
    ///
    /// # Errors
    /// As [`Node::publisher`].
    pub fn take_queue<M: Msg>(&self, intake: &Intake, capacity: usize) -> Result<Queue<M>, ShellError> {
        Queue::start(self, intake, capacity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::Health;
    use crate::shutdown::Shutdown;

    fn shared(qos: Qos) -> Shared {
        let clock = Clock::new(&Shutdown::new());
        Shared {
            topic: "image".into(),
            resolved: "/image".into(),
            type_name: "sensor_msgs/msg/Image",
            qos,
            noun: "image",
            started: Instant::now(),
            clock,
            tally: Mutex::new(Tally::new(None, Duration::ZERO, Moment::default())),
            complaints: Mutex::default(),
        }
    }

    #[test]
    fn publishers_of_another_type_or_of_a_lesser_profile_are_not_heard() {
        let publisher = |name: &str, kind: &str, qos| (name.to_owned(), format!("sensor_msgs/msg/{kind}"), qos);
        let (best, reliable) = (Qos::BestEffort { depth: 5 }, Qos::Reliable { depth: 5 });
        let known = of_topic(
            &shared(reliable),
            &[
                publisher("/image", "Image", reliable),
                publisher("/image", "Image", best),
                publisher("/image", "CompressedImage", reliable),
                publisher("/elsewhere", "Image", best),
            ],
        );
        assert_eq!((known.fitting, known.unheard.len()), (1, 2), "{known:?}");
        assert!(known.unheard[0].contains("best effort") && known.unheard[0].contains("reliable"), "{known:?}");
        assert!(known.unheard[1].contains("CompressedImage"), "{known:?}");
        assert_eq!(of_topic(&shared(best), &[publisher("/image", "Image", reliable)]).unheard, [] as [String; 0]);
    }

    #[test]
    fn an_intake_is_reported_until_it_is_dropped() {
        let clock = Clock::new(&Shutdown::new());
        let intakes = Intakes::new(&clock);
        let intake = Intake { shared: Arc::new(shared(Qos::Reliable { depth: 1 })) };
        lock(&intakes.all).push(Arc::downgrade(&intake.shared));
        let publishers = [("/image".into(), "sensor_msgs/msg/Image".into(), Qos::BestEffort { depth: 1 })];
        let report = |intakes: &Intakes| {
            let mut report = Report::new();
            intakes.report(&publishers, &mut report);
            report.health()
        };
        assert_eq!(report(&intakes), Health::Warn);
        drop(intake);
        assert_eq!(report(&intakes), Health::Ok);
    }
}
