//! Who simulates which part of a batch: several pools, which may come, go, fall silent and come back.
//!
//! A part is a range of episodes that is handed out as a whole. It goes to a pool that is free; where that pool leaves, fails
//! or is silent for too long, to the next one. The first answer counts, whoever gives it, and any further one does not: as an
//! episode depends on its seed and number alone, they are the same. There is no clock in here: times are seconds since any
//! moment, and come in.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

#[cfg(test)]
mod tests;

/// Sizes and times of parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Episodes of a part at most.
    pub max_part: usize,
    /// Episodes of the first part of a pool, whose speed nobody knows.
    pub first_part: usize,
    /// How long a part should take, s. Shorter ones spread better and are soon missed, longer ones keep all of a pool's
    /// workers busy.
    pub part_s: f64,
    /// A part is taken for lost after this many times the time that its pool took for as many episodes.
    pub patience_factor: f64,
    /// But never before this, s.
    pub min_patience_s: f64,
    /// How long a part may take where no pool has done one yet, s.
    pub first_patience_s: f64,
    /// How long the batch waits for a pool while none is at work, s.
    pub stall_s: f64,
}

impl Limits {
    /// Parts of `max_part` episodes at most.
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

    /// For a pool that nobody has measured, the times of the slowest of the others are stretched by this much more.
    const STRANGER: f64 = 4.0;
    /// A pool that was silent is left alone for twice as long each time, up to this, s.
    const MAX_PAUSE_S: f64 = 60.0;
}

/// One request to one pool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// Names the request from here on.
    pub call: u64,
    /// The pool.
    pub pool: String,
    /// Places of its episodes in the batch.
    pub episodes: Range<usize>,
}

/// What became of an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answered {
    /// It is the first one for these episodes.
    First(Range<usize>),
    /// Others were faster: it does not count.
    Late,
}

/// What happened to a pool.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// It has come into the graph.
    Joined {
        /// Its name.
        pool: String,
    },
    /// It has left the graph, with the episodes that it was simulating.
    Left {
        /// Its name.
        pool: String,
        /// They are done by others.
        episodes: Option<Range<usize>>,
    },
    /// It has been silent for too long.
    Silent {
        /// Its name.
        pool: String,
        /// They are done by others.
        episodes: Range<usize>,
        /// How long it had, s.
        waited_s: f64,
    },
}

/// What a pool has done.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Episodes whose first answer came from it.
    pub episodes: usize,
    /// Episodes that it was asked for and others did.
    pub lost: usize,
}

#[derive(Debug, Default)]
struct Pool {
    is_there: bool,
    /// Why its answers are not taken.
    refused: Option<String>,
    /// The request that it is working on, as far as is known.
    at_work: Option<u64>,
    /// Times in a row that it was silent or failed.
    failures: u32,
    /// It gets nothing before.
    paused_until_s: f64,
    seconds_per_episode: Option<f64>,
    tally: Tally,
}

#[derive(Debug)]
struct Part {
    episodes: Range<usize>,
    is_done: bool,
}

#[derive(Debug)]
struct Call {
    pool: String,
    part: usize,
    since_s: f64,
    patience_s: f64,
    /// Its part has been given up, and its answer is welcome all the same.
    is_lost: bool,
}

/// The state of one batch after the other.
#[derive(Debug)]
pub struct Dispatch {
    limits: Limits,
    pools: BTreeMap<String, Pool>,
    parts: Vec<Part>,
    /// Parts that nobody is working on, by their place.
    waiting: BTreeSet<usize>,
    /// Episodes that are in no part yet.
    uncut: Range<usize>,
    calls: BTreeMap<u64, Call>,
    newest_call: u64,
    last_sign_s: f64,
    failure: Option<String>,
}

impl Dispatch {
    /// No pools, and nothing to do.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            pools: BTreeMap::new(),
            parts: Vec::new(),
            waiting: BTreeSet::new(),
            uncut: 0..0,
            calls: BTreeMap::new(),
            newest_call: 0,
            last_sign_s: 0.0,
            failure: None,
        }
    }

    /// Begins a batch. What is known of the pools stays; answers to earlier batches do not count.
    pub fn begin(&mut self, episodes: usize, limits: Limits, now_s: f64) {
        self.limits = limits;
        (self.parts, self.uncut) = (Vec::new(), 0..episodes);
        self.waiting.clear();
        self.calls.clear();
        self.pools.values_mut().for_each(|pool| pool.at_work = None);
        self.last_sign_s = now_s;
    }

    /// Whether every episode is done.
    pub fn is_done(&self) -> bool {
        self.uncut.is_empty() && self.parts.iter().all(|part| part.is_done)
    }

    /// The pools that there are now.
    pub fn set_pools(&mut self, names: &BTreeSet<String>) -> Vec<Event> {
        let mut events = Vec::new();
        let gone: Vec<String> = self
            .pools
            .iter()
            .filter(|(name, pool)| pool.is_there && !names.contains(*name))
            .map(|(n, _)| n.clone())
            .collect();
        for pool in gone {
            let call = self.pools.get_mut(&pool).and_then(|state| {
                state.is_there = false;
                state.at_work.take()
            });
            let episodes = call.and_then(|call| self.give_up(call));
            events.push(Event::Left { pool, episodes });
        }
        for name in names {
            let pool = self.pools.entry(name.clone()).or_default();
            if !pool.is_there {
                // It may be another process on another machine by now.
                *pool = Pool { is_there: true, tally: pool.tally, ..Pool::default() };
                events.push(Event::Joined { pool: name.clone() });
            }
        }
        events
    }

    /// The next part for a pool that is free; none: nothing to hand out, or nobody to take it. Earlier requests to that pool
    /// need no longer be waited for.
    pub fn next(&mut self, now_s: f64) -> Option<Assignment> {
        let free = |pool: &Pool| {
            pool.is_there && pool.refused.is_none() && pool.at_work.is_none() && pool.paused_until_s <= now_s
        };
        // The fastest first, then those that nobody has measured.
        let speed = |pool: &Pool| pool.seconds_per_episode.unwrap_or(f64::INFINITY);
        let free = self.pools.iter().filter(|(_, pool)| free(pool));
        let name = free.min_by(|(_, a), (_, b)| speed(a).total_cmp(&speed(b)))?.0.clone();
        let part = match self.waiting.pop_first() {
            Some(part) => part,
            None => self.cut(&name)?,
        };
        let (patience_s, episodes) = (self.patience_s(&name, part), self.parts[part].episodes.clone());
        self.newest_call += 1;
        let call = Call { pool: name.clone(), part, since_s: now_s, patience_s, is_lost: false };
        self.calls.retain(|_, earlier| earlier.pool != name);
        self.calls.insert(self.newest_call, call);
        self.pools.get_mut(&name)?.at_work = Some(self.newest_call);
        Some(Assignment { call: self.newest_call, pool: name, episodes })
    }

    /// A new part, of as many episodes as the pool does in good time, and no more than leaves enough for the others.
    fn cut(&mut self, pool: &str) -> Option<usize> {
        if self.uncut.is_empty() {
            return None;
        }
        let size = match self.pools.get(pool).and_then(|pool| pool.seconds_per_episode) {
            Some(seconds) => (self.limits.part_s / seconds.max(1e-9)).min(1e6) as usize,
            None => self.limits.first_part,
        };
        let takers = self.pools.values().filter(|pool| pool.is_there && pool.refused.is_none()).count().max(1);
        let share = self.uncut.len().div_ceil(2 * takers);
        let end = self.uncut.start + size.min(share).clamp(1, self.limits.max_part).min(self.uncut.len());
        self.parts.push(Part { episodes: self.uncut.start..end, is_done: false });
        self.uncut.start = end;
        Some(self.parts.len() - 1)
    }

    /// How long a pool has for a part, s.
    fn patience_s(&self, pool: &str, part: usize) -> f64 {
        let episodes = self.parts[part].episodes.len() as f64;
        let own = self.pools.get(pool).and_then(|pool| pool.seconds_per_episode);
        let slowest = self.pools.values().filter_map(|pool| pool.seconds_per_episode).reduce(f64::max);
        let factor = self.limits.patience_factor;
        match (own, slowest) {
            (Some(seconds), _) => (factor * seconds * episodes).max(self.limits.min_patience_s),
            (None, Some(seconds)) => Limits::STRANGER * (factor * seconds * episodes).max(self.limits.min_patience_s),
            (None, None) => self.limits.first_patience_s,
        }
    }

    /// An answer has come.
    pub fn answered(&mut self, call: u64, now_s: f64) -> Answered {
        self.last_sign_s = now_s;
        let Some(call) = self.end(call) else { return Answered::Late };
        let part = &mut self.parts[call.part];
        if let Some(pool) = self.pools.get_mut(&call.pool) {
            (pool.failures, pool.paused_until_s) = (0, now_s);
            let seconds = (now_s - call.since_s).max(0.0) / part.episodes.len() as f64;
            // Of an answer that was given up it is not known whether the pool or the network was slow.
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

    /// A request has ended without an answer.
    pub fn failed(&mut self, call: u64, reason: &str, now_s: f64) {
        self.failure = Some(reason.to_owned());
        self.give_up(call);
        if let Some(ended) = self.end(call) {
            self.pause(&ended.pool, ended.patience_s.min(self.limits.min_patience_s), now_s);
        }
    }

    /// A pool's answer is none of this batch's: it gets no more parts while it stays.
    pub fn refused(&mut self, call: u64, reason: &str) {
        self.give_up(call);
        let pool = self.end(call).and_then(|call| self.pools.get_mut(&call.pool));
        if let Some(pool) = pool {
            pool.refused = Some(reason.to_owned());
        }
    }

    /// Gives up the parts of pools that are silent for too long.
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

    /// Seconds until something is due without an answer or a change of the graph.
    pub fn wait_s(&self, now_s: f64) -> f64 {
        let late = self.calls.values().filter(|call| !call.is_lost).map(|call| call.since_s + call.patience_s);
        let back = self.pools.values().map(|pool| pool.paused_until_s).filter(|until_s| *until_s > now_s);
        late.chain(back).map(|at_s| (at_s - now_s).max(0.0)).fold(self.limits.stall_s, f64::min)
    }

    /// Why the batch cannot go on; none while it can, or a pool has been at work within the patience.
    pub fn stalled(&mut self, now_s: f64) -> Option<String> {
        if self.calls.values().any(|call| !call.is_lost) {
            self.last_sign_s = now_s;
        }
        if self.is_done() || now_s - self.last_sign_s < self.limits.stall_s {
            return None;
        }
        let refused = self.pools.iter().filter(|(_, pool)| pool.is_there);
        let refused: Vec<String> =
            refused.filter_map(|(name, pool)| Some(format!("{name}: {}", pool.refused.as_ref()?))).collect();
        let there = self.pools.values().filter(|pool| pool.is_there).count();
        let mut message =
            format!("no pool has been at work for {:.0} s, {there} in the graph", now_s - self.last_sign_s);
        for reason in refused.iter().chain(&self.failure) {
            message += "; ";
            message += reason;
        }
        Some(message)
    }

    /// What each pool has done, in all batches.
    pub fn tallies(&self) -> impl Iterator<Item = (&str, Tally)> {
        self.pools.iter().map(|(name, pool)| (name.as_str(), pool.tally))
    }

    /// The request is over, and its pool free.
    fn end(&mut self, call: u64) -> Option<Call> {
        let ended = self.calls.remove(&call)?;
        if let Some(pool) = self.pools.get_mut(&ended.pool)
            && pool.at_work == Some(call)
        {
            pool.at_work = None;
        }
        Some(ended)
    }

    /// Has the part of a request done by others, where nobody has done it; returns its episodes.
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

    /// Leaves a pool alone for a while.
    fn pause(&mut self, pool: &str, first_s: f64, now_s: f64) {
        if let Some(pool) = self.pools.get_mut(pool) {
            pool.at_work = None;
            pool.paused_until_s = now_s + (first_s * 2f64.powi(pool.failures.min(16) as i32)).min(Limits::MAX_PAUSE_S);
            pool.failures += 1;
        }
    }
}
