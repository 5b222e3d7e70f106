//! The records of a recording or of live topics, and the episodes in them.

use super::{Episode, EpisodeError};
use crate::task::DeltaAnchor;
use crate::{GripPose, Keypoints, Observation};
use std::collections::BTreeMap;

/// Time before an episode's start from which records still belong to it, ns: the pose and the frame that it starts from.
const LEAD_NS: i64 = 200_000_000;

/// What a live log keeps of the newest records, ns: an episode that starts now may have begun with them.
const RECENT_NS: i64 = 2_000_000_000;
/// Longest episode that a live log waits for the end of, ns: a start that is older was left by a node that died.
const OPEN_NS: i64 = 3_600_000_000_000;

/// The start of an episode, as `/episode/event` reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeStart {
    /// Name of the policy that runs; `recorded` where a path was recorded without one.
    pub policy: String,
    /// Seed of the episode.
    pub seed: u64,
    /// s between two actions.
    pub step_period_s: f64,
    /// What a delta is added to.
    pub delta_anchor: DeltaAnchor,
}

/// Records of the steps of episodes: by number of the episode, stamp in ns and number of the step.
type Steps<T> = BTreeMap<(u32, i64, u32), T>;

/// Stamped records of the topics that inference needs. Stamps are ns of one clock.
///
/// A number may come twice, as when the node that gives them was started again: an episode is one start, and what bears
/// its number up to the next start of that number is its own.
#[derive(Debug, Clone, Default)]
pub struct EpisodeLog {
    keypoints: BTreeMap<i64, Keypoints>,
    poses: BTreeMap<i64, GripPose>,
    actions: Steps<[f64; 2]>,
    observations: Steps<Observation>,
    /// By number of the episode and stamp.
    starts: BTreeMap<(u32, i64), EpisodeStart>,
    /// By number of the episode and stamp.
    ends: BTreeMap<(u32, i64), String>,
    /// Stamp of the record that came last.
    newest_ns: Option<i64>,
}

/// An episode that both started and ended, by its stamps in ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Span {
    start_ns: i64,
    number: u32,
    end_ns: i64,
    /// Where the next episode of the same number begins.
    until_ns: i64,
}

impl EpisodeLog {
    /// Records the keypoints of the image stamped `stamp_ns`.
    pub fn push_keypoints(&mut self, stamp_ns: i64, keypoints: Keypoints) {
        self.newest_ns = Some(stamp_ns);
        self.keypoints.insert(stamp_ns, keypoints);
    }

    /// Records the pose of the grip at `stamp_ns`.
    pub fn push_pose(&mut self, stamp_ns: i64, pose: GripPose) {
        self.newest_ns = Some(stamp_ns);
        self.poses.insert(stamp_ns, pose);
    }

    /// Records action `step` (dx, dz in m) of an episode.
    pub fn push_action(&mut self, stamp_ns: i64, episode: u32, step: u32, delta_m: [f64; 2]) {
        self.newest_ns = Some(stamp_ns);
        self.actions.insert((episode, stamp_ns, step), delta_m);
    }

    /// Records observation `step` of an episode.
    pub fn push_observation(&mut self, stamp_ns: i64, episode: u32, step: u32, observation: Observation) {
        self.newest_ns = Some(stamp_ns);
        self.observations.insert((episode, stamp_ns, step), observation);
    }

    /// Records the start of an episode.
    pub fn push_start(&mut self, stamp_ns: i64, episode: u32, start: EpisodeStart) {
        self.newest_ns = Some(stamp_ns);
        self.starts.insert((episode, stamp_ns), start);
    }

    /// Records the end of an episode.
    pub fn push_end(&mut self, stamp_ns: i64, episode: u32, reason: String) {
        self.newest_ns = Some(stamp_ns);
        self.ends.insert((episode, stamp_ns), reason);
    }

    /// The episodes that both started and ended, in order of their starts.
    fn spans(&self) -> Vec<Span> {
        let span = |&(number, start_ns): &(u32, i64)| {
            let after = (number, start_ns.saturating_add(1))..=(number, i64::MAX);
            let until_ns = self.starts.range(after.clone()).next().map_or(i64::MAX, |((_, next_ns), _)| *next_ns);
            let end_ns = self.ends.range(after).next().map(|((_, end_ns), _)| *end_ns).filter(|e| *e < until_ns)?;
            Some(Span { start_ns, number, end_ns, until_ns })
        };
        let mut spans: Vec<Span> = self.starts.keys().filter_map(span).collect();
        spans.sort_unstable();
        spans
    }

    /// Numbers of the episodes that both started and ended, in order of their starts.
    pub fn complete(&self) -> Vec<u32> {
        self.spans().into_iter().map(|s| s.number).collect()
    }

    /// Drops what live inference has no use for, so that a log that runs for days stays small. Kept are the last complete
    /// episode, those that started within the last hour and have not ended yet, and the newest two seconds; the time is that
    /// of the record that came last.
    pub fn forget_old(&mut self) {
        let Some(newest_ns) = self.newest_ns else { return };
        let spans = self.spans();
        let ended = |key: &(u32, i64)| spans.iter().any(|s| (s.number, s.start_ns) == *key);
        let open = self.starts.keys().filter(|key| !ended(key)).map(|(_, start_ns)| *start_ns);
        let awaited = open.filter(|start_ns| newest_ns.saturating_sub(*start_ns) <= OPEN_NS).min();
        let recent_ns = newest_ns.saturating_sub(RECENT_NS);
        let from_ns = awaited.map_or(recent_ns, |start_ns| recent_ns.min(start_ns.saturating_sub(LEAD_NS)));
        let whole = spans.last().map(|s| s.start_ns.saturating_sub(LEAD_NS)..=s.end_ns);
        let kept = |stamp_ns: i64| stamp_ns >= from_ns || whole.as_ref().is_some_and(|w| w.contains(&stamp_ns));
        self.keypoints.retain(|stamp_ns, _| kept(*stamp_ns));
        self.poses.retain(|stamp_ns, _| kept(*stamp_ns));
        self.actions.retain(|(_, stamp_ns, _), _| kept(*stamp_ns));
        self.observations.retain(|(_, stamp_ns, _), _| kept(*stamp_ns));
        self.starts.retain(|(_, stamp_ns), _| kept(*stamp_ns));
        self.ends.retain(|(_, stamp_ns), _| kept(*stamp_ns));
    }

    /// What the log holds, in words.
    pub fn summary(&self) -> String {
        format!(
            "{} keypoints, {} poses, {} observations, {} actions, {} episode starts, {} episode ends",
            self.keypoints.len(),
            self.poses.len(),
            self.observations.len(),
            self.actions.len(),
            self.starts.len(),
            self.ends.len()
        )
    }

    /// The last complete episode called `number`; none: the last one of all.
    pub fn episode(&self, number: Option<u32>) -> Result<Episode, EpisodeError> {
        let spans = self.spans();
        let missing = || EpisodeError::NoEpisode(self.summary());
        let last = *spans.last().ok_or_else(missing)?;
        let Some(number) = number else { return Ok(self.gather(last, &spans)) };
        let complete = || spans.iter().map(|s| s.number).collect();
        let found = spans.iter().rfind(|s| s.number == number);
        let span = *found.ok_or_else(|| EpisodeError::NoSuchEpisode { number, complete: complete() })?;
        Ok(self.gather(span, &spans))
    }

    /// Every complete episode, in order of their starts.
    pub fn episodes(&self) -> Vec<Episode> {
        let spans = self.spans();
        spans.iter().map(|span| self.gather(*span, &spans)).collect()
    }

    /// The records of an episode.
    fn gather(&self, span: Span, all: &[Span]) -> Episode {
        let Span { start_ns, number, end_ns, until_ns } = span;
        let seconds = |ns: i64| (ns - start_ns) as f64 * 1e-9;
        let from_ns = start_ns.saturating_sub(LEAD_NS);
        let steps = (number, from_ns, 0)..(number, until_ns.saturating_sub(LEAD_NS).max(end_ns), u32::MAX);
        Episode {
            number,
            namesakes: all.iter().filter(|s| s.number == number).count() - 1,
            start: self.starts[&(number, start_ns)].clone(),
            start_ns,
            duration_s: seconds(end_ns),
            end: self.ends[&(number, end_ns)].clone(),
            keypoints: self.keypoints.range(from_ns..=end_ns).map(|(t, k)| (seconds(*t), *k)).collect(),
            poses: self.poses.range(from_ns..=end_ns).map(|(t, p)| (seconds(*t), *p)).collect(),
            actions: in_order(self.actions.range(steps.clone())),
            observations: in_order(self.observations.range(steps)),
        }
    }
}

/// The records of the steps in the order of the steps.
fn in_order<'a, T: Copy + 'a>(records: impl Iterator<Item = (&'a (u32, i64, u32), &'a T)>) -> Vec<(u32, T)> {
    let mut steps: Vec<(u32, T)> = records.map(|((_, _, step), value)| (*step, *value)).collect();
    steps.sort_by_key(|(step, _)| *step);
    steps
}
