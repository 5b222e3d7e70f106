//! Intakes: each counts the messages of one subscription that were received, doubted and dropped, with the reasons.
//!
//! `/diagnostics` of the node reports every intake. The log names each kind of flaw, at most every few seconds.

use super::stamp_check::StampCheck;
use super::tally::{Findings, Flaw, Moment, Names, Publishers, Tally};
use crate::dds::interface::Msg;
use crate::dds::qos::Qos;
use crate::process::health::{OtherPublisher, Report, Source};
use crate::time::clock::{Clock, wall_now};
use crate::time::point::Time;
use crate::time::watchdog::Throttle;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Minimum time between two log lines about one kind of flaw.
const COMPLAIN: Duration = Duration::from_secs(5);

/// Counter of one subscription. Clones share the counts. The intake is reported until the last clone is dropped.
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

/// Sorts the publishers of an intake's topic into fitting and unheard ones.
fn of_topic(shared: &Shared, publishers: &[OtherPublisher]) -> Publishers {
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
    // Several publishers with the same fault give one problem.
    known.unheard.dedup();
    known
}

impl Shared {
    fn now(&self) -> Moment {
        Moment { uptime: self.started.elapsed(), clock: self.clock.now() }
    }
}

impl Source for Shared {
    fn report(&self, publishers: &[OtherPublisher], report: &mut Report) {
        let known = of_topic(self, publishers);
        let Findings { problems, values } = lock(&self.tally).report(&self.resolved, &known, self.now());
        for (key, value) in &values {
            report.value(key, value);
        }
        for (health, text) in &problems {
            report.problem(*health, text);
        }
    }
}

impl Intake {
    /// Creates the intake of a topic. `resolved` is the topic's absolute name. Without `names` only unheard publishers are reported.
    pub(crate) fn new<M: Msg>(
        topic: &str,
        resolved: String,
        qos: Qos,
        names: Option<Names>,
        patience: Duration,
        clock: &Clock,
    ) -> Self {
        let now = Moment { uptime: Duration::ZERO, clock: clock.now() };
        let shared = Shared {
            topic: topic.to_owned(),
            resolved,
            type_name: M::TYPE_NAME,
            qos,
            noun: names.map_or("message", |names| names.one),
            started: Instant::now(),
            clock: clock.clone(),
            tally: Mutex::new(Tally::new(names, patience, now)),
            complaints: Mutex::new(BTreeMap::new()),
        };
        Self { shared: Arc::new(shared) }
    }

    /// Returns the intake as a source of health reports.
    pub(crate) fn source(&self) -> Weak<dyn Source> {
        let source: Arc<dyn Source> = Arc::<Shared>::clone(&self.shared);
        Arc::downgrade(&source)
    }

    /// Returns the name of the topic before remapping.
    pub(crate) fn topic(&self) -> &str {
        &self.shared.topic
    }

    /// Returns the profile of the subscription.
    pub(crate) fn qos(&self) -> Qos {
        self.shared.qos
    }

    /// Sets whether the node needs the topic now. While it does, silence is an error, and so is a stream of only bad messages.
    pub fn need(&self, needed: bool) {
        lock(&self.shared.tally).need(needed, self.shared.now());
    }

    /// Returns true while the node needs the topic.
    #[must_use]
    pub fn is_needed(&self) -> bool {
        lock(&self.shared.tally).is_needed()
    }

    /// Counts a flaw of a message that is used nevertheless.
    pub fn doubt(&self, flaw: &Flaw) {
        lock(&self.shared.tally).doubt(flaw);
        self.complain(flaw, "doubtful");
    }

    /// Counts a flaw of a stamp that is zero, out of order or far from the node's clock.
    pub fn check_stamp(&self, check: &mut StampCheck, stamp: Time) {
        if let Some(flaw) = check.flaw(stamp, self.shared.clock.now()) {
            self.doubt(&flaw);
        }
    }

    /// Counts a message. The error is the reason of a drop.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::health::{Health, Sources};
    use crate::time::shutdown::Shutdown;

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
    fn publishers_of_another_type_or_of_a_weaker_profile_are_not_heard() {
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
        let sources = Sources::default();
        let intake = Intake { shared: Arc::new(shared(Qos::Reliable { depth: 1 })) };
        sources.add(intake.source());
        let publishers = [("/image".into(), "sensor_msgs/msg/Image".into(), Qos::BestEffort { depth: 1 })];
        let health = || {
            let mut report = Report::new();
            sources.report(&publishers, &mut report);
            report.health()
        };
        assert_eq!(health(), Health::Warn);
        drop(intake);
        assert_eq!(health(), Health::Ok);
    }
}
