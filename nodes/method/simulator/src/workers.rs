//! Parallel map with results in order.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Applies `work` to every item on `workers` threads. Returns the results in the items' order. The assignment of items
/// to threads is left to chance, so that `work` must not depend on it.
#[allow(clippy::disallowed_methods, reason = "the pool's workers are the one place where pure code starts threads")]
pub fn map<T: Send, R: Send>(items: Vec<T>, workers: usize, work: impl Fn(usize, T) -> R + Sync) -> Vec<R> {
    let count = items.len();
    if workers <= 1 || count <= 1 {
        return items.into_iter().enumerate().map(|(i, item)| work(i, item)).collect();
    }
    let items: Vec<Mutex<Option<T>>> = items.into_iter().map(|item| Mutex::new(Some(item))).collect();
    let results: Vec<Mutex<Option<R>>> = (0..count).map(|_| Mutex::new(None)).collect();
    let next = AtomicUsize::new(0);
    let run = || loop {
        let i = next.fetch_add(1, Ordering::Relaxed);
        let Some(slot) = items.get(i) else { return };
        if let Some(item) = slot.lock().unwrap_or_else(PoisonError::into_inner).take() {
            let result = work(i, item);
            *results[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
        }
    };
    std::thread::scope(|scope| {
        // The calling thread is a worker too.
        for _ in 1..workers.min(count) {
            scope.spawn(run);
        }
        run();
    });
    results
        .into_iter()
        .map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner).expect("every item was worked on"))
        .collect()
}

/// Returns the number of processors of the machine.
pub fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Returns the number of workers that a node's parameter asks for. 0 or less means one per processor.
pub fn asked_for(parameter: i64) -> usize {
    match usize::try_from(parameter) {
        Ok(0) | Err(_) => available(),
        Ok(n) => n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_or_less_asks_for_all_processors() {
        assert_eq!([-1, 0, 3].map(asked_for), [available(), available(), 3]);
    }

    #[test]
    fn results_come_in_order_with_any_number_of_workers() {
        for workers in [1, 2, 8] {
            let squares = map((0..100).collect(), workers, |i, v: usize| i * v);
            assert!(squares.iter().enumerate().all(|(i, s)| *s == i * i));
        }
    }
}
