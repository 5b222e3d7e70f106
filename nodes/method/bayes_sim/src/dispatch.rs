//! Assignment of the episodes of a batch to pools that may join, leave, fall silent and return.
//!
//! A part is a range of episodes that is assigned as a whole. It goes to a free pool. If that pool leaves, fails or is silent
//! for too long, the part goes to the next one. The first answer counts and later ones do not: an episode depends on its seed
//! and number alone, so that all answers are equal. This module reads no clock: times are arguments, in seconds since any
//! moment.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

#[cfg(test)]
mod tests;

/// Limits of the sizes and times of parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest number of episodes in a part.
    pub max_part: usize,
    /// Number of episodes in the first part of a pool, whose speed is unknown.
    pub first_part: usize,
    /// Intended duration of a part in s. Shorter parts balance the load better and are missed sooner; longer parts keep all
    /// workers of a pool busy.
    pub part_s: f64,
    /// Multiple of the expected duration after which a part is given up.
    pub patience_factor: f64,
    /// Least time in s before a part is given up.
    pub min_patience_s: f64,
    /// Time in s before a part is given up while no pool has been measured.
    pub first_patience_s: f64,
    /// Time in s that the batch waits for a pool while none is at work.
    pub stall_s: f64,
}

impl Limits {
    /// Default limits with parts of at most `max_part` episodes.
    pub fn of_parts(max_part: usize) -> Self {
        Self {
            max_part: max_part.max(1),
            first_part: 4,
            part_s: 1.0,
            patience_factor: 5.0,
            min_patience_s: 3.0,
            first_patience_s: 120.0,
            stall_s: 60.0,
        }
    }

    /// Factor on the patience with a pool that has not been measured, over that with the slowest measured pool.
    const UNMEASURED_FACTOR: f64 = 4.0;
    /// Longest pause in s of a pool that was silent. The pause doubles each time.
    const MAX_PAUSE_S: f64 = 60.0;
}

/// Request to one pool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// Number of the request.
    pub call: u64,
    /// Name of the pool.
    pub pool: String,
    /// Indices of its episodes in the batch.
    pub episodes: Range<usize>,
}

/// Use of an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answered {
    /// First answer for these episodes.
    First(Range<usize>),
    /// Late answer, which does not count.
    Late,
}

/// Change in the state of a pool.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A pool has joined the graph.
    Joined {
        /// Name of the pool.
        pool: String,
    },
    /// A pool has left the graph.
    Left {
        /// Name of the pool.
        pool: String,
        /// Episodes that it was simulating, which go to other pools.
        episodes: Option<Range<usize>>,
    },
    /// A pool has been silent for too long.
    Silent {
        /// Name of the pool.
        pool: String,
        /// Episodes that it was simulating, which go to other pools.
        episodes: Range<usize>,
        /// Time in s that it had for them.
        waited_s: f64,
    },
}

/// Work of a pool.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Number of episodes whose first answer came from it.
    pub episodes: usize,
    /// Number of episodes that it was asked for and other pools simulated.
    pub lost: usize,
}

/// State of a pool.
#[derive(Debug, Default)]
struct Pool {
    is_present: bool,
    /// Reason for which its answers are not accepted.
    refused: Option<String>,
    /// Number of the request that it is working on.
    at_work: Option<u64>,
    /// Number of times in a row that it was silent or failed.
    failures: u32,
    /// Time before which it gets no part.
    paused_until_s: f64,
    /// Running mean of its speed; none before its first answer.
    seconds_per_episode: Option<f64>,
    tally: Tally,
}

/// Part of a batch.
#[derive(Debug)]
struct Part {
    episodes: Range<usize>,
    is_done: bool,
}

/// Request under way.
#[derive(Debug)]
struct Call {
    pool: String,
    part: usize,
    since_s: f64,
    patience_s: f64,
    /// True if its part was given up. An answer is still accepted.
    is_lost: bool,
}

/// State of the assignment, for one batch after the other.
#[derive(Debug)]
pub struct Dispatch {
    limits: Limits,
    pools: BTreeMap<String, Pool>,
    parts: Vec<Part>,
    /// Indices of the parts on which no pool is working.
    waiting: BTreeSet<usize>,
    /// Episodes that are in no part yet.
    remaining: Range<usize>,
    calls: BTreeMap<u64, Call>,
    newest_call: u64,
    /// Time at which a pool was last known to be at work.
    last_sign_s: f64,
    /// Last failure, for the error message.
    failure: Option<String>,
}

impl Dispatch {
    /// Assignment without pools and episodes.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            pools: BTreeMap::new(),
            parts: Vec::new(),
            waiting: BTreeSet::new(),
            remaining: 0..0,
            calls: BTreeMap::new(),
            newest_call: 0,
            last_sign_s: 0.0,
            failure: None,
        }
    }

    /// Begins a batch. The state of the pools is kept. Answers to earlier batches no longer count.
    pub fn begin(&mut self, episodes: usize, limits: Limits, now_s: f64) {
        self.limits = limits;
        (self.parts, self.remaining) = (Vec::new(), 0..episodes);
        self.waiting.clear();
        self.calls.clear();
        self.pools.values_mut().for_each(|pool| pool.at_work = None);
        self.last_sign_s = now_s;
    }

    /// Returns true if every episode is done.
    pub fn is_done(&self) -> bool {
        self.remaining.is_empty() && self.parts.iter().all(|part| part.is_done)
    }

    /// Sets the pools that are present. Returns those that joined or left.
    pub fn set_pools(&mut self, names: &BTreeSet<String>) -> Vec<Event> {
        let mut events = Vec::new();
        let gone: Vec<String> = self
            .pools
            .iter()
            .filter(|(name, pool)| pool.is_present && !names.contains(*name))
            .map(|(n, _)| n.clone())
            .collect();
        for pool in gone {
            let call = self.pools.get_mut(&pool).and_then(|state| {
                state.is_present = false;
                state.at_work.take()
            });
            let episodes = call.and_then(|call| self.give_up(call));
            events.push(Event::Left { pool, episodes });
        }
        for name in names {
            let pool = self.pools.entry(name.clone()).or_default();
            if !pool.is_present {
                // It may be another process on another machine: its speed and its failures are forgotten.
                *pool = Pool { is_present: true, tally: pool.tally, ..Pool::default() };
                events.push(Event::Joined { pool: name.clone() });
            }
        }
        events
    }

    /// Next assignment of a part to a free pool; none if no part is left or no pool is free. It replaces earlier requests to
    /// the pool, whose answers need no longer be awaited.
    pub fn next(&mut self, now_s: f64) -> Option<Assignment> {
        let free = |pool: &Pool| {
            pool.is_present && pool.refused.is_none() && pool.at_work.is_none() && pool.paused_until_s <= now_s
        };
        // Fastest first; pools without a measured speed last.
        let speed = |pool: &Pool| pool.seconds_per_episode.unwrap_or(f64::INFINITY);
        let free = self.pools.iter().filter(|(_, pool)| free(pool));
        let name = free.min_by(|(_, a), (_, b)| speed(a).total_cmp(&speed(b)))?.0.clone();
        let part = match self.waiting.pop_first() {
            Some(part) => part,
            None => self.new_part(&name)?,
        };
        let (patience_s, episodes) = (self.patience_s(&name, part), self.parts[part].episodes.clone());
        self.newest_call += 1;
        let call = Call { pool: name.clone(), part, since_s: now_s, patience_s, is_lost: false };
        self.calls.retain(|_, earlier| earlier.pool != name);
        self.calls.insert(self.newest_call, call);
        self.pools.get_mut(&name)?.at_work = Some(self.newest_call);
        Some(Assignment { call: self.newest_call, pool: name, episodes })
    }

    /// Index of a new part. Its size is the number of episodes that the pool simulates in the intended time, but at most half
    /// of its fair share of the remaining episodes.
    fn new_part(&mut self, pool: &str) -> Option<usize> {
        if self.remaining.is_empty() {
            return None;
        }
        let size = match self.pools.get(pool).and_then(|pool| pool.seconds_per_episode) {
            // The bounds only guard the conversion to an integer.
            Some(seconds) => (self.limits.part_s / seconds.max(1e-9)).min(1e6) as usize,
            None => self.limits.first_part,
        };
        let takers = self.pools.values().filter(|pool| pool.is_present && pool.refused.is_none()).count().max(1);
        // Half of the fair share: parts shrink towards the end of a batch, so that all pools finish at about the same time.
        let share = self.remaining.len().div_ceil(2 * takers);
        let end = self.remaining.start + size.min(share).clamp(1, self.limits.max_part).min(self.remaining.len());
        self.parts.push(Part { episodes: self.remaining.start..end, is_done: false });
        self.remaining.start = end;
        Some(self.parts.len() - 1)
    }

    /// Time in s that a pool has for a part.
    fn patience_s(&self, pool: &str, part: usize) -> f64 {
        let episodes = self.parts[part].episodes.len() as f64;
        let own = self.pools.get(pool).and_then(|pool| pool.seconds_per_episode);
        let slowest = self.pools.values().filter_map(|pool| pool.seconds_per_episode).reduce(f64::max);
        let factor = self.limits.patience_factor;
        match (own, slowest) {
            (Some(seconds), _) => (factor * seconds * episodes).max(self.limits.min_patience_s),
            (None, Some(seconds)) => {
                Limits::UNMEASURED_FACTOR * (factor * seconds * episodes).max(self.limits.min_patience_s)
            }
            (None, None) => self.limits.first_patience_s,
        }
    }

    /// Processes an answer that arrived at `now_s`.
    pub fn answered(&mut self, call: u64, now_s: f64) -> Answered {
        self.last_sign_s = now_s;
        let Some(call) = self.end(call) else { return Answered::Late };
        let part = &mut self.parts[call.part];
        if let Some(pool) = self.pools.get_mut(&call.pool) {
            (pool.failures, pool.paused_until_s) = (0, now_s);
            let seconds = (now_s - call.since_s).max(0.0) / part.episodes.len() as f64;
            // A lost answer may have been delayed by the network: it may double the pool's measured time at most.
            let limit = if call.is_lost { 2.0 } else { f64::INFINITY };
            let mean = |known: f64| 0.5 * (known + seconds.min(limit * known));
            pool.seconds_per_episode = Some(pool.seconds_per_episode.map_or(seconds, mean));
            if !part.is_done {
                pool.tally.episodes += part.episodes.len();
                pool.tally.lost -= if call.is_lost { part.episodes.len() } else { 0 };
            }
        }
        if part.is_done {
            return Answered::Late;
        }
        part.is_done = true;
        self.waiting.remove(&call.part);
        Answered::First(self.parts[call.part].episodes.clone())
    }

    /// Processes a request that failed without an answer.
    pub fn failed(&mut self, call: u64, reason: &str, now_s: f64) {
        self.failure = Some(reason.to_owned());
        self.give_up(call);
        if let Some(ended) = self.end(call) {
            self.pause(&ended.pool, ended.patience_s.min(self.limits.min_patience_s), now_s);
        }
    }

    /// Refuses the answers of a pool, which gets no more parts until it leaves the graph.
    pub fn refused(&mut self, call: u64, reason: &str) {
        self.give_up(call);
        let pool = self.end(call).and_then(|call| self.pools.get_mut(&call.pool));
        if let Some(pool) = pool {
            pool.refused = Some(reason.to_owned());
        }
    }

    /// Gives up the parts of pools that have been silent for too long. Returns these pools.
    pub fn expire(&mut self, now_s: f64) -> Vec<Event> {
        let is_late = |call: &Call| !call.is_lost && now_s - call.since_s >= call.patience_s;
        let late: Vec<u64> = self.calls.iter().filter(|(_, call)| is_late(call)).map(|(id, _)| *id).collect();
        let mut events = Vec::new();
        for id in late {
            let Some(episodes) = self.give_up(id) else { continue };
            let Some((pool, waited_s)) = self.calls.get(&id).map(|call| (call.pool.clone(), call.patience_s)) else {
                continue;
            };
            self.failure = Some(format!("{pool}: no answer after {waited_s:.1} s"));
            self.pause(&pool, waited_s.min(self.limits.min_patience_s), now_s);
            events.push(Event::Silent { pool, episodes, waited_s });
        }
        events
    }

    /// Time in s until the next part is to be given up or the next pause ends.
    pub fn wait_s(&self, now_s: f64) -> f64 {
        let late = self.calls.values().filter(|call| !call.is_lost).map(|call| call.since_s + call.patience_s);
        let back = self.pools.values().map(|pool| pool.paused_until_s).filter(|until_s| *until_s > now_s);
        late.chain(back).map(|at_s| (at_s - now_s).max(0.0)).fold(self.limits.stall_s, f64::min)
    }

    /// Reason for which the batch cannot continue; none while a pool has been at work within `stall_s`.
    pub fn stalled(&mut self, now_s: f64) -> Option<String> {
        if self.calls.values().any(|call| !call.is_lost) {
            self.last_sign_s = now_s;
        }
        if self.is_done() || now_s - self.last_sign_s < self.limits.stall_s {
            return None;
        }
        let refused = self.pools.iter().filter(|(_, pool)| pool.is_present);
        let refused: Vec<String> =
            refused.filter_map(|(name, pool)| Some(format!("{name}: {}", pool.refused.as_ref()?))).collect();
        let there = self.pools.values().filter(|pool| pool.is_present).count();
        let mut message =
            format!("no pool has been at work for {:.0} s, {there} in the graph", now_s - self.last_sign_s);
        for reason in refused.iter().chain(&self.failure) {
            message += "; ";
            message += reason;
        }
        Some(message)
    }

    /// Work of each pool in all batches.
    pub fn tallies(&self) -> impl Iterator<Item = (&str, Tally)> {
        self.pools.iter().map(|(name, pool)| (name.as_str(), pool.tally))
    }

    /// Removes a request and frees its pool.
    fn end(&mut self, call: u64) -> Option<Call> {
        let ended = self.calls.remove(&call)?;
        if let Some(pool) = self.pools.get_mut(&ended.pool)
            && pool.at_work == Some(call)
        {
            pool.at_work = None;
        }
        Some(ended)
    }

    /// Returns the part of a request to the waiting ones, unless it is done. Returns its episodes.
    fn give_up(&mut self, call: u64) -> Option<Range<usize>> {
        let call = self.calls.get_mut(&call).filter(|call| !call.is_lost)?;
        call.is_lost = true;
        let part = &self.parts[call.part];
        if part.is_done {
            return None;
        }
        self.waiting.insert(call.part);
        if let Some(pool) = self.pools.get_mut(&call.pool) {
            pool.tally.lost += part.episodes.len();
        }
        Some(part.episodes.clone())
    }

    /// Pauses a pool for `first_s` times two to the power of its failures.
    fn pause(&mut self, pool: &str, first_s: f64, now_s: f64) {
        if let Some(pool) = self.pools.get_mut(pool) {
            pool.at_work = None;
            pool.paused_until_s = now_s + (first_s * 2f64.powi(pool.failures.min(16) as i32)).min(Limits::MAX_PAUSE_S);
            pool.failures += 1;
        }
    }
}
