//! Network between server and client: loss, jitter and stalls of robot states, seeded.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::collections::VecDeque;

/// Quality of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Network {
    /// No loss, no delay.
    #[default]
    None,
    /// Two laboratories with a Panda and a kernel without real-time patches.
    ///
    /// Source: recordings of 30 s that franka-rs publishes. 0.08 to 0.34 % of states were lost, never two in a row; 99 % of periods
    /// were below 1.15 to 1.23 ms, the longest was 5.3 to 7.6 ms; 1 to 1.5 % of commands came too late.
    Lab,
}

/// Fault of the network on demand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Loses this many of the next states.
    LoseStates(u32),
    /// Loses this many of the next commands.
    LoseCommands(u32),
    /// Sends this many of the next states twice.
    RepeatStates(u32),
    /// Sends the next state after the one that follows it.
    SwapStates,
    /// Loses all states and commands while true.
    Cut(bool),
}

/// Share of lost states in a laboratory. Middle of 0.08 to 0.34 %.
const LOSS: f64 = 0.002;
/// Spread of the delay of a state, ms. Chosen: the period, 1 ms and the difference of two such delays, has its 99th percentile at
/// 1.19 ms.
const JITTER_MS: f64 = 0.095;
/// Share of states that begin a stall. Chosen: with [`STALL_MS`] and [`LOSS`], 1 to 1.5 % of commands come too late.
const STALLS: f64 = 0.003;
/// Shortest and longest stall, ms. Chosen: the longest period of a recording was 5.3 to 7.6 ms.
const STALL_MS: [f64; 2] = [1.0, 6.0];

/// State on its way.
#[derive(Debug)]
pub struct Underway {
    /// Time of arrival, ms on the clock of the caller.
    pub due_ms: f64,
    /// Datagram.
    pub datagram: Box<[u8]>,
}

/// Way of states from the server to a client.
#[derive(Debug)]
pub struct Link {
    network: Network,
    random: ChaCha8Rng,
    underway: VecDeque<Underway>,
    /// Spare buffers, so that a running stream allocates nothing.
    spare: Vec<Box<[u8]>>,
    lost_last: bool,
    lose_states: u32,
    lose_commands: u32,
    repeat_states: u32,
    is_cut: bool,
    swap: bool,
    held: Option<Underway>,
}

impl Link {
    /// Link with its own random numbers.
    pub fn new(network: Network, seed: u64) -> Self {
        Self {
            network,
            random: ChaCha8Rng::seed_from_u64(seed),
            underway: VecDeque::new(),
            spare: Vec::new(),
            lost_last: false,
            lose_states: 0,
            lose_commands: 0,
            repeat_states: 0,
            is_cut: false,
            swap: false,
            held: None,
        }
    }

    /// Adds a fault to those that wait.
    pub fn inject(&mut self, fault: Fault) {
        match fault {
            Fault::LoseStates(count) => self.lose_states += count,
            Fault::LoseCommands(count) => self.lose_commands += count,
            Fault::RepeatStates(count) => self.repeat_states += count,
            Fault::SwapStates => self.swap = true,
            Fault::Cut(is_cut) => self.is_cut = is_cut,
        }
    }

    /// Forgets the states underway: the client left.
    pub fn clear(&mut self) {
        while let Some(state) = self.underway.pop_front().or_else(|| self.held.take()) {
            self.spare.push(state.datagram);
        }
    }

    /// Returns true if the command that came is lost.
    pub fn loses_command(&mut self) -> bool {
        let lost = self.lose_commands > 0;
        self.lose_commands -= u32::from(lost);
        lost || self.is_cut
    }

    /// Takes a state at `now_ms`. Returns true if it is due at once, so that its command can come within the cycle.
    pub fn send(&mut self, now_ms: f64, datagram: &[u8]) -> bool {
        if self.loses_state() {
            return false;
        }
        // A datagram does not overtake another one.
        let earliest_ms = self.underway.back().map_or(now_ms, |last| last.due_ms.max(now_ms));
        let due_ms = earliest_ms.max(now_ms + self.delay_ms());
        let state = Underway { due_ms, datagram: self.copy(datagram) };
        if std::mem::take(&mut self.swap) {
            self.held = Some(state);
            return false;
        }
        self.underway.push_back(state);
        if self.repeat_states > 0 {
            self.repeat_states -= 1;
            let again = self.copy(datagram);
            self.underway.push_back(Underway { due_ms, datagram: again });
        }
        if let Some(held) = self.held.take() {
            self.underway.push_back(Underway { due_ms, ..held });
        }
        due_ms < now_ms + 1.0
    }

    /// Time at which the next state is due, ms.
    pub fn next_due_ms(&self) -> Option<f64> {
        self.underway.front().map(|state| state.due_ms)
    }

    /// Passes on every state that is due at `now_ms`.
    pub fn deliver(&mut self, now_ms: f64, mut to: impl FnMut(&[u8])) {
        while self.next_due_ms().is_some_and(|due_ms| due_ms <= now_ms) {
            let Some(state) = self.underway.pop_front() else { return };
            to(&state.datagram);
            self.spare.push(state.datagram);
        }
    }

    fn loses_state(&mut self) -> bool {
        if self.is_cut {
            return true;
        }
        if self.lose_states > 0 {
            self.lose_states -= 1;
            return true;
        }
        // In the recordings, no two states in a row were lost.
        let drawn = self.network == Network::Lab && self.random.random_bool(LOSS);
        self.lost_last = drawn && !self.lost_last;
        self.lost_last
    }

    fn delay_ms(&mut self) -> f64 {
        if self.network == Network::None {
            return 0.0;
        }
        let jitter_ms = Normal::new(0.0, JITTER_MS).map_or(0.0, |normal| normal.sample(&mut self.random)).abs();
        let stalls = self.random.random_bool(STALLS);
        jitter_ms + if stalls { self.random.random_range(STALL_MS[0]..STALL_MS[1]) } else { 0.0 }
    }

    fn copy(&mut self, datagram: &[u8]) -> Box<[u8]> {
        match self.spare.pop() {
            Some(mut buffer) if buffer.len() == datagram.len() => {
                buffer.copy_from_slice(datagram);
                buffer
            }
            _ => datagram.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arrivals of `count` states that leave each millisecond: identifier and time, ms.
    fn arrivals(link: &mut Link, count: u32) -> Vec<(u32, f64)> {
        let mut got = Vec::new();
        for id in 0..count {
            link.send(f64::from(id), &id.to_le_bytes());
            // Deliveries in steps of 10 us, until the next state leaves.
            for step in 0..100 {
                let now_ms = f64::from(id) + f64::from(step) / 100.0;
                link.deliver(now_ms, |bytes| got.push((u32::from_le_bytes(bytes.try_into().unwrap()), now_ms)));
            }
        }
        got
    }

    #[test]
    fn without_a_preset_every_state_is_due_at_once() {
        let mut link = Link::new(Network::None, 1);
        assert!((0..100).all(|id| link.send(f64::from(id), &[0])));
    }

    #[test]
    fn the_laboratory_has_the_loss_jitter_and_stalls_of_the_recordings() {
        let got = arrivals(&mut Link::new(Network::Lab, 3), 60_000);
        let lost = 1.0 - got.len() as f64 / 60_000.0;
        assert!((0.0008..0.0034).contains(&lost), "share of lost states: {lost}");
        let pairs = || got.windows(2).map(|w| (w[1].0 - w[0].0, w[1].1 - w[0].1));
        assert!(pairs().all(|(ids, _)| ids <= 2), "two states in a row are never lost");
        let mut periods_ms: Vec<f64> = pairs().filter(|(ids, _)| *ids == 1).map(|(_, ms)| ms).collect();
        periods_ms.sort_by(f64::total_cmp);
        let p99_ms = periods_ms[periods_ms.len() * 99 / 100];
        assert!((1.15..1.24).contains(&p99_ms), "99th percentile of the period: {p99_ms} ms");
        let longest_ms = *periods_ms.last().unwrap();
        assert!((5.3..7.6).contains(&longest_ms), "longest period: {longest_ms} ms");
        let late = got.iter().filter(|(id, ms)| ms - f64::from(*id) >= 1.0).count() as f64 / 60_000.0;
        assert!((0.01..0.015).contains(&(late + lost)), "share of missed cycles: {}", late + lost);
    }

    #[test]
    fn the_same_seed_gives_the_same_arrivals() {
        let run = |seed| arrivals(&mut Link::new(Network::Lab, seed), 5000);
        assert_eq!(run(7), run(7));
        assert_ne!(run(7), run(8));
    }

    #[test]
    fn faults_come_on_demand() {
        let mut link = Link::new(Network::None, 1);
        link.inject(Fault::LoseStates(2));
        link.inject(Fault::SwapStates);
        link.inject(Fault::RepeatStates(1));
        let ids: Vec<u32> = arrivals(&mut link, 7).iter().map(|(id, _)| *id).collect();
        assert_eq!(ids, [3, 3, 2, 4, 5, 6]);
        link.inject(Fault::LoseCommands(1));
        assert!(link.loses_command() && !link.loses_command());
    }
}
