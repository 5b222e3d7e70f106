//! Replays a bag into the graph.
#![allow(clippy::disallowed_methods, reason = "replaying follows the wall clock")]

mod arm_watch;

use crate::error::BagError;
use crate::kinds::{self, Outlet};
use crate::reader::{BagMessage, BagReader, Topic};
use arm_watch::ArmWatch;
use catenary_msgs::Interface;
use catenary_msgs::msg::ArmState;
use catenary_msgs::rosgraph_msgs::msg::Clock;
use catenary_shell::{Node, Publisher, Qos, Throttle, Time, contract, stamp, wall_now};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Ticks of `/clock` per second of wall time.
const CLOCK_HZ: f64 = 200.0;
/// Least and greatest finite speed.
const RATES: [f64; 2] = [1e-3, 1e6];
/// How long the last messages have to reach reliable subscribers.
const LINGER: Duration = Duration::from_millis(500);
/// Complaints come at most this often.
const COMPLAIN: Duration = Duration::from_secs(5);

/// What is replayed, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplaySettings {
    /// Bag folder or .mcap file.
    pub bag: PathBuf,
    /// Names of the bag's topics; none: all.
    pub topics: Vec<String>,
    /// Speed, default 1; larger is faster, infinite as fast as messages can be published.
    pub rate: f64,
    /// s of the bag to skip, default 0.
    pub start_offset_s: f64,
    /// Whether to begin anew at the end, default no.
    pub repeat: bool,
    /// Whether to publish `/clock` in step with the bag instead of what the bag has of it, default no.
    pub clock: bool,
    /// Whether to replay commands, too, where no arm or a simulated one follows them, default no.
    pub allow_replay: bool,
    /// Whether to replay what an arm and a camera measure where others publish it, too, default no.
    pub allow_others: bool,
    /// How long to wait until every topic has a subscriber, default 2 s. Replaying begins in any case.
    pub wait: Duration,
}

impl ReplaySettings {
    /// The whole bag once, at its own speed, without commands.
    #[must_use]
    pub fn new(bag: PathBuf) -> Self {
        Self {
            bag,
            topics: Vec::new(),
            rate: 1.0,
            start_offset_s: 0.0,
            repeat: false,
            clock: false,
            allow_replay: false,
            allow_others: false,
            wait: Duration::from_secs(2),
        }
    }

    /// Opens the bag, having checked the numbers.
    ///
    /// # Errors
    /// [`BagError::Setting`], and those of [`BagReader::open`].
    pub fn open(&self) -> Result<BagReader, BagError> {
        self.check()?;
        let bag = BagReader::open(&self.bag)?;
        let span_s = bag.span_ns().map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9);
        if self.start_offset_s > span_s {
            let expected = format!("at most the {span_s:.3} s of the bag");
            let got = format!("{:?}", self.start_offset_s);
            return Err(BagError::Setting { name: "start_offset_s", expected, got });
        }
        Ok(bag)
    }

    fn check(&self) -> Result<(), BagError> {
        let wrong = |name, expected: &str, got: f64| {
            Err(BagError::Setting { name, expected: expected.to_owned(), got: format!("{got:?}") })
        };
        let [slowest, fastest] = RATES;
        if !(self.rate == f64::INFINITY || (slowest..=fastest).contains(&self.rate)) {
            return wrong("rate", &format!("a number from {slowest} to {fastest}, or inf"), self.rate);
        }
        if !self.start_offset_s.is_finite() || self.start_offset_s < 0.0 {
            return wrong("start_offset_s", "a number of at least zero", self.start_offset_s);
        }
        Ok(())
    }
}

/// What was replayed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplaySummary {
    /// Messages that were published.
    pub published: u64,
    /// Messages that could not be, each with a warning.
    pub failed: u64,
    /// Topics that were left out, and why.
    pub left_out: Vec<String>,
}

/// Publishes a bag's messages in time, as they were recorded and with the profiles that were offered then, until its end
/// or until the node is told to end.
///
/// Never with a real arm in the graph: that it is there, or comes, ends the replay. `/panda/target_pose` is left out
/// unless [`ReplaySettings::allow_replay`] says otherwise.
///
/// # Errors
/// [`BagError`]: settings, a bag that is none or has nothing to replay, the graph, [`BagError::Refused`].
pub fn replay(node: &Node, settings: &ReplaySettings) -> Result<ReplaySummary, BagError> {
    let bag = settings.open()?;
    for note in bag.notes() {
        tracing::warn!("{note}");
    }
    let mut summary = ReplaySummary::default();
    let chosen = choose(node, &bag, settings, &mut summary.left_out)?;
    for left_out in &summary.left_out {
        tracing::warn!("not replayed: {left_out}");
    }
    let states = chosen.iter().filter(|t| t.type_name == ArmState::TYPE_NAME).map(|t| t.name.clone());
    let watch = ArmWatch::start(node, states.collect())?;
    watch.wait_until_safe(node)?;
    if !settings.allow_others {
        refuse_others(node, &chosen, settings)?;
    }
    let mut player = Player::new(node, &chosen, settings, watch)?;
    player.wait_for_subscribers(settings.wait);
    let names: Vec<&str> = chosen.iter().map(|t| t.name.as_str()).collect();
    while player.play(&bag, &names, settings, &mut summary)? && settings.repeat {}
    node.shutdown().wait_timeout(LINGER);
    Ok(summary)
}

/// Fails where somebody publishes a time, or what an arm or a camera measures, that is to be replayed: nobody could tell
/// the two apart. What is computed from that may come from both.
fn refuse_others(node: &Node, topics: &[&Topic], settings: &ReplaySettings) -> Result<(), BagError> {
    let measured = |name: &&str| ["/panda/", "/camera/"].iter().any(|part| name.contains(part)) || *name == "/clock";
    let clock = settings.clock.then_some("/clock");
    let mut taken = Vec::new();
    for name in topics.iter().map(|t| t.name.as_str()).chain(clock).filter(measured) {
        if !is_command(node, name)? && node.publisher_count(name)? > 0 {
            taken.push(name);
        }
    }
    match taken.is_empty() {
        true => Ok(()),
        false => Err(BagError::Refused(format!(
            "others publish {} now, and nobody could tell theirs from the bag's; end them, replay in another \
             ROS_DOMAIN_ID, or allow_others",
            taken.join(", ")
        ))),
    }
}

/// The topics to replay; what is left out is said in words.
fn choose<'a>(
    node: &Node,
    bag: &'a BagReader,
    settings: &ReplaySettings,
    left_out: &mut Vec<String>,
) -> Result<Vec<&'a Topic>, BagError> {
    for name in &settings.topics {
        if bag.topic(name).is_none() {
            let expected = format!("topics of the bag, which has {}", bag.describe_topics());
            return Err(BagError::Setting { name: "topics", expected, got: format!("{name:?}") });
        }
    }
    let mut chosen = Vec::new();
    for entry in bag.topics() {
        let topic: &Topic = &entry.topic;
        if !(settings.topics.is_empty() || settings.topics.contains(&topic.name)) {
            continue;
        }
        let reason = match kinds::find(&topic.type_name) {
            None => Some(format!("its type {} is not known here", topic.type_name)),
            Some(_) if settings.clock && topic.type_name == Clock::TYPE_NAME => {
                Some("/clock is made in step with the bag".to_owned())
            }
            Some(_) if is_command(node, &topic.name)? && !settings.allow_replay => {
                Some("it commands an arm, and allow_replay is false".to_owned())
            }
            Some(kind) => kind.check(topic).err().map(|e| e.to_string()),
        };
        match reason {
            Some(reason) => left_out.push(format!("{}: {reason}", topic.name)),
            None => chosen.push(topic),
        }
    }
    if chosen.is_empty() {
        return Err(BagError::NoTopic {
            path: bag.path().to_owned(),
            needed: "a topic to replay".to_owned(),
            found: bag.describe_topics(),
        });
    }
    Ok(chosen)
}

/// Whether an arm follows what is published under this name, before or after remapping, in any namespace.
fn is_command(node: &Node, name: &str) -> Result<bool, BagError> {
    let command = format!("/{}", contract::TARGET_POSE.name);
    Ok([name.to_owned(), node.resolve(name)?].iter().any(|n| n.ends_with(&command)))
}

struct Entry {
    outlet: Box<dyn Outlet>,
    is_command: bool,
}

/// Publishers and time of a replay.
struct Player<'a> {
    node: &'a Node,
    outlets: BTreeMap<String, Entry>,
    clock: Option<Publisher<Clock>>,
    watch: ArmWatch,
    complaint: Throttle,
}

impl<'a> Player<'a> {
    fn new(node: &'a Node, topics: &[&Topic], settings: &ReplaySettings, watch: ArmWatch) -> Result<Self, BagError> {
        let mut outlets = BTreeMap::new();
        for topic in topics {
            let Some(kind) = kinds::find(&topic.type_name) else { continue };
            let others = node.publisher_count(&topic.name)?;
            if others > 0 && topic.name != "/rosout" && topic.name != "/diagnostics" {
                tracing::warn!("{}: {others} others publish there, too", topic.name);
            }
            let agreed = contract::topic(&topic.name).map_or(Qos::DEFAULT, |t| t.qos);
            let qos = topic.qos.first().copied().unwrap_or(agreed);
            let is_command = is_command(node, &topic.name)?;
            outlets.insert(topic.name.clone(), Entry { outlet: kind.outlet(node, &topic.name, qos)?, is_command });
        }
        let clock = contract::CLOCK;
        let clock = if settings.clock { Some(node.publisher::<Clock>(clock.name, clock.qos)?) } else { None };
        Ok(Self { node, outlets, clock, watch, complaint: Throttle::new(COMPLAIN) })
    }

    fn wait_for_subscribers(&self, patience: Duration) {
        let until = Instant::now() + patience;
        let unheard =
            |entry: &&Entry| !entry.outlet.wait_for_subscriber(until.saturating_duration_since(Instant::now()));
        let unheard: Vec<&str> = self.outlets.values().filter(unheard).map(|e| e.outlet.topic()).collect();
        if !unheard.is_empty() {
            tracing::info!("nobody listens to {}", unheard.join(", "));
        }
    }

    /// Publishes the bag once; false: the node shall end.
    fn play(
        &mut self,
        bag: &BagReader,
        names: &[&str],
        settings: &ReplaySettings,
        summary: &mut ReplaySummary,
    ) -> Result<bool, BagError> {
        let Some((first_ns, _)) = bag.span_ns() else { return Ok(false) };
        let start_ns = first_ns.saturating_add((settings.start_offset_s * 1e9) as i64);
        let pace = Pace { start_ns, since: Instant::now(), rate: settings.rate };
        let tick_ns = (1e9 / CLOCK_HZ * if settings.rate.is_finite() { settings.rate } else { 1.0 }).max(1.0) as i64;
        let mut next_tick_ns = start_ns;
        for message in bag.messages_of(names) {
            let message = match message {
                Ok(message) => message,
                Err(error) => {
                    tracing::warn!("{error}");
                    continue;
                }
            };
            let at_ns = message.log_time_ns;
            if at_ns < start_ns {
                continue;
            }
            while let Some(clock) = self.clock.as_ref().filter(|_| next_tick_ns <= at_ns) {
                if !pace.wait(self.node, next_tick_ns) {
                    return Ok(false);
                }
                clock.send(Clock { clock: stamp::to_msg(Time::from_nanos(next_tick_ns)) });
                next_tick_ns = next_tick_ns.saturating_add(tick_ns);
            }
            if !pace.wait(self.node, at_ns) {
                return Ok(false);
            }
            self.watch.check()?;
            self.publish(&message, summary)?;
        }
        Ok(true)
    }

    fn publish(&mut self, message: &BagMessage, summary: &mut ReplaySummary) -> Result<(), BagError> {
        let Some(Entry { outlet, is_command }) = self.outlets.get(&message.topic.name) else { return Ok(()) };
        if *is_command && outlet.has_subscriber() && !self.watch.has_simulated_arm() {
            return Err(BagError::Refused(format!(
                "somebody listens on {}, and no /{} says that it is a simulated arm",
                outlet.topic(),
                contract::ARM_STATE.name
            )));
        }
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

/// How the bag's time runs on the wall's.
struct Pace {
    start_ns: i64,
    since: Instant,
    rate: f64,
}

impl Pace {
    /// Waits for a time of the bag; false: the node shall end.
    fn wait(&self, node: &Node, at_ns: i64) -> bool {
        let seconds = at_ns.saturating_sub(self.start_ns) as f64 * 1e-9 / self.rate;
        let due = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let left = due.saturating_sub(self.since.elapsed());
        if left.is_zero() { !node.is_shutdown() } else { !node.shutdown().wait_timeout(left) }
    }
}
