//! Blocking on futures from plain threads, with a deadline and without a reactor.
//!
//! Hand-written: `smol::future::block_on` has no deadline, and a timer of smol would need its reactor thread.

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::Thread;
use std::time::Instant;

struct Unpark {
    thread: Thread,
    woken: AtomicBool,
}

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        if !self.woken.swap(true, Ordering::AcqRel) {
            self.thread.unpark();
        }
    }
}

/// Runs a future on this thread until it is ready. Returns `None` at the deadline.
pub(crate) fn block_until<F: Future>(future: F, deadline: Option<Instant>) -> Option<F::Output> {
    let mut future = pin!(future);
    let unpark = Arc::new(Unpark { thread: std::thread::current(), woken: AtomicBool::new(false) });
    let waker = Waker::from(Arc::clone(&unpark));
    let mut context = Context::from_waker(&waker);
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
            return Some(output);
        }
        // A park may end without a wake-up, so the flag decides.
        while !unpark.woken.swap(false, Ordering::AcqRel) {
            match deadline {
                None => std::thread::park(),
                Some(deadline) => {
                    let now = Instant::now();
                    if now >= deadline {
                        return None;
                    }
                    std::thread::park_timeout(deadline - now);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_ready_future_returns_and_a_silent_one_ends_at_the_deadline() {
        assert_eq!(block_until(async { 3 }, None), Some(3));
        let start = Instant::now();
        let deadline = start + Duration::from_millis(20);
        assert_eq!(block_until(std::future::pending::<()>(), Some(deadline)), None);
        assert!(start.elapsed() >= Duration::from_millis(20));
    }

    #[test]
    fn a_wake_up_from_another_thread_is_seen_even_after_a_nested_call() {
        let (sender, receiver) = smol::channel::bounded(1);
        let thread = std::thread::spawn(move || {
            block_until(
                async {
                    block_until(async {}, None);
                    receiver.recv().await
                },
                Some(Instant::now() + Duration::from_secs(5)),
            )
        });
        std::thread::sleep(Duration::from_millis(10));
        sender.try_send(7).unwrap();
        assert_eq!(thread.join().unwrap(), Some(Ok(7)));
    }
}
