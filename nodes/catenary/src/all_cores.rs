//! Numbered work on all cores, with the results in order.

use anyhow::{Context, Result};
use catenary_simulator::workers;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;

/// Sets the shared counter to its end when dropped, so that no worker takes another number.
struct StopOnDrop<'a>(&'a AtomicU64, u64);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(self.1, Ordering::Relaxed);
    }
}

/// Calls `work` with all `numbers` on every core, and `keep` with each result, in order. The first error stops it.
pub fn in_order<T: Send>(
    numbers: Range<u64>,
    work: impl Fn(u64) -> Result<T> + Sync,
    mut keep: impl FnMut(T) -> Result<()>,
) -> Result<()> {
    let (next, end) = (AtomicU64::new(numbers.start), numbers.end);
    let (sender, done) = channel();
    std::thread::scope(|scope| {
        for _ in 0..workers::available() {
            let (sender, next, work) = (sender.clone(), &next, &work);
            scope.spawn(move || {
                // A worker that panics stops the other workers too.
                let _last = StopOnDrop(next, end);
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    // A closed channel means that `keep` has failed: nobody needs further results.
                    if number >= end || sender.send((number, work(number))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let _last = StopOnDrop(&next, end);
        // Results that arrived before their turn.
        let mut early = BTreeMap::new();
        for number in numbers {
            let outcome = loop {
                if let Some(outcome) = early.remove(&number) {
                    break outcome;
                }
                let (of, outcome) = done.recv().context("a worker died")?;
                early.insert(of, outcome);
            };
            outcome.and_then(&mut keep)?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_on_all_cores_is_kept_in_order_up_to_the_first_error() {
        let slow_first = |number: u64| {
            // Results arrive out of order: every third number takes longest.
            std::thread::sleep(std::time::Duration::from_millis(if number.is_multiple_of(3) { 20 } else { 1 }));
            if number == 40 { anyhow::bail!("no {number}") } else { Ok(number) }
        };
        let mut kept = Vec::new();
        in_order(3..20, slow_first, |number| {
            kept.push(number);
            Ok(())
        })
        .unwrap();
        assert_eq!(kept, (3..20).collect::<Vec<_>>());
        kept.clear();
        // The range is far longer than the test may take: it ends in time only if the error stops the workers.
        let error = in_order(30..1_000_000, slow_first, |number| {
            kept.push(number);
            Ok(())
        });
        assert_eq!((error.unwrap_err().to_string(), kept), ("no 40".to_owned(), (30..40).collect()));
        assert!(in_order(0..10, slow_first, |_| anyhow::bail!("full")).is_err());
    }
}
