//! The simulator pools of the graph, asked as one simulator.
//!
//! [`Dispatch`] decides; here are the threads that ask, the clock, and the look at the graph.
#![allow(clippy::disallowed_methods, reason = "the ROS side asks for the time and starts threads")]

use crate::convert;
use crate::dispatch::{Answered, Dispatch, Event, Limits};
use catenary_core::{SimulationRequest, Simulator, SimulatorError, Track};
use catenary_msgs::srv::{Simulate, SimulateResponse};
use catenary_shell::convert as wire;
use catenary_shell::{CallError, Client, Node, Param, Shutdown};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::Scope;
use std::time::{Duration, Instant};

/// Bytes of the tracks of one part.
const REPLY_BYTES: usize = 48_000;
/// Bytes of one frame of a track on the wire.
const FRAME_BYTES: usize = 17 * 8;
/// Frames of a track where the policy's steps decide.
const DEFAULT_FRAMES: usize = 17;
/// Time between two looks at the graph.
const LOOK: Duration = Duration::from_millis(100);
/// Longest wait for one answer. That for a part is shorter, and [`Dispatch`]'s.
const CALL: Duration = Duration::from_secs(3600);
/// How long a pool that died may count beside the one that was started in its place, s: somewhat more than its lease.
const SUCCESSION_S: f64 = 15.0;
/// Whose answers are taken: pools of another version may mean something else.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What all inferences of this node have asked for.
#[derive(Debug, Clone, Copy, Default)]
pub struct Totals {
    /// Episodes that were simulated.
    pub episodes: usize,
    /// Episodes that a pool was asked for and another did.
    pub redone: usize,
    /// Time steps that did not converge in the episodes that counted.
    pub unconverged_steps: u64,
    /// Pools in the graph when it was looked at last.
    pub pools: usize,
    /// A batch is under way.
    pub asking: bool,
}

/// The pools that this node may ask.
pub struct Pools {
    node: Node,
    /// Patterns of their names.
    patterns: Param<String>,
    /// How long an inference waits for a pool, s.
    stall_s: Param<f64>,
    /// Those that were asked, by name.
    clients: Mutex<BTreeMap<String, Client<Simulate>>>,
    totals: Mutex<Totals>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pools {
    /// Those of the node's graph whose service fits one of the patterns, which are separated by commas.
    pub fn new(node: Node, patterns: Param<String>, stall_s: Param<f64>) -> Self {
        Self { node, patterns, stall_s, clients: Mutex::default(), totals: Mutex::default() }
    }

    /// What has been asked for so far.
    pub fn totals(&self) -> Totals {
        *lock(&self.totals)
    }

    /// A simulator of one model, for as long as `is_cancelled` does not hold.
    pub fn simulator<'a>(&'a self, model_yaml: &'a str, is_cancelled: &'a dyn Fn() -> bool) -> PoolsSimulator<'a> {
        let dispatch = Dispatch::new(Limits::of_parts(1));
        let state = State { dispatch, meaning: None, doubles: BTreeMap::new() };
        PoolsSimulator { pools: self, model_yaml, is_cancelled, start: Instant::now(), state: Mutex::new(state) }
    }

    /// The services that there are now, with how many nodes serve each.
    fn present(&self) -> Result<BTreeMap<String, usize>, SimulatorError> {
        let mut found = self.node.services_of_type::<Simulate>().map_err(|e| backend(&e))?;
        let patterns = self.patterns.get();
        let trimmed = |pattern: &'_ str| pattern.trim().trim_end_matches('/').to_owned();
        found.retain(|name, _| patterns.split(',').any(|pattern| fits(&trimmed(pattern), name)));
        lock(&self.totals).pools = found.len();
        Ok(found)
    }
}

/// Whether a name fits a pattern, in which `*` stands for anything. A pattern without it may also name the namespace or node.
fn fits(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None if pattern.is_empty() => false,
        None => name == pattern || (name.starts_with(pattern) && name[pattern.len()..].starts_with('/')),
        Some((head, rest)) => match name.strip_prefix(head) {
            Some(_) if rest.is_empty() => true,
            Some(tail) => (0..=tail.len()).any(|at| tail.get(at..).is_some_and(|tail| fits_to_the_end(rest, tail))),
            None => false,
        },
    }
}

fn fits_to_the_end(pattern: &str, name: &str) -> bool {
    if pattern.contains('*') { fits(pattern, name) } else { name == pattern }
}

/// Episodes that pools were asked for and others did.
fn lost(dispatch: &Dispatch) -> usize {
    dispatch.tallies().map(|(_, tally)| tally.lost).sum()
}

fn backend(error: &dyn std::fmt::Display) -> SimulatorError {
    SimulatorError::Backend(error.to_string())
}

struct State {
    dispatch: Dispatch,
    /// What the first pool made of the model, and its name.
    meaning: Option<(u64, String)>,
    /// Services that are served by several nodes.
    doubles: BTreeMap<String, Double>,
}

/// A service that several nodes serve.
struct Double {
    since_s: f64,
    is_told: bool,
}

/// All pools as one simulator of one model.
pub struct PoolsSimulator<'a> {
    pools: &'a Pools,
    model_yaml: &'a str,
    is_cancelled: &'a dyn Fn() -> bool,
    start: Instant,
    state: Mutex<State>,
}

type Message = (u64, String, Result<SimulateResponse, CallError>);

/// One batch on its way.
struct Batch<'scope, 'a> {
    simulator: &'a PoolsSimulator<'a>,
    request: &'a SimulationRequest,
    tracks: Vec<Option<Track>>,
    /// Ends the requests of each pool.
    stops: BTreeMap<String, Shutdown>,
    stop: Shutdown,
    sender: Sender<Message>,
    scope: &'scope Scope<'scope, 'a>,
}

impl Simulator for PoolsSimulator<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let frames = request.frame_times_s.len().max(DEFAULT_FRAMES);
        let limits =
            Limits { stall_s: self.pools.stall_s.get(), ..Limits::of_parts(REPLY_BYTES / (frames * FRAME_BYTES)) };
        let (mut state, begun_s) = (lock(&self.state), self.now_s());
        let lost_before = lost(&state.dispatch);
        state.dispatch.begin(request.thetas.len(), limits, begun_s);
        lock(&self.pools.totals).asking = true;
        let (sender, receiver) = channel();
        let tracks = std::thread::scope(|scope| {
            let stop = self.pools.node.shutdown().child();
            let tracks = vec![None; request.thetas.len()];
            let mut batch =
                Batch { simulator: self, request, tracks, stops: BTreeMap::new(), stop: stop.clone(), sender, scope };
            let outcome = batch.run(&mut state, &receiver);
            // The threads that still wait for answers that nobody needs end now.
            stop.trigger();
            outcome.map(|()| batch.tracks)
        });
        lock(&self.pools.totals).asking = false;
        let tracks: Vec<Track> = tracks?.into_iter().flatten().collect();
        let mut totals = lock(&self.pools.totals);
        totals.episodes += tracks.len();
        totals.redone += lost(&state.dispatch) - lost_before;
        drop(totals);
        tracing::debug!("{} episodes in {:.3} s", tracks.len(), self.now_s() - begun_s);
        Ok(tracks)
    }
}

impl PoolsSimulator<'_> {
    fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Which pool did how much, in words.
    pub fn summary(&self) -> String {
        let state = lock(&self.state);
        let total: usize = state.dispatch.tallies().map(|(_, tally)| tally.episodes).sum();
        let share = |n: usize| 100.0 * n as f64 / total.max(1) as f64;
        let of = |(name, tally): (&str, crate::dispatch::Tally)| {
            let lost = if tally.lost > 0 { format!(", {} lost", tally.lost) } else { String::new() };
            format!("{name} {} ({:.0} %{lost})", tally.episodes, share(tally.episodes))
        };
        format!("{total} episodes: {}", state.dispatch.tallies().map(of).collect::<Vec<_>>().join(", "))
    }
}

impl<'scope, 'a> Batch<'scope, 'a> {
    fn run(&mut self, state: &mut State, receiver: &Receiver<Message>) -> Result<(), SimulatorError> {
        let mut looked: Option<Instant> = None;
        loop {
            if looked.is_none_or(|at| at.elapsed() >= LOOK) {
                self.look(state)?;
                looked = Some(Instant::now());
            }
            let now_s = self.simulator.now_s();
            let silent = state.dispatch.expire(now_s);
            self.tell(&silent);
            while let Some(part) = state.dispatch.next(now_s) {
                self.ask(part.call, part.pool, part.episodes)?;
            }
            if state.dispatch.is_done() {
                return Ok(());
            }
            if let Some(reason) = state.dispatch.stalled(now_s) {
                return Err(SimulatorError::Backend(reason));
            }
            if (self.simulator.is_cancelled)() || self.stop.is_triggered() {
                return Err(SimulatorError::Backend("cancelled".to_owned()));
            }
            let wait = Duration::from_secs_f64(state.dispatch.wait_s(now_s)).min(LOOK);
            match receiver.recv_timeout(wait) {
                Ok((call, pool, answer)) => self.hear(state, call, &pool, answer)?,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
        }
    }

    /// Looks who is in the graph.
    fn look(&mut self, state: &mut State) -> Result<(), SimulatorError> {
        let pools = self.simulator.pools;
        let present = pools.present()?;
        let now_s = self.simulator.now_s();
        state.doubles.retain(|name, _| present.get(name).is_some_and(|nodes| *nodes > 1));
        for (name, _) in present.iter().filter(|(_, nodes)| **nodes > 1) {
            let double = state.doubles.entry(name.clone()).or_insert(Double { since_s: now_s, is_told: false });
            if !double.is_told && now_s - double.since_s > SUCCESSION_S {
                double.is_told = true;
                tracing::warn!(
                    "{name}: several pools have this name and do the same work: give each a namespace of its own"
                );
            }
        }
        let events = state.dispatch.set_pools(&present.into_keys().collect());
        for event in &events {
            match event {
                Event::Joined { pool } => {
                    let mut clients = lock(&pools.clients);
                    if !clients.contains_key(pool) {
                        clients.insert(pool.clone(), pools.node.client::<Simulate>(pool).map_err(|e| backend(&e))?);
                    }
                }
                Event::Left { pool, .. } => {
                    lock(&pools.clients).remove(pool);
                    if let Some(stop) = self.stops.remove(pool) {
                        stop.trigger();
                    }
                }
                Event::Silent { .. } => {}
            }
        }
        self.tell(&events);
        Ok(())
    }

    fn tell(&self, events: &[Event]) {
        for event in events {
            match event {
                Event::Joined { pool } => tracing::info!("{pool} is there"),
                Event::Left { pool, episodes: None } => tracing::info!("{pool} has left"),
                Event::Left { pool, episodes: Some(episodes) } => {
                    tracing::warn!("{pool} has left: its {} episodes are done by others", episodes.len());
                }
                Event::Silent { pool, episodes, waited_s } => {
                    tracing::warn!(
                        "{pool}: no answer after {waited_s:.1} s: its {} episodes are done by others",
                        episodes.len()
                    );
                }
            }
        }
    }

    /// Asks a pool for a part, on a thread of its own; what it was asked before need not be answered any more.
    fn ask(&mut self, call: u64, pool: String, part: Range<usize>) -> Result<(), SimulatorError> {
        let client = lock(&self.simulator.pools.clients).get(&pool).cloned();
        let client = client.ok_or_else(|| backend(&format!("{pool}: no client")))?;
        let stop = self.stop.child();
        if let Some(earlier) = self.stops.insert(pool.clone(), stop.clone()) {
            earlier.trigger();
        }
        tracing::debug!("{pool}: episodes {} to {}", part.start, part.end - 1);
        let message = convert::simulate_request(&self.request.part(part), self.simulator.model_yaml);
        let sender = self.sender.clone();
        self.scope.spawn(move || {
            let answer = client.call_until(message, CALL, &stop);
            // The batch may have ended meanwhile.
            let _ = sender.send((call, pool, answer));
        });
        Ok(())
    }

    fn hear(
        &mut self,
        state: &mut State,
        call: u64,
        pool: &str,
        answer: Result<SimulateResponse, CallError>,
    ) -> Result<(), SimulatorError> {
        let now_s = self.simulator.now_s();
        let answer = match answer {
            Ok(answer) => answer,
            // It was told to give up.
            Err(CallError::Shutdown { .. }) => return Ok(()),
            Err(error) => {
                tracing::warn!("{error}");
                state.dispatch.failed(call, &error.to_string(), now_s);
                return Ok(());
            }
        };
        if let Err(reason) = self.check(state, pool, &answer) {
            tracing::error!("{pool} is left out: {reason}");
            state.dispatch.refused(call, &reason);
            return Ok(());
        }
        if !answer.success {
            return Err(SimulatorError::Backend(answer.message));
        }
        let tracks = answer.tracks.iter().map(wire::track_from_msg).collect::<Result<Vec<Track>, _>>();
        let tracks = tracks.map_err(|e| backend(&e))?;
        if let Answered::First(episodes) = state.dispatch.answered(call, now_s) {
            if tracks.len() != episodes.len() {
                let (expected, got) = (episodes.len(), tracks.len());
                return Err(backend(&format!("{pool}: expected {expected} tracks, got {got}")));
            }
            lock(&self.simulator.pools.totals).unconverged_steps += answer.unconverged_steps;
            for (place, track) in self.tracks[episodes].iter_mut().zip(tracks) {
                *place = Some(track);
            }
        }
        Ok(())
    }

    /// Whether a pool's answer belongs to this program and to the others' answers.
    fn check(&self, state: &mut State, pool: &str, answer: &SimulateResponse) -> Result<(), String> {
        if answer.version != VERSION {
            return Err(format!("expected a pool of version {VERSION}, got {:?}", answer.version));
        }
        if !answer.success {
            return Ok(());
        }
        let (meaning, first) = state.meaning.get_or_insert_with(|| (answer.fingerprint, pool.to_owned()));
        if *meaning != answer.fingerprint {
            return Err(format!(
                "its model or its arithmetic is another than that of {first}: fingerprint {:016x}, not {meaning:016x}",
                answer.fingerprint
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_choose_pools_by_name_or_part_of_it() {
        let name = "/cluster/node3/simulator_pool/simulate";
        for pattern in
            ["*", "/cluster/*", "*/simulate", "/cluster/node*/simulator_pool/*", name, "/cluster", "/cluster/node3"]
        {
            assert!(fits(pattern, name), "{pattern}");
        }
        for pattern in ["", "/clus", "/lab/*", "*/simulat", "/cluster/node4", "/cluster/node", "node3*"] {
            assert!(!fits(pattern, name), "{pattern}");
        }
    }
}
