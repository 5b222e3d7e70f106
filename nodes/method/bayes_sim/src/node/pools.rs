//! Simulator pools of the graph as one simulator.
//!
//! [`Dispatch`] assigns the work. This module holds the threads that wait for answers, the clock and the view of the graph.
#![allow(clippy::disallowed_methods, reason = "the node reads the clock and starts threads")]

use crate::convert;
use crate::dispatch::{Answered, Dispatch, Event, Limits};
use catenary_core::{Model, SimulationRequest, Simulator, SimulatorError, Track};
use catenary_msgs::srv::{Simulate, SimulateResponse};
use catenary_shell::convert as wire;
use catenary_shell::{CallError, Client, Node, Param, Shutdown};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::Scope;
use std::time::{Duration, Instant};

/// Largest size of the tracks of one part in bytes.
const REPLY_BYTES: usize = 48_000;
/// Size of one frame of a track on the wire: 17 numbers of 8 bytes.
const FRAME_BYTES: usize = 17 * 8;
/// Size of a frame's wrench, if the model observes it.
const WRENCH_BYTES: usize = 3 * 8;
/// Assumed frames of a track whose length depends on the steps of a policy: 16 steps and the start.
const DEFAULT_FRAMES: usize = 17;
/// Period at which the pools in the graph are updated.
const GRAPH_PERIOD: Duration = Duration::from_millis(100);
/// Longest wait for one answer. [`Dispatch`] gives up a part much earlier.
const CALL: Duration = Duration::from_secs(3600);
/// Time in s for which a pool that died may still count beside its replacement: somewhat more than its lease in discovery.
const TAKEOVER_S: f64 = 15.0;
/// Version of the pools whose answers are accepted: another version may simulate something else.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Figures of all inferences of this node.
#[derive(Debug, Clone, Copy, Default)]
pub struct Totals {
    /// Number of simulated episodes.
    pub episodes: usize,
    /// Number of episodes that one pool was asked for and another one simulated.
    pub redone: usize,
    /// Number of time steps without convergence in the accepted episodes.
    pub unconverged_steps: u64,
    /// Number of pools at the last update of the graph.
    pub pools: usize,
    /// True while a batch is being simulated.
    pub asking: bool,
}

/// Pools that this node may ask.
pub struct Pools {
    node: Node,
    /// Patterns of the names of their services.
    patterns: Param<String>,
    /// Time in s that an inference waits for a pool.
    stall_s: Param<f64>,
    /// Clients of the pools, by the name of the service.
    clients: Mutex<BTreeMap<String, Client<Simulate>>>,
    totals: Mutex<Totals>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pools {
    /// Pools in the graph of `node` whose service matches one of the comma-separated `patterns`.
    pub fn new(node: Node, patterns: Param<String>, stall_s: Param<f64>) -> Self {
        Self { node, patterns, stall_s, clients: Mutex::default(), totals: Mutex::default() }
    }

    /// Figures so far.
    pub fn totals(&self) -> Totals {
        *lock(&self.totals)
    }

    /// Simulator of one model, with the text of its file. It fails once `is_cancelled` returns true.
    pub fn simulator<'a>(
        &'a self,
        (model_yaml, model): (&'a str, &'a Model),
        is_cancelled: &'a dyn Fn() -> bool,
    ) -> PoolsSimulator<'a> {
        let dispatch = Dispatch::new(Limits::of_parts(1));
        let state = State { dispatch, fingerprint: None, ranges: BTreeMap::new(), shared_names: BTreeMap::new() };
        PoolsSimulator { pools: self, model_yaml, model, is_cancelled, start: Instant::now(), state: Mutex::new(state) }
    }

    /// Services present in the graph, each with the number of nodes that serve it.
    fn present(&self) -> Result<BTreeMap<String, usize>, SimulatorError> {
        let mut found = self.node.services_of_type::<Simulate>().map_err(|e| backend(&e))?;
        let patterns = self.patterns.get();
        let trimmed = |pattern: &'_ str| pattern.trim().trim_end_matches('/').to_owned();
        found.retain(|name, _| patterns.split(',').any(|pattern| matches_pattern(&trimmed(pattern), name)));
        lock(&self.totals).pools = found.len();
        Ok(found)
    }
}

/// Returns true if `name` matches `pattern`, in which `*` stands for any text. A pattern without `*` may also be the namespace
/// or the node.
fn matches_pattern(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None if pattern.is_empty() => false,
        None => name == pattern || (name.starts_with(pattern) && name[pattern.len()..].starts_with('/')),
        Some((head, rest)) => match name.strip_prefix(head) {
            Some(_) if rest.is_empty() => true,
            Some(tail) => (0..=tail.len()).any(|at| tail.get(at..).is_some_and(|tail| matches_to_the_end(rest, tail))),
            None => false,
        },
    }
}

/// Returns true if `pattern` matches the whole rest of a name: a rest without `*` is no namespace.
fn matches_to_the_end(pattern: &str, name: &str) -> bool {
    if pattern.contains('*') { matches_pattern(pattern, name) } else { name == pattern }
}

/// Number of episodes that one pool was asked for and another one simulated.
fn lost(dispatch: &Dispatch) -> usize {
    dispatch.tallies().map(|(_, tally)| tally.lost).sum()
}

/// Error of the simulator from that of a pool.
fn backend(error: &dyn std::fmt::Display) -> SimulatorError {
    SimulatorError::Backend(error.to_string())
}

/// State of a simulator over several pools.
struct State {
    dispatch: Dispatch,
    /// Fingerprint of the model in the first answer, and the pool that gave it.
    fingerprint: Option<(u64, String)>,
    /// Range of each inferred parameter in the first answer: smallest and largest value that the pools accept.
    ranges: BTreeMap<String, [f64; 2]>,
    /// Services that several nodes serve under one name.
    shared_names: BTreeMap<String, SharedName>,
}

/// Service that several nodes serve under one name.
struct SharedName {
    since_s: f64,
    /// True once a warning was given.
    is_reported: bool,
}

/// Simulator of one model over all pools.
pub struct PoolsSimulator<'a> {
    pools: &'a Pools,
    model_yaml: &'a str,
    model: &'a Model,
    is_cancelled: &'a dyn Fn() -> bool,
    start: Instant,
    state: Mutex<State>,
}

/// Number of a call, its pool and the answer.
type Message = (u64, String, Result<SimulateResponse, CallError>);

/// Batch that is being simulated.
struct Batch<'scope, 'a> {
    simulator: &'a PoolsSimulator<'a>,
    request: &'a SimulationRequest,
    /// Accepted tracks by episode.
    tracks: Vec<Option<Track>>,
    /// Switch that ends the newest request to each pool.
    stops: BTreeMap<String, Shutdown>,
    /// Switch that ends all requests.
    stop: Shutdown,
    sender: Sender<Message>,
    scope: &'scope Scope<'scope, 'a>,
}

impl Simulator for PoolsSimulator<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let frames = request.frame_times_s.len().max(DEFAULT_FRAMES);
        let frame_bytes = FRAME_BYTES + self.model.observation.wrench.map_or(0, |_| WRENCH_BYTES);
        let limits =
            Limits { stall_s: self.pools.stall_s.get(), ..Limits::of_parts(REPLY_BYTES / (frames * frame_bytes)) };
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
            // Threads may still wait for answers that are no longer needed: the scope must not wait for them.
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

    /// Range in the pools' answers; none before the first batch.
    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        lock(&self.state).ranges.get(name).copied()
    }
}

impl PoolsSimulator<'_> {
    /// Time in s since the simulator was made.
    fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Episodes and share of each pool, in words.
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
    /// Simulates the batch until every episode has a track.
    fn run(&mut self, state: &mut State, receiver: &Receiver<Message>) -> Result<(), SimulatorError> {
        let mut updated: Option<Instant> = None;
        loop {
            if updated.is_none_or(|at| at.elapsed() >= GRAPH_PERIOD) {
                self.update_pools(state)?;
                updated = Some(Instant::now());
            }
            let now_s = self.simulator.now_s();
            let silent = state.dispatch.expire(now_s);
            self.log(&silent);
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
            // At most a period, also to notice a cancel.
            let wait = Duration::from_secs_f64(state.dispatch.wait_s(now_s)).min(GRAPH_PERIOD);
            match receiver.recv_timeout(wait) {
                Ok((call, pool, answer)) => self.receive(state, call, &pool, answer)?,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
        }
    }

    /// Updates the pools from the graph.
    fn update_pools(&mut self, state: &mut State) -> Result<(), SimulatorError> {
        let pools = self.simulator.pools;
        let present = pools.present()?;
        let now_s = self.simulator.now_s();
        state.shared_names.retain(|name, _| present.get(name).is_some_and(|nodes| *nodes > 1));
        for (name, _) in present.iter().filter(|(_, nodes)| **nodes > 1) {
            let shared =
                state.shared_names.entry(name.clone()).or_insert(SharedName { since_s: now_s, is_reported: false });
            // A pool that was killed stays in the graph until its lease ends: no warning before.
            if !shared.is_reported && now_s - shared.since_s > TAKEOVER_S {
                shared.is_reported = true;
                tracing::warn!(
                    "{name}: several pools have this name and simulate the same episodes: give each a namespace of its own"
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
        self.log(&events);
        Ok(())
    }

    /// Logs what happened to the pools.
    fn log(&self, events: &[Event]) {
        for event in events {
            match event {
                Event::Joined { pool } => tracing::info!("{pool} joined"),
                Event::Left { pool, episodes: None } => tracing::info!("{pool} left"),
                Event::Left { pool, episodes: Some(episodes) } => {
                    tracing::warn!("{pool} left: its {} episodes go to other pools", episodes.len());
                }
                Event::Silent { pool, episodes, waited_s } => {
                    tracing::warn!(
                        "{pool}: no answer after {waited_s:.1} s: its {} episodes go to other pools",
                        episodes.len()
                    );
                }
            }
        }
    }

    /// Asks a pool for a part on a new thread, which ends an earlier request to the pool.
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
            // No one receives if the batch has ended meanwhile.
            let _ = sender.send((call, pool, answer));
        });
        Ok(())
    }

    /// Processes an answer.
    fn receive(
        &mut self,
        state: &mut State,
        call: u64,
        pool: &str,
        answer: Result<SimulateResponse, CallError>,
    ) -> Result<(), SimulatorError> {
        let now_s = self.simulator.now_s();
        let answer = match answer {
            Ok(answer) => answer,
            // This side ended the request.
            Err(CallError::Shutdown { .. }) => return Ok(()),
            Err(error) => {
                tracing::warn!("{error}");
                state.dispatch.failed(call, &error.to_string(), now_s);
                return Ok(());
            }
        };
        // The version comes first: a failure that a pool of another version reports must not fail the batch.
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
        if state.ranges.is_empty() {
            let ranges = answer.theta_low.iter().zip(&answer.theta_high).map(|(low, high)| [*low, *high]);
            let names = self.simulator.model.theta.parameters().iter().map(|p| p.name.clone());
            state.ranges = names.zip(ranges).collect();
        }
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

    /// Checks that an answer has the version of this program and the fingerprint of the other pools' answers.
    fn check(&self, state: &mut State, pool: &str, answer: &SimulateResponse) -> Result<(), String> {
        if answer.version != VERSION {
            return Err(format!("expected a pool of version {VERSION}, got {:?}", answer.version));
        }
        if !answer.success {
            return Ok(());
        }
        let (fingerprint, first) = state.fingerprint.get_or_insert_with(|| (answer.fingerprint, pool.to_owned()));
        if *fingerprint != answer.fingerprint {
            return Err(format!(
                "its model or its arithmetic differs from that of {first}: fingerprint {:016x}, not {fingerprint:016x}",
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
    fn patterns_choose_pools_by_name_namespace_or_node() {
        let name = "/cluster/node3/simulator_pool/simulate";
        for pattern in
            ["*", "/cluster/*", "*/simulate", "/cluster/node*/simulator_pool/*", name, "/cluster", "/cluster/node3"]
        {
            assert!(matches_pattern(pattern, name), "{pattern}");
        }
        for pattern in ["", "/clus", "/lab/*", "*/simulat", "/cluster/node4", "/cluster/node", "node3*"] {
            assert!(!matches_pattern(pattern, name), "{pattern}");
        }
    }
}
