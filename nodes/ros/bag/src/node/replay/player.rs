//! Player: publishes the messages of a bag at their recorded times.

use super::arm_watch::ArmWatch;
use super::choice::is_command;
use super::settings::ReplaySettings;
use crate::error::BagError;
use crate::format::profile::KEEP_ALL;
use crate::node::kinds::{self, Outlet};
use crate::reader::{BagMessage, BagReader, Topic};
use catenary_msgs::Interface;
use catenary_msgs::msg::ArmState;
use catenary_msgs::rosgraph_msgs::msg::Clock;
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::{Node, Publisher, Qos, Throttle, Time, contract, stamp, wall_now};
use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

/// Messages and bytes per second at an infinite rate. A faster burst would overflow the sockets of best-effort
/// subscribers.
const FASTEST: [f64; 2] = [5_000.0, 1e8];
/// Least time between two checks of who follows the replayed commands.
const LOOK: Duration = Duration::from_millis(200);
/// Least time between two log lines about failed messages.
const COMPLAIN: Duration = Duration::from_secs(5);

/// Result of a replay.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplaySummary {
    /// Number of published messages.
    pub published: u64,
    /// Number of messages that were unreadable or could not be published, each with a warning. A damaged chunk counts
    /// once, because the number of its messages is unknown.
    pub failed: u64,
    /// Topics that were left out, with the reason.
    pub left_out: Vec<String>,
}

struct Entry {
    type_name: String,
    outlet: Box<dyn Outlet>,
    is_command: bool,
    /// Number of messages for late subscribers; none if the topic is not latched.
    latched: Option<u16>,
}

/// Publishers and clock of a replay.
pub(super) struct Player<'a> {
    node: &'a Node,
    outlets: BTreeMap<String, Entry>,
    clock: Option<Publisher<Clock>>,
    watch: ArmWatch,
    /// Time of the last check of the followers of commands.
    looked: Option<Instant>,
    complaint: Throttle,
}

impl<'a> Player<'a> {
    pub(super) fn new(
        node: &'a Node,
        bag: &BagReader,
        topics: &[&Topic],
        settings: &ReplaySettings,
        watch: ArmWatch,
    ) -> Result<Self, BagError> {
        let mut outlets = BTreeMap::new();
        for topic in topics {
            let others = node.publisher_count(&topic.name)?;
            // Every node publishes on these two topics.
            if others > 0 && topic.name != "/rosout" && topic.name != "/diagnostics" {
                tracing::warn!("{}: {others} others publish there, too", topic.name);
            }
            let messages = bag.topic(&topic.name).map_or(0, |t| t.messages);
            let qos = settings.overrides.apply(&topic.name, kept_for_all(topic, offered_before(topic), messages));
            let is_command = is_command(node, &topic.name)?;
            let type_name = topic.type_name.clone();
            let latched = qos.is_transient_local().then_some(qos.depth());
            let outlet = match kinds::find(&type_name) {
                Some(kind) => kind.outlet(node, &topic.name, qos)?,
                None => kinds::raw_outlet(node, &topic.name, &type_name, qos)?,
            };
            outlets.insert(topic.name.clone(), Entry { type_name, outlet, is_command, latched });
        }
        let clock = contract::CLOCK;
        let clock =
            if settings.clock_hz.is_some() { Some(node.publisher::<Clock>(clock.name, clock.qos)?) } else { None };
        Ok(Self { node, outlets, clock, watch, looked: None, complaint: Throttle::new(COMPLAIN) })
    }

    pub(super) fn wait_for_subscribers(&self, patience: Duration) {
        let until = Instant::now() + patience;
        let unheard =
            |entry: &&Entry| !entry.outlet.wait_for_subscriber(until.saturating_duration_since(Instant::now()));
        let unheard: Vec<&str> = self.outlets.values().filter(unheard).map(|e| e.outlet.topic()).collect();
        if !unheard.is_empty() {
            tracing::info!("no subscribers to {}", unheard.join(", "));
        }
    }

    /// Publishes the bag once. Returns false if the bag is empty or the node is told to shut down.
    ///
    /// It begins with the latched messages that a subscriber at the start of the played part would have received.
    pub(super) fn play(
        &mut self,
        bag: &BagReader,
        names: &[&str],
        settings: &ReplaySettings,
        summary: &mut ReplaySummary,
    ) -> Result<bool, BagError> {
        let Some((first_ns, _)) = bag.span_ns() else { return Ok(false) };
        if self.node.shutdown().wait_timeout(Duration::from_secs_f64(settings.delay_s)) {
            return Ok(false);
        }
        let start_ns = first_ns.saturating_add((settings.start_offset_s * 1e9) as i64);
        let end_ns =
            settings.duration_s.filter(|s| *s >= 0.0).map_or(i64::MAX, |s| start_ns.saturating_add((s * 1e9) as i64));
        let mut pace = Pace { start_ns, since: Instant::now(), rate: settings.rate, busy_s: 0.0 };
        let clock_hz = settings.clock_hz.unwrap_or(ReplaySettings::CLOCK_HZ);
        let tick_ns = (1e9 / clock_hz * if settings.rate.is_finite() { settings.rate } else { 1.0 }).max(1.0) as i64;
        let mut next_tick_ns = start_ns;
        let mut latched = Latched::default();
        for message in bag.messages_of(names) {
            let message = match message {
                Ok(message) => message,
                Err(BagError::Interrupted { .. }) => return Ok(false),
                Err(error) => {
                    tracing::warn!("{error}");
                    summary.failed += 1;
                    continue;
                }
            };
            let at_ns = message.log_time_ns;
            // Its time in the replay is not known; it was named before the start.
            if !bag.is_usual_time(at_ns) {
                summary.failed += 1;
                continue;
            }
            if at_ns < start_ns {
                latched.keep(message, &self.outlets);
                continue;
            }
            if at_ns > end_ns {
                break;
            }
            for message in latched.take() {
                self.publish(&message, summary)?;
            }
            while let Some(clock) = self.clock.as_ref().filter(|_| next_tick_ns <= at_ns) {
                if !pace.wait(self.node, next_tick_ns) {
                    return Ok(false);
                }
                clock.send(Clock { clock: stamp::to_msg(Time::from_nanos(next_tick_ns)) });
                pace.account(0);
                let Some(next) = next_tick_ns.checked_add(tick_ns) else { break };
                next_tick_ns = next;
            }
            if !pace.wait(self.node, at_ns) {
                return Ok(false);
            }
            self.publish(&message, summary)?;
            pace.account(message.data.len());
        }
        for message in latched.take() {
            self.publish(&message, summary)?;
        }
        Ok(true)
    }

    fn publish(&mut self, message: &BagMessage, summary: &mut ReplaySummary) -> Result<(), BagError> {
        self.watch.check()?;
        let Some(Entry { type_name, outlet, is_command, .. }) = self.outlets.get(&message.topic.name) else {
            return Ok(());
        };
        // Two topics of one name and different types: only the first is replayed.
        if message.topic.type_name != *type_name {
            return Ok(());
        }
        let is_due = self.looked.is_none_or(|looked| looked.elapsed() >= LOOK);
        if *is_command && outlet.has_subscriber() && is_due {
            self.watch.check_followers(self.node, &message.topic.name)?;
            self.looked = Some(Instant::now());
        }
        // The watch must know the stamp before the state is published, or it would take it for that of an arm.
        if message.topic.type_name == ArmState::TYPE_NAME
            && let Ok(state) = message.decode::<ArmState>()
        {
            self.watch.expect(&state);
        }
        match outlet.publish(message) {
            Ok(()) => summary.published += 1,
            Err(error) => {
                summary.failed += 1;
                if let Some(before) = self.complaint.pass(wall_now()) {
                    tracing::warn!("{error} (and {before} before)");
                }
            }
        }
        Ok(())
    }
}

/// Profile to offer, as in rosbag2: the profile of the recorded publishers if they agree.
fn offered_before(topic: &Topic) -> Qos {
    let agreed = contract::topic(&topic.name).map_or(Qos::DEFAULT, |t| t.qos);
    match &topic.qos[..] {
        [] => agreed,
        [first, others @ ..] if others.iter().all(|q| q == first) => *first,
        _ => {
            tracing::warn!("{}: its publishers offered several profiles; replayed as {agreed}", topic.name);
            agreed
        }
    }
}

/// Profile with a depth for all transforms of `/tf_static`. Each of its broadcasters latches its own transforms, and a
/// replay has one publisher for all of them.
fn kept_for_all(topic: &Topic, qos: Qos, messages: u64) -> Qos {
    let is_static = qos.is_transient_local() && topic.type_name == TFMessage::TYPE_NAME;
    let depth = u16::try_from(messages).unwrap_or(KEEP_ALL).min(KEEP_ALL);
    if is_static { qos.with_depth(qos.depth().max(depth)) } else { qos }
}

/// Last messages of latched topics from before the start.
#[derive(Default)]
struct Latched(BTreeMap<String, VecDeque<BagMessage>>);

impl Latched {
    fn keep(&mut self, message: BagMessage, outlets: &BTreeMap<String, Entry>) {
        let Some(depth) = outlets.get(&message.topic.name).and_then(|entry| entry.latched) else { return };
        let kept = self.0.entry(message.topic.name.clone()).or_default();
        kept.push_back(message);
        if kept.len() > usize::from(depth) {
            kept.pop_front();
        }
    }

    fn take(&mut self) -> impl Iterator<Item = BagMessage> + use<> {
        std::mem::take(&mut self.0).into_values().flatten()
    }
}

/// Relation of the bag's time to wall time.
struct Pace {
    start_ns: i64,
    since: Instant,
    rate: f64,
    /// Least time in s for the messages published so far, at an infinite rate.
    busy_s: f64,
}

impl Pace {
    /// Waits for a time of the bag. Returns false if the node is told to shut down.
    fn wait(&self, node: &Node, at_ns: i64) -> bool {
        let seconds = (at_ns.saturating_sub(self.start_ns) as f64 * 1e-9 / self.rate).max(self.busy_s);
        let due = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let left = due.saturating_sub(self.since.elapsed());
        if left.is_zero() { !node.is_shutdown() } else { !node.shutdown().wait_timeout(left) }
    }

    /// Counts a published message of so many bytes, or a tick of the clock.
    fn account(&mut self, bytes: usize) {
        if self.rate.is_infinite() {
            self.busy_s += (1.0 / FASTEST[0]).max(bytes as f64 / FASTEST[1]);
        }
    }
}
