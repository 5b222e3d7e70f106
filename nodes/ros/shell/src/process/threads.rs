//! Threads of a node: named, joined at shutdown, and with every panic logged.

use super::logging::Rosout;
use crate::error::ShellError;
use crate::time::shutdown::{Shutdown, Signal};
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Timeout of shutdown for threads to end.
const JOIN_TIMEOUT: Duration = Duration::from_secs(3);

/// Numbers and names of the running threads.
type Running = Signal<Vec<(u64, String)>>;

static NEXT: AtomicU64 = AtomicU64::new(1);

thread_local! {
    static OWN: Cell<u64> = const { Cell::new(0) };
}

pub(crate) struct Threads {
    rosout: Arc<Rosout>,
    shutdown: Shutdown,
    running: Arc<Running>,
    panicked: Arc<Mutex<Option<String>>>,
    handles: Mutex<Vec<JoinHandle<()>>>,
}

struct Guard {
    number: u64,
    name: String,
    shutdown: Shutdown,
    running: Arc<Running>,
    panicked: Arc<Mutex<Option<String>>>,
}

impl Drop for Guard {
    fn drop(&mut self) {
        if std::thread::panicking() {
            tracing::error!("thread {} panicked: the node shuts down", self.name);
            // The first panic is kept: later ones may follow from it.
            self.panicked.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| self.name.clone());
            self.shutdown.trigger();
        }
        self.running.lock().retain(|(number, _)| *number != self.number);
        self.running.notify();
    }
}

impl Threads {
    pub(crate) fn new(rosout: Arc<Rosout>, shutdown: Shutdown) -> Self {
        Self {
            rosout,
            shutdown,
            running: Arc::new(Signal::new(Vec::new())),
            panicked: Arc::new(Mutex::new(None)),
            handles: Mutex::new(Vec::new()),
        }
    }

    /// Starts a thread. A panic in it is logged and ends the node.
    pub(crate) fn spawn(&self, name: &str, body: impl FnOnce() + Send + 'static) -> Result<(), ShellError> {
        let rosout = Arc::clone(&self.rosout);
        let (shutdown, running, panicked) =
            (self.shutdown.clone(), Arc::clone(&self.running), Arc::clone(&self.panicked));
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        // Entered before the start, so that `join` cannot miss a thread that is just starting.
        running.lock().push((number, name.to_owned()));
        let guard = Guard { number, name: name.to_owned(), shutdown, running, panicked };
        let handle = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                OWN.set(number);
                rosout.enter();
                let _guard = guard;
                body();
            })
            .map_err(|error| ShellError::create(format!("thread {name}"), error))?;
        let mut handles = self.handles.lock().unwrap_or_else(PoisonError::into_inner);
        // Goals start a thread each, so finished handles must not accumulate.
        handles.retain(|handle| !handle.is_finished());
        handles.push(handle);
        Ok(())
    }

    /// Returns the name of the first thread that panicked.
    pub(crate) fn panicked(&self) -> Option<String> {
        self.panicked.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until all threads except the calling one have ended. The error holds the names of those that did not end in time.
    pub(crate) fn join(&self) -> Result<(), Vec<String>> {
        // A node may be stopped from one of its own threads, which cannot wait for itself.
        let own = OWN.get();
        let deadline = Instant::now() + JOIN_TIMEOUT;
        let handles = std::mem::take(&mut *self.handles.lock().unwrap_or_else(PoisonError::into_inner));
        let mut guard = self.running.lock();
        loop {
            let others = guard.iter().filter(|(number, _)| *number != own);
            let late: Vec<String> = others.map(|(_, name)| name.clone()).collect();
            if late.is_empty() {
                break;
            }
            if Instant::now() >= deadline {
                return Err(late);
            }
            guard = self.running.wait_until(guard, Some(deadline));
        }
        drop(guard);
        for handle in handles {
            // A thread that joins itself would wait for ever.
            if handle.thread().id() != std::thread::current().id() {
                // The thread's guard has logged a panic.
                let _panic = handle.join();
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn threads() -> (Threads, Shutdown) {
        let shutdown = Shutdown::new();
        (Threads::new(Rosout::new("node").0, shutdown.clone()), shutdown)
    }

    #[test]
    fn a_panic_is_named_and_triggers_shutdown() {
        let (threads, shutdown) = threads();
        threads.spawn("worker", || panic!("on purpose")).unwrap();
        shutdown.wait();
        threads.join().unwrap();
        assert_eq!(threads.panicked().as_deref(), Some("worker"));
    }

    #[test]
    fn join_waits_for_all_except_its_own_thread() {
        let (threads, shutdown) = threads();
        let threads = Arc::new(threads);
        let (sender, receiver) = std::sync::mpsc::channel();
        let inner = Arc::clone(&threads);
        threads.spawn("joiner", move || sender.send(inner.join()).unwrap()).unwrap();
        let ending = shutdown.clone();
        threads.spawn("sleeper", move || ending.wait()).unwrap();
        shutdown.trigger();
        assert_eq!(receiver.recv().unwrap(), Ok(()));
        threads.join().unwrap();
    }
}
