//! Live episodes of the running graph.

use crate::episodes::convert::Feed;
use catenary_core::episode::{EpisodeError, is_base_frame};
use catenary_core::{Episode, EpisodeLog};
use catenary_msgs::geometry_msgs::msg::{PoseStamped, WrenchStamped};
use catenary_msgs::msg::{EefDelta, EpisodeEvent, Keypoints, Observation};
use catenary_shell::{
    Act, Flaw, GoalHandle, Intake, Msg, Names, Node, Received, ShellError, Subscription, contract, stamp,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Number of messages of a topic that may wait for the log.
const BURST: u16 = 256;
/// Period at which the log drops records that are not needed.
const TIDY: Duration = Duration::from_secs(5);
/// Silence of poses or keypoints within an episode that counts as a fault.
const SILENCE: Duration = Duration::from_secs(1);
/// Longest time for which an open episode is expected to continue, several times that of a usual one: a node that dies
/// sends no end.
const LONGEST: Duration = Duration::from_secs(120);
/// Period at which a waiting goal checks for an episode.
const LOOK: Duration = Duration::from_millis(100);

/// Log of the episodes on the topics, filled while it lives: the last complete episode and open ones.
pub struct LiveEpisodes {
    log: Arc<Mutex<EpisodeLog>>,
    _subscriptions: [Subscription; 6],
}

impl LiveEpisodes {
    /// Subscribes to the topics. The log is filled until the node shuts down.
    ///
    /// # Errors
    /// [`ShellError`] if a topic cannot be subscribed to.
    pub fn listen(node: &Node) -> Result<Self, ShellError> {
        let log = Arc::new(Mutex::new(EpisodeLog::default()));
        let keypoints = intake::<Keypoints>(node, &contract::KEYPOINTS, Names { one: "keypoints", many: "keypoints" })?;
        let poses = intake::<PoseStamped>(node, &contract::CURRENT_POSE, Names { one: "pose", many: "poses" })?;
        let wrenches =
            intake::<WrenchStamped>(node, &contract::EXTERNAL_WRENCH, Names { one: "wrench", many: "wrenches" })?;
        let actions = intake::<EefDelta>(node, &contract::ACTION, Names { one: "action", many: "actions" })?;
        let seen = Names { one: "observation", many: "observations" };
        let observations = intake::<Observation>(node, &contract::OBSERVATION, seen)?;
        let events = Names { one: "episode_event", many: "episode_events" };
        let events = intake::<EpisodeEvent>(node, &contract::EPISODE_EVENT, events)?;
        let needed = [keypoints.clone(), poses.clone()];
        let (watching, clock) = (needed.clone(), node.clock().clone());
        let (doubted, asked) = (poses.clone(), node.clone());
        let mut runner = None;
        let subscriptions = [
            follow::<Keypoints>(node, &log, &keypoints, |_| Ok(()))?,
            follow::<PoseStamped>(node, &log, &poses, move |received| {
                doubt_frame(&doubted, &received.message);
                Ok(())
            })?,
            // No episode waits for it: a model need not observe it.
            follow::<WrenchStamped>(node, &log, &wrenches, |_| Ok(()))?,
            follow::<EefDelta>(node, &log, &actions, |_| Ok(()))?,
            follow::<Observation>(node, &log, &observations, |_| Ok(()))?,
            follow::<EpisodeEvent>(node, &log, &events, move |received| {
                let (event, writer) = (&received.message, received.publisher);
                check_runner(&asked, &mut runner, writer, event)?;
                // Events are latched: an old one reports an episode that is over.
                let age = clock.now().saturating_since(stamp::from_msg(&event.header.stamp));
                let begins = event.event == EpisodeEvent::STARTED && age < LONGEST;
                watching.iter().for_each(|intake| intake.need(begins));
                Ok(())
            })?,
        ];
        let (tidied, shutdown) = (Arc::clone(&log), node.shutdown().clone());
        node.spawn("tidy_log", move || {
            let mut open_for = Duration::ZERO;
            while !shutdown.wait_timeout(TIDY) {
                lock(&tidied).forget_old();
                open_for = if needed.iter().any(Intake::is_needed) { open_for + TIDY } else { Duration::ZERO };
                if open_for > LONGEST {
                    needed.iter().for_each(|intake| intake.need(false));
                }
            }
        })?;
        Ok(Self { log, _subscriptions: subscriptions })
    }

    /// Last complete episode with poses or keypoints. Events are latched, so an episode without both ended before this
    /// subscription began.
    ///
    /// # Errors
    /// [`EpisodeError::NoEpisode`] if there is none.
    pub fn last(&self) -> Result<Episode, EpisodeError> {
        let log = lock(&self.log);
        let episode = log.last()?;
        // Its records were sent before the subscription, and only its latched events were received.
        if episode.poses.is_empty() && episode.keypoints.is_empty() {
            return Err(EpisodeError::NoEpisode { cause: String::new(), found: log.summary() });
        }
        Ok(episode)
    }

    /// Waits for an episode of [`LiveEpisodes::last`] and returns it; none if the goal is cancelled before.
    #[must_use]
    pub fn wait<A: Act>(&self, goal: &GoalHandle<A>) -> Option<Episode> {
        loop {
            if let Ok(episode) = self.last() {
                return Some(episode);
            }
            if goal.wait_cancelled(LOOK) {
                return None;
            }
        }
    }

    /// Numbers of the received records by kind, as text.
    #[must_use]
    pub fn summary(&self) -> String {
        lock(&self.log).summary()
    }
}

fn lock(log: &Mutex<EpisodeLog>) -> MutexGuard<'_, EpisodeLog> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Intake of a topic of the contract, with a depth for the bursts of a fast replay.
fn intake<M: Msg>(node: &Node, topic: &contract::Topic, names: Names) -> Result<Intake, ShellError> {
    let qos = if topic.qos.is_transient_local() { topic.qos } else { topic.qos.with_depth(BURST) };
    node.intake::<M>(topic.name, qos, names, SILENCE)
}

/// Feeds every message that passes `check` to the log: all messages of a burst, and not the newest alone.
fn follow<M: Msg + Feed>(
    node: &Node,
    log: &Arc<Mutex<EpisodeLog>>,
    intake: &Intake,
    mut check: impl FnMut(&Received<M>) -> Result<(), Flaw> + Send + 'static,
) -> Result<Subscription, ShellError> {
    let log = Arc::clone(log);
    node.take::<M>(intake, move |received| {
        check(&received)?;
        received.message.feed(&mut lock(&log)).map_err(|error| Flaw::new(error.field, error))
    })
}

/// Checks that an event comes from the writer that began the running episode, as long as that one is in the graph. `runner` is this writer.
///
/// # Errors
/// [`Flaw`] with both nodes.
fn check_runner(
    node: &Node,
    runner: &mut Option<[u8; 16]>,
    writer: [u8; 16],
    event: &EpisodeEvent,
) -> Result<(), Flaw> {
    if let Some(bound) = runner.filter(|bound| *bound != writer) {
        let publishers = node.publishers(contract::EPISODE_EVENT.name).unwrap_or_default();
        if let Some(other) = publishers.iter().find(|peer| peer.endpoint() == bound) {
            let from = node.peer(writer);
            return Err(Flaw::new("stranger", format!("event of {from} within an episode of {other}: not used")));
        }
    }
    *runner = (event.event == EpisodeEvent::STARTED).then_some(writer);
    Ok(())
}

/// Reports a pose in a frame other than the arm's base. The log notes it and uses the pose, as for a bag.
fn doubt_frame(poses: &Intake, pose: &PoseStamped) {
    let frame = &pose.header.frame_id;
    if !is_base_frame(frame) {
        poses.doubt(&Flaw::new("frame", format!("expected frame `panda_link0`, got `{frame}`")));
    }
}
