//! Episodes of the running graph.

use crate::convert::Feed;
use catenary_core::episode::EpisodeError;
use catenary_core::{Episode, EpisodeLog};
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{EefDelta, EpisodeEvent, Keypoints, Observation};
use catenary_shell::{Act, GoalHandle, Msg, Node, ShellError, Subscription, contract};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Messages of a topic that may wait for the log.
const BURST: u16 = 256;
/// How often the log drops what nobody needs.
const TIDY: Duration = Duration::from_secs(5);
/// How often a goal that waits for an episode looks for it.
const LOOK: Duration = Duration::from_millis(100);

/// What the topics say of episodes while this lives: the last complete one, and those under way.
pub struct LiveEpisodes {
    log: Arc<Mutex<EpisodeLog>>,
    _subscriptions: [Subscription; 5],
}

impl LiveEpisodes {
    /// Listens from now on, until the node ends.
    ///
    /// # Errors
    /// [`ShellError`] where a topic cannot be subscribed to.
    pub fn listen(node: &Node) -> Result<Self, ShellError> {
        let log = Arc::new(Mutex::new(EpisodeLog::default()));
        let subscriptions = [
            follow::<Keypoints>(node, &log, &contract::KEYPOINTS)?,
            follow::<PoseStamped>(node, &log, &contract::CURRENT_POSE)?,
            follow::<EefDelta>(node, &log, &contract::ACTION)?,
            follow::<Observation>(node, &log, &contract::OBSERVATION)?,
            follow::<EpisodeEvent>(node, &log, &contract::EPISODE_EVENT)?,
        ];
        let (tidied, shutdown) = (Arc::clone(&log), node.shutdown().clone());
        node.spawn("tidy_log", move || {
            while !shutdown.wait_timeout(TIDY) {
                lock(&tidied).forget_old();
            }
        })?;
        Ok(Self { log, _subscriptions: subscriptions })
    }

    /// The last complete episode, where anything of it was seen. Events are told to late joiners: one without poses and
    /// keypoints ended before this listened.
    ///
    /// # Errors
    /// [`EpisodeError::NoEpisode`] where there is none.
    pub fn last(&self) -> Result<Episode, EpisodeError> {
        let log = lock(&self.log);
        let episode = log.last()?;
        if episode.poses.is_empty() && episode.keypoints.is_empty() {
            return Err(EpisodeError::NoEpisode { cause: String::new(), found: log.summary() });
        }
        Ok(episode)
    }

    /// The last complete episode, as [`LiveEpisodes::last`] knows it, waited for; none where the goal is cancelled before.
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

    /// What was heard, in words.
    #[must_use]
    pub fn summary(&self) -> String {
        lock(&self.log).summary()
    }
}

fn lock(log: &Mutex<EpisodeLog>) -> MutexGuard<'_, EpisodeLog> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Feeds every message of a topic to the log: all of a burst, as a fast replay brings it, and not the newest alone.
fn follow<M: Msg + Feed>(
    node: &Node,
    log: &Arc<Mutex<EpisodeLog>>,
    topic: &contract::Topic,
) -> Result<Subscription, ShellError> {
    let log = Arc::clone(log);
    let qos = if topic.qos.is_transient_local() { topic.qos } else { topic.qos.with_depth(BURST) };
    node.subscription::<M>(topic.name, qos, move |received| {
        if let Err(error) = received.message.feed(&mut lock(&log)) {
            tracing::warn!("{} left out of the log: {error}", M::TYPE_NAME);
        }
    })
}
