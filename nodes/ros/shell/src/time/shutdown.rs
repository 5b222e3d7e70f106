//! Orderly shutdown: a flag that also wakes every waiter.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Waiter that must be woken at shutdown.
pub(crate) trait Wake: Send + Sync {
    /// Wakes the waiter, which then sees the flag.
    fn wake(&self);
}

/// Mutex with a condition variable that shutdown notifies.
pub(crate) struct Signal<T> {
    state: Mutex<T>,
    changed: Condvar,
}

impl<T> Signal<T> {
    pub(crate) fn new(state: T) -> Self {
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, T> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn notify(&self) {
        self.changed.notify_all();
    }

    pub(crate) fn wait<'a>(&'a self, guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
        self.changed.wait(guard).unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a notification, at most until the deadline; `None`: without limit.
    pub(crate) fn wait_until<'a>(&'a self, guard: MutexGuard<'a, T>, deadline: Option<Instant>) -> MutexGuard<'a, T> {
        let Some(deadline) = deadline else {
            return self.wait(guard);
        };
        let timeout = deadline.saturating_duration_since(Instant::now());
        self.changed.wait_timeout(guard, timeout).unwrap_or_else(PoisonError::into_inner).0
    }
}

impl<T: Send> Wake for Signal<T> {
    fn wake(&self) {
        // A waiter between its check of the flag and its wait holds the lock. Without taking it the wake-up could be lost.
        drop(self.lock());
        self.notify();
    }
}

/// Flag that a node or a process must end. Clones share it.
#[derive(Clone)]
pub struct Shutdown {
    inner: Arc<Inner>,
}

struct Inner {
    flag: AtomicBool,
    wakes: Mutex<Vec<Weak<dyn Wake>>>,
    own: Arc<Signal<()>>,
    close: smol::channel::Sender<()>,
    closed: smol::channel::Receiver<()>,
}

impl Inner {
    fn trigger(&self) {
        if self.flag.swap(true, Ordering::AcqRel) {
            return;
        }
        self.close.close();
        self.own.wake();
        // Taken out of the lock: a waiter may register another one while it is woken.
        let wakes = std::mem::take(&mut *self.wakes.lock().unwrap_or_else(PoisonError::into_inner));
        for wake in wakes.iter().filter_map(Weak::upgrade) {
            wake.wake();
        }
    }
}

impl Wake for Inner {
    fn wake(&self) {
        self.trigger();
    }
}

impl Default for Shutdown {
    fn default() -> Self {
        Self::new()
    }
}

impl Shutdown {
    /// Creates an untriggered shutdown.
    #[must_use]
    pub fn new() -> Self {
        let (close, closed) = smol::channel::bounded(1);
        Self {
            inner: Arc::new(Inner {
                flag: AtomicBool::new(false),
                wakes: Mutex::new(Vec::new()),
                own: Arc::new(Signal::new(())),
                close,
                closed,
            }),
        }
    }

    /// Creates a shutdown that is triggered with this one, and may be triggered before it.
    #[must_use]
    pub fn child(&self) -> Self {
        let child = Self::new();
        let inner: Arc<dyn Wake> = Arc::<Inner>::clone(&child.inner);
        self.register(Arc::downgrade(&inner));
        child
    }

    /// Returns true once it is triggered.
    #[must_use]
    pub fn is_triggered(&self) -> bool {
        self.inner.flag.load(Ordering::Acquire)
    }

    /// Triggers it and wakes every waiter. A second call does nothing.
    pub fn trigger(&self) {
        self.inner.trigger();
    }

    /// Waits until it is triggered.
    pub fn wait(&self) {
        let mut guard = self.inner.own.lock();
        while !self.is_triggered() {
            guard = self.inner.own.wait(guard);
        }
    }

    /// Waits until it is triggered, at most `timeout`. Returns true if it is triggered.
    pub fn wait_timeout(&self, timeout: Duration) -> bool {
        let deadline = Instant::now() + timeout;
        let mut guard = self.inner.own.lock();
        while !self.is_triggered() && Instant::now() < deadline {
            guard = self.inner.own.wait_until(guard, Some(deadline));
        }
        self.is_triggered()
    }

    /// Resolves when it is triggered.
    pub(crate) async fn triggered(&self) {
        // The channel never carries a value. An error means that it was closed.
        while self.inner.closed.recv().await.is_ok() {}
    }

    /// Registers a waiter. It is woken at shutdown, or at once if that has come.
    pub(crate) fn register(&self, wake: Weak<dyn Wake>) {
        {
            let mut wakes = self.inner.wakes.lock().unwrap_or_else(PoisonError::into_inner);
            wakes.retain(|wake| wake.strong_count() > 0);
            wakes.push(wake.clone());
        }
        // Checked after the registration: a trigger in between must not be missed. A second wake-up does no harm.
        if self.is_triggered()
            && let Some(wake) = wake.upgrade()
        {
            wake.wake();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_is_triggered_with_its_parent_or_before_it() {
        let parent = Shutdown::new();
        let (early, late) = (parent.child(), parent.child());
        early.trigger();
        assert!(early.is_triggered() && !late.is_triggered() && !parent.is_triggered());
        parent.trigger();
        assert!(late.is_triggered() && parent.child().is_triggered());
    }

    #[test]
    fn triggering_wakes_threads_and_futures() {
        let shutdown = Shutdown::new();
        let signal = Arc::new(Signal::new(0_u32));
        let weak: Weak<dyn Wake> = Arc::downgrade(&(Arc::clone(&signal) as Arc<dyn Wake>));
        shutdown.register(weak);
        let waiting = {
            let (shutdown, signal) = (shutdown.clone(), Arc::clone(&signal));
            std::thread::spawn(move || {
                let mut guard = signal.lock();
                while !shutdown.is_triggered() {
                    guard = signal.wait(guard);
                }
                drop(guard);
                smol::future::block_on(shutdown.triggered());
                shutdown.wait();
            })
        };
        assert!(!shutdown.wait_timeout(Duration::from_millis(5)));
        shutdown.trigger();
        waiting.join().unwrap();
        assert!(shutdown.wait_timeout(Duration::from_secs(5)));
    }
}
