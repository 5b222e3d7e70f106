//! Stream of records by stamp. It notices a recording that runs through the same times again: after a clock was set back, or
//! where recordings were joined whose clocks begin at 0. Records of both passes then lie among one another, and no stamp shows
//! which belong together.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::{Deref, DerefMut, RangeInclusive};

/// Step of the stamps in ns that begins another pass. Messages of one publisher overtake each other by less, and so do those of a
/// slow second publisher of a topic.
const PASS_NS: u64 = 1_000_000_000;

/// Records by stamp in ns.
#[derive(Debug, Clone)]
pub(super) struct Stream<T> {
    records: BTreeMap<i64, T>,
    /// Passes of a recording through time; none if they are not watched.
    passes: Option<Passes>,
}

/// Passes through time, in order of arrival.
#[derive(Debug, Clone, Default)]
struct Passes {
    /// First and last stamp of the present pass.
    present: Option<[i64; 2]>,
    /// Ends of the times of earlier passes, by their beginnings; they are apart from one another.
    earlier: BTreeMap<i64, i64>,
    /// Stamps of records within the time of an earlier pass, which that pass does not have.
    mixed: BTreeSet<i64>,
    /// True if a record lay within the time of an earlier pass.
    repeats: bool,
}

impl Passes {
    /// Takes the stamp of a record. Returns true if it lies within the time of an earlier pass.
    fn take(&mut self, stamp_ns: i64) -> bool {
        self.present = Some(match self.present {
            Some([first, last]) if stamp_ns.abs_diff(last) > PASS_NS => {
                self.end_pass([first, last]);
                [stamp_ns; 2]
            }
            Some([first, last]) => [first.min(stamp_ns), last.max(stamp_ns)],
            None => [stamp_ns; 2],
        });
        let earlier = self.earlier.range(..=stamp_ns).next_back();
        let is_again = earlier.is_some_and(|(_, last)| stamp_ns <= *last);
        self.repeats |= is_again;
        is_again
    }

    /// Adds the time of a pass to that of the earlier ones.
    fn end_pass(&mut self, [mut first, mut last]: [i64; 2]) {
        while let Some((begin, end)) = self.earlier.range(..=last).next_back().map(|(begin, end)| (*begin, *end)) {
            if end < first {
                break;
            }
            self.earlier.remove(&begin);
            (first, last) = (first.min(begin), last.max(end));
        }
        self.earlier.insert(first, last);
    }
}

impl<T: PartialEq> Stream<T> {
    /// Watches for passes through the same times from now on.
    pub(super) fn watch_passes(&mut self) {
        self.passes.get_or_insert_default();
    }

    /// Inserts a record; one with the same stamp is replaced. `in_order` is false for a record whose place among the others is unknown: it
    /// belongs to no pass.
    pub(super) fn insert(&mut self, stamp_ns: i64, record: T, in_order: bool) {
        // The very record that the stream has mixes nothing, as after a replay in a loop.
        if let Some(passes) = self.passes.as_mut().filter(|_| in_order)
            && passes.take(stamp_ns)
            && self.records.get(&stamp_ns) != Some(&record)
        {
            passes.mixed.insert(stamp_ns);
        }
        self.records.insert(stamp_ns, record);
    }

    /// Passes over a record that is not kept. It belongs to a pass all the same.
    pub(super) fn pass_over(&mut self, stamp_ns: i64, in_order: bool) {
        if let Some(passes) = self.passes.as_mut().filter(|_| in_order) {
            passes.take(stamp_ns);
        }
    }

    /// Begins another reading of the same recording. Returns true if a record of the last one lay within the time of an earlier pass.
    pub(super) fn read_again(&mut self) -> bool {
        self.passes.as_mut().is_some_and(|passes| std::mem::take(passes).repeats)
    }

    /// Share of the records in a range of stamps that belong to another pass than the rest may do.
    pub(super) fn mixed_share(&self, range_ns: RangeInclusive<i64>) -> f64 {
        let mixed = self.passes.as_ref().map_or(0, |passes| passes.mixed.range(range_ns.clone()).count());
        match self.records.range(range_ns).count() {
            0 => 0.0,
            all => mixed as f64 / all as f64,
        }
    }
}

// Derived, it would ask for a default of the records.
impl<T> Default for Stream<T> {
    fn default() -> Self {
        Self { records: BTreeMap::new(), passes: None }
    }
}

impl<T> Deref for Stream<T> {
    type Target = BTreeMap<i64, T>;

    fn deref(&self) -> &Self::Target {
        &self.records
    }
}

impl<T> DerefMut for Stream<T> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.records
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    /// Stream of records that arrive in this order, as stamp in tenths of a second and value.
    fn stream(records: impl IntoIterator<Item = (i64, i64)>) -> Stream<i64> {
        let mut stream = Stream::default();
        stream.watch_passes();
        records.into_iter().for_each(|(tenths, value)| stream.insert(tenths * SECOND / 10, value, true));
        stream
    }

    fn share(stream: &Stream<i64>, from_s: i64, to_s: i64) -> f64 {
        stream.mixed_share(from_s * SECOND..=to_s * SECOND)
    }

    #[test]
    fn records_of_two_passes_through_a_time_are_mixed() {
        let again = stream((0..100).map(|t| (t, t)).chain((50..150).map(|t| (t, -t))));
        assert_eq!((share(&again, 0, 4), share(&again, 5, 9), share(&again, 11, 14)), (0.0, 1.0, 0.0));
        // The second pass has stamps of its own: its records are half of those in the range.
        let between = stream((0..100).map(|t| (2 * t, t)).chain((0..100).map(|t| (2 * t + 1, t))));
        assert!((share(&between, 0, 19) - 0.5).abs() < 0.01);
    }

    #[test]
    fn a_loop_a_late_message_and_a_time_between_earlier_ones_mix_nothing() {
        let pass = || (0..100).map(|t| (t, t));
        assert_eq!(share(&stream(pass().chain(pass()).chain(pass())), 0, 9), 0.0);
        let swapped = stream((0..100).map(|t| (if t % 2 == 0 { t + 5 } else { t - 4 }, t)));
        assert_eq!(share(&swapped, 0, 12), 0.0);
        let back = stream(pass().chain((1000..1100).map(|t| (t, t))).chain((500..600).map(|t| (t, t))));
        assert_eq!(share(&back, 0, 200), 0.0);
        // A live log takes whatever comes last.
        let mut unwatched = Stream::default();
        pass().chain((0..100).map(|t| (t, -t))).for_each(|(t, value)| unwatched.insert(t * SECOND / 10, value, true));
        assert_eq!(share(&unwatched, 0, 9), 0.0);
    }
}
