//! Clock of a node: wall time, or `/clock` if `use_sim_time` is set.

use super::point::Time;
use super::shutdown::{Shutdown, Signal, Wake};
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Maximum uninterrupted wait on the wall clock: a step of the system clock is noticed within it.
const LONGEST_WAIT: Duration = Duration::from_secs(1);

struct Inner {
    simulated: AtomicBool,
    simulated_nanos: AtomicI64,
    source: Mutex<Source>,
    signal: Arc<Signal<()>>,
    shutdown: Shutdown,
}

/// Arrivals of `/clock`, in a clock that never steps.
struct Source {
    /// Moment since which `/clock` is followed.
    since: Instant,
    /// Arrival of the newest message.
    heard: Option<Instant>,
    /// Number of messages since the last one with another time.
    repeated: u32,
}

/// Clock of a node. Clones share it.
#[derive(Clone)]
pub struct Clock {
    inner: Arc<Inner>,
}

/// Turn of a periodic loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Start of the turn.
    pub now: Time,
    /// Number of the turn, from 0.
    pub index: u64,
    /// Number of turns skipped so far, because the loop was late by a period or more.
    pub missed: u64,
}

impl Clock {
    /// Creates a wall clock. Its waits end with `shutdown`.
    #[must_use]
    pub fn new(shutdown: &Shutdown) -> Self {
        let signal = Arc::new(Signal::new(()));
        let wake: Arc<dyn Wake> = Arc::<Signal<()>>::clone(&signal);
        // A weak reference: a clock that is dropped needs no wake-up.
        shutdown.register(Arc::downgrade(&wake));
        Self {
            inner: Arc::new(Inner {
                simulated: AtomicBool::new(false),
                simulated_nanos: AtomicI64::new(0),
                source: Mutex::new(Source { since: Instant::now(), heard: None, repeated: 0 }),
                signal,
                shutdown: shutdown.clone(),
            }),
        }
    }

    /// Returns the present time. Simulated time is [`Time::ZERO`] until the first message on `/clock`.
    #[must_use]
    pub fn now(&self) -> Time {
        if self.is_simulated() {
            Time::from_nanos(self.inner.simulated_nanos.load(Ordering::Acquire))
        } else {
            wall_now()
        }
    }

    /// Returns true if the clock follows `/clock`.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.inner.simulated.load(Ordering::Acquire)
    }

    /// Switches between wall and simulated time.
    pub(crate) fn set_simulated(&self, simulated: bool) {
        self.inner.simulated.store(simulated, Ordering::Release);
        // The silence of an earlier /clock says nothing about the new one.
        *self.source() = Source { since: Instant::now(), heard: None, repeated: 0 };
        self.inner.signal.wake();
    }

    /// Sets the time of a `/clock` message.
    pub(crate) fn set_simulated_time(&self, now: Time) {
        let before = self.inner.simulated_nanos.swap(now.nanos(), Ordering::AcqRel);
        let mut source = self.source();
        source.heard = Some(Instant::now());
        source.repeated = if before == now.nanos() { source.repeated.saturating_add(1) } else { 0 };
        drop(source);
        self.inner.signal.wake();
    }

    /// Returns true if simulated time stands still: the newest messages on `/clock` have the time of those before. False on the wall clock.
    #[must_use]
    pub fn stands_still(&self) -> bool {
        self.is_simulated() && self.source().repeated >= 2
    }

    fn source(&self) -> MutexGuard<'_, Source> {
        self.inner.source.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the silence of `/clock` in wall time, and whether a message ever came; `None` on the wall clock.
    pub(crate) fn silence(&self) -> Option<(Duration, bool)> {
        let source = self.source();
        self.is_simulated().then(|| (source.heard.unwrap_or(source.since).elapsed(), source.heard.is_some()))
    }

    /// Waits until `time`. Returns false on shutdown.
    pub fn sleep_until(&self, time: Time) -> bool {
        let mut guard = self.inner.signal.lock();
        loop {
            if self.inner.shutdown.is_triggered() {
                return false;
            }
            let now = self.now();
            if now >= time {
                return true;
            }
            // Simulated time has no deadline in wall time: the next `/clock` message wakes the wait.
            let longest = (!self.is_simulated()).then(|| Instant::now() + time.saturating_since(now).min(LONGEST_WAIT));
            guard = self.inner.signal.wait_until(guard, longest);
        }
    }

    /// Waits for `duration` of this clock. Returns false on shutdown.
    pub fn sleep(&self, duration: Duration) -> bool {
        self.sleep_until(self.now() + duration)
    }

    /// Creates a periodic loop on this clock. Its first turn begins at once.
    #[must_use]
    pub fn rate(&self, period: Duration) -> Rate {
        Rate { clock: self.clone(), period, next: None, index: 0, missed: 0 }
    }
}

/// Returns the present wall time.
#[must_use]
pub fn wall_now() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Time::ZERO + since
}

/// Periodic loop without drift. A late loop skips turns instead of catching up.
pub struct Rate {
    clock: Clock,
    period: Duration,
    next: Option<Time>,
    index: u64,
    missed: u64,
}

impl Rate {
    /// Sets the period from the next turn on.
    pub fn set_period(&mut self, period: Duration) {
        self.period = period;
    }

    /// Waits for the next turn. Returns `None` on shutdown.
    pub fn tick(&mut self) -> Option<Tick> {
        let due = match self.next {
            None => self.clock.now(),
            Some(next) => {
                let now = self.clock.now();
                // After a step back of the clock the loop would wait for as long as the step.
                if next.saturating_since(now) > 2 * self.period { now + self.period } else { next }
            }
        };
        if !self.clock.sleep_until(due) {
            return None;
        }
        let now = self.clock.now();
        let late = now.saturating_since(due);
        let skipped = late.as_nanos().checked_div(self.period.as_nanos()).unwrap_or(0);
        let skipped = u32::try_from(skipped).unwrap_or(u32::MAX);
        self.missed += u64::from(skipped);
        self.next = Some(due + self.period * skipped.saturating_add(1));
        let tick = Tick { now, index: self.index, missed: self.missed };
        self.index += 1;
        Some(tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_keeps_its_period_on_the_wall_clock() {
        let clock = Clock::new(&Shutdown::new());
        let mut rate = clock.rate(Duration::from_millis(10));
        let start = Instant::now();
        let ticks: Vec<_> = (0..6).map(|_| rate.tick().unwrap()).collect();
        assert!(start.elapsed() >= Duration::from_millis(50));
        let index: Vec<_> = ticks.iter().map(|tick| tick.index).collect();
        assert_eq!(index, [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn a_late_loop_skips_turns() {
        let clock = Clock::new(&Shutdown::new());
        clock.set_simulated(true);
        clock.set_simulated_time(Time::from_nanos(1_000));
        let mut rate = clock.rate(Duration::from_nanos(100));
        assert_eq!(rate.tick().unwrap().missed, 0);
        // Due at 1 100: late by two whole periods and a half.
        clock.set_simulated_time(Time::from_nanos(1_350));
        assert_eq!(rate.tick().unwrap().missed, 2);
        clock.set_simulated_time(Time::from_nanos(1_400));
        let tick = rate.tick().unwrap();
        assert_eq!((tick.index, tick.missed), (2, 2));
    }

    #[test]
    fn time_stands_still_when_the_clock_topic_repeats_itself() {
        let clock = Clock::new(&Shutdown::new());
        let mut tell = |nanos| {
            clock.set_simulated_time(Time::from_nanos(nanos));
            clock.stands_still()
        };
        // On the wall clock nothing stands still.
        assert_eq!([5, 5, 5].map(&mut tell), [false; 3]);
        clock.set_simulated(true);
        assert_eq!([6, 6, 6, 7, 7, 7].map(&mut tell), [false, false, true, false, false, true]);
    }

    #[test]
    fn simulated_waits_follow_the_clock_topic_and_end_at_shutdown() {
        let shutdown = Shutdown::new();
        let clock = Clock::new(&shutdown);
        clock.set_simulated(true);
        assert_eq!(clock.now(), Time::ZERO);
        let waiter = {
            let clock = clock.clone();
            std::thread::spawn(move || {
                let reached = clock.sleep_until(Time::from_nanos(500));
                (reached, clock.now(), clock.sleep_until(Time::from_nanos(9_000)))
            })
        };
        clock.set_simulated_time(Time::from_nanos(400));
        // Time for the thread to wake up if it wrongly does.
        std::thread::sleep(Duration::from_millis(10));
        assert!(!waiter.is_finished());
        clock.set_simulated_time(Time::from_nanos(600));
        std::thread::sleep(Duration::from_millis(10));
        shutdown.trigger();
        assert_eq!(waiter.join().unwrap(), (true, Time::from_nanos(600), false));
    }
}
