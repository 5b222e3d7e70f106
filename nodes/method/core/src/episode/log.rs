//! Log of stamped records, from a recording or from live topics, and the episodes in it.

use super::complete::{Episode, EpisodeStart, is_fault};
use super::error::EpisodeError;
use super::kept::{Kept, LEAD_NS, Span};
use super::plausible::{KEYPOINTS, MOST_LEFT_OUT, MeasuredPose, POSES, seconds};
use super::stream::Stream;
use crate::{Keypoints, Observation};
use std::collections::BTreeMap;

/// Frame in which poses are expected.
const BASE_FRAME: &str = "panda_link0";

/// Age in ns of the newest records that a live log keeps: an episode whose start arrives late begins with them.
const RECENT_NS: i64 = 2_000_000_000;
/// Age in ns of an open start after which a live log stops waiting for its end: the node that sent it has died.
const OPEN_NS: i64 = 3_600_000_000_000;

/// Share of records with the stamp 0 above which a note is made. A few are normal: a node under simulated time has no
/// clock at first.
const UNSTAMPED: f64 = 0.05;

/// Kind of a record; each kind comes from one topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RecordKind {
    /// Keypoints of an image.
    Keypoints,
    /// Poses of the hand.
    Pose,
    /// Observations of a policy.
    Observation,
    /// Actions of a policy.
    Action,
    /// Starts and ends of episodes.
    Event,
}

impl RecordKind {
    /// Plural for sentences.
    fn plural(self) -> &'static str {
        match self {
            Self::Keypoints => "keypoints",
            Self::Pose => "poses",
            Self::Observation => "observations",
            Self::Action => "actions",
            Self::Event => "episode events",
        }
    }
}

/// True if `frame` is the frame of the arm's base. An empty name stands for it, and tf's first release wrote a leading
/// slash.
pub fn is_base_frame(frame: &str) -> bool {
    frame.is_empty() || frame.trim_start_matches('/') == BASE_FRAME
}

/// Records of steps, by number of the episode, stamp in ns and number of the step.
type Steps<T> = BTreeMap<(u32, i64, u32), T>;

/// Stamped records of the topics that inference needs. Stamps are in ns of one clock.
///
/// An episode number may come twice, because a node that is started again counts anew. An episode is therefore one
/// start event; the records with its number belong to it until the next start with that number.
#[derive(Debug, Clone, Default)]
pub struct EpisodeLog {
    keypoints: Stream<Keypoints>,
    poses: Stream<MeasuredPose>,
    wrenches: Stream<[f64; 3]>,
    actions: Steps<[f64; 2]>,
    observations: Steps<Observation>,
    /// Starts, by number of the episode and stamp.
    starts: BTreeMap<(u32, i64), EpisodeStart>,
    /// Reasons of ends, by number of the episode and stamp.
    ends: BTreeMap<(u32, i64), String>,
    /// Stamp of the last record in order of arrival.
    newest_ns: Option<i64>,
    /// Counts by kind: records with the stamp 0 (their publisher has no clock), and all records.
    counts: BTreeMap<RecordKind, (usize, usize)>,
    /// Frames of poses that differ from the arm's base, by stamp.
    foreign_frames: BTreeMap<i64, String>,
    /// Episodes whose records are kept; none to keep all records.
    only: Option<Kept>,
    /// Records that were not kept, by kind.
    passed: BTreeMap<RecordKind, Passed>,
    /// Number of poses in a foreign frame that were not kept, by frame.
    passed_frames: BTreeMap<String, usize>,
    /// Number of episodes of which only the latched events were received.
    latched: usize,
    /// True for a recording that runs through the same times again. Known after the first reading.
    repeats: bool,
    /// True while the order of the records that are pushed is unknown.
    out_of_order: bool,
    /// Doubts about the recording, one sentence each.
    notes: Vec<String>,
}

/// Greatest number of foreign frames that are told apart.
const MOST_FRAMES: usize = 16;

/// Records that a log counts without keeping them.
#[derive(Debug, Clone, Copy)]
struct Passed {
    count: usize,
    /// First and last stamp in ns.
    span_ns: [i64; 2],
}

impl EpisodeLog {
    /// Log of a recording, whose records arrive once and in order. An episode is refused if the recording runs through its time
    /// again with other records. A live log takes the newest records instead.
    pub fn of_recording() -> Self {
        let mut log = Self::default();
        log.keypoints.watch_passes();
        log.poses.watch_passes();
        log
    }

    /// Sets whether the next records come in the order in which they arrived. A message with a wrong log time does not.
    pub fn set_in_order(&mut self, in_order: bool) {
        self.out_of_order = !in_order;
    }

    /// Adds a doubt about the recording. Every episode carries it in [`Episode::notes`].
    pub fn note(&mut self, note: String) {
        self.notes.push(note);
    }

    /// Doubts about the recording as a whole: stamps, frames, and those added by [`Self::note`].
    pub fn notes(&self) -> Vec<String> {
        let frame = |(frame, count): (&&String, &usize)| {
            format!(
                "{POSES}: header.frame_id: expected \"{BASE_FRAME}\", got \"{frame}\" in {count} poses, which are used as if they were in panda_link0: if the frames differ, transform the poses and record again"
            )
        };
        let mut counts: BTreeMap<&String, usize> = self.passed_frames.iter().map(|(f, count)| (f, *count)).collect();
        self.foreign_frames.values().for_each(|frame| *counts.entry(frame).or_default() += 1);
        let frames = counts.iter().map(frame);
        self.unstamped_note().into_iter().chain(frames).chain(self.notes.iter().cloned()).collect()
    }

    /// Note on records without a stamp, if they are more than the first moments of a simulated clock.
    fn unstamped_note(&self) -> Option<String> {
        // A single record without a stamp among few others exceeds the share, but means nothing.
        let many = self.counts.iter().filter(|(_, (none, all))| *none > 1 && *none as f64 > UNSTAMPED * *all as f64);
        let named: Vec<String> = many.map(|(kind, (none, _))| format!("{none} {}", kind.plural())).collect();
        // Keypoints and poses come first in the order of kinds: inference needs them.
        let (listed, others) = match named.as_slice() {
            [] => return None,
            [only] => (only.clone(), String::new()),
            [first, second, rest @ ..] => {
                let rest = rest.iter().map(|r| format!(", {r}")).collect::<String>();
                (format!("{first} and {second}"), rest.replacen(',', ", as have", 1))
            }
        };
        Some(format!(
            "{listed} have the stamp 0{others}: nodes with use_sim_time stamp 0 if they receive no /clock; publish /clock or set use_sim_time to false, and record again"
        ))
    }

    /// Counts the stamp of a record.
    fn stamped(&mut self, kind: RecordKind, stamp_ns: i64) {
        self.newest_ns = Some(stamp_ns);
        if !self.is_counting() {
            return;
        }
        let (none, all) = self.counts.entry(kind).or_default();
        *none += usize::from(stamp_ns == 0);
        *all += 1;
    }

    fn is_counting(&self) -> bool {
        self.only.as_ref().is_none_or(|only| only.counts)
    }

    /// Counts a record of a stream. Returns true if it is to be kept.
    fn takes(&mut self, kind: RecordKind, stamp_ns: i64, is_kept: impl Fn(&Kept) -> bool) -> bool {
        self.stamped(kind, stamp_ns);
        let Some(only) = &self.only else { return true };
        if only.counts {
            let passed = self.passed.entry(kind).or_insert(Passed { count: 0, span_ns: [stamp_ns; 2] });
            passed.count += 1;
            passed.span_ns = [passed.span_ns[0].min(stamp_ns), passed.span_ns[1].max(stamp_ns)];
        }
        is_kept(only)
    }

    /// Begins the first of two readings of a recording: starts, ends and notes are kept, and all other records are only
    /// counted. [`Self::keep`] begins the second reading. A long recording needs little memory then.
    pub fn survey(&mut self) {
        self.only = Some(Kept::new(Vec::new(), true));
    }

    /// Begins the second reading of a recording, and keeps the records of the episodes that [`Self::episode`] chooses for
    /// these numbers.
    ///
    /// # Errors
    /// Errors of [`Self::episode`].
    pub fn keep(&mut self, numbers: &[Option<u32>]) -> Result<(), EpisodeError> {
        let all = self.spans();
        let chosen = numbers.iter().map(|number| Ok(self.chosen(*number, &all)?.0));
        let mut spans = chosen.collect::<Result<Vec<Span>, EpisodeError>>()?;
        spans.sort_unstable();
        spans.dedup();
        self.read_again(spans);
        Ok(())
    }

    /// Begins the second reading of a recording, and keeps the records of all complete episodes.
    pub fn keep_all(&mut self) {
        self.read_again(self.spans());
    }

    /// Begins the second reading, which keeps the records of these episodes.
    fn read_again(&mut self, spans: Vec<Span>) {
        self.only = Some(Kept::new(spans, false));
        for repeats in [self.keypoints.read_again(), self.poses.read_again()] {
            self.repeats |= repeats;
        }
    }

    /// True if the recording runs through the same times again. No stamp then shows that an episode is over, and
    /// [`Self::take_ended`] must wait for the end of the recording.
    pub fn repeats(&self) -> bool {
        self.repeats
    }

    /// Number of the records of streams that are held in memory.
    pub fn held(&self) -> usize {
        self.keypoints.len() + self.poses.len() + self.wrenches.len() + self.actions.len() + self.observations.len()
    }

    /// Takes the kept episodes out of the log that ended before `before_ns`, with all their records. Later records of
    /// these episodes are not kept.
    pub fn take_ended(&mut self, before_ns: i64) -> Vec<Episode> {
        let all = self.spans();
        let Some(only) = &mut self.only else { return Vec::new() };
        let (ended, left) = std::mem::take(&mut only.spans).into_iter().partition(|s| s.end_ns < before_ns);
        self.only = Some(Kept::new(left, false));
        let ended: Vec<Span> = ended;
        let episodes = ended.iter().map(|span| self.gather(*span, &all)).collect();
        // Episodes may overlap, and steps may be stamped after the end: what an open one needs stays.
        let only = self.only.take().unwrap_or_default();
        self.keypoints.retain(|stamp_ns, _| only.holds(*stamp_ns));
        self.poses.retain(|stamp_ns, _| only.holds(*stamp_ns));
        self.wrenches.retain(|stamp_ns, _| only.holds(*stamp_ns));
        self.actions.retain(|(number, stamp_ns, _), _| only.holds_step(*number, *stamp_ns));
        self.observations.retain(|(number, stamp_ns, _), _| only.holds_step(*number, *stamp_ns));
        self.only = Some(only);
        episodes
    }

    /// Forgets complete episodes of which a recorder that started later received the latched events alone. `is_latched`
    /// tells for number, start and end in ns if the events came together; an episode during which a pose or keypoints were
    /// stamped is kept.
    pub fn forget_latched(&mut self, is_latched: impl Fn(u32, [i64; 2]) -> bool) {
        let recorded = |s: &Span| {
            [RecordKind::Keypoints, RecordKind::Pose].iter().any(|kind| {
                let span = self.passed.get(kind).map(|passed| passed.span_ns);
                span.is_some_and(|[first, last]| first <= s.end_ns && s.start_ns <= last)
            })
        };
        let is_over = |s: &Span| is_latched(s.number, [s.start_ns, s.end_ns]) && !recorded(s);
        let over: Vec<Span> = self.spans().into_iter().filter(is_over).collect();
        for span in &over {
            self.starts.remove(&(span.number, span.start_ns));
            self.ends.remove(&(span.number, span.end_ns));
        }
        self.latched += over.len();
    }

    /// Forgets an end whose start was not received.
    pub fn forget_end(&mut self, number: u32, end_ns: i64) {
        self.ends.remove(&(number, end_ns));
    }

    /// Records the frame of the pose at `stamp_ns`, if it is not the arm's base.
    pub fn push_frame(&mut self, stamp_ns: i64, frame: &str) {
        if is_base_frame(frame) {
            return;
        }
        match &self.only {
            None => _ = self.foreign_frames.insert(stamp_ns, frame.to_owned()),
            Some(only) if only.counts => {
                if let Some(count) = self.passed_frames.get_mut(frame) {
                    *count += 1;
                } else if self.passed_frames.len() < MOST_FRAMES {
                    self.passed_frames.insert(frame.to_owned(), 1);
                }
            }
            // The frame was counted in the first reading.
            Some(_) => {}
        }
    }

    /// Records the keypoints of the image stamped `stamp_ns`.
    pub fn push_keypoints(&mut self, stamp_ns: i64, keypoints: Keypoints) {
        if self.takes(RecordKind::Keypoints, stamp_ns, |only| only.holds(stamp_ns)) {
            self.keypoints.insert(stamp_ns, keypoints, !self.out_of_order);
        } else {
            self.keypoints.pass_over(stamp_ns, !self.out_of_order);
        }
    }

    /// Records the pose of the hand at `stamp_ns`.
    pub fn push_pose(&mut self, stamp_ns: i64, pose: impl Into<MeasuredPose>) {
        if self.takes(RecordKind::Pose, stamp_ns, |only| only.holds(stamp_ns)) {
            self.poses.insert(stamp_ns, pose.into(), !self.out_of_order);
        } else {
            self.poses.pass_over(stamp_ns, !self.out_of_order);
        }
    }

    /// Records the wrench of the object on the hand at `stamp_ns`, in the order of [`crate::Frame::wrench`].
    pub fn push_wrench(&mut self, stamp_ns: i64, wrench: [f64; 3]) {
        // An episode has it or not: its stamps add nothing to the doubts about the clocks of keypoints and poses.
        if self.only.as_ref().is_none_or(|only| !only.counts && only.holds(stamp_ns)) {
            self.wrenches.insert(stamp_ns, wrench, !self.out_of_order);
        }
    }

    /// Records action `step` (dx, dz in m) of an episode.
    pub fn push_action(&mut self, stamp_ns: i64, episode: u32, step: u32, delta_m: [f64; 2]) {
        if self.takes(RecordKind::Action, stamp_ns, |only| only.holds_step(episode, stamp_ns)) {
            self.actions.insert((episode, stamp_ns, step), delta_m);
        }
    }

    /// Records observation `step` of an episode.
    pub fn push_observation(&mut self, stamp_ns: i64, episode: u32, step: u32, observation: Observation) {
        if self.takes(RecordKind::Observation, stamp_ns, |only| only.holds_step(episode, stamp_ns)) {
            self.observations.insert((episode, stamp_ns, step), observation);
        }
    }

    /// Records the start of an episode.
    pub fn push_start(&mut self, stamp_ns: i64, episode: u32, start: EpisodeStart) {
        self.stamped(RecordKind::Event, stamp_ns);
        self.starts.insert((episode, stamp_ns), start);
    }

    /// Records the end of an episode.
    pub fn push_end(&mut self, stamp_ns: i64, episode: u32, reason: String) {
        self.stamped(RecordKind::Event, stamp_ns);
        self.ends.insert((episode, stamp_ns), reason);
    }

    /// Complete episodes in order of their starts.
    fn spans(&self) -> Vec<Span> {
        let span = |&(number, start_ns): &(u32, i64)| {
            // An end after the next start of the same number belongs to that start: this episode was killed.
            let after = (number, start_ns.saturating_add(1))..=(number, i64::MAX);
            let until_ns = self.starts.range(after.clone()).next().map_or(i64::MAX, |((_, next_ns), _)| *next_ns);
            let end_ns = self.ends.range(after).next().map(|((_, end_ns), _)| *end_ns).filter(|e| *e < until_ns)?;
            Some(Span { start_ns, number, end_ns, until_ns })
        };
        let mut spans: Vec<Span> = self.starts.keys().filter_map(span).collect();
        spans.sort_unstable();
        spans
    }

    /// Numbers of the complete episodes in order of their starts.
    pub fn complete(&self) -> Vec<u32> {
        self.spans().into_iter().map(|s| s.number).collect()
    }

    /// Drops records that live inference does not need, so a log that runs for days stays small.
    ///
    /// It keeps the last complete episode, episodes that started within the last hour and have not ended, and the
    /// newest two seconds. The present is the stamp of the last record in order of arrival: a replay may run back in
    /// time.
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
        self.wrenches.retain(|stamp_ns, _| kept(*stamp_ns));
        self.foreign_frames.retain(|stamp_ns, _| kept(*stamp_ns));
        self.actions.retain(|(_, stamp_ns, _), _| kept(*stamp_ns));
        self.observations.retain(|(_, stamp_ns, _), _| kept(*stamp_ns));
        self.starts.retain(|(_, stamp_ns), _| kept(*stamp_ns));
        self.ends.retain(|(_, stamp_ns), _| kept(*stamp_ns));
        // Records with the stamp 0 were dropped above, so the note about them must go too.
        if !kept(0) {
            self.counts.clear();
        }
    }

    /// Numbers of the records by kind, as text.
    pub fn summary(&self) -> String {
        let all = |kind, kept: usize| self.passed.get(&kind).map_or(kept, |passed| passed.count);
        let latched = match self.latched {
            0 => String::new(),
            1 => ", and the latched events of 1 episode before the recording".to_owned(),
            many => format!(", and the latched events of {many} episodes before the recording"),
        };
        format!(
            "{} keypoints, {} poses, {} observations, {} actions, {} episode starts, {} episode ends{latched}",
            all(RecordKind::Keypoints, self.keypoints.len()),
            all(RecordKind::Pose, self.poses.len()),
            all(RecordKind::Observation, self.observations.len()),
            all(RecordKind::Action, self.actions.len()),
            self.starts.len(),
            self.ends.len()
        )
    }

    /// Note on starts and ends that do not form an episode.
    fn unpaired_note(&self) -> Option<String> {
        if let Some(((number, start_ns), _)) = self.starts.last_key_value() {
            let before = self.ends.range((*number, i64::MIN)..=(*number, *start_ns)).next_back();
            return Some(match before {
                Some(((_, end_ns), _)) if end_ns < start_ns => format!(
                    "/episode/event: the end of episode {number} is stamped {:.3} s before its start (header.stamp {} and {}): the clock was set back meanwhile",
                    start_ns.saturating_sub(*end_ns) as f64 * 1e-9,
                    seconds(*end_ns),
                    seconds(*start_ns)
                ),
                Some(_) => format!(
                    "/episode/event: start and end of episode {number} have the same stamp {}",
                    seconds(*start_ns)
                ),
                None => format!(
                    "/episode/event: episode {number} has no end: the recording, or the node that ran the episode, ended before"
                ),
            });
        }
        let ((number, _), _) = self.ends.first_key_value()?;
        Some(format!("/episode/event: episode {number} ends without a start: the recording began after the episode"))
    }

    /// Error of a log without a complete episode.
    fn no_episode(&self) -> EpisodeError {
        // Stamps of 0 also cause unpaired events: only the cause is named.
        let unpaired = self.unstamped_note().is_none().then(|| self.unpaired_note()).flatten();
        let cause = unpaired.into_iter().chain(self.notes()).map(|note| format!("{note}: ")).collect();
        EpisodeError::NoEpisode { cause, found: self.summary() }
    }

    /// Returns the last complete episode called `number`. Without a number: the last complete episode that no fault
    /// ended.
    ///
    /// # Errors
    /// [`EpisodeError::NoEpisode`], [`EpisodeError::NoSuchEpisode`] or [`EpisodeError::Fault`].
    pub fn episode(&self, number: Option<u32>) -> Result<Episode, EpisodeError> {
        let spans = self.spans();
        let (span, note) = self.chosen(number, &spans)?;
        let mut episode = self.gather(span, &spans);
        episode.notes.extend(note);
        Ok(episode)
    }

    /// Chooses one of the complete episodes `spans`, as [`Self::episode`] says, with a note about one that is passed over.
    fn chosen(&self, number: Option<u32>, spans: &[Span]) -> Result<(Span, Option<String>), EpisodeError> {
        let last = *spans.last().ok_or_else(|| self.no_episode())?;
        let Some(number) = number else { return self.last_in_order(last, spans) };
        let complete = || spans.iter().map(|s| s.number).collect();
        let found = spans.iter().rfind(|s| s.number == number);
        let span = *found.ok_or_else(|| EpisodeError::NoSuchEpisode { number, complete: complete() })?;
        Ok((span, None))
    }

    /// Returns the last episode that no fault ended, with a note if `last`, the last complete episode, is another one.
    fn last_in_order(&self, last: Span, spans: &[Span]) -> Result<(Span, Option<String>), EpisodeError> {
        let reason = |s: &Span| self.ends[&(s.number, s.end_ns)].as_str();
        let fault = format!("/episode/event: episode {} ended with \"{}\"", last.number, reason(&last));
        // An episode with a fault is used only if its number is given.
        let in_order = spans.iter().rfind(|s| !is_fault(reason(s)));
        let span = *in_order.ok_or_else(|| EpisodeError::Fault(fault.clone()))?;
        let passed_over = || format!("{fault} and is passed over: episode {} is used instead", span.number);
        Ok((span, (span != last).then(passed_over)))
    }

    /// Returns the last complete episode, also if a fault ended it.
    ///
    /// # Errors
    /// [`EpisodeError::NoEpisode`].
    pub fn last(&self) -> Result<Episode, EpisodeError> {
        let spans = self.spans();
        let last = *spans.last().ok_or_else(|| self.no_episode())?;
        Ok(self.gather(last, &spans))
    }

    /// All complete episodes in order of their starts.
    pub fn episodes(&self) -> Vec<Episode> {
        let spans = self.spans();
        spans.iter().map(|span| self.gather(*span, &spans)).collect()
    }

    /// Collects the records of an episode.
    fn gather(&self, span: Span, all: &[Span]) -> Episode {
        let Span { start_ns, number, end_ns, until_ns } = span;
        let since_s = |ns: i64| ns.saturating_sub(start_ns) as f64 * 1e-9;
        let from_ns = start_ns.saturating_sub(LEAD_NS);
        // Steps may be stamped after the end, but not within the lead of the next episode with this number.
        let steps = (number, from_ns, 0)..(number, until_ns.saturating_sub(LEAD_NS).max(end_ns), u32::MAX);
        Episode {
            number,
            namesakes: all.iter().filter(|s| s.number == number).count() - 1,
            start: self.starts[&(number, start_ns)].clone(),
            start_ns,
            duration_s: since_s(end_ns),
            end: self.ends[&(number, end_ns)].clone(),
            keypoints: self.keypoints.range(from_ns..=end_ns).map(|(t, k)| (since_s(*t), *k)).collect(),
            poses: self.poses.range(from_ns..=end_ns).map(|(t, p)| (since_s(*t), *p)).collect(),
            wrenches: self.wrenches.range(from_ns..=end_ns).map(|(t, w)| (since_s(*t), *w)).collect(),
            actions: in_order(self.actions.range(steps.clone())),
            observations: in_order(self.observations.range(steps)),
            mixed: self.mixed(from_ns, end_ns),
            notes: self.notes().into_iter().chain(self.elsewhere(from_ns, end_ns)).collect(),
        }
    }

    /// Reason why the records between two stamps cannot be told from others of the recording; none if they can.
    fn mixed(&self, from_ns: i64, end_ns: i64) -> Option<String> {
        let range_ns = || from_ns..=end_ns;
        let shares = [(KEYPOINTS, self.keypoints.mixed_share(range_ns())), (POSES, self.poses.mixed_share(range_ns()))];
        let (topic, share) = shares.into_iter().find(|(_, share)| *share > MOST_LEFT_OUT)?;
        Some(format!(
            "{topic}: header.stamp: expected that a recording passes through a time once, got {:.0} % of the frames between {} and {} in a second pass: the clock was set back, or recordings were joined whose clocks begin anew, and records of two episodes cannot be told apart; put each episode into a bag of its own",
            100.0 * share,
            seconds(from_ns),
            seconds(end_ns)
        ))
    }

    /// Notes on streams that have records, but none between two stamps: another clock stamps them than the events.
    fn elsewhere(&self, from_ns: i64, end_ns: i64) -> Vec<String> {
        fn span<T>(records: &BTreeMap<i64, T>, passed: Option<&Passed>, range_ns: [i64; 2]) -> Option<[i64; 2]> {
            let kept = records.first_key_value().zip(records.last_key_value());
            let all = passed.map(|p| p.span_ns).or_else(|| kept.map(|(first, last)| [*first.0, *last.0]))?;
            records.range(range_ns[0]..=range_ns[1]).next().is_none().then_some(all)
        }
        let (range_ns, passed) = ([from_ns, end_ns], |kind| self.passed.get(&kind));
        let streams = [
            (KEYPOINTS, span(&self.keypoints, passed(RecordKind::Keypoints), range_ns)),
            (POSES, span(&self.poses, passed(RecordKind::Pose), range_ns)),
        ];
        let note = |(topic, [first, last]): (&str, [i64; 2])| {
            format!(
                "{topic}: header.stamp: expected stamps of the episode, {} to {}, got {} to {}: it is stamped by another clock, or was not published then; use one clock for all nodes and record again",
                seconds(from_ns),
                seconds(end_ns),
                seconds(first),
                seconds(last)
            )
        };
        streams.into_iter().filter_map(|(topic, span)| Some((topic, span?))).map(note).collect()
    }
}

/// Values with the numbers of their steps, sorted by step.
fn in_order<'a, T: Copy + 'a>(records: impl Iterator<Item = (&'a (u32, i64, u32), &'a T)>) -> Vec<(u32, T)> {
    let mut steps: Vec<(u32, T)> = records.map(|((_, _, step), value)| (*step, *value)).collect();
    steps.sort_by_key(|(step, _)| *step);
    steps
}
